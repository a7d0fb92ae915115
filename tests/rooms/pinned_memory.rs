//! What untrusted peers can make a node hold by calls that they never end, by streams on which nothing more comes, and by messages
//! that grow when they are decoded: no more than all connections may hold together. Each by itself, so that none gives way
//! to another.

#![allow(clippy::disallowed_macros, reason = "a test says what it measured")]

use std::net::SocketAddr;
use std::process::Stdio;
use std::time::Duration;

use crate::room::{Node, named_room, program};
use bytes::{BufMut as _, Bytes, BytesMut};
use h2::SendStream;
use h2::client::{ResponseFuture, SendRequest};
use proto::v1::{self, camera_node_client::CameraNodeClient};
use tokio::net::TcpStream;
use tokio::task::JoinSet;

/// What a node may grow by.
const MOST_GROWN_MIB: u64 = 100;
/// As many streams and connections as one machine may have.
const STREAMS: usize = 16;
const CONNECTIONS: usize = 4;
/// Nearly the longest message of a call.
const LONG_BYTES: usize = 47 << 20;

/// A node without a coordinator: it reads what untrusted peers send.
struct Attacked {
    node: Node,
    address: SocketAddr,
    before_kib: u64,
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
        let before_kib = memory_kib(&node, "VmRSS:");
        Attacked { node, address, before_kib, _folder: folder }
    }

    /// It is small, and as well as before.
    async fn check(self) {
        let grown_mib = (memory_kib(&self.node, "VmHWM:") - self.before_kib) / 1024;
        eprintln!("the node grew by {grown_mib} MiB");
        assert!(grown_mib <= MOST_GROWN_MIB, "the node grew by {grown_mib} MiB");
        let mut client =
            CameraNodeClient::connect(format!("http://{}", self.address)).await.expect("gets in");
        let described = client.describe(v1::DescribeRequest {}).await.expect("answers");
        assert_eq!(described.get_ref().cameras.len(), 2);
    }
}

fn memory_kib(node: &Node, line: &str) -> u64 {
    let status = std::fs::read_to_string(format!("/proc/{}/status", node.id())).expect("it runs");
    let line = status.lines().find_map(|found| found.strip_prefix(line)).expect("in every status");
    line.trim_matches(|c: char| !c.is_ascii_digit()).parse().expect("a number")
}

type Requests = SendRequest<Bytes>;

async fn http2(address: SocketAddr) -> Option<Requests> {
    let socket = TcpStream::connect(address).await.ok()?;
    let (requests, connection) = h2::client::handshake(socket).await.ok()?;
    tokio::spawn(connection);
    requests.ready().await.ok()
}

async fn call(
    requests: &Requests,
    address: SocketAddr,
    name: &str,
) -> Option<(ResponseFuture, SendStream<Bytes>)> {
    let request = http::Request::post(format!("http://{address}/hulltouch.v1.CameraNode/{name}"));
    let request =
        request.header("content-type", "application/grpc").header("te", "trailers").body(()).ok()?;
    requests.clone().ready().await.ok()?.send_request(request, false).ok()
}

/// Sends a whole message, and leaves the call open.
async fn send(stream: &mut SendStream<Bytes>, message: &Bytes) -> Option<()> {
    let mut framed = BytesMut::with_capacity(message.len() + 5);
    framed.put_u8(0);
    framed.put_u32(message.len() as u32);
    framed.put_slice(message);
    let mut left = framed.freeze();
    while !left.is_empty() {
        stream.reserve_capacity(left.len().min(64 << 10));
        while stream.capacity() == 0 {
            std::future::poll_fn(|context| stream.poll_capacity(context)).await?.ok()?;
        }
        let part = left.split_to(left.len().min(stream.capacity()));
        stream.send_data(part, false).ok()?;
    }
    Some(())
}

/// A message on every stream of every connection, one after the other; returns how many were sent whole. What was sent
/// stays as it is for a while.
async fn on_all_streams(address: SocketAddr, name: &'static str, message: Bytes) -> usize {
    let mut connections = JoinSet::new();
    for _ in 0..CONNECTIONS {
        let message = message.clone();
        connections.spawn(async move {
            let Some(requests) = http2(address).await else { return 0 };
            let mut open = Vec::new();
            let mut whole = 0;
            for _ in 0..STREAMS {
                let Some((reply, mut stream)) = call(&requests, address, name).await else { break };
                if send(&mut stream, &message).await.is_none() {
                    break;
                }
                whole += 1;
                open.push((reply, stream));
            }
            tokio::time::sleep(Duration::from_secs(1)).await;
            whole
        });
    }
    connections.join_all().await.into_iter().sum()
}

/// Fields of a message, each without content.
fn empty_entries(field: u8, bytes: usize) -> Bytes {
    [field << 3 | 2, 0].repeat(bytes / 2).into()
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn calls_that_are_never_ended_hold_no_more_than_all_may() {
    let attacked = Attacked::start();
    // Field 15 is none: what is whole is decoded, and nothing is made of it.
    let mut message = BytesMut::from(&[15 << 3 | 2][..]);
    let mut length = LONG_BYTES as u64;
    while length >= 0x80 {
        message.put_u8(length as u8 | 0x80);
        length >>= 7;
    }
    message.put_u8(length as u8);
    message.put_bytes(7, LONG_BYTES);
    let whole = on_all_streams(attacked.address, "RegisterShapes", message.freeze()).await;
    assert!(whole > 0, "nothing was taken");
    attacked.check().await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn streams_that_fall_silent_hold_no_more_than_all_may() {
    let attacked = Attacked::start();
    // A question about bodies that are not registered: it is refused.
    let message = v1::ProbeRequest {
        bodies: Some(v1::Bodies { shapes: vec![0; 40 << 20].into(), ..v1::Bodies::default() }),
        ..v1::ProbeRequest::default()
    };
    let message = prost::Message::encode_to_vec(&message).into();
    let whole = on_all_streams(attacked.address, "Probe", message).await;
    assert!(whole > 0, "nothing was taken");
    attacked.check().await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn entries_without_content_are_counted_before_they_are_decoded() {
    let attacked = Attacked::start();
    // 24 million shapes, and cameras.
    for (name, field) in [("RegisterShapes", 1), ("Probe", 13)] {
        let requests = http2(attacked.address).await.expect("gets in");
        let (reply, mut stream) = call(&requests, attacked.address, name).await.expect("calls");
        let message = match name {
            "Probe" => Bytes::from([field << 3, 1].repeat(LONG_BYTES / 2)),
            _ => empty_entries(field, LONG_BYTES),
        };
        send(&mut stream, &message).await.expect("it is within the limit of its call");
        stream.send_data(Bytes::new(), true).expect("open");
        let reply = reply.await.expect("answers");
        let status = match reply.headers().get("grpc-status") {
            Some(status) => status.clone(),
            None => trailers(reply).await.get("grpc-status").expect("a status").clone(),
        };
        assert_eq!(status, (tonic::Code::InvalidArgument as i32).to_string().as_str(), "{name}");
    }
    attacked.check().await;
}

async fn trailers(reply: http::Response<h2::RecvStream>) -> http::HeaderMap {
    let mut body = reply.into_body();
    while let Some(data) = body.data().await {
        let data = data.expect("data");
        body.flow_control().release_capacity(data.len()).expect("open");
    }
    body.trailers().await.expect("trailers").expect("some")
}
