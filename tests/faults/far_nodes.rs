//! Nodes behind a network: what is far is asked less, and a way that becomes longer is followed.

#![allow(clippy::disallowed_macros, reason = "a test says what it measured")]

use std::fs;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::time::Duration;

use crate::link::{Delay, Link};
use crate::namespace::Host;
use crate::room::{Node, Running, cameras, coordinator, ended, program};
use serde_json::Value;
use testkit::{Watch, timely};

const NODES: usize = 4;
const PORT: u16 = 7001;

/// Four hosts of two cameras, and the ways to them.
struct Room {
    folder: tempfile::TempDir,
    links: Vec<Link>,
    _nodes: Vec<Node>,
    _hosts: Vec<Host>,
}

/// A studio and how it is filmed.
struct Film {
    size: (u32, u32),
    fps: f64,
}

/// What a busy machine films with a debug build.
const SMALL: Film = Film { size: (96, 72), fps: 5.0 };

impl Room {
    /// `None`, and says why, on a machine that makes no hosts.
    fn new(film: &Film, delay: Delay) -> Option<Room> {
        let hosts: Result<Vec<Host>, String> = (0..NODES).map(|_| Host::new(100)).collect();
        let hosts =
            hosts.inspect_err(|why| testkit::skip(format_args!("no network namespaces: {why}"))).ok()?;
        let folder = tempfile::tempdir().expect("a folder");
        let rig = stage::studio_rig(2 * NODES, film.size).expect("a rig");
        fs::write(folder.path().join("rig.toml"), rig.to_toml()).expect("written");
        let at_nodes = cluster_file(folder.path(), "nodes", film, &[None; NODES]);
        let node = |(number, host): (usize, &Host)| {
            let listen = format!("{}:{PORT}", host.address);
            let mut command = host.command(&program());
            command.args(["node", "--listen", &listen, "--insecure"]);
            Node::start_at(command, &at_nodes, &cameras(number))
        };
        let nodes = hosts.iter().enumerate().map(node).collect();
        let link = |(number, host): (usize, &Host)| {
            Link::to(SocketAddr::from((host.address, PORT)), delay, number as u64)
        };
        let links: Vec<Link> = hosts.iter().enumerate().map(link).collect();
        let addresses: Vec<Option<SocketAddr>> = links.iter().map(|link| Some(link.address)).collect();
        cluster_file(folder.path(), "room", film, &addresses);
        Some(Room { folder, links, _nodes: nodes, _hosts: hosts })
    }

    fn cluster(&self) -> PathBuf {
        self.folder.path().join("room.cluster.toml")
    }

    fn run(&self, seconds: &str, more: &[&str], meanwhile: impl FnOnce(&[Link])) -> Result<Value, String> {
        let json = self.folder.path().join("out.json");
        let run = Running::start(coordinator(program(), &self.cluster(), seconds, &json).args(more));
        meanwhile(&self.links);
        ended(run, &json)
    }
}

fn cluster_file(folder: &Path, name: &str, film: &Film, nodes: &[Option<SocketAddr>]) -> PathBuf {
    let mut text = format!("rig = \"rig.toml\"\nscene = \"topple\"\nfps = {:?}\n", film.fps);
    for camera in 0..2 * NODES {
        text += &format!("[[camera]]\nname = \"cam_{camera}\"\n");
        if let Some(address) = nodes[camera / 2] {
            text += &format!("node = \"{address}\"\n");
        }
        text += "source = { kind = \"stage\", motion = \"sweep\" }\n";
    }
    let file = folder.join(format!("{name}.cluster.toml"));
    fs::write(&file, text).expect("written");
    file
}

fn missed_share(figures: &Value) -> f64 {
    figures["missed"]["share"].as_f64().expect("a share")
}

#[test]
fn what_is_far_is_gathered_and_misses_nothing() {
    let Some(room) = Room::new(&SMALL, Delay { ms: 12.0, jitter_ms: 1.0 }) else { return };
    let watch = Watch::start();
    let Some(figures) = watch.judge(room.run("12", &["--fresh"], |_| {})) else { return };
    assert_eq!(figures["transport"], "auto");
    let gathered = figures["questions"]["gathered"].as_u64().expect("a count");
    timely!(watch, gathered > 10, "{}", figures["questions"]);
    timely!(watch, missed_share(&figures) < 0.05, "{}", figures["missed"]);
}

#[test]
fn a_way_that_becomes_longer_is_followed() {
    let Some(room) = Room::new(&SMALL, Delay { ms: 1.0, jitter_ms: 0.2 }) else { return };
    let watch = Watch::start();
    let ran = room.run("12", &["--fresh", "--transport", "gather"], |links| {
        std::thread::sleep(Duration::from_secs(4));
        links[1].set_delay(Delay { ms: 21.0, jitter_ms: 0.2 });
    });
    let Some(figures) = watch.judge(ran) else { return };
    timely!(watch, missed_share(&figures) < 0.05, "{}", figures["missed"]);
    let late_steps = figures["missed"]["late_steps"].as_u64().expect("a count");
    timely!(watch, late_steps < 5 * 120, "late until the latency has followed: {late_steps}");
}

/// Minutes, and of a release build: `HULLTOUCH_MEASURE=1 cargo test --release --test faults far_nodes::studio -- --nocapture`
/// prints what runs miss by how far nodes are.
#[test]
fn a_studio_of_far_nodes_misses_under_a_hundredth() {
    if std::env::var_os("HULLTOUCH_MEASURE").is_none() {
        testkit::skip("HULLTOUCH_MEASURE is not set, and it takes minutes");
        return;
    }
    let studio = Film { size: (640, 480), fps: 30.0 };
    for (ms, jitter_ms) in [(1.0, 0.25), (2.0, 0.5), (5.0, 0.5)] {
        let Some(room) = Room::new(&studio, Delay { ms, jitter_ms }) else { return };
        for transport in ["cluster", "gather", "auto", "auto", "auto", "auto", "auto"] {
            let figures = room.run("30", &["--fresh", "--transport", transport], |_| {}).expect("ends well");
            eprintln!(
                "{ms} ± {jitter_ms} ms {transport}: {} % missed, gathered {} of {} passes, age {:.1} ms, digest {}",
                100.0 * missed_share(&figures),
                figures["questions"]["gathered"],
                figures["questions"]["passes"],
                figures["response_age_ms"]["p50"].as_f64().unwrap_or_default(),
                figures["trajectory_digest"],
            );
            assert!(transport != "auto" || missed_share(&figures) < 0.01, "{}", figures["missed"]);
        }
    }
}
