//! A run does not care what wall clocks say, nor when somebody sets them.
#![allow(clippy::print_stdout, reason = "a test that is skipped says so")]

use std::fs;
use std::io::{BufRead as _, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use serde_json::Value;

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
        let mut command = Command::new(env!("CARGO_BIN_EXE_hulltouch"));
        command.env("LD_PRELOAD", library).env("FAKETIME_TIMESTAMP_FILE", &self.0);
        command.envs([("FAKETIME_NO_CACHE", "1"), ("FAKETIME_DONT_FAKE_MONOTONIC", "1")]);
        command
    }
}

/// A node that ends with its test.
struct Node(Child);

impl Node {
    fn start(mut command: Command, cluster: &Path, cameras: &[&str]) -> Node {
        command.arg("node").arg(cluster).arg("--stop-with-stdin");
        for camera in cameras {
            command.args(["--camera", camera]);
        }
        let mut child = command.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().expect("starts");
        let mut line = String::new();
        let stdout = child.stdout.take().expect("piped");
        BufReader::new(stdout).read_line(&mut line).expect("it says that it listens");
        Node(child)
    }
}

impl Drop for Node {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Four nodes of two cameras each, filming ten frames a second: a busy machine must not miss one.
fn cluster_file(folder: &Path) -> PathBuf {
    let rig = stage::studio_rig(8, (96, 72)).expect("a rig");
    fs::write(folder.join("rig.toml"), rig.to_toml()).expect("written");
    let mut text = "rig = \"rig.toml\"\nscene = \"topple\"\nfps = 10\nlatency_s = 0.4\n".to_owned();
    for (at, camera) in rig.cameras().iter().enumerate() {
        let (name, node) = (camera.name(), format!("unix:{}.sock", at / 2));
        text += &format!(
            "[[camera]]\nname = {name:?}\nnode = {node:?}\nsource = {{ kind = \"stage\", motion = \"sweep\" }}\n"
        );
    }
    let file = folder.join("room.cluster.toml");
    fs::write(&file, text).expect("written");
    file
}

fn coordinator(mut program: Command, cluster: &Path, json: &Path) -> Command {
    program.arg("coordinator").arg(cluster).args(["--seconds", SECONDS, "--json"]).arg(json);
    program.stdout(Stdio::null()).stderr(Stdio::piped());
    program
}

fn figures(child: Child, json: &Path) -> Value {
    let output = child.wait_with_output().expect("ends");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&fs::read(json).expect("figures")).expect("JSON")
}

#[test]
fn wall_clocks_that_are_off_and_are_set_in_mid_run_change_nothing() {
    let Some(library) = faketime() else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let (cluster, json) = (cluster_file(folder.path()), folder.path().join("out.json"));
    let offs = ["-86400", "-0.2", "+0.2", "+3600"];
    let clocks: Vec<WallClock> =
        (0..4).map(|at| WallClock::new(folder.path(), &at.to_string(), offs[at])).collect();
    let nodes: Vec<Node> = (0..4)
        .map(|at| {
            let cameras = [2 * at, 2 * at + 1].map(|camera| format!("cam_{camera}"));
            Node::start(clocks[at].program(&library), &cluster, &cameras.each_ref().map(String::as_str))
        })
        .collect();
    let ours = WallClock::new(folder.path(), "coordinator", "+0");
    let live = coordinator(ours.program(&library), &cluster, &json).spawn().expect("starts");
    let steps = [(&ours, "-30"), (&clocks[1], "+3"), (&ours, "+5"), (&clocks[1], "-3"), (&clocks[3], "+0")];
    for (clock, off) in steps {
        std::thread::sleep(Duration::from_millis(900));
        clock.set(off);
    }
    let live = figures(live, &json);
    let missed = &live["missed"];
    assert_eq!((&missed["frames"], &missed["blind_steps"]), (&0.into(), &0.into()), "{live}");
    assert_eq!(missed["late_steps"], 0, "{live}");
    let again = coordinator(Command::new(env!("CARGO_BIN_EXE_hulltouch")), &cluster, &json)
        .arg("--unpaced")
        .spawn()
        .expect("starts");
    let lock_step = figures(again, &json);
    assert!(lock_step["contacts"].as_u64().is_some_and(|contacts| contacts > 20), "{lock_step}");
    assert_eq!(live["trajectory_digest"], lock_step["trajectory_digest"]);
    drop(nodes);
}
