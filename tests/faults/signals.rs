//! A run that is asked to end leaves nothing behind, whichever signal asks.

use std::io::{BufRead as _, BufReader};
use std::path::Path;
use std::process::{ExitStatus, Stdio};

use rustix::process::{Pid, Signal, kill_process};
use testkit::Running;

/// Starts a live demo whose temporary files go to `folder`, and waits until it serves.
fn demo(folder: &Path) -> Running {
    let mut command = testkit::command(env!("CARGO_BIN_EXE_hulltouch"));
    command
        .args(["demo", "--cameras", "2", "--size", "160x120", "--seconds", "600", "--headless"])
        .args(["--listen", "127.0.0.1:0"])
        .env("TMPDIR", folder)
        .stdout(Stdio::null())
        .stderr(Stdio::piped());
    let mut running = Running::start(&mut command);
    let stderr = BufReader::new(running.child().stderr.take().expect("piped"));
    let mut lines = stderr.lines().map_while(Result::ok);
    assert!(lines.any(|line| line.starts_with("page: ")), "it serves a page");
    // What else it writes must not fill the pipe.
    std::thread::spawn(move || lines.for_each(drop));
    running
}

/// Starts a sample of more film than is written before a signal comes, and waits until it is written beside `room`.
fn sample(folder: &Path) -> Running {
    let mut command = testkit::command(env!("CARGO_BIN_EXE_hulltouch"));
    command.arg("sample").arg(folder.join("room")).args(["--size", "320x240", "--seconds", "600"]);
    let mut running = Running::start(command.stdout(Stdio::piped()).stderr(Stdio::null()));
    let mut line = String::new();
    let stdout = running.child().stdout.take().expect("piped");
    BufReader::new(stdout).read_line(&mut line).expect("it says how much it writes");
    assert!(line.ends_with(" bytes\n"), "{line}");
    running
}

fn ended_by(signal: Signal, folder: &Path) -> ExitStatus {
    let mut demo = demo(folder);
    assert!(std::fs::read_dir(folder).expect("listed").count() > 0, "the studio is in a temporary folder");
    let process = Pid::from_raw(demo.id().cast_signed()).expect("a number");
    kill_process(process, signal).expect("sent");
    demo.child().wait().expect("ends")
}

#[test]
fn every_signal_that_ends_a_run_leaves_no_temporary_folder() {
    for signal in [Signal::INT, Signal::TERM, Signal::HUP, Signal::QUIT] {
        let folder = tempfile::tempdir().expect("folder");
        let status = ended_by(signal, folder.path());
        assert!(status.code().is_some(), "{signal:?} killed it");
        let left: Vec<_> = std::fs::read_dir(folder.path()).expect("listed").flatten().collect();
        assert!(left.is_empty(), "{signal:?} left {left:?}");
    }
}

#[test]
fn a_sample_that_is_interrupted_leaves_nothing() {
    let folder = tempfile::tempdir().expect("folder");
    let mut sample = sample(folder.path());
    let entries = || std::fs::read_dir(folder.path()).expect("listed").flatten().collect::<Vec<_>>();
    assert_eq!(entries().len(), 1, "a temporary folder");
    let process = Pid::from_raw(sample.id().cast_signed()).expect("a number");
    kill_process(process, Signal::INT).expect("sent");
    assert_eq!(sample.child().wait().expect("ends").code(), Some(1));
    assert!(entries().is_empty(), "{:?}", entries());
}
