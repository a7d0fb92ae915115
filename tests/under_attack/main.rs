//! Rooms under attack: untrusted peers do all at once what the fault model lists, at every port, while a coordinator holds
//! the lease. No process grows much, and the run misses next to nothing.

#![allow(clippy::disallowed_macros, reason = "a test says what it measured")]

#[path = "../shared/announcements.rs"]
mod announcements;
#[path = "../shared/certified.rs"]
mod certified;
mod counts;
mod handshakes;
mod lease_holder;
#[path = "../shared/namespace.rs"]
mod namespace;
mod node_port;
mod page_port;
#[path = "../shared/room.rs"]
mod room;

use std::fs::{self, File};
use std::net::SocketAddr;
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use announcements::{Announcer, instance, new_hosts};
use certified::issue;
use counts::{Count, check_made};
use namespace::Host;
use net::{Authority, Identity, Validity};
use proto::v1::{self, camera_node_client::CameraNodeClient};
use room::{Node, Running, ask_to_end, await_leader, coordinator, ended, named_room, program};
use testkit::{Watch, timely};
use tokio::io::AsyncWriteExt as _;
use tokio::net::TcpStream;
use tokio::sync::Mutex;
use tokio::task::JoinSet;
use tokio::time::{Instant, sleep};

/// How long, seconds; more by this variable.
const SECONDS: &str = "60";
const SECONDS_VARIABLE: &str = "HULLTOUCH_ATTACK_S";
/// What a process may grow by.
const MOST_GROWN_MIB: u64 = 100;
/// The share of its frames that a run may miss.
const MOST_MISSED: f64 = 0.01;
/// Ticks of the clock of `/proc` in a second.
const TICKS_PER_S: f64 = 100.0;

static SILENT_SOCKETS: Count = Count::new("silent sockets");
static SLOW_BYTES: Count = Count::new("slow bytes");
static ANNOUNCEMENTS: Count = Count::new("announcements");

/// One attack at a time: they would take each other's processor.
static ATTACK: Mutex<()> = Mutex::const_new(());

fn attack_s() -> Duration {
    let text = std::env::var(SECONDS_VARIABLE).unwrap_or_else(|_| SECONDS.into());
    let seconds = text.parse().unwrap_or_else(|_| panic!("{SECONDS_VARIABLE} is {text:?}, expected seconds"));
    Duration::from_secs(seconds)
}

/// A process under attack, and what it had and used before.
struct Victim {
    name: &'static str,
    process: u32,
    before_mib: u64,
    before_s: f64,
}

impl Victim {
    fn new(name: &'static str, process: u32) -> Victim {
        Victim { name, process, before_mib: memory_mib(process, "VmRSS:"), before_s: processor_s(process) }
    }

    /// How much more memory it has had at most.
    fn grown_mib(&self) -> u64 {
        memory_mib(self.process, "VmHWM:").saturating_sub(self.before_mib)
    }

    /// Says what the attack cost it.
    fn check(&self, attack: Duration) {
        let (grown_mib, used_s) = (self.grown_mib(), processor_s(self.process) - self.before_s);
        eprintln!(
            "{}: grew by {grown_mib} MiB, used {:.2} processors",
            self.name,
            used_s / attack.as_secs_f64()
        );
        assert!(grown_mib <= MOST_GROWN_MIB, "{} grew by {grown_mib} MiB", self.name);
    }
}

/// A line of what the system says of a process's memory, MiB.
fn memory_mib(process: u32, line: &str) -> u64 {
    let status = fs::read_to_string(format!("/proc/{process}/status")).expect("it runs");
    let line = status.lines().find_map(|found| found.strip_prefix(line)).expect("in every status");
    let kib: u64 = line.trim_matches(|c: char| !c.is_ascii_digit()).parse().expect("a number");
    kib / 1024
}

/// The time for which a process has computed.
fn processor_s(process: u32) -> f64 {
    let stat = fs::read_to_string(format!("/proc/{process}/stat")).expect("it runs");
    let (_, after_name) = stat.rsplit_once(") ").expect("in every stat");
    let ticks = after_name.split(' ').skip(11).take(2).map(|ticks| ticks.parse::<f64>().expect("a number"));
    ticks.sum::<f64>() / TICKS_PER_S
}

/// A run with its page, and where that listens; it says so in this file.
fn start_with_page(mut command: Command, said: &Path) -> (Running, SocketAddr) {
    let running = Running::start(command.stderr(File::create(said).expect("created")));
    let by = std::time::Instant::now() + Duration::from_secs(60);
    loop {
        let text = fs::read_to_string(said).expect("text");
        let page = text.lines().find_map(|line| line.strip_prefix("page: http://")?.strip_suffix('/'));
        if let Some(address) = page {
            return (running, address.parse().expect("an address"));
        }
        assert!(std::time::Instant::now() < by, "it says nothing of its page: {text}");
        std::thread::sleep(Duration::from_millis(20));
    }
}

/// The run's figures are those of an undisturbed one.
fn check_run(watch: &Watch, running: Running, json: &Path, attack: Duration) {
    ask_to_end(&running);
    let Some(figures) = watch.judge(ended(running, json)) else { return };
    let frames = figures["frames"].as_u64().expect("a count");
    let missed = figures["missed"]["frames"].as_u64().expect("a count");
    eprintln!("{missed} of {frames} frames missed; a step took {}", figures["step_ms"]);
    let (least, most) = (9.0 * attack.as_secs_f64(), MOST_MISSED * frames as f64);
    timely!(watch, frames as f64 >= least, "{frames} frames, missed {}", figures["missed"]);
    timely!(watch, missed as f64 <= most, "{missed} of {frames} frames missed: {}", figures["missed"]);
}

/// Longer than the attack and what comes before: then it is asked to end.
fn run_s(attack: Duration) -> String {
    (attack + Duration::from_secs(100)).as_secs().to_string()
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_room_goes_on_under_attack() {
    let _alone = ATTACK.lock().await;
    let watch = Watch::start();
    let folder = tempfile::tempdir().expect("a folder");
    let unbound = named_room(folder.path(), "", "");
    let nodes = ["left", "right"].map(|name| node(&unbound, name));
    let [left, right] = [&nodes[0], &nodes[1]].map(|node| format!("address = {:?}", node.address()));
    let cluster = named_room(folder.path(), &left, &right);
    let json = folder.path().join("out.json");
    let attack = attack_s();
    let mut command = coordinator(program(), &cluster, &run_s(attack), &json);
    command.args(["--headless", "--listen", "127.0.0.1:0"]);
    let said = folder.path().join("said");
    let starting = tokio::task::spawn_blocking(move || start_with_page(command, &said));
    let (running, page) = starting.await.expect("starts");
    let status = move || {
        let mut command = program();
        command.arg("status").arg(&cluster);
        command
    };
    tokio::task::spawn_blocking(move || await_leader(status)).await.expect("the lease is held");

    let victims = [("left", nodes[0].id()), ("right", nodes[1].id()), ("coordinator", running.id())];
    let victims = victims.map(|(name, process)| Victim::new(name, process));
    let until = Instant::now() + attack;
    let mut peers = JoinSet::new();
    for node in &nodes {
        node_port::attack(&mut peers, node.address().parse().expect("an address"), until);
    }
    page_port::attack(&mut peers, page, until);
    peers.join_all().await;
    check_made(&watch, &[&SILENT_SOCKETS, &SLOW_BYTES, &node_port::HALF_MESSAGE_BYTES, &node_port::RESETS]);
    check_made(
        &watch,
        &[&node_port::ANNOUNCED, &page_port::PING_BYTES, &page_port::REQUESTS, &page_port::GUESSES],
    );
    victims.iter().for_each(|victim| victim.check(attack));
    tokio::task::spawn_blocking(move || check_run(&watch, running, &json, attack)).await.expect("ends");
}

/// The node has no lease holder, so that it reads dear questions.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_node_without_a_lease_holder_stays_small() {
    let _alone = ATTACK.lock().await;
    let watch = Watch::start();
    let folder = tempfile::tempdir().expect("a folder");
    let node = node(&named_room(folder.path(), "", ""), "left");
    let address: SocketAddr = node.address().parse().expect("an address");
    let (victim, attack) = (Victim::new("left", node.id()), attack_s() / 4);
    let mut peers = JoinSet::new();
    node_port::attack(&mut peers, address, Instant::now() + attack);
    peers.join_all().await;
    check_made(&watch, &[&SILENT_SOCKETS, &SLOW_BYTES, &node_port::HALF_MESSAGE_BYTES, &node_port::RESETS]);
    check_made(&watch, &[&node_port::ANNOUNCED, &node_port::QUESTIONS]);
    victim.check(attack);
    // It is as well as before.
    let mut client = CameraNodeClient::connect(format!("http://{address}")).await.expect("gets in");
    let described = client.describe(v1::DescribeRequest {}).await.expect("answers");
    assert_eq!(described.get_ref().cameras.len(), 2);
}

/// Nodes are found by DNS-SD, and one machine of their network does what it can without a certificate.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_room_with_certificates_goes_on_under_attack_from_its_network() {
    let _alone = ATTACK.lock().await;
    let host = match Host::new(1000) {
        Ok(host) => host,
        Err(why) => return testkit::skip(format_args!("no network namespaces: {why}")),
    };
    let watch = Watch::start();
    let folder = tempfile::tempdir().expect("a folder");
    let (path, cluster) = (folder.path().to_owned(), named_room(folder.path(), "", ""));
    let authority = Authority::make(certified::ROOM, Validity::days(30)).expect("an authority");
    let identities = ["left", "right"].map(|name| (name, Identity::node(certified::ROOM, name)));
    for (name, owner) in identities.iter().chain([&("coordinator", Identity::coordinator(certified::ROOM))]) {
        issue(&path.join(name), &authority, owner, Validity::days(30));
    }
    let there = |arguments: &[&str]| {
        let mut command = host.command(&program());
        command.args(arguments).current_dir(&path).stderr(Stdio::null());
        command
    };
    let nodes = [("left", "0.0.0.0:7001"), ("right", "0.0.0.0:7002")].map(|(name, listens)| {
        let node = there(&["node", "--certs", name, "--host", name, "--listen", listens]);
        Node::start_at(node, &cluster, &[])
    });
    let announcer = Announcer::beside(&host);
    let (attack, is_over) = (attack_s(), Arc::new(AtomicBool::new(false)));
    let announcing = std::thread::spawn({
        let is_over = Arc::clone(&is_over);
        move || announce_until(&announcer, &is_over)
    });

    let json = path.join("out.json");
    let mut command = coordinator(host.command(&program()), &cluster, &run_s(attack), &json);
    command.args(["--certs", "coordinator", "--headless", "--listen", "0.0.0.0:7443"]).current_dir(&path);
    let running = Running::start(&mut command);
    tokio::task::block_in_place(|| {
        await_leader(|| {
            let mut command = there(&["status"]);
            command.arg(&cluster).args(["--certs", "coordinator"]);
            command
        });
    });
    let victims = [("left", nodes[0].id()), ("right", nodes[1].id()), ("coordinator", running.id())];
    let victims = victims.map(|(name, process)| Victim::new(name, process));
    let (until, hello) = (Instant::now() + attack, handshakes::client_hello(&path).await);
    let mut peers = JoinSet::new();
    for port in [7001, 7002, 7443] {
        let address = SocketAddr::from((host.address, port));
        handshakes::replay(&mut peers, &hello, address, until);
        peers.spawn(again(until, move || silent_sockets(address, 100)));
        (0..20).for_each(|_| drop(peers.spawn(again(until, move || a_byte_a_second(address)))));
    }
    peers.join_all().await;
    is_over.store(true, Ordering::Relaxed);
    announcing.join().expect("ends");
    check_made(&watch, &[&SILENT_SOCKETS, &SLOW_BYTES, &handshakes::REPLAYS, &ANNOUNCEMENTS]);
    victims.iter().for_each(|victim| victim.check(attack));
    tokio::task::spawn_blocking(move || check_run(&watch, running, &json, attack)).await.expect("ends");
}

/// Addresses of ever new hosts, and instances of both nodes at ports where nothing listens: 134 KB a second.
fn announce_until(announcer: &Announcer, is_over: &AtomicBool) {
    for number in 0.. {
        if is_over.load(Ordering::Relaxed) {
            return;
        }
        announcer.flood(13_400, 134_000, |part| new_hosts(number * 100 + part));
        for node in ["left", "right"] {
            announcer.send(&instance(node, number, announcer.address, 20_000 + (number % 1000) as u16));
        }
        ANNOUNCEMENTS.add(1);
    }
}

fn node(cluster: &Path, name: &str) -> Node {
    let mut command = program();
    command.args(["node", "--listen", "127.0.0.1:0", "--host", name]).stderr(Stdio::null());
    Node::start_at(command, cluster, &[])
}

/// Begins an attack again when the server has ended it.
async fn again<F: Future<Output = Option<()>> + Send>(until: Instant, attack: impl Fn() -> F + Send) {
    while Instant::now() < until {
        let _ = tokio::time::timeout_at(until, attack()).await;
        sleep(Duration::from_millis(20)).await;
    }
}

async fn silent_sockets(address: SocketAddr, count: usize) -> Option<()> {
    let mut sockets = Vec::with_capacity(count);
    for _ in 0..count {
        sockets.push(TcpStream::connect(address).await.ok()?);
        SILENT_SOCKETS.add(1);
        sleep(Duration::from_millis(2)).await;
    }
    sleep(Duration::from_secs(2)).await;
    Some(())
}

async fn a_byte_a_second(address: SocketAddr) -> Option<()> {
    let mut socket = TcpStream::connect(address).await.ok()?;
    for byte in b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n" {
        socket.write_all(&[*byte]).await.ok()?;
        SLOW_BYTES.add(1);
        sleep(Duration::from_secs(1)).await;
    }
    Some(())
}
