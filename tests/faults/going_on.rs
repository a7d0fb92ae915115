//! A node that is lost, or stands still, is left out: the hull of the other cameras stays, and the node comes back.

use std::io::{BufRead as _, BufReader};
use std::path::Path;
use std::process::{ChildStderr, Command, Output};
use std::time::{Duration, Instant};

use crate::room::{
    Node, Running, await_leader, cameras, cluster_file, cluster_file_of, coordinator, ended, program,
};
use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;
use tempfile::TempDir;
use testkit::{Watch, timely};

const NODES: usize = 4;

/// What a run says and figures while something happens to its second node.
fn run(
    watch: &Watch,
    seconds: &str,
    min_cameras: usize,
    happens: impl FnOnce(&mut Vec<Node>, &Path),
) -> Option<(String, Value)> {
    let folder = tempfile::tempdir().expect("a folder");
    let (said, figures) = run_in(&folder, &cluster_file(folder.path(), NODES), seconds, min_cameras, happens);
    // It has given up: its own limits are of real time.
    Some((said.clone(), watch.judge(figures.ok_or(said))?))
}

fn run_in(
    folder: &TempDir,
    cluster: &Path,
    seconds: &str,
    min_cameras: usize,
    happens: impl FnOnce(&mut Vec<Node>, &Path),
) -> (String, Option<Value>) {
    let (cluster, json) = (cluster.to_owned(), folder.path().join("out.json"));
    let text = std::fs::read_to_string(&cluster).expect("written");
    std::fs::write(&cluster, format!("min_cameras = {min_cameras}\n{text}")).expect("written");
    let mut nodes: Vec<Node> =
        (0..NODES).map(|node| Node::start(program(), &cluster, &cameras(node))).collect();
    let run = Running::start(coordinator(program(), &cluster, seconds, &json).env("RUST_LOG", "info"));
    std::thread::sleep(Duration::from_millis(2500));
    happens(&mut nodes, &cluster);
    let output: Output = run.wait_with_output().expect("ends");
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    if output.status.code() == Some(1) && testkit::ran_out_of_time(&said) {
        return (said, None);
    }
    assert!(output.status.success(), "{}: {said}", output.status);
    let figures = std::fs::read(&json).expect("figures");
    (said, Some(serde_json::from_slice(&figures).expect("JSON")))
}

/// What a program says, line by line.
struct Said {
    lines: BufReader<ChildStderr>,
    so_far: String,
}

impl Said {
    /// Reads on until a line contains this.
    fn until(&mut self, sought: &str) {
        while !self.so_far.lines().any(|line| line.contains(sought)) {
            let read = self.lines.read_line(&mut self.so_far);
            assert!(read.is_ok_and(|read| read > 0), "no {sought:?}: {}", self.so_far);
        }
    }
}

/// A coordinator that runs, and what it says.
fn leader(command: &mut Command) -> (Running, Said) {
    let mut run = Running::start(command.env("RUST_LOG", "info"));
    let lines = BufReader::new(run.child().stderr.take().expect("piped"));
    (run, Said { lines, so_far: String::new() })
}

fn steps(figures: &Value, what: &str) -> u64 {
    figures["missed"][what].as_u64().expect("a number")
}

#[test]
fn a_node_that_is_killed_is_left_out_and_taken_back() {
    let watch = Watch::start();
    let ran = run(&watch, "7", 3, |nodes, cluster| {
        drop(nodes.remove(1));
        std::thread::sleep(Duration::from_millis(1200));
        nodes.push(Node::start(program(), cluster, &cameras(1)));
    });
    let Some((said, figures)) = ran else { return };
    let expected = ["going on without node", "going on with 6 cameras", "is back, 8 cameras"];
    timely!(watch, expected.iter().all(|line| said.contains(line)), "expected {expected:?}: {said}");
    timely!(watch, steps(&figures, "blind_steps") == 0, "{}: {said}", figures["missed"]);
    // Twelve tenths of a second at 120 steps a second, and what the node takes to start.
    let reduced = steps(&figures, "reduced_steps");
    timely!(watch, (100..480).contains(&reduced), "{reduced} steps without it: {said}");
    timely!(
        watch,
        steps(&figures, "frames") < 5,
        "{} frames, missed {}",
        figures["frames"],
        figures["missed"]
    );
}

#[test]
fn a_run_begins_without_a_node_that_is_away_and_takes_it_in_later() {
    let watch = Watch::start();
    let folder = tempfile::tempdir().expect("a folder");
    let (cluster, json) = (cluster_file(folder.path(), NODES), folder.path().join("out.json"));
    let start = |node| Node::start(program(), &cluster, &cameras(node));
    let mut nodes: Vec<Node> = [0, 2, 3].map(start).into();
    let (mut run, mut said) =
        leader(coordinator(program(), &cluster, "600", &json).args(["--patience", "2"]));
    said.until("it begins without node");
    said.until("going on with 6 cameras");
    nodes.push(start(1));
    said.until("is back, 8 cameras");
    let process = Pid::from_raw(run.child().id().cast_signed()).expect("a number");
    kill_process(process, Signal::INT).expect("asked to end");
    let Some(figures) = watch.judge(ended(run, &json)) else { return };
    assert!(steps(&figures, "reduced_steps") > 0, "{}", figures["missed"]);
    assert_eq!(figures["cameras"], 8);
}

#[test]
fn a_restarted_coordinator_does_not_wait_for_a_node_that_is_away() {
    let watch = Watch::start();
    let folder = tempfile::tempdir().expect("a folder");
    let (cluster, json) = (cluster_file(folder.path(), NODES), folder.path().join("out.json"));
    let mut nodes: Vec<Node> =
        (0..NODES).map(|node| Node::start(program(), &cluster, &cameras(node))).collect();
    let (first, _) = leader(&mut coordinator(program(), &cluster, "600", &json));
    await_leader(|| {
        let mut status = program();
        status.arg("status").arg(&cluster);
        status
    });
    // Nodes are handed the world once a second.
    std::thread::sleep(Duration::from_secs(4));
    drop(first);
    drop(nodes.remove(1));
    let began = Instant::now();
    let (_next, mut said) = leader(&mut coordinator(program(), &cluster, "600", &json));
    said.until("it begins without node");
    let took = began.elapsed();
    timely!(watch, took < Duration::from_secs(20), "it waited for {took:?} of a minute");
    said.until("going on from the world");
}

#[test]
fn a_run_that_lacks_too_many_cameras_does_not_begin() {
    let folder = tempfile::tempdir().expect("a folder");
    let (cluster, json) = (cluster_file(folder.path(), NODES), folder.path().join("out.json"));
    let _node = Node::start(program(), &cluster, &cameras(0));
    let output = coordinator(program(), &cluster, "1", &json).args(["--patience", "1"]).output();
    let output = output.expect("ends");
    assert_eq!(output.status.code(), Some(1));
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(said.contains("(cam_2, cam_3)") && !said.contains("it begins without"), "{said}");
}

#[test]
fn what_lies_on_a_table_stays_there_without_a_node() {
    let watch = Watch::start();
    let heights = |happens: fn(&mut Vec<Node>)| {
        let folder = tempfile::tempdir().expect("a folder");
        let table = "motion = \"idle\", props = [\"table\"], person = false";
        let cluster = cluster_file_of(folder.path(), NODES, "rest", table);
        let (said, figures) = run_in(&folder, &cluster, "5", 3, |nodes, _| happens(nodes));
        let figures = watch.judge(figures.ok_or(said))?;
        let bodies = figures["bodies"].as_array().expect("bodies").clone();
        let reduced = steps(&figures, "reduced_steps");
        let heights_m = bodies.iter().map(|body| body["end"][1].as_f64().expect("a height"));
        Some((heights_m.collect::<Vec<_>>(), reduced))
    };
    let Some((with_all, _)) = heights(|_| {}) else { return };
    let Some((without_one, reduced)) = heights(|nodes| drop(nodes.remove(1))) else { return };
    timely!(watch, reduced > 120, "{reduced} steps without it");
    let lies = with_all.iter().all(|&height| height > 0.7);
    timely!(watch, lies, "it lies on the table: {with_all:?}");
    for (with_all, without_one) in with_all.iter().zip(&without_one) {
        timely!(
            watch,
            (with_all - without_one).abs() < 0.1,
            "{with_all} m with all cameras, {without_one} m without two"
        );
    }
}

#[test]
fn a_node_that_stands_still_is_left_out_until_it_goes_on() {
    let watch = Watch::start();
    let ran = run(&watch, "6", 3, |nodes, _| {
        let process = Pid::from_raw(nodes[1].id().cast_signed()).expect("a number");
        kill_process(process, Signal::STOP).expect("stopped");
        std::thread::sleep(Duration::from_millis(1500));
        kill_process(process, Signal::CONT).expect("continued");
    });
    let Some((said, figures)) = ran else { return };
    let expected = ["going on without node", "going on with 6 cameras", "is back, 8 cameras"];
    timely!(watch, expected.iter().all(|line| said.contains(line)), "expected {expected:?}: {said}");
    timely!(watch, steps(&figures, "blind_steps") == 0, "{}: {said}", figures["missed"]);
    let reduced = steps(&figures, "reduced_steps");
    timely!(watch, (100..400).contains(&reduced), "{reduced} steps without it: {said}");
}

#[test]
fn below_the_least_number_of_cameras_there_is_no_hull() {
    let watch = Watch::start();
    let ran = run(&watch, "4", 7, |nodes, _| drop(nodes.remove(1)));
    let Some((said, figures)) = ran else { return };
    let too_few = "hull unavailable, collisions off: 6 of 8 cameras, 7 needed: node";
    // If it is lost while it is asked, that is said first.
    let unanswered = "hull unavailable, collisions off: node";
    timely!(watch, said.contains(too_few) || said.contains(unanswered), "{said}");
    assert!(!said.contains("going on with"), "{said}");
    timely!(
        watch,
        steps(&figures, "blind_steps") > 60,
        "{} frames, missed {}",
        figures["frames"],
        figures["missed"]
    );
    assert_eq!(steps(&figures, "reduced_steps"), 0, "{figures}");
}
