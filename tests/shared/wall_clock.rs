//! Wall clocks that lie, one a process.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

/// The library that lies to programs about the wall clock, if it is installed.
pub fn faketime() -> Option<PathBuf> {
    let folders = fs::read_dir("/usr/lib").ok()?.flatten().map(|entry| entry.path().join("faketime"));
    let found = folders.map(|folder| folder.join("libfaketimeMT.so.1")).find(|library| library.exists());
    if found.is_none() {
        testkit::skip("wall clocks that are off: libfaketime is not installed (Debian package faketime)");
    }
    found
}

/// A wall clock of its own, in a file that says how far it is off.
pub struct WallClock(PathBuf);

impl WallClock {
    /// One that is off by so many seconds: "+0.2".
    pub fn new(folder: &Path, name: &str, off: &str) -> WallClock {
        let clock = WallClock(folder.join(format!("{name}.clock")));
        clock.set(off);
        clock
    }

    /// Sets it at once: a file that is half written would be another time.
    pub fn set(&self, off: &str) {
        let beside = self.0.with_extension("new");
        fs::write(&beside, format!("{off}\n")).expect("written");
        fs::rename(beside, &self.0).expect("renamed");
    }

    /// The program, as it runs by this clock.
    pub fn lies_to(&self, mut command: Command, library: &Path) -> Command {
        command.env("LD_PRELOAD", library).env("FAKETIME_TIMESTAMP_FILE", &self.0);
        command.envs([("FAKETIME_NO_CACHE", "1"), ("FAKETIME_DONT_FAKE_MONOTONIC", "1")]);
        command
    }
}
