//! Lines that the log of `cargo test` shows of tests that pass, too.

use std::io::Write as _;

/// Writes one line to the process's own standard error, which the test harness does not capture.
pub fn aloud(line: &str) {
    // A log that is closed hides the line, and fails no test.
    let _ = std::io::stderr().lock().write_all(format!("{line}\n").as_bytes());
}
