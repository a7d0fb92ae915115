//! What untrusted peers take from a node without certificates, they do not take from its lease holder: memory for messages,
//! and a connection slot.

use std::net::SocketAddr;
use std::process::Stdio;
use std::time::Duration;

use bytes::Bytes;
use hull::question::{Batch, Points, Question, QuestionKind};
use proto::Claim;
use proto::convert::{QuestionWriter, RefusalReason, StreamKnows, claim_to_wire, refusal_of};
use proto::v1::{self, camera_node_client::CameraNodeClient};
use testkit::{Watch, timely};
use tokio::sync::mpsc;
use tokio::task::JoinSet;
use tokio::time::{Instant, sleep};
use tokio_stream::wrappers::ReceiverStream;
use tonic::transport::{Channel, Endpoint};

use super::ATTACK;
use super::node_port::{call, http2};
use super::room::{Node, named_room, program};

/// Points of a question: more than a pass of a thousand bodies asks at once.
const POINTS: usize = 100_000;
const QUESTIONS: u64 = 20;
const HOLDER: u64 = 0x1234_5678_9abc;
/// A coordinator gives a node so long.
const TIMEOUT: Duration = Duration::from_secs(30);

struct Attacked {
    _node: Node,
    address: SocketAddr,
    _folder: tempfile::TempDir,
}

impl Attacked {
    fn start() -> Attacked {
        let folder = tempfile::tempdir().expect("a folder");
        let cluster = named_room(folder.path(), "", "");
        let mut command = program();
        command.args(["node", "--listen", "127.0.0.1:0", "--host", "left"]).stderr(Stdio::null());
        let node = Node::start_at(command, &cluster, &[]);
        let address = node.address().parse().expect("an address");
        Attacked { _node: node, address, _folder: folder }
    }

    async fn client(&self) -> Option<CameraNodeClient<Channel>> {
        let endpoint = Endpoint::new(format!("http://{}", self.address)).expect("an address");
        let client = CameraNodeClient::new(endpoint.connect().await.ok()?);
        Some(client.max_encoding_message_size(proto::MAX_MESSAGE_BYTES))
    }
}

async fn claim(client: &mut CameraNodeClient<Channel>) -> Result<(), tonic::Status> {
    let claim = Claim { id: HOLDER, name: "stage".into(), term: 1 };
    client.hold(claim_to_wire(claim)).await.map(|_| ())
}

/// Opens a connection with a message of 47 MiB of which only a part is sent, and keeps it open.
async fn half_message(address: SocketAddr, sent_bytes: usize) -> Option<()> {
    let (reply, mut stream) = http2(address).await?.send_request(call(address, "Probe"), false).ok()?;
    let mut announced = vec![0];
    announced.extend_from_slice(&(47u32 << 20).to_be_bytes());
    stream.send_data(announced.into(), false).ok()?;
    let mut left = Bytes::from(vec![7; sent_bytes]);
    while !left.is_empty() {
        stream.reserve_capacity(left.len().min(64 << 10));
        while stream.capacity() == 0 {
            std::future::poll_fn(|context| stream.poll_capacity(context)).await?.ok()?;
        }
        stream.send_data(left.split_to(left.len().min(stream.capacity())), false).ok()?;
    }
    // Ends when the node ends the connection.
    let _ = reply.await;
    Some(())
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn half_sent_messages_cost_the_lease_holder_no_question() {
    let _alone = ATTACK.lock().await;
    let attacked = Attacked::start();
    let mut leader = attacked.client().await.expect("a slot");
    claim(&mut leader).await.expect("free");
    let mut attackers = JoinSet::new();
    for _ in 0..31 {
        let address = attacked.address;
        attackers.spawn(async move {
            loop {
                half_message(address, (22 << 20) / 10).await;
                sleep(Duration::from_millis(50)).await;
            }
        });
    }
    // What they have sent by now is all that they send.
    sleep(Duration::from_secs(3)).await;

    // Without order, so that they cannot be packed.
    let scattered = |at: usize, factor: f64| (at as f64 * factor).fract();
    let point =
        |at| [scattered(at, 0.754_877_666), scattered(at, 0.569_840_291), scattered(at, 0.819_172_513)];
    let points = (0..POINTS).map(point).collect();
    let batches = vec![Batch::all(Points::World(points))];
    let question = Question { kind: QuestionKind::Classes, batches, ..Question::default() };
    let (sender, requests) = mpsc::channel(1);
    let mut replies = leader.probe(ReceiverStream::new(requests)).await.expect("a stream").into_inner();
    let mut refused = Vec::new();
    for id in 0..QUESTIONS {
        let written = QuestionWriter::default().write(&question);
        let message = v1::ProbeRequest { holder: HOLDER, ..written.message(&StreamKnows::default(), id, 0) };
        sender.send(message).await.expect("open");
        let reply = tokio::time::timeout(TIMEOUT, replies.message()).await.expect("in time");
        let reply = reply.expect("no failure").expect("a reply");
        refused.push(refusal_of(&reply));
    }
    attackers.shutdown().await;
    let busy = refused.iter().filter(|reason| **reason == Some(RefusalReason::Busy)).count();
    eprintln!("{busy} of {QUESTIONS} questions were refused as BUSY");
    assert_eq!(busy, 0, "{refused:?}");
}

/// A connection that asks every 1.5 s, and comes back when it was ended.
async fn ask_again_and_again(address: SocketAddr) {
    loop {
        let endpoint = Endpoint::new(format!("http://{address}")).expect("an address");
        if let Ok(channel) = endpoint.connect().await {
            let mut client = CameraNodeClient::new(channel);
            while client.describe(v1::DescribeRequest {}).await.is_ok() {
                sleep(Duration::from_millis(1500)).await;
            }
        }
        sleep(Duration::from_millis(300)).await;
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn connections_that_ask_all_the_time_keep_no_coordinator_out() {
    let _alone = ATTACK.lock().await;
    let watch = Watch::start();
    let attacked = Attacked::start();
    let mut attackers = JoinSet::new();
    for _ in 0..40 {
        attackers.spawn(ask_again_and_again(attacked.address));
    }
    sleep(Duration::from_secs(3)).await;

    let began = Instant::now();
    let mut leader = loop {
        if let Some(mut client) = attacked.client().await
            && claim(&mut client).await.is_ok()
        {
            break client;
        }
        assert!(began.elapsed() < TIMEOUT, "the coordinator is locked out");
        sleep(Duration::from_millis(100)).await;
    };
    let took = began.elapsed();
    eprintln!("the coordinator was admitted after {took:?}");
    timely!(watch, took < Duration::from_secs(10), "admitted after {took:?}");
    // Once it holds the lease, its connection is never ended for another.
    for _ in 0..20 {
        claim(&mut leader).await.expect("the same connection goes on");
        sleep(Duration::from_millis(250)).await;
    }
    attackers.shutdown().await;
}
