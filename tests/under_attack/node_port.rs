//! What untrusted peers do at a node's port without certificates.

use std::net::SocketAddr;

use bytes::Bytes;
use h2::client::SendRequest;
use proto::convert::{shape_key, shape_to_wire};
use proto::v1::{self, camera_node_client::CameraNodeClient};
use tokio::net::TcpStream;
use tokio::task::JoinSet;
use tokio::time::Instant;

use super::counts::Count;
use super::{a_byte_a_second, again, silent_sockets};

pub static HALF_MESSAGE_BYTES: Count = Count::new("bytes of half messages");
pub static RESETS: Count = Count::new("calls reset");
pub static ANNOUNCED: Count = Count::new("lengths announced");
pub static QUESTIONS: Count = Count::new("dear questions");

/// All at once, until then.
pub fn attack(peers: &mut JoinSet<()>, address: SocketAddr, until: Instant) {
    (0..13).for_each(|_| drop(peers.spawn(again(until, move || half_messages(address, until)))));
    (0..4).for_each(|_| drop(peers.spawn(again(until, move || silent_sockets(address, 100)))));
    (0..20).for_each(|_| drop(peers.spawn(again(until, move || a_byte_a_second(address)))));
    peers.spawn(again(until, move || resets(address)));
    peers.spawn(again(until, move || too_long(address)));
    (0..4).for_each(|_| drop(peers.spawn(again(until, move || dear_questions(address, until)))));
}

type Requests = SendRequest<Bytes>;

pub async fn http2(address: SocketAddr) -> Option<Requests> {
    let socket = TcpStream::connect(address).await.ok()?;
    let (requests, connection) = h2::client::handshake(socket).await.ok()?;
    tokio::spawn(connection);
    requests.ready().await.ok()
}

pub fn call(address: SocketAddr, name: &str) -> http::Request<()> {
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
                HALF_MESSAGE_BYTES.add(part.len());
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

/// Calls that are taken back at once.
async fn resets(address: SocketAddr) -> Option<()> {
    let mut requests = http2(address).await?;
    for _ in 0..10_000 {
        requests = requests.ready().await.ok()?;
        let (_, mut stream) = requests.send_request(call(address, "Describe"), false).ok()?;
        stream.send_reset(h2::Reason::CANCEL);
        RESETS.add(1);
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
        ANNOUNCED.add(1);
    }
    Some(())
}

/// Short questions about a million samples. The peer reads one answer and leaves the others.
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
            QUESTIONS.add(1);
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
