//! What processes used, as the system counted it.

use std::fs;

use rustix::time::{ClockId, clock_gettime};

/// Processor time of a process since it began, seconds, over the threads that it has now; `None` where the
/// system does not tell.
pub fn process_cpu_s(process: u32) -> Option<f64> {
    let threads = fs::read_dir(format!("/proc/{process}/task")).ok()?;
    let mut total_s = 0.0;
    for thread in threads.flatten() {
        // A thread may have ended since it was listed.
        let Ok(told) = fs::read_to_string(thread.path().join("schedstat")) else { continue };
        let ns: f64 = told.split_whitespace().next()?.parse().ok()?;
        total_s += ns * 1e-9;
    }
    Some(total_s)
}

/// Memory of a process that is in use now, and the most that ever was, MB (10⁶ bytes).
pub fn process_memory_mb(process: u32) -> Option<(f64, f64)> {
    let told = fs::read_to_string(format!("/proc/{process}/status")).ok()?;
    let mb = |key: &str| -> Option<f64> {
        let line = told.lines().find_map(|line| line.strip_prefix(key))?;
        let kib: f64 = line.split_whitespace().next()?.parse().ok()?;
        Some(kib * 1024.0 / 1e6)
    };
    Some((mb("VmRSS:")?, mb("VmHWM:")?))
}

/// The system's numbers of this process's threads of a name.
pub fn threads_named(name: &str) -> Vec<u32> {
    let threads = fs::read_dir("/proc/self/task").into_iter().flatten().flatten();
    let is_named = |thread: &fs::DirEntry| {
        fs::read_to_string(thread.path().join("comm")).is_ok_and(|found| found.trim_end() == name)
    };
    let named = threads.filter(is_named);
    named.filter_map(|thread| thread.file_name().to_str()?.parse().ok()).collect()
}

/// Processor time of a thread of this process, seconds; none where the system does not tell.
pub fn thread_s(thread: u32) -> f64 {
    let told = fs::read_to_string(format!("/proc/self/task/{thread}/schedstat")).unwrap_or_default();
    let ns: Option<f64> = told.split_whitespace().next().and_then(|ns| ns.parse().ok());
    ns.unwrap_or(0.0) * 1e-9
}

/// Processor time of this thread, seconds.
pub fn thread_cpu_s() -> f64 {
    clock_s(ClockId::ThreadCPUTime)
}

/// Processor time of this process, of threads that have ended too, seconds.
pub fn this_process_cpu_s() -> f64 {
    clock_s(ClockId::ProcessCPUTime)
}

fn clock_s(clock: ClockId) -> f64 {
    let time = clock_gettime(clock);
    time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    #[cfg(target_os = "linux")]
    fn threads_are_found_by_their_names() {
        let (end, ended) = std::sync::mpsc::channel::<()>();
        let thread = std::thread::Builder::new().name("of a name".to_owned());
        let waiting = thread.spawn(move || ended.recv()).expect("a thread");
        while threads_named("of a name").is_empty() {
            std::thread::yield_now();
        }
        assert!(thread_s(threads_named("of a name")[0]) < 10.0 && threads_named("of none").is_empty());
        drop(end);
        assert!(waiting.join().is_ok());
    }

    #[test]
    #[cfg(target_os = "linux")]
    fn this_process_uses_memory_and_time() {
        let (now_mb, most_mb) = process_memory_mb(std::process::id()).expect("told");
        assert!(now_mb > 1.0 && most_mb >= now_mb);
        let began_s = thread_cpu_s();
        let mut sum = 0u64;
        while thread_cpu_s() - began_s < 0.02 {
            sum = std::hint::black_box(sum + 1);
        }
        assert!(process_cpu_s(std::process::id()).expect("told") > 0.01);
    }
}
