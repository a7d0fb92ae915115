//! A sample is a whole room: its film has silhouettes that move bodies, and every command of its README.txt works.

use std::fs;
use std::io::{BufRead as _, BufReader};
use std::path::Path;
use std::process::{Output, Stdio};

use serde_json::Value;

use crate::room::{Running, program};

/// Runs the program in a folder to its end, which must be a good one.
#[track_caller]
fn run(folder: &Path, words: &[&str]) -> Output {
    let output = program().current_dir(folder).args(words).output().expect("runs");
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{words:?} said {said}{}", String::from_utf8_lossy(&output.stdout));
    output
}

/// Starts a node as the words say, and waits until it listens.
fn node(folder: &Path, words: &[&str]) -> Running {
    let mut command = program();
    command.current_dir(folder).args(words).arg("--stop-with-stdin");
    let mut running = Running::start(command.stdin(Stdio::piped()).stdout(Stdio::piped()));
    let mut line = String::new();
    let stdout = running.child().stdout.take().expect("piped");
    BufReader::new(stdout).read_line(&mut line).expect("a line");
    assert!(line.starts_with("listening on unix:"), "{words:?} said {line}");
    running
}

#[test]
fn a_sample_is_a_room_and_every_command_of_its_readme_works() {
    let parent = tempfile::tempdir().expect("a folder");
    let options = ["sample", "room", "--size", "320x240", "--seconds", "2"];
    let said = String::from_utf8(run(parent.path(), &options).stdout).expect("text");
    let folder = parent.path().join("room");
    let films = ["films", "empty"].iter().flat_map(|kind| fs::read_dir(folder.join(kind)).expect("listed"));
    let sizes = films.map(|film| film.expect("a film").metadata().expect("a size").len());
    let (count, bytes) = sizes.fold((0, 0), |(count, bytes), size| (count + 1, bytes + size));
    assert!(count == 8 && said.contains(&format!(": {bytes} bytes\n")), "{count} films: {said}");
    assert_eq!(fs::read_dir(parent.path()).expect("listed").count(), 1, "nothing else is left");

    // Ports of this machine may be in use.
    let cluster = folder.join("room.cluster.toml");
    let mut text = fs::read_to_string(&cluster).expect("a cluster file");
    for (address, socket) in [("127.0.0.1:7001", "unix:left.sock"), ("127.0.0.1:7002", "unix:right.sock")] {
        assert!(text.contains(address), "{text}");
        text = text.replace(address, socket);
    }
    fs::write(&cluster, text).expect("written");

    let readme = fs::read_to_string(folder.join("README.txt")).expect("a text");
    let (mut nodes, mut names) = (Vec::new(), Vec::new());
    for command in readme.lines().filter_map(|line| line.strip_prefix("    hulltouch ")) {
        let mut words: Vec<&str> = command.split(' ').collect();
        names.push(words[0]);
        if words[0] == "node" {
            nodes.push(node(&folder, &words));
            continue;
        }
        // A test opens no browser.
        for word in words.iter_mut().filter(|word| **word == "--open") {
            *word = "--headless";
        }
        run(&folder, &words);
    }
    assert_eq!(names, ["demo", "demo", "replay", "doctor", "node", "node", "coordinator"]);

    let figures = fs::read(folder.join("run.json")).expect("figures");
    let figures: Value = serde_json::from_slice(&figures).expect("JSON");
    assert_eq!((&figures["cameras"], &figures["frames"]), (&Value::from(4), &Value::from(60)));
    assert_eq!(figures["missed"]["blind_steps"], 0, "the hull is in use from the first frame on");
    let bodies = figures["bodies"].as_array().expect("bodies").iter();
    let touched: Vec<f64> = bodies.filter_map(|body| body["first_touch_s"].as_f64()).collect();
    // The person stands still for a second first, before the stacks and not in them.
    assert!(touched.len() >= 2 && touched.iter().all(|&at_s| at_s > 1.0), "touched at {touched:?} s");
}
