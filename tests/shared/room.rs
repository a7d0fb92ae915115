//! A room of several node processes and their coordinator, for tests.

use std::fs;
use std::io::{BufRead as _, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;
#[allow(unused_imports, reason = "not every test needs it")]
pub use testkit::Running;

/// A node that ends with its test.
pub struct Node(Running, String);

impl Node {
    /// Its process.
    #[allow(dead_code, reason = "not every test needs it")]
    pub fn id(&self) -> u32 {
        self.0.id()
    }

    /// Where it listens.
    #[allow(dead_code, reason = "not every test needs it")]
    pub fn address(&self) -> &str {
        self.1.trim().strip_prefix("listening on ").unwrap_or_else(|| panic!("found {:?}", self.1))
    }

    /// Starts one with these cameras, and waits until it listens.
    #[allow(dead_code, reason = "not every test needs it")]
    pub fn start(mut command: Command, cluster: &Path, cameras: &[String]) -> Node {
        command.arg("node");
        Node::start_at(command, cluster, cameras)
    }

    /// Starts the node of the cluster file that has this name, and waits until it listens.
    #[allow(dead_code, reason = "not every test needs it")]
    pub fn start_named(mut command: Command, cluster: &Path, name: &str) -> Node {
        command.args(["node", "--host", name]);
        Node::start_at(command, cluster, &[])
    }

    /// The same of a command that says where it listens.
    #[allow(dead_code, reason = "not every test needs it")]
    pub fn start_at(mut command: Command, cluster: &Path, cameras: &[String]) -> Node {
        command.arg(cluster).arg("--stop-with-stdin");
        for camera in cameras {
            command.args(["--camera", camera.as_str()]);
        }
        let mut running = Running::start(command.stdin(Stdio::piped()).stdout(Stdio::piped()));
        let mut line = String::new();
        let stdout = running.child().stdout.take().expect("piped");
        BufReader::new(stdout).read_line(&mut line).expect("it says that it listens");
        Node(running, line)
    }
}

/// So many nodes of two cameras each, filming ten frames a second: a busy machine must not miss one.
#[allow(dead_code, reason = "not every test needs it")]
pub fn cluster_file(folder: &Path, nodes: usize) -> PathBuf {
    cluster_file_of(folder, nodes, "topple", "motion = \"sweep\"")
}

/// The same of a scene, and of what is on the stage.
#[allow(dead_code, reason = "not every test needs it")]
pub fn cluster_file_of(folder: &Path, nodes: usize, scene: &str, stage: &str) -> PathBuf {
    let rig = stage::studio_rig(2 * nodes, (96, 72)).expect("a rig");
    fs::write(folder.join("rig.toml"), rig.to_toml()).expect("written");
    let mut text = format!("rig = \"rig.toml\"\nscene = {scene:?}\nfps = 10\nlatency_s = 0.4\n");
    for (at, camera) in rig.cameras().iter().enumerate() {
        let (name, node) = (camera.name(), format!("unix:{}.sock", at / 2));
        text += &format!(
            "[[camera]]\nname = {name:?}\nnode = {node:?}\nsource = {{ kind = \"stage\", {stage} }}\n"
        );
    }
    let file = folder.join("room.cluster.toml");
    fs::write(&file, text).expect("written");
    file
}

/// A room of the nodes "left" and "right" with two cameras each; what `[[node]]` says of each besides its name.
#[allow(dead_code, reason = "not every test needs it")]
pub fn named_room(folder: &Path, left: &str, right: &str) -> PathBuf {
    let file = cluster_file(folder, 2);
    let text = fs::read_to_string(&file).expect("written");
    let text = text.replace("\"unix:0.sock\"", "\"left\"").replace("\"unix:1.sock\"", "\"right\"");
    let nodes = format!("[[node]]\nname = \"left\"\n{left}\n[[node]]\nname = \"right\"\n{right}\n[[camera]]");
    fs::write(&file, text.replacen("[[camera]]", &nodes, 1)).expect("written");
    file
}

/// The program that was built.
pub fn program() -> Command {
    testkit::command(env!("CARGO_BIN_EXE_hulltouch"))
}

/// The names of a node's cameras.
#[allow(dead_code, reason = "not every test needs it")]
pub fn cameras(node: usize) -> [String; 2] {
    [2 * node, 2 * node + 1].map(|camera| format!("cam_{camera}"))
}

/// A coordinator of the room that writes its figures.
#[allow(dead_code, reason = "not every test needs it")]
pub fn coordinator(mut program: Command, cluster: &Path, seconds: &str, json: &Path) -> Command {
    program.arg("coordinator").arg(cluster).args(["--seconds", seconds, "--json"]).arg(json);
    program.stdout(Stdio::null()).stderr(Stdio::piped());
    program
}

/// Waits until all nodes of a room have a connected lease holder.
#[allow(dead_code, reason = "not every test needs it")]
pub fn await_leader(status: impl Fn() -> Command) {
    let by = Instant::now() + Duration::from_secs(60);
    loop {
        let output = status().arg("--json").output().expect("runs");
        let found: Value = serde_json::from_slice(&output.stdout).unwrap_or_default();
        let nodes = found["nodes"].as_array().cloned().unwrap_or_default();
        if !nodes.is_empty() && nodes.iter().all(|node| node["leader"]["is_there"] == true) {
            return;
        }
        assert!(
            Instant::now() < by,
            "no coordinator leads: {found} {}",
            String::from_utf8_lossy(&output.stderr)
        );
        std::thread::sleep(Duration::from_millis(100));
    }
}

/// The figures of a run that went well.
#[allow(dead_code, reason = "not every test needs it")]
pub fn figures(running: Running, json: &Path) -> Value {
    ended(running, json).unwrap_or_else(|said| panic!("{said}"))
}

/// The figures of a run, or what it said when it ran out of time: it has limits of its own, which a busy machine exceeds.
/// One that ends in another way fails its test.
#[allow(dead_code, reason = "not every test needs it")]
pub fn ended(running: Running, json: &Path) -> Result<Value, String> {
    let output = running.wait_with_output().expect("ends");
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    if output.status.code() == Some(1) && testkit::ran_out_of_time(&said) {
        return Err(said);
    }
    assert!(output.status.success(), "{}: {said}", output.status);
    Ok(serde_json::from_slice(&fs::read(json).expect("figures")).expect("JSON"))
}

/// Frames that a run got.
#[allow(dead_code, reason = "not every test needs it")]
pub fn frames(figures: &Value) -> u64 {
    figures["frames"].as_u64().expect("a count")
}

/// Steps of a run for which no hull was available.
#[allow(dead_code, reason = "not every test needs it")]
pub fn blind_steps(figures: &Value) -> u64 {
    figures["missed"]["blind_steps"].as_u64().expect("a count")
}

/// How many frames a run got and what it missed, for the message of a failed test.
#[allow(dead_code, reason = "not every test needs it")]
pub fn missed(figures: &Value) -> String {
    format!("{} frames, missed {}", figures["frames"], figures["missed"])
}

/// Asks a run to end, as a key press does.
#[allow(dead_code, reason = "not every test needs it")]
pub fn ask_to_end(run: &Running) {
    let process = Pid::from_raw(run.id().cast_signed()).expect("a number");
    // It may have ended meanwhile.
    let _ = kill_process(process, Signal::INT);
}
