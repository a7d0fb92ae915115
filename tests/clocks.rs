//! A run does not care what wall clocks say, nor when somebody sets them.
#![allow(clippy::print_stdout, reason = "a test that is skipped says so")]

#[path = "shared/room.rs"]
mod room;

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;

use room::{Node, cameras, cluster_file, coordinator, figures, program};

const SECONDS: &str = "5";

/// The library that lies to programs about the wall clock, if it is installed.
fn faketime() -> Option<PathBuf> {
    let folders = fs::read_dir("/usr/lib").ok()?.flatten().map(|entry| entry.path().join("faketime"));
    let found = folders.map(|folder| folder.join("libfaketimeMT.so.1")).find(|library| library.exists());
    if found.is_none() {
        println!("skipped: libfaketime is not installed (Debian: faketime)");
    }
    found
}

/// A wall clock of its own, in a file that says how far it is off.
struct WallClock(PathBuf);

impl WallClock {
    fn new(folder: &Path, name: &str, off: &str) -> WallClock {
        let clock = WallClock(folder.join(format!("{name}.clock")));
        clock.set(off);
        clock
    }

    /// Sets it at once: a file that is half written would be another time.
    fn set(&self, off: &str) {
        let beside = self.0.with_extension("new");
        fs::write(&beside, format!("{off}\n")).expect("written");
        fs::rename(beside, &self.0).expect("renamed");
    }

    /// The program, as it runs by this clock.
    fn program(&self, library: &Path) -> Command {
        let mut command = program();
        command.env("LD_PRELOAD", library).env("FAKETIME_TIMESTAMP_FILE", &self.0);
        command.envs([("FAKETIME_NO_CACHE", "1"), ("FAKETIME_DONT_FAKE_MONOTONIC", "1")]);
        command
    }
}

#[test]
fn wall_clocks_that_are_off_and_are_set_in_mid_run_change_nothing() {
    let Some(library) = faketime() else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let (cluster, json) = (cluster_file(folder.path(), 4), folder.path().join("out.json"));
    let offs = ["-86400", "-0.2", "+0.2", "+3600"];
    let clocks: Vec<WallClock> =
        (0..4).map(|at| WallClock::new(folder.path(), &at.to_string(), offs[at])).collect();
    let node = |at: usize| Node::start(clocks[at].program(&library), &cluster, &cameras(at));
    let nodes: Vec<Node> = (0..4).map(node).collect();
    let ours = WallClock::new(folder.path(), "coordinator", "+0");
    let live = coordinator(ours.program(&library), &cluster, SECONDS, &json).spawn().expect("starts");
    let steps = [(&ours, "-30"), (&clocks[1], "+3"), (&ours, "+5"), (&clocks[1], "-3"), (&clocks[3], "+0")];
    for (clock, off) in steps {
        std::thread::sleep(Duration::from_millis(900));
        clock.set(off);
    }
    let live = figures(live, &json);
    let missed = &live["missed"];
    assert_eq!((&missed["frames"], &missed["blind_steps"]), (&0.into(), &0.into()), "{live}");
    assert_eq!(missed["late_steps"], 0, "{live}");
    let again = coordinator(program(), &cluster, SECONDS, &json).arg("--unpaced").spawn().expect("starts");
    let lock_step = figures(again, &json);
    assert!(lock_step["contacts"].as_u64().is_some_and(|contacts| contacts > 20), "{lock_step}");
    assert_eq!(live["trajectory_digest"], lock_step["trajectory_digest"]);
    drop(nodes);
}
