//! No process is left of a test process that panics, is killed, or is interrupted.

use std::io::{BufRead as _, BufReader};
use std::os::unix::process::CommandExt as _;
use std::process::{Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use testkit::{Running, command, mark};

/// Says to this program's second process how its test ends: "panic", or "wait" for a signal.
const END: &str = "HULLTOUCH_SWEEP_END";
/// Marks all processes of one try.
const TRY: &str = "HULLTOUCH_SWEEP_TRY";
/// Longer than any wait that succeeds.
const SOON: Duration = Duration::from_secs(60);

/// The test of the second process: starts what never ends by itself. Without `END` it has nothing to do.
#[test]
#[expect(clippy::zombie_processes, reason = "this is about processes that a test does not wait for")]
fn processes_that_never_end() {
    let Ok(end) = std::env::var(END) else { return };
    // A child with a child of its own, one that is its own group, and one that ignores what asks it to end.
    let family = Running::start(command("sh").args(["-c", "sleep 1000 & sleep 1000"]));
    let _alone = command("sleep").arg("1000").process_group(0).spawn().expect("starts");
    let _deaf =
        command("sh").args(["-c", "trap '' HUP INT TERM; sleep 1000 & wait"]).spawn().expect("starts");
    let (name, value) = mark();
    // As code under test starts programs.
    let mut inner = Command::new("env");
    let _inner = inner.arg(format!("{name}={value}")).args(["sleep", "1000"]).spawn().expect("starts");
    assert!(end == "wait", "as it was told");
    thread::sleep(Duration::from_secs(1000));
    drop(family);
}

/// Starts this program again with that test alone; its processes carry the mark of this try.
fn start(attempt: &str, end: &str) -> Running {
    let mut again = command(std::env::current_exe().expect("a program"));
    again.args(["--exact", "processes_that_never_end", "--nocapture"]).env(END, end).env(TRY, attempt);
    again.process_group(0).stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::null());
    Running::start(&mut again)
}

/// The processes of a try.
fn processes(attempt: &str) -> Vec<String> {
    let mark = format!("{TRY}={attempt}");
    let entries = std::fs::read_dir("/proc").expect("Linux").flatten();
    let has_mark =
        |environment: Vec<u8>| environment.split(|byte| *byte == 0).any(|one| one == mark.as_bytes());
    let paths = entries.map(|entry| entry.path());
    let found = paths.filter(|path| std::fs::read(path.join("environ")).is_ok_and(has_mark));
    found.map(|path| std::fs::read_to_string(path.join("cmdline")).unwrap_or_default()).collect()
}

#[track_caller]
fn await_none(attempt: &str) {
    let deadline = Instant::now() + SOON;
    loop {
        let left = processes(attempt);
        if left.is_empty() {
            return;
        }
        assert!(Instant::now() < deadline, "{attempt}: these are left: {left:#?}");
        thread::sleep(Duration::from_millis(50));
    }
}

/// Sends the signal of Ctrl-C to a whole process group.
fn interrupt(group: u32) {
    let status = Command::new("sh").args(["-c", "kill -s INT -- -$0", &group.to_string()]).status();
    assert!(status.is_ok_and(|status| status.success()), "group {group}");
}

/// A mark of this process's tries alone.
fn attempt(number: u32) -> String {
    format!("{}-{number}", std::process::id())
}

#[test]
fn nothing_is_left_of_a_test_that_panics() {
    let attempt = attempt(0);
    // Not for the end of its output: what is left would hold it open.
    let status = start(&attempt, "panic").child().wait().expect("ends");
    assert_eq!(status.code(), Some(101));
    await_none(&attempt);
}

#[test]
fn nothing_is_left_of_a_test_process_that_is_killed_at_any_moment() {
    for number in 1..=8 {
        let running = start(&attempt(number), "wait");
        // From before its first process has started to after the last one.
        thread::sleep(Duration::from_millis(u64::from(number * number)));
        drop(running);
    }
    (1..=8).for_each(|number| await_none(&attempt(number)));
}

#[test]
fn nothing_is_left_of_a_test_that_is_interrupted_with_its_whole_group() {
    let attempt = attempt(9);
    let mut running = start(&attempt, "wait");
    let stdout = BufReader::new(running.child().stdout.take().expect("piped"));
    assert!(stdout.lines().map_while(Result::ok).any(|line| line.starts_with("running 1 test")));
    let deadline = Instant::now() + SOON;
    // The harness, the sweeper with its `cat`, and what the test has started.
    while processes(&attempt).len() < 9 {
        assert!(Instant::now() < deadline, "{:#?}", processes(&attempt));
        thread::sleep(Duration::from_millis(20));
    }
    interrupt(running.id());
    assert!(!running.child().wait().expect("ends").success());
    await_none(&attempt);
}
