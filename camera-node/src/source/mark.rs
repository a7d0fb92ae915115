//! The mark of a camera program: a variable of its environment, which all that it starts inherits, in whatever process group or
//! session. A program that clears its environment loses it.

use std::fs::{self, File};
use std::io::Read as _;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use rustix::process::{Pid, PidfdFlags, Signal, pidfd_open, pidfd_send_signal};

/// The variable.
pub const VARIABLE: &str = "HULLTOUCH_CAMERA_PROGRAM";
/// So many bytes of an environment are looked at.
const MAX_ENVIRONMENT_BYTES: u64 = 256 * 1024;
/// Looks until nothing is found, and so often at most: a process may start others meanwhile.
const MAX_LOOKS: usize = 50;
const LOOK_EVERY: Duration = Duration::from_millis(2);

/// The mark of one program.
#[derive(Debug)]
pub struct Mark(String);

impl Mark {
    /// One that no other program has, of this process or of another.
    pub fn new() -> Mark {
        static MADE: AtomicU64 = AtomicU64::new(0);
        let made = MADE.fetch_add(1, Ordering::Relaxed);
        Mark(format!("{}-{made}-{:.0}", std::process::id(), 1e9 * film_time::monotonic_s()))
    }

    /// The variable's value.
    pub fn value(&self) -> &str {
        &self.0
    }

    /// Kills every process that has it.
    pub fn kill_all(&self) {
        let sought = format!("{VARIABLE}={}", self.0);
        for _ in 0..MAX_LOOKS {
            let processes = fs::read_dir("/proc").into_iter().flatten().flatten();
            let ids = processes.filter_map(|entry| entry.file_name().to_str()?.parse().ok());
            if ids.filter(|&id| kill_if_marked(id, sought.as_bytes())).count() == 0 {
                return;
            }
            std::thread::sleep(LOOK_EVERY);
        }
    }
}

/// Whether a process has this in its environment; it is killed then.
fn kill_if_marked(id: i32, sought: &[u8]) -> bool {
    // The number may become another process's, the descriptor does not.
    let Some(process) = Pid::from_raw(id).and_then(|id| pidfd_open(id, PidfdFlags::empty()).ok()) else {
        return false;
    };
    let mut environment = Vec::new();
    // Empty once it has ended.
    let read = File::open(format!("/proc/{id}/environ"))
        .and_then(|file| file.take(MAX_ENVIRONMENT_BYTES).read_to_end(&mut environment));
    read.is_ok()
        && environment.split(|&byte| byte == 0).any(|variable| variable == sought)
        && pidfd_send_signal(process, Signal::KILL).is_ok()
}
