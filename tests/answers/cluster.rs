//! The whole program on this machine: equal runs over all transports, and what happens when nodes or
//! the program itself are killed.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;
use testkit::{Running, Watch, ran_out_of_time, timely};

fn hulltouch() -> Command {
    testkit::command(env!("CARGO_BIN_EXE_hulltouch"))
}

/// A short lock-step run of a small studio; returns its figures.
fn lock_step(folder: &Path, transport: &str, seed: &str) -> Value {
    lock_step_with(folder, transport, seed, &[])
}

fn lock_step_with(folder: &Path, transport: &str, seed: &str, more: &[&str]) -> Value {
    let json = folder.join(format!("{transport}-{seed}.json"));
    let output = hulltouch()
        .args(["demo", "--cameras", "4", "--size", "320x240", "--seconds", "4", "--unpaced", "--headless"])
        .args(["--transport", transport, "--seed", seed])
        .args(more)
        .arg("--json")
        .arg(&json)
        .output()
        .expect("runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_str(&std::fs::read_to_string(json).expect("written")).expect("JSON")
}

#[test]
fn one_seed_is_one_run_over_every_transport() {
    let folder = tempfile::tempdir().expect("folder");
    let runs = ["inprocess", "gather", "cluster", "cluster"].map(|t| lock_step(folder.path(), t, "1"));
    for run in &runs {
        assert_eq!(run["trajectory_digest"], runs[0]["trajectory_digest"], "{}", run["transport"]);
        assert_eq!(run["inside_samples"], runs[0]["inside_samples"]);
        assert_eq!((&run["frames"], &run["missed"]["frames"]), (&Value::from(121), &Value::from(0)));
    }
    assert!(runs[0]["inside_samples"].as_u64().expect("a number") > 50, "bodies meet the person");
    assert_eq!(runs[2]["bytes"]["silhouettes"], 0, "no silhouette crosses the network in a cluster");
    assert!(runs[1]["bytes"]["silhouettes"].as_u64().expect("a number") > 10_000);
    let rounded = lock_step_with(folder.path(), "cluster", "1", &["--precision", "quantised"]);
    let samples = |run: &Value| run["inside_samples"].as_f64().expect("a number");
    assert!((samples(&rounded) / samples(&runs[0]) - 1.0).abs() < 0.2, "rounded numbers, about the same run");
    let bytes = |run: &Value| {
        ["to_nodes", "from_nodes"]
            .map(|way| run["bytes"][way].as_u64().expect("a number"))
            .iter()
            .sum::<u64>()
    };
    assert!(bytes(&rounded) < bytes(&runs[2]), "{} of {} bytes", bytes(&rounded), bytes(&runs[2]));
    let other = lock_step(folder.path(), "inprocess", "2");
    assert_ne!(other["trajectory_digest"], runs[0]["trajectory_digest"], "another seed, another run");
}

#[test]
fn bodies_under_contacts_are_one_run_over_every_transport_and_when_it_is_made_again() {
    let folder = tempfile::tempdir().expect("folder");
    let run = |transport, hull_time, more: &[&str]| {
        let contacts = ["--response", "contacts", "--scene", "lift", "--hull-time", hull_time];
        lock_step_with(folder.path(), transport, "1", &[&contacts, more].concat())
    };
    let digests = ["newest", "between"].map(|hull_time| {
        let runs = ["inprocess", "gather", "cluster"].map(|transport| run(transport, hull_time, &[]));
        for run in &runs {
            assert_eq!(run["trajectory_digest"], runs[0]["trajectory_digest"], "{}", run["transport"]);
            assert_eq!((&run["response"], &run["hull_time"]), (&"contacts".into(), &hull_time.into()));
        }
        let middle = &runs[0]["bodies"][1];
        assert!(
            middle["end"][1].as_f64().expect("a height") > 1.5,
            "{middle} rides on the lid that is lifted"
        );
        // Rounded answers cannot be asked for again: their contacts are in the file.
        for precision in ["exact", "quantised"] {
            let file = folder.path().join(format!("{hull_time}_{precision}.mcap"));
            let file = file.to_str().expect("text");
            run("cluster", hull_time, &["--precision", precision, "--record", file]);
            let replay =
                hulltouch().args(["replay", file, "--unpaced", "--headless"]).output().expect("runs");
            assert!(replay.status.success(), "{}", String::from_utf8_lossy(&replay.stdout));
        }
        runs[0]["trajectory_digest"].clone()
    });
    assert_ne!(digests[0], digests[1], "the hull is of another moment");
}

/// A run of three cameras whose films have these lengths, in frames; returns its figures.
fn uneven_films(folder: &Path, frames: [u64; 3], arguments: &[&str]) -> Value {
    let rig = stage::studio_rig(3, (160, 120)).expect("a rig");
    std::fs::write(folder.join("rig.toml"), rig.to_toml()).expect("written");
    let mut text = "rig = \"rig.toml\"\nscene = \"topple\"\nfps = 30\nhold_s = 2.0\n".to_owned();
    for (camera, frames) in rig.cameras().iter().zip(frames) {
        let name = camera.name();
        text += &format!(
            "[[camera]]\nname = {name:?}\nsource = {{ kind = \"stage\", motion = \"sweep\", frames = {frames} }}\n"
        );
    }
    let (cluster, json) = (folder.join("uneven.cluster.toml"), folder.join("uneven.json"));
    std::fs::write(&cluster, text).expect("written");
    let output = hulltouch()
        .args(["demo", "--headless", "--recording"])
        .arg(&cluster)
        .args(arguments)
        .arg("--json")
        .arg(&json)
        .output()
        .expect("runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_str(&std::fs::read_to_string(json).expect("written")).expect("JSON")
}

#[test]
fn films_of_unequal_length_end_with_the_shortest_and_are_held_over_every_transport() {
    let folder = tempfile::tempdir().expect("folder");
    let run =
        |transport| uneven_films(folder.path(), [240, 45, 240], &["--unpaced", "--transport", transport]);
    let runs = ["inprocess", "gather", "cluster", "cluster"].map(run);
    for run in &runs {
        // Film of 1.5 s, held for 2 s more, at 120 steps a second.
        assert_eq!(run["steps"], 420, "{}", run["transport"]);
        assert_eq!(run["trajectory_digest"], runs[0]["trajectory_digest"], "{}", run["transport"]);
        let missed = &run["missed"];
        assert_eq!(
            (&missed["frames_expected"], &missed["frames"], &missed["blind_steps"]),
            (&45.into(), &0.into(), &0.into())
        );
    }
}

/// A live demo in the background.
struct Live {
    running: Running,
    json: PathBuf,
    _folder: tempfile::TempDir,
}

impl Live {
    fn start(seconds: &str) -> Live {
        let folder = tempfile::tempdir().expect("folder");
        let json = folder.path().join("out.json");
        let mut command = hulltouch();
        command.args(["demo", "--cameras", "3", "--size", "160x120", "--headless", "--seconds", seconds]);
        command.arg("--json").arg(&json).stdout(Stdio::null()).stderr(Stdio::piped());
        Live { running: Running::start(&mut command), json, _folder: folder }
    }

    /// Its node processes, once all are there.
    fn nodes(&self) -> Vec<u32> {
        let deadline = Instant::now() + Duration::from_secs(60);
        loop {
            let nodes = children_of(self.running.id());
            if nodes.len() == 3 {
                return nodes;
            }
            assert!(Instant::now() < deadline, "three nodes, found {nodes:?}");
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    /// Waits for its end: figures and what it said. `None` on a machine that is too busy for it.
    fn finish(self, watch: &Watch) -> Option<(Value, String)> {
        let output = self.running.wait_with_output().expect("ends");
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        // It gives up when nodes take too long.
        timely!(watch, output.status.code() != Some(1) || !ran_out_of_time(&said), "{said}");
        assert!(output.status.success(), "{}: {said}", output.status);
        let figures = std::fs::read_to_string(self.json).expect("written");
        Some((serde_json::from_str(&figures).expect("JSON"), said))
    }
}

/// The process ids of a process's children, from `/proc`.
fn children_of(parent: u32) -> Vec<u32> {
    let entries = std::fs::read_dir("/proc").expect("Linux").flatten();
    let ids = entries.filter_map(|entry| entry.file_name().to_str()?.parse::<u32>().ok());
    let is_child = |id: &u32| {
        let status = std::fs::read_to_string(format!("/proc/{id}/status")).unwrap_or_default();
        status.lines().any(|line| line == format!("PPid:\t{parent}"))
    };
    ids.filter(is_child).collect()
}

fn is_running(id: u32) -> bool {
    let status = std::fs::read_to_string(format!("/proc/{id}/status")).unwrap_or_default();
    // A zombie has ended; only its parent has not asked yet.
    !status.is_empty() && !status.contains("State:\tZ")
}

fn send(signal: Signal, id: u32) {
    kill_process(Pid::from_raw(id.cast_signed()).expect("a number"), signal).expect("sent");
}

fn gone_within(ids: &[u32], patience: Duration) -> bool {
    let deadline = Instant::now() + patience;
    while ids.iter().any(|&id| is_running(id)) {
        if Instant::now() > deadline {
            return false;
        }
        std::thread::sleep(Duration::from_millis(20));
    }
    true
}

#[test]
fn a_demo_that_is_killed_leaves_no_process() {
    for how in [Signal::KILL, Signal::TERM] {
        let mut live = Live::start("600");
        let nodes = live.nodes();
        send(how, live.running.id());
        live.running.child().wait().expect("reaped");
        assert!(gone_within(&nodes, Duration::from_secs(60)), "nodes outlive a demo ended by {how:?}");
    }
}

#[test]
fn a_node_that_dies_leaves_a_coordinator_that_steps_on_and_says_so() {
    let watch = Watch::start();
    let live = Live::start("4");
    let nodes = live.nodes();
    std::thread::sleep(Duration::from_secs(2));
    send(Signal::KILL, nodes[0]);
    let Some((figures, said)) = live.finish(&watch) else { return };
    timely!(watch, said.contains("hull unavailable"), "{said}");
    let number = |key: &str| figures["missed"][key].as_u64().expect("a number");
    timely!(watch, number("blind_steps") > 0, "{} frames, missed {}", figures["frames"], figures["missed"]);
    let made = figures["steps"].as_f64().expect("a number") / 120.0;
    let slipped = figures["missed"]["slipped_s"].as_f64().expect("a number");
    timely!(watch, made + slipped > 3.9, "the world went on to the end: {made} s made, {slipped} s slipped");
    assert!(gone_within(&nodes, Duration::from_secs(60)));
}

#[test]
fn a_node_that_stalls_is_missed_and_comes_back() {
    let watch = Watch::start();
    let live = Live::start("7");
    let nodes = live.nodes();
    std::thread::sleep(Duration::from_secs(2));
    send(Signal::STOP, nodes[1]);
    std::thread::sleep(Duration::from_millis(2500));
    send(Signal::CONT, nodes[1]);
    let Some((figures, said)) = live.finish(&watch) else { return };
    timely!(watch, said.contains("hull unavailable"), "{said}");
    let missed = figures["missed"]["frames"].as_u64().expect("a number");
    let used = figures["frames"].as_u64().expect("a number");
    timely!(watch, missed > 30, "frames were missed while it stood still: {}", figures["missed"]);
    timely!(watch, used > 60, "and film was used before and after: {}", figures["missed"]);
}

/// A free port: taken and given back, so that a node can have it twice.
fn free_address() -> String {
    let listener = std::net::TcpListener::bind("127.0.0.1:0").expect("a port");
    listener.local_addr().expect("bound").to_string()
}

/// A node of one camera at the address that the cluster file gives it.
fn start_node(cluster: &Path, camera: &str) -> Running {
    let mut command = hulltouch();
    command.arg("node").arg(cluster).args(["--camera", camera, "--stop-with-stdin"]);
    let mut node = Running::start(command.stdin(Stdio::piped()).stdout(Stdio::piped()));
    let mut line = String::new();
    let stdout = node.child().stdout.take().expect("piped");
    std::io::BufRead::read_line(&mut std::io::BufReader::new(stdout), &mut line).expect("announces");
    assert!(line.starts_with("listening on "), "{line}");
    node
}

#[test]
fn a_node_that_is_started_again_is_taken_back_without_help() {
    let watch = Watch::start();
    let folder = tempfile::tempdir().expect("folder");
    let rig = stage::studio_rig(2, (160, 120)).expect("a rig");
    std::fs::write(folder.path().join("rig.toml"), rig.to_toml()).expect("written");
    let mut text = "rig = \"rig.toml\"\nscene = \"crowd\"\nfps = 30\nlatency_s = 0.05\n".to_owned();
    // One over TCP; the other's socket file outlives the killed process, and is replaced.
    for (camera, address) in rig.cameras().iter().zip([free_address(), "unix:second.sock".to_owned()]) {
        let name = camera.name();
        text +=
            &format!("[[camera]]\nname = {name:?}\nnode = {address:?}\nsource = {{ kind = \"stage\" }}\n");
    }
    let cluster = folder.path().join("cluster.toml");
    std::fs::write(&cluster, text).expect("written");
    let json = folder.path().join("out.json");
    let mut first = start_node(&cluster, "cam_0");
    let second = start_node(&cluster, "cam_1");
    let mut command = hulltouch();
    command.arg("coordinator").arg(&cluster).args(["--seconds", "7", "--json"]).arg(&json);
    command.env("RUST_LOG", "info").stdout(Stdio::null()).stderr(Stdio::piped());
    let coordinator = Running::start(&mut command);
    std::thread::sleep(Duration::from_secs(2));
    drop(second);
    std::thread::sleep(Duration::from_millis(700));
    let mut second = start_node(&cluster, "cam_1");
    let output = coordinator.wait_with_output().expect("ends");
    let said = String::from_utf8_lossy(&output.stderr);
    timely!(watch, output.status.code() != Some(1) || !ran_out_of_time(&said), "{said}");
    assert!(output.status.success(), "{}: {said}", output.status);
    let expected = ["hull unavailable", "hull available again"];
    timely!(watch, expected.iter().all(|line| said.contains(line)), "expected {expected:?}: {said}");
    let figures: Value =
        serde_json::from_str(&std::fs::read_to_string(json).expect("written")).expect("JSON");
    timely!(
        watch,
        figures["missed"]["blind_steps"].as_u64().expect("a number") > 20,
        "{} frames, missed {}",
        figures["frames"],
        figures["missed"]
    );
    timely!(
        watch,
        figures["frames"].as_u64().expect("a number") > 90,
        "film was used before and after: {}",
        figures["missed"]
    );
    for node in [&mut first, &mut second] {
        drop(node.child().stdin.take());
        assert!(node.child().wait().expect("reaped").success());
    }
    assert!(!folder.path().join("second.sock").exists(), "a node takes its socket with it");
}
