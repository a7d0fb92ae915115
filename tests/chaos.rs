//! A room in which something fails every two seconds: the run goes on, and what failed is back soon after its fault ends.

#![allow(clippy::disallowed_macros, reason = "a test says what it measured")]

#[path = "shared/filmed.rs"]
mod filmed;
#[path = "shared/link.rs"]
mod link;
#[path = "shared/room.rs"]
mod room;
#[path = "shared/wall_clock.rs"]
mod wall_clock;

use std::collections::HashSet;
use std::fs;
use std::io::{BufRead as _, BufReader};
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::thread;
use std::time::{Duration, Instant};

use filmed::{film_argument, film_of, filmed_room};
use link::{Delay, Link};
use parking_lot::Mutex;
use room::{Node, Running, cameras, cluster_file, coordinator, ended, frames, missed, program};
use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;
use testkit::{Watch, timely};
use wall_clock::{WallClock, faketime};

const NODES: usize = 4;
/// From a fault's end until all cameras are there again.
const BACK_WITHIN: Duration = Duration::from_secs(3);
/// Bodies of this scene never move faster, m/s.
const FASTEST_M_S: f64 = 20.0;
/// What a process may grow by while nothing but time goes by, KiB.
const GROWTH_KIB: u64 = 40 * 1024;

/// Numbers from a seed (SplitMix64).
struct Random(u64);

impl Random {
    fn below(&mut self, end: u64) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut mixed = self.0;
        mixed = (mixed ^ (mixed >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        (mixed ^ (mixed >> 31)) % end
    }
}

/// Nodes of live cameras, and the ways to them.
struct Room {
    folder: tempfile::TempDir,
    nodes: Vec<Option<Node>>,
    addresses: Vec<String>,
    links: Vec<Link>,
    clocks: Clocks,
}

/// Wall clocks of all nodes, and the coordinator's, where they can be faked.
struct Clocks {
    library: Option<PathBuf>,
    clocks: Vec<WallClock>,
}

impl Clocks {
    fn new(folder: &Path) -> Clocks {
        let clocks = (0..=NODES).map(|at| WallClock::new(folder, &at.to_string(), "+0")).collect();
        Clocks { library: faketime(), clocks }
    }

    /// The program by the clock of a node, or the coordinator's.
    fn program(&self, at: usize) -> Command {
        match &self.library {
            Some(library) => self.clocks[at].lies_to(program(), library),
            None => program(),
        }
    }
}

impl Room {
    fn new() -> Room {
        let folder = tempfile::tempdir().expect("a folder");
        let clocks = Clocks::new(folder.path());
        let places: Vec<SocketAddr> = (1..=NODES as u16).map(|port| ([127, 0, 0, 1], port).into()).collect();
        let cluster = filmed_room(folder.path(), &places);
        let start = |node: usize| start(clocks.program(node), &cluster, node, "127.0.0.1:0");
        let nodes: Vec<Node> = (0..NODES).map(start).collect();
        let addresses: Vec<String> = nodes.iter().map(|node| node.address().to_owned()).collect();
        let link = |address: &String| {
            Link::to(address.parse().expect("an address"), Delay { ms: 0.0, jitter_ms: 0.0 }, 1)
        };
        let links: Vec<Link> = addresses.iter().map(link).collect();
        let mut text = fs::read_to_string(&cluster).expect("written");
        for (place, link) in places.iter().zip(&links) {
            text = text.replace(&format!("\"{place}\""), &format!("\"{}\"", link.address));
        }
        fs::write(folder.path().join("linked.cluster.toml"), text).expect("written");
        Room { folder, nodes: nodes.into_iter().map(Some).collect(), addresses, links, clocks }
    }

    fn cluster(&self) -> PathBuf {
        self.folder.path().join("linked.cluster.toml")
    }

    /// Makes a fault, and ends it. Returns what it was.
    fn fail(&mut self, random: &mut Random) -> String {
        let (node, camera) = (random.below(NODES as u64) as usize, random.below(2 * NODES as u64));
        let name = format!("cam_{camera}");
        let film = film_of(self.folder.path(), &name);
        let beside = |mark: &str| PathBuf::from(format!("{}.{mark}", film.display()));
        let pause = Duration::from_millis(300 + random.below(1200));
        match random.below(8) {
            0 => {
                self.nodes[node] = None;
                thread::sleep(pause);
                let command = self.clocks.program(node);
                self.nodes[node] = Some(start(command, &self.cluster(), node, &self.addresses[node]));
                format!("node {node} killed for {pause:?}")
            }
            1 => {
                let process = self.nodes[node].as_ref().expect("it runs").id();
                stopped(process, pause);
                format!("node {node} stopped for {pause:?}")
            }
            2 => {
                self.links[node].cut(true);
                thread::sleep(pause);
                self.links[node].cut(false);
                format!("the way to node {node} cut for {pause:?}")
            }
            3 => {
                camera_programs(self.folder.path(), &name)
                    .into_iter()
                    .for_each(|process| signal(process, Signal::KILL));
                format!("the program of {name} killed")
            }
            4 => {
                camera_programs(self.folder.path(), &name)
                    .into_iter()
                    .for_each(|process| stopped(process, pause));
                format!("the program of {name} stopped for {pause:?}")
            }
            5 => {
                let (at, off_s) = (random.below(1 + NODES as u64) as usize, random.below(120));
                self.clocks.clocks[at].set(&format!("{:+}", off_s.cast_signed() - 60));
                format!("wall clock {at} set to {off_s} - 60 s")
            }
            kind => {
                let mark = beside(if kind == 6 { "silent" } else { "garbled" });
                fs::write(&mark, "").expect("written");
                thread::sleep(pause);
                fs::remove_file(&mark).expect("removed");
                format!("{} for {pause:?}", mark.display())
            }
        }
    }
}

fn start(mut command: Command, cluster: &Path, node: usize, listen: &str) -> Node {
    command.args(["node", "--listen", listen]).stderr(Stdio::null());
    Node::start_at(command, cluster, &cameras(node))
}

fn signal(process: u32, signal: Signal) {
    // It may have ended meanwhile.
    let _ = kill_process(Pid::from_raw(process.cast_signed()).expect("a number"), signal);
}

fn stopped(process: u32, pause: Duration) {
    signal(process, Signal::STOP);
    thread::sleep(pause);
    signal(process, Signal::CONT);
}

/// The processes that film as a camera of this test.
fn camera_programs(folder: &Path, name: &str) -> Vec<u32> {
    let arguments = format!("\0{}\0", film_argument(folder, name));
    let processes = fs::read_dir("/proc").expect("Linux").flatten();
    let numbers = processes.filter_map(|process| process.file_name().to_str()?.parse::<u32>().ok());
    let is_it = |process: &u32| {
        let read = fs::read_to_string(format!("/proc/{process}/cmdline"));
        read.is_ok_and(|line| line.contains(&arguments))
    };
    numbers.filter(is_it).collect()
}

fn memory_kib(process: u32) -> u64 {
    let status = fs::read_to_string(format!("/proc/{process}/status")).unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"));
    line.and_then(|line| line.trim().strip_suffix(" kB")?.parse().ok()).unwrap_or_default()
}

/// What a coordinator says, and which cameras it goes on without.
#[derive(Default)]
struct Said {
    lines: Vec<String>,
    lost: HashSet<String>,
}

fn listen(run: &mut Child) -> Arc<Mutex<Said>> {
    let said = Arc::new(Mutex::new(Said::default()));
    let (stderr, shared) = (run.stderr.take().expect("piped"), Arc::clone(&said));
    thread::spawn(move || {
        for line in BufReader::new(stderr).lines().map_while(Result::ok) {
            let mut said = shared.lock();
            for camera in (0..2 * NODES).map(|camera| format!("\"cam_{camera}\"")) {
                if line.contains(&format!("camera {camera} films nothing")) {
                    said.lost.insert(camera);
                } else if line.contains(&format!("camera {camera} is back")) {
                    said.lost.remove(&camera);
                }
            }
            said.lines.push(line);
        }
    });
    said
}

fn number(name: &str, default: u64) -> u64 {
    std::env::var(name).ok().and_then(|text| text.parse().ok()).unwrap_or(default)
}

/// One room at a time: sixteen camera programs would be late of themselves on two cores.
static ALONE: Mutex<()> = Mutex::new(());

/// Whether this becomes true of the cameras that are lost, within a minute.
fn comes_true(said: &Mutex<Said>, is_true: impl Fn(&HashSet<String>) -> bool) -> bool {
    let asked = Instant::now();
    while asked.elapsed() < Duration::from_secs(60) {
        if is_true(&said.lock().lost) {
            return true;
        }
        thread::sleep(Duration::from_millis(5));
    }
    false
}

#[test]
fn a_camera_that_falls_silent_takes_no_other_with_it() {
    let _alone = ALONE.lock();
    let watch = Watch::start();
    let room = Room::new();
    let json = room.folder.path().join("out.json");
    let mut run = coordinator(program(), &room.cluster(), "100000", &json);
    let mut run = Running::start(run.env("RUST_LOG", "info"));
    let said = listen(run.child());
    thread::sleep(Duration::from_millis(2500));
    // One that a busy machine holds up is back before.
    comes_true(&said, HashSet::is_empty);
    let mark = PathBuf::from(format!("{}.silent", film_of(room.folder.path(), "cam_1").display()));
    fs::write(&mark, "").expect("written");
    // Another that is late on a busy machine is back in no time.
    let alone = comes_true(&said, |lost| lost.len() == 1 && lost.contains("\"cam_1\""));
    fs::remove_file(&mark).expect("removed");
    let back = comes_true(&said, HashSet::is_empty);
    signal(run.id(), Signal::INT);
    assert!(run.child().wait().expect("ends").success());
    let lines = said.lock().lines.join("\n");
    timely!(watch, alone, "cam_1 alone was not lost: {lines}");
    timely!(watch, back, "cam_1 is not back: {lines}");
}

/// `HULLTOUCH_CHAOS_S` and `HULLTOUCH_CHAOS_SEED` make it longer, and another.
#[test]
fn a_run_in_which_everything_fails_goes_on() {
    let _alone = ALONE.lock();
    let watch = Watch::start();
    let (seconds, seed) = (number("HULLTOUCH_CHAOS_S", 60), number("HULLTOUCH_CHAOS_SEED", 1));
    let mut random = Random(seed);
    let mut room = Room::new();
    let json = room.folder.path().join("out.json");
    let mut run = coordinator(room.clocks.program(NODES), &room.cluster(), "100000", &json);
    let mut run = Running::start(run.env("RUST_LOG", "info"));
    let said = listen(run.child());
    let ready = Instant::now();
    thread::sleep(Duration::from_secs(4));
    let before_kib = memory_kib(run.id());
    let mut faults = Vec::new();
    while ready.elapsed() < Duration::from_secs(seconds) {
        let fault = room.fail(&mut random);
        let ended = Instant::now();
        thread::sleep(Duration::from_millis(700));
        while !said.lock().lost.is_empty() && ended.elapsed() < BACK_WITHIN {
            thread::sleep(Duration::from_millis(20));
        }
        faults.push(fault);
        let now = said.lock();
        let last = now.lines.iter().rev().take(30).rev().cloned().collect::<Vec<_>>().join("\n");
        assert!(
            run.child().try_wait().expect("a child").is_none(),
            "seed {seed}: it ended after {faults:?}: {last}"
        );
        let is_back = now.lost.is_empty();
        timely!(watch, is_back, "seed {seed}: {:?} is not back after {faults:?}: {last}", now.lost);
    }
    let grown_kib = memory_kib(run.id()).saturating_sub(before_kib);
    signal(run.id(), Signal::INT);
    let status = run.child().wait().expect("ends");
    assert!(status.success(), "seed {seed}: {status}");
    let figures: Value = serde_json::from_slice(&fs::read(&json).expect("figures")).expect("JSON");
    assert_eq!(figures["faults"], 0, "seed {seed}: numbers that are none");
    let missed = figures["missed"]["share"].as_f64().expect("a number");
    for body in figures["bodies"].as_array().expect("bodies") {
        let fastest_m_s = body["max_speed_m_s"].as_f64().expect("a number");
        assert!(fastest_m_s < FASTEST_M_S, "seed {seed}: {body}");
    }
    assert!(grown_kib < GROWTH_KIB, "seed {seed}: it grew by {grown_kib} KiB over {} faults", faults.len());
    timely!(watch, missed < 0.2, "seed {seed}: {}", figures["missed"]);
    eprintln!("{} faults, {}, grown by {grown_kib} KiB", faults.len(), figures["missed"]);
}

/// `HULLTOUCH_STARTS` says how many are tried.
#[test]
fn a_node_that_freezes_for_a_moment_does_not_fail_a_start() {
    let _alone = ALONE.lock();
    let watch = Watch::start();
    let folder = tempfile::tempdir().expect("a folder");
    let (cluster, json) = (cluster_file(folder.path(), NODES), folder.path().join("out.json"));
    let nodes: Vec<Node> = (0..NODES).map(|node| Node::start(program(), &cluster, &cameras(node))).collect();
    for seed in 0..number("HULLTOUCH_STARTS", 8) {
        let mut random = Random(seed);
        let run = Running::start(&mut coordinator(program(), &cluster, "0.5", &json));
        // A start takes about half a second: each of its phases is met.
        let (after, frozen) = (random.below(700), 40 + random.below(21));
        thread::sleep(Duration::from_millis(after));
        let node = random.below(NODES as u64) as usize;
        stopped(nodes[node].id(), Duration::from_millis(frozen));
        let Some(figures) = watch.judge(ended(run, &json)) else { return };
        assert!(
            frames(&figures) > 0,
            "start {seed}: node {node} was frozen for {frozen} ms after {after} ms: {}",
            missed(&figures)
        );
    }
}
