//! A run does not care what wall clocks say, nor when they are set.

use std::time::Duration;

use crate::room::{Node, Running, cameras, cluster_file, coordinator, ended, program};
use crate::wall_clock::{WallClock, faketime};
use testkit::{Watch, timely};

const SECONDS: &str = "5";

#[test]
fn wall_clocks_that_are_off_and_are_set_in_mid_run_change_nothing() {
    let Some(library) = faketime() else { return };
    let watch = Watch::start();
    let folder = tempfile::tempdir().expect("a folder");
    let (cluster, json) = (cluster_file(folder.path(), 4), folder.path().join("out.json"));
    let offs = ["-86400", "-0.2", "+0.2", "+3600"];
    let clocks: Vec<WallClock> =
        (0..4).map(|at| WallClock::new(folder.path(), &at.to_string(), offs[at])).collect();
    let node = |at: usize| Node::start(clocks[at].lies_to(program(), &library), &cluster, &cameras(at));
    let nodes: Vec<Node> = (0..4).map(node).collect();
    let ours = WallClock::new(folder.path(), "coordinator", "+0");
    let live = Running::start(&mut coordinator(ours.lies_to(program(), &library), &cluster, SECONDS, &json));
    let steps = [(&ours, "-30"), (&clocks[1], "+3"), (&ours, "+5"), (&clocks[1], "-3"), (&clocks[3], "+0")];
    for (clock, off) in steps {
        std::thread::sleep(Duration::from_millis(900));
        clock.set(off);
    }
    let Some(live) = watch.judge(ended(live, &json)) else { return };
    let missed = &live["missed"];
    for what in ["frames", "blind_steps", "late_steps"] {
        timely!(watch, missed[what] == 0, "{what}: {missed}");
    }
    let again = Running::start(coordinator(program(), &cluster, SECONDS, &json).arg("--unpaced"));
    let Some(lock_step) = watch.judge(ended(again, &json)) else { return };
    assert!(lock_step["contacts"].as_u64().is_some_and(|contacts| contacts > 20), "{lock_step}");
    // A live run has the same bits as long as it is never late for a frame.
    let is_same = live["trajectory_digest"] == lock_step["trajectory_digest"];
    timely!(watch, is_same, "another trajectory than in lock-step: {missed}");
    drop(nodes);
}
