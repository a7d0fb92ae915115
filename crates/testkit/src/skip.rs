//! A test, or a part of it, that this machine cannot run.

use std::fmt::Display;
use std::io::{self, Write as _};
use std::panic::Location;
use std::process::{Command, Stdio};
use std::thread;

/// Reports in one line that the running test is skipped, or a part of it, and why. The line is visible without
/// `--nocapture`: the test harness captures the print macros and not the stream itself.
#[track_caller]
pub fn skip(reason: impl Display) {
    // The harness names each test's thread. With one thread it runs tests on the main one.
    let place = Location::caller();
    let line = match thread::current().name() {
        Some(name) if name != "main" => format!("skipped: {name}: {reason}"),
        _ => format!("skipped: {}:{}: {reason}", place.file(), place.line()),
    };
    write_line(&line);
}

/// Writes a line where the log of `cargo test` shows it, also of a test that passes.
pub(crate) fn write_line(line: &str) {
    // One write, so that lines of parallel tests do not mix. A closed stream is no reason to fail.
    let _ = io::stderr().write_all(format!("{line}\n").as_bytes());
}

/// Whether a program is installed; reports the test as skipped if not, with the Debian package to install.
#[track_caller]
pub fn has_program(program: &str, package: &str) -> bool {
    // Some refuse this argument; they are there too.
    let mut command = Command::new(program);
    command.arg("--version").stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    let error = match command.status() {
        Ok(_) => return true,
        Err(error) => error,
    };
    skip(format_args!("{program} cannot be run: {error} (Debian package {package})"));
    false
}
