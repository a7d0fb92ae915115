//! A room under attack: strangers that say nothing, too much, too slowly or never the end, all at once and in clear text, while
//! a coordinator leads the node that they reach. The node stays small and its run misses next to nothing.

#![allow(clippy::disallowed_macros, reason = "a test says what it measured")]

#[path = "shared/room.rs"]
mod room;

use std::net::SocketAddr;
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use bytes::Bytes;
use h2::client::SendRequest;
use proto::convert::{shape_key, shape_to_wire};
use proto::v1::{self, camera_node_client::CameraNodeClient};
use room::{Node, Running, await_leader, coordinator, ended, named_room, program};
use testkit::{Watch, timely};
use tokio::io::AsyncWriteExt as _;
use tokio::net::TcpStream;
use tokio::sync::Mutex;
use tokio::task::JoinSet;
use tokio::time::{Instant, sleep};

/// How long, seconds; more by this variable.
const SECONDS: &str = "60";
const SECONDS_VARIABLE: &str = "HULLTOUCH_STRANGERS_S";
/// What a node may grow by.
const MOST_GROWN_MIB: u64 = 100;
/// The share of its frames that a run may miss.
const MOST_MISSED: f64 = 0.01;
/// What strangers did, so that no attack is one in name alone.
struct Done {
    half_message_bytes: AtomicU64,
    silent_sockets: AtomicU64,
    slow_bytes: AtomicU64,
    resets: AtomicU64,
    announced: AtomicU64,
    questions: AtomicU64,
}

static DONE: Done = Done {
    half_message_bytes: AtomicU64::new(0),
    silent_sockets: AtomicU64::new(0),
    slow_bytes: AtomicU64::new(0),
    resets: AtomicU64::new(0),
    announced: AtomicU64::new(0),
    questions: AtomicU64::new(0),
};

fn did(what: &AtomicU64, much: usize) {
    what.fetch_add(much as u64, Ordering::Relaxed);
}

/// Each kind of attack was made since the last look; questions are read by a node that nobody leads.
fn check_done(is_led: bool) {
    let Done { half_message_bytes, silent_sockets, slow_bytes, resets, announced, questions } = &DONE;
    let kinds = [
        ("half message bytes", half_message_bytes),
        ("silent sockets", silent_sockets),
        ("slow bytes", slow_bytes),
        ("resets", resets),
        ("lengths announced", announced),
        ("questions", questions),
    ];
    let done = kinds.map(|(kind, count)| (kind, count.swap(0, Ordering::Relaxed)));
    eprintln!("{done:?}");
    let is_made = |(kind, count): &(&str, u64)| *count > 0 || (is_led && *kind == "questions");
    assert!(done.iter().all(is_made), "{done:?}");
}

/// One attack at a time: they would take each other's processor.
static ATTACK: Mutex<()> = Mutex::const_new(());

fn seconds() -> u64 {
    let text = std::env::var(SECONDS_VARIABLE).unwrap_or_else(|_| SECONDS.into());
    text.parse().unwrap_or_else(|_| panic!("{SECONDS_VARIABLE} is {text:?}, expected seconds"))
}

/// What a process holds and has held at most, MiB.
fn memory_mib(process: u32, line: &str) -> u64 {
    let status = std::fs::read_to_string(format!("/proc/{process}/status")).expect("it runs");
    let line = status.lines().find_map(|found| found.strip_prefix(line)).expect("in every status");
    let kib: u64 = line.trim_matches(|c: char| !c.is_ascii_digit()).parse().expect("a number");
    kib / 1024
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
    let attack = Duration::from_secs(seconds());
    let lasts = (attack + Duration::from_secs(6)).as_secs().to_string();
    let running = Running::start(&mut coordinator(program(), &cluster, &lasts, &json));
    let led = tokio::task::spawn_blocking(move || await_leader(|| status(&cluster)));
    led.await.expect("led");

    let before = nodes.each_ref().map(|node| memory_mib(node.id(), "VmRSS:"));
    let until = Instant::now() + attack;
    let mut strangers = JoinSet::new();
    // One node leads the run; the other is attacked by those who would lead it, too.
    for node in &nodes {
        let address: SocketAddr = node.address().parse().expect("an address");
        attack_from_all_sides(&mut strangers, address, until);
    }
    strangers.join_all().await;
    check_done(true);
    let grown: Vec<u64> =
        nodes.iter().zip(before).map(|(node, before)| memory_mib(node.id(), "VmHWM:") - before).collect();
    let ended = tokio::task::spawn_blocking(move || ended(running, &json)).await.expect("ends");
    let Some(figures) = watch.judge(ended) else { return };
    let frames = figures["frames"].as_u64().expect("a count");
    let missed = figures["missed"]["frames"].as_u64().expect("a count");
    eprintln!("{missed} of {frames} frames missed; the nodes grew by {grown:?} MiB");
    assert!(grown.iter().all(|&mib| mib <= MOST_GROWN_MIB), "the nodes grew by {grown:?} MiB");
    timely!(
        watch,
        frames as f64 >= 9.0 * attack.as_secs_f64(),
        "{frames} frames, missed {}",
        figures["missed"]
    );
    let most = MOST_MISSED * frames as f64;
    timely!(watch, missed as f64 <= most, "{missed} of {frames} frames missed: {}", figures["missed"]);
}

/// Nobody leads this node, so that dear questions are read.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_node_that_nobody_leads_stays_small() {
    let _alone = ATTACK.lock().await;
    let folder = tempfile::tempdir().expect("a folder");
    let node = node(&named_room(folder.path(), "", ""), "left");
    let address: SocketAddr = node.address().parse().expect("an address");
    let before = memory_mib(node.id(), "VmRSS:");
    let until = Instant::now() + Duration::from_secs(seconds() / 4);
    let mut strangers = JoinSet::new();
    attack_from_all_sides(&mut strangers, address, until);
    strangers.join_all().await;
    check_done(false);
    let grown = memory_mib(node.id(), "VmHWM:") - before;
    eprintln!("the node grew by {grown} MiB");
    assert!(grown <= MOST_GROWN_MIB, "the node grew by {grown} MiB");
    // It is as well as before.
    let mut client = CameraNodeClient::connect(format!("http://{address}")).await.expect("gets in");
    let described = client.describe(v1::DescribeRequest {}).await.expect("answers");
    assert_eq!(described.get_ref().cameras.len(), 2);
}

fn status(cluster: &Path) -> Command {
    let mut command = program();
    command.arg("status").arg(cluster);
    command
}

fn node(cluster: &Path, name: &str) -> Node {
    let mut command = program();
    command.args(["node", "--listen", "127.0.0.1:0", "--host", name]).stderr(Stdio::null());
    Node::start_at(command, cluster, &[])
}

fn attack_from_all_sides(strangers: &mut JoinSet<()>, address: SocketAddr, until: Instant) {
    (0..13).for_each(|_| drop(strangers.spawn(again(until, move || half_messages(address, until)))));
    (0..4).for_each(|_| drop(strangers.spawn(again(until, move || silent_sockets(address, 100)))));
    (0..20).for_each(|_| drop(strangers.spawn(again(until, move || a_byte_a_second(address)))));
    strangers.spawn(again(until, move || resets(address)));
    strangers.spawn(again(until, move || too_long(address)));
    (0..4).for_each(|_| drop(strangers.spawn(again(until, move || dear_questions(address, until)))));
}

/// Whoever is thrown out comes back.
async fn again<F: Future<Output = Option<()>> + Send>(until: Instant, attack: impl Fn() -> F + Send) {
    while Instant::now() < until {
        let _ = tokio::time::timeout_at(until, attack()).await;
        sleep(Duration::from_millis(20)).await;
    }
}

type Requests = SendRequest<Bytes>;

async fn http2(address: SocketAddr) -> Option<Requests> {
    let socket = TcpStream::connect(address).await.ok()?;
    let (requests, connection) = h2::client::handshake(socket).await.ok()?;
    tokio::spawn(connection);
    requests.ready().await.ok()
}

fn call(address: SocketAddr, name: &str) -> http::Request<()> {
    let request = http::Request::post(format!("http://{address}/hulltouch.v1.CameraNode/{name}"));
    request.header("content-type", "application/grpc").header("te", "trailers").body(()).expect("valid")
}

/// Sixteen streams, on each a message of 47 MiB that never ends.
async fn half_messages(address: SocketAddr, until: Instant) -> Option<()> {
    let requests = http2(address).await?;
    let mut streams = JoinSet::new();
    for _ in 0..16 {
        let (_, mut stream) =
            requests.clone().ready().await.ok()?.send_request(call(address, "Probe"), false).ok()?;
        streams.spawn(async move {
            let mut announced = vec![0];
            announced.extend_from_slice(&(47u32 << 20).to_be_bytes());
            stream.send_data(announced.into(), false).ok()?;
            let part = Bytes::from(vec![7; 64 << 10]);
            for _ in 0..(46 << 20) / part.len() {
                stream.reserve_capacity(part.len());
                while stream.capacity() < part.len() {
                    std::future::poll_fn(|context| stream.poll_capacity(context)).await?.ok()?;
                }
                stream.send_data(part.clone(), false).ok()?;
                did(&DONE.half_message_bytes, part.len());
            }
            tokio::time::sleep_until(until).await;
            Some(())
        });
    }
    while let Some(ended) = streams.join_next().await {
        // Thrown out: all others are, too.
        ended.ok()??;
    }
    Some(())
}

async fn silent_sockets(address: SocketAddr, count: usize) -> Option<()> {
    let mut sockets = Vec::with_capacity(count);
    for _ in 0..count {
        sockets.push(TcpStream::connect(address).await.ok()?);
        did(&DONE.silent_sockets, 1);
        sleep(Duration::from_millis(2)).await;
    }
    sleep(Duration::from_secs(2)).await;
    Some(())
}

async fn a_byte_a_second(address: SocketAddr) -> Option<()> {
    let mut socket = TcpStream::connect(address).await.ok()?;
    for byte in b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n" {
        socket.write_all(&[*byte]).await.ok()?;
        did(&DONE.slow_bytes, 1);
        sleep(Duration::from_secs(1)).await;
    }
    Some(())
}

/// Calls that are taken back at once.
async fn resets(address: SocketAddr) -> Option<()> {
    let mut requests = http2(address).await?;
    for _ in 0..10_000 {
        requests = requests.ready().await.ok()?;
        let (_, mut stream) = requests.send_request(call(address, "Describe"), false).ok()?;
        stream.send_reset(h2::Reason::CANCEL);
        did(&DONE.resets, 1);
    }
    Some(())
}

/// 4 GiB announced.
async fn too_long(address: SocketAddr) -> Option<()> {
    let mut requests = http2(address).await?;
    for name in ["RegisterShapes", "Probe", "KeepWorld", "Describe"] {
        requests = requests.ready().await.ok()?;
        let (reply, mut stream) = requests.send_request(call(address, name), false).ok()?;
        stream.send_data(Bytes::from_static(&[0, 0xff, 0xff, 0xff, 0xff]), false).ok()?;
        // Refused at the announcement: nothing else is sent.
        reply.await.ok()?;
        did(&DONE.announced, 1);
    }
    Some(())
}

/// Short questions about a million samples whose answers nobody reads.
async fn dear_questions(address: SocketAddr, until: Instant) -> Option<()> {
    let endpoint = tonic::transport::Endpoint::new(format!("http://{address}")).ok()?;
    let channel = endpoint.initial_stream_window_size(1024).connect().await.ok()?;
    let mut client = CameraNodeClient::new(channel).max_encoding_message_size(proto::MAX_MESSAGE_BYTES);
    let samples = (0..1_000_000).map(|at| [at as f32 * 1e-6, 0.0, 0.0]).collect();
    let shape = hull::Shape::new(samples).ok()?;
    let key = shape_key(&shape.digest());
    let request = v1::RegisterShapesRequest { shapes: vec![shape_to_wire(&shape)], holder: 0 };
    // Refused while the node is held.
    let _ = client.register_shapes(request).await;
    let mut streams = JoinSet::new();
    for _ in 0..8 {
        let mut client = client.clone();
        streams.spawn(async move {
            let questions = (0..200).map(move |id| dear_question(id, key));
            let mut replies = client.probe(tokio_stream::iter(questions)).await.ok()?.into_inner();
            // The first is read, so that one was answered; no other is.
            replies.message().await.ok()??;
            did(&DONE.questions, 1);
            tokio::time::sleep_until(until).await;
            drop(replies);
            Some(())
        });
    }
    streams.join_all().await;
    Some(())
}

fn dear_question(id: u64, key: u64) -> v1::ProbeRequest {
    let plain = |bytes: &[u8]| Bytes::from([&[0], bytes].concat());
    let pose: Vec<u8> =
        [0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0f64].iter().flat_map(|part| part.to_le_bytes()).collect();
    let bodies = v1::Bodies { shapes: plain(&key.to_le_bytes()), poses: pose.into(), world: vec![] };
    // A choice of runs: none left out, a million taken.
    let all = Bytes::from_static(&[2, 0, 0xc0, 0x84, 0x3d]);
    v1::ProbeRequest {
        id,
        bodies: Some(bodies),
        points: Some(v1::Points { picked: Some(all.clone()), kept: Some(all) }),
        kind: v1::probe_request::Kind::Edges.into(),
        ..v1::ProbeRequest::default()
    }
}
