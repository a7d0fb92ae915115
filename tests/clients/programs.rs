//! What programs get from a running demo: gRPC, JSON over WebSocket, OSC.

use std::net::UdpSocket;
use std::time::Duration;

use crate::demo::{Demo, TOKEN};
use futures::{SinkExt as _, StreamExt as _};
use proto::v1;
use proto::v1::world_client::WorldClient;
use serde_json::{Value, json};
use tokio_tungstenite::tungstenite::Message;
use tonic::transport::Channel;
use tonic::{Code, Request};

const TIMEOUT: Duration = Duration::from_secs(60);

/// A client of a run that has begun: the page's port answers a little earlier.
async fn client(demo: &Demo) -> WorldClient<Channel> {
    let mut client = WorldClient::connect(format!("http://{}", demo.address)).await.expect("connects");
    let begins = async {
        while let Err(status) = client.describe(v1::DescribeWorldRequest {}).await {
            assert_eq!(status.code(), Code::Unavailable, "{status}");
            tokio::time::sleep(Duration::from_millis(5)).await;
        }
    };
    tokio::time::timeout(TIMEOUT, begins).await.expect("in time");
    client
}

fn steering<T>(message: T) -> Request<T> {
    let mut request = Request::new(message);
    let token = format!("Bearer {TOKEN}").parse().expect("plain text");
    request.metadata_mut().insert("authorization", token);
    request
}

fn vector(x: f64, y: f64, z: f64) -> Option<v1::Vector> {
    Some(v1::Vector { x, y, z })
}

fn ball(radius: f64) -> Option<v1::BodyShape> {
    let kind = v1::body_shape::Kind::Ball(v1::body_shape::Ball { radius });
    Some(v1::BodyShape { kind: Some(kind) })
}

/// The next state that is as asked.
async fn state(
    states: &mut tonic::Streaming<v1::WorldState>,
    is_it: impl Fn(&v1::WorldState) -> bool,
) -> v1::WorldState {
    let search = async {
        loop {
            let state = states.message().await.expect("it goes on").expect("it goes on");
            if is_it(&state) {
                return state;
            }
        }
    };
    tokio::time::timeout(TIMEOUT, search).await.expect("in time")
}

fn body(state: &v1::WorldState, id: u32) -> Option<&v1::BodyState> {
    state.bodies.iter().find(|body| body.id == id)
}

fn height(state: &v1::WorldState, id: u32) -> f64 {
    body(state, id).and_then(|body| body.position).expect("a place").y
}

#[tokio::test]
async fn a_program_follows_and_steers_over_grpc() {
    let demo = Demo::start(&[]);
    let mut client = client(&demo).await;
    let viewer = client.describe(v1::DescribeWorldRequest {}).await.expect("described").into_inner();
    assert_eq!((&viewer.scene[..], viewer.may_steer, viewer.bodies.len()), ("topple", false, 12));
    let controller = client.describe(steering(v1::DescribeWorldRequest {})).await.expect("described");
    assert!(controller.into_inner().may_steer);
    for refused in [client.pause(v1::PauseRequest {}).await, client.reset(v1::ResetRequest {}).await] {
        assert_eq!(refused.expect_err("a viewer").code(), Code::PermissionDenied);
    }
    let follow = v1::FollowRequest { rate_hz: 60.0, touches: false };
    let mut states = client.follow(follow).await.expect("followed").into_inner();

    let spawn = v1::SpawnRequest { shape: ball(0.1), position: vector(1.2, 1.0, 1.2), ..Default::default() };
    let id = client.spawn(steering(spawn.clone())).await.expect("spawned").into_inner().body;
    state(&mut states, |state| body(state, id).is_some() && height(state, id) < 0.5).await;
    let nowhere = v1::SpawnRequest { position: None, ..spawn.clone() };
    let refused = client.spawn(steering(nowhere)).await.expect_err("no place");
    assert_eq!(
        (refused.code(), refused.message()),
        (Code::InvalidArgument, "position is missing, expected a vector")
    );
    let taken = v1::SpawnRequest { name: "left_0".into(), ..spawn };
    let refused = client.spawn(steering(taken)).await.expect_err("a name twice");
    assert_eq!(
        (refused.code(), refused.message()),
        (Code::FailedPrecondition, "name: `left_0`, expected one that no body has")
    );

    let grab = v1::GrabRequest { body: id, grip: None, target: vector(1.2, 1.4, 1.2) };
    client.grab(steering(grab)).await.expect("held");
    let held = state(&mut states, |state| (height(state, id) - 1.4).abs() < 0.02).await;
    assert!(body(&held, id).expect("there").grabbed);
    let throw = v1::ReleaseRequest { body: id, velocity: vector(0.0, 4.0, 0.0) };
    client.release(steering(throw)).await.expect("thrown");
    state(&mut states, |state| height(state, id) > 1.9).await;

    client.pause(steering(v1::PauseRequest {})).await.expect("paused");
    let paused = state(&mut states, |state| state.paused).await;
    client.step(steering(v1::StepRequest { steps: 5 })).await.expect("counted");
    state(&mut states, |state| state.paused && state.step == paused.step + 5).await;
    client.remove(steering(v1::RemoveRequest { body: id })).await.expect("gone");
    state(&mut states, |state| body(state, id).is_none()).await;
    let refused = client.remove(steering(v1::RemoveRequest { body: id })).await.expect_err("twice");
    assert_eq!(refused.message(), format!("there is no body {id}"));
    client.reset(steering(v1::ResetRequest {})).await.expect("again");
    let again = state(&mut states, |state| state.generation == 1).await;
    assert_eq!((again.step, again.bodies.len()), (0, 12));
    client.resume(steering(v1::ResumeRequest {})).await.expect("resumed");
    state(&mut states, |state| state.step > 10).await;
    let set =
        v1::Parameters { gravity: vector(0.0, 0.0, 0.0), answers_hull: Some(false), ..Default::default() };
    client.set_parameters(steering(set)).await.expect("set");
    let now = client.describe(v1::DescribeWorldRequest {}).await.expect("described").into_inner();
    let parameters = now.parameters.expect("all of them");
    assert_eq!((parameters.gravity, parameters.answers_hull), (vector(0.0, 0.0, 0.0), Some(false)));
}

#[tokio::test]
async fn a_follower_gets_states_at_the_rate_it_asked_for() {
    let demo = Demo::start(&[]);
    let mut client = client(&demo).await;
    for wrong in [-1.0, 121.0, f64::NAN] {
        let follow = v1::FollowRequest { rate_hz: wrong, touches: false };
        assert_eq!(client.follow(follow).await.expect_err("no rate").code(), Code::InvalidArgument);
    }
    let mut states = client
        .follow(v1::FollowRequest { rate_hz: 10.0, touches: false })
        .await
        .expect("followed")
        .into_inner();
    let first = state(&mut states, |state| state.step > 0).await;
    let mut last = first.clone();
    for _ in 0..20 {
        last = state(&mut states, |_| true).await;
    }
    let film_s = last.film_s - first.film_s;
    // A busy machine may skip ticks, but none comes early.
    assert!(film_s > 1.5, "20 states of 10 a second in {film_s} s");
}

/// Another program of the same machine, which offers wrong tokens without end.
async fn guess(mut client: WorldClient<Channel>) {
    loop {
        let mut request = Request::new(v1::PauseRequest {});
        request
            .metadata_mut()
            .insert("authorization", "Bearer not-the-right-token".parse().expect("plain text"));
        let refused = client.pause(request).await.expect_err("a wrong token");
        assert_eq!(refused.code(), Code::PermissionDenied);
    }
}

#[tokio::test]
async fn a_program_that_has_shown_its_token_steers_while_others_guess_it() {
    let demo = Demo::start(&[]);
    let mut client = client(&demo).await;
    client.pause(steering(v1::PauseRequest {})).await.expect("paused");
    let guessers: Vec<_> = futures::future::join_all((0..8).map(|_| self::client(&demo))).await;
    let guessing: Vec<_> = guessers.into_iter().map(|client| tokio::spawn(guess(client))).collect();
    // Until all turns of this machine are taken for seconds.
    tokio::time::sleep(Duration::from_secs(3)).await;
    for _ in 0..100 {
        client.step(steering(v1::StepRequest { steps: 1 })).await.expect("stepped");
    }
    assert!(guessing.iter().all(|guessing| !guessing.is_finished()));
    guessing.iter().for_each(tokio::task::JoinHandle::abort);
}

#[tokio::test]
async fn a_program_that_follows_never_gives_way_to_others_that_ask() {
    use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
    let demo = Demo::start(&[]);
    let mut client = client(&demo).await;
    let follow = v1::FollowRequest { rate_hz: 60.0, touches: false };
    let mut states = client.follow(follow).await.expect("followed").into_inner();
    let request = format!("GET /nothing HTTP/1.1\r\nHost: {}\r\n\r\n", demo.address);
    let mut others = Vec::new();
    for _ in 0..80 {
        let mut other = tokio::net::TcpStream::connect(&demo.address).await.expect("connects");
        other.write_all(request.as_bytes()).await.expect("sent");
        let mut answer = [0; 12];
        other.read_exact(&mut answer).await.expect("answered");
        assert_eq!(&answer, b"HTTP/1.1 404");
        others.push(other);
    }
    // The first of them gave way; the program, which came before it, did not.
    let mut rest = Vec::new();
    let ended = tokio::time::timeout(TIMEOUT, others[0].read_to_end(&mut rest)).await;
    assert!(ended.is_ok(), "the first that asked is there still");
    let now = state(&mut states, |_| true).await;
    state(&mut states, |state| state.step > now.step + 10).await;
}

#[tokio::test]
async fn a_program_follows_and_steers_over_json() {
    let demo = Demo::start(&[]);
    let open = async |query: &str| {
        let address = format!("ws://{}/state?{query}", demo.address);
        tokio_tungstenite::connect_async(address).await.expect("connects").0
    };
    let mut viewer = open("rate=20").await;
    let mut controller = open(&format!("rate=60&token={TOKEN}")).await;
    let ask = |id: u64, mut command: Value| {
        command["op"] = "command".into();
        command["id"] = id.into();
        Message::text(command.to_string())
    };
    let heard = async |socket: &mut tokio_tungstenite::WebSocketStream<_>, is_it: &dyn Fn(&Value) -> bool| {
        let search = async {
            while let Some(message) = socket.next().await {
                let text = message.expect("it goes on").into_text().expect("text");
                let value: Value = serde_json::from_str(&text).expect("JSON");
                if is_it(&value) {
                    return value;
                }
            }
            panic!("it ended");
        };
        tokio::time::timeout(TIMEOUT, search).await.expect("in time")
    };
    viewer.send(ask(1, json!({"command": "pause"}))).await.expect("sent");
    let refused = heard(&mut viewer, &|message| message["id"] == 1).await;
    assert_eq!(refused["op"], "refused");
    assert!(refused["why"].as_str().is_some_and(|why| why.starts_with("a viewer cannot steer")), "{refused}");
    let spawn = json!({"command": "spawn", "shape": {"ball": {"radius": 0.1}}, "position": [1.2, 1, 1.2], "name": "mine"});
    controller.send(ask(7, spawn)).await.expect("sent");
    let done = heard(&mut controller, &|message| message["id"] == 7).await;
    let id = done["body"].clone();
    assert_eq!((&done["op"], &id), (&json!("done"), &json!(12)));
    let of_it = |message: &Value| {
        message["bodies"].as_array().and_then(|all| all.iter().find(|body| body["id"] == id)).cloned()
    };
    let state =
        heard(&mut viewer, &|message| of_it(message).is_some_and(|body| body["name"] == "mine")).await;
    assert_eq!((&state["op"], &state["generation"]), (&json!("state"), &json!(0)));
    let grab = json!({"command": "grab", "body": id, "grip": [0, 0, 0], "target": [1.2, 1.5, 1.2]});
    controller.send(ask(8, grab)).await.expect("sent");
    heard(&mut viewer, &|message| of_it(message).is_some_and(|body| body["grabbed"] == true)).await;
    let held = "body `mine` is held by another program";
    let mut other = open(&format!("rate=1&token={TOKEN}")).await;
    let grab = json!({"command": "grab", "body": id, "grip": [0, 0, 0], "target": [0, 1.5, 0]});
    other.send(ask(9, grab)).await.expect("sent");
    let refused = heard(&mut other, &|message| message["id"] == 9).await;
    assert_eq!((&refused["op"], &refused["why"]), (&json!("refused"), &json!(held)));
    let grab = v1::GrabRequest { body: 12, grip: None, target: vector(0.0, 1.5, 0.0) };
    let refused = client(&demo).await.grab(steering(grab)).await.expect_err("held");
    assert_eq!((refused.code(), refused.message()), (Code::FailedPrecondition, held));
    drop(controller);
    heard(&mut viewer, &|message| of_it(message).is_some_and(|body| body["grabbed"] == false)).await;
    viewer.send(Message::text("[1")).await.expect("sent");
    let refused = heard(&mut viewer, &|message| message["op"] == "refused").await;
    assert!(refused["why"].as_str().is_some_and(|why| why.contains("no JSON")), "{refused}");
}

#[test]
fn bundles_come_over_osc() {
    let receiver = UdpSocket::bind("127.0.0.1:0").expect("a port");
    receiver.set_read_timeout(Some(TIMEOUT)).expect("set");
    let to = receiver.local_addr().expect("bound").to_string();
    let _demo = Demo::start(&["--osc", &to]);
    let mut buffer = [0; 9000];
    let length = receiver.recv(&mut buffer).expect("a bundle");
    let (_, packet) = rosc::decoder::decode_udp(&buffer[..length]).expect("OSC");
    let rosc::OscPacket::Bundle(bundle) = packet else { panic!("a bundle") };
    let addresses = bundle.content.iter().map(|packet| match packet {
        rosc::OscPacket::Message(message) => &message.addr[..],
        rosc::OscPacket::Bundle(_) => panic!("no bundle in a bundle"),
    });
    let addresses: Vec<&str> = addresses.collect();
    assert_eq!(addresses[0], "/hulltouch/world");
    for name in ["right_stand", "right_0", "left_4"] {
        assert!(addresses.contains(&&format!("/hulltouch/body/{name}/pose")[..]), "{addresses:?}");
    }
}
