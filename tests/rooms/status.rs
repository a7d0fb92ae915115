//! A room at a glance.

use std::fs;
use std::path::Path;
use std::process::Output;
use std::time::{Duration, Instant};

use crate::room::{Node, Running, blind_steps, coordinator, ended, missed, named_room, program};
use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;
use testkit::{Watch, timely};

fn status(cluster: &Path, more: &[&str]) -> Output {
    program().arg("status").arg(cluster).args(more).output().expect("ends")
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// Nodes of a room over Unix sockets.
fn nodes(folder: &Path) -> (std::path::PathBuf, Vec<Node>) {
    let cluster = named_room(folder, "address = \"unix:left.sock\"", "address = \"unix:right.sock\"");
    let nodes = ["left", "right"].map(|name| Node::start_named(program(), &cluster, name));
    (cluster, nodes.into())
}

#[test]
fn a_run_is_seen_and_does_not_notice() {
    let watch = Watch::start();
    let folder = tempfile::tempdir().expect("a folder");
    let ((cluster, _nodes), json) = (nodes(folder.path()), folder.path().join("out.json"));
    let idle = status(&cluster, &[]);
    assert_eq!(idle.status.code(), Some(1), "{}", text(&idle.stderr));
    assert!(text(&idle.stdout).ends_with("lacks: no coordinator leads the nodes: no camera films\n"));

    let mut run = Running::start(&mut coordinator(program(), &cluster, "600", &json));
    let deadline = Instant::now() + Duration::from_secs(60);
    let well = loop {
        let found = status(&cluster, &["--json"]);
        if found.status.success() {
            break text(&found.stdout);
        }
        assert!(Instant::now() < deadline, "{}", text(&found.stdout));
        std::thread::sleep(Duration::from_millis(300));
    };
    let table = text(&status(&cluster, &[]).stdout);
    let process = Pid::from_raw(run.child().id().cast_signed()).expect("a number");
    kill_process(process, Signal::INT).expect("asked to end");
    let Some(figures) = watch.judge(ended(run, &json)) else { return };
    timely!(watch, blind_steps(&figures) == 0, "{}", missed(&figures));

    let well: Value = serde_json::from_str(&well).expect("one object");
    assert_eq!((well["room"].as_str(), well["ok"].as_bool()), (Some("room"), Some(true)), "{well}");
    for (node, name) in well["nodes"].as_array().expect("nodes").iter().zip(["left", "right"]) {
        assert_eq!((&node["name"], &node["problem"]), (&name.into(), &Value::Null), "{node}");
        assert_eq!(node["version"], env!("CARGO_PKG_VERSION"));
        assert!(node["leader"]["name"].as_str().is_some_and(|name| name.starts_with("the coordinator on ")));
        assert_eq!((&node["leader"]["term"], &node["leader"]["is_there"]), (&1.into(), &true.into()));
        let (offset_ms, bound_ms) = (node["clock_offset_ms"].as_f64(), node["clock_bound_ms"].as_f64());
        assert!(offset_ms.zip(bound_ms).is_some_and(|(off, bound)| off.abs() <= bound + 1.0), "{node}");
        for camera in node["cameras"].as_array().expect("cameras") {
            let fps = camera["frames_per_s"].as_f64().expect("a rate");
            timely!(watch, (9.0..12.0).contains(&fps), "{camera}");
            assert!(
                camera["foreground"].as_f64().is_some_and(|share| share > 0.005 && share < 0.6),
                "{camera}"
            );
            assert!(camera["frame"].as_u64().is_some() && camera["age_ms"].as_f64().is_some(), "{camera}");
            assert_eq!(camera["stamps"], "index");
        }
    }
    assert!(table.starts_with("room room: 2 nodes, 4 cameras, 10 frames/s\n"), "{table}");
    assert_eq!(table.lines().filter(|line| line.starts_with("cam_")).count(), 4, "{table}");
}

#[test]
fn a_node_that_does_not_answer_is_lacking() {
    let folder = tempfile::tempdir().expect("a folder");
    let (cluster, mut nodes) = nodes(folder.path());
    drop(nodes.pop());
    let found = status(&cluster, &[]);
    let said = text(&found.stdout);
    assert_eq!(found.status.code(), Some(1), "{said}");
    assert!(said.contains("does not answer: cannot connect: "), "{said}");
    let last = said.lines().last().expect("a verdict");
    assert!(last.starts_with("lacks: node right: cannot connect: "), "{said}");
    assert_eq!(text(&found.stderr), "hulltouch: room room lacks something (2)\n");
}

#[test]
fn viewers_see_it_with_their_certificate_and_nodes_do_not_with_theirs() {
    let folder = tempfile::tempdir().expect("a folder");
    let cluster = named_room(folder.path(), "", "");
    let certs = folder.path().join("certs");
    let made = program().arg("certs").arg(&cluster).arg("--into").arg(&certs).output().expect("ends");
    assert!(made.status.success(), "{}", text(&made.stderr));
    let started = ["left", "right"].map(|name| {
        let mut command = program();
        let own = certs.join("nodes").join(name);
        command.args(["node", "--listen", "127.0.0.1:0", "--host", name, "--certs"]).arg(own);
        Node::start_at(command, &cluster, &[])
    });
    let [left, right] = [&started[0], &started[1]].map(|node| format!("address = {:?}", node.address()));
    let cluster = named_room(folder.path(), &left, &right);
    let seen = |whose: &str| {
        let own = certs.join(whose);
        status(&cluster, &["--certs", own.to_str().expect("a path")])
    };
    for whose in ["viewer", "coordinator"] {
        let found = text(&seen(whose).stdout);
        assert!(found.contains("364 days"), "{whose}: {found}");
        assert!(
            found.ends_with("lacks: no coordinator leads the nodes: no camera films\n"),
            "{whose}: {found}"
        );
    }
    let refused = seen("nodes/right");
    assert_eq!(refused.status.code(), Some(2));
    assert!(
        text(&refused.stderr).contains("is of right.node.room.hulltouch, expected"),
        "{}",
        text(&refused.stderr)
    );
}

#[test]
fn watching_prints_again_and_again() {
    let folder = tempfile::tempdir().expect("a folder");
    let (cluster, _nodes) = nodes(folder.path());
    let out = folder.path().join("watched");
    let file = fs::File::create(&out).expect("made");
    let watching =
        Running::start(program().arg("status").arg(&cluster).args(["--watch", "--json"]).stdout(file));
    let deadline = Instant::now() + Duration::from_secs(60);
    while fs::read_to_string(&out).expect("text").lines().count() < 3 {
        assert!(Instant::now() < deadline, "it prints once a second");
        std::thread::sleep(Duration::from_millis(100));
    }
    drop(watching);
    for line in fs::read_to_string(&out).expect("text").lines() {
        let look: Value = serde_json::from_str(line).expect("one object a line");
        assert_eq!(look["nodes"].as_array().map(Vec::len), Some(2), "{look}");
    }
}
