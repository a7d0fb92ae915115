//! One contract, two shells: the same suite drives a node served in this process and a real node
//! process, over the wire.

use std::io::{BufRead as _, BufReader, Write as _};
use std::net::SocketAddr;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::time::Duration;

use camera_node::service::Node;
use camera_node::source::{SourceConfig, StageConfig};
use camera_node::{NodeCamera, NodeConfig};
use hull::question::{Answer, Batch, Directions, Points, Question};
use hull::view_set::Scratch;
use hull::{Pose, ProbeSettings, Rig, Shape, Silhouette, View, ViewSet};
use proto::convert::{
    ProbeAnswer, RefusalReason, answer_from_wire, pixel_rect_from_wire, question_to_wire, shape_to_wire,
};
use proto::v1;
use proto::v1::camera_node_client::CameraNodeClient;
use segment::SegmentSettings;
use tokio::sync::mpsc;
use tokio_stream::StreamExt as _;
use tokio_stream::wrappers::ReceiverStream;
use tonic::Streaming;
use tonic::transport::Channel;

const FPS: f64 = 30.0;
const PATIENCE: Duration = Duration::from_secs(20);

fn rig() -> Rig {
    stage::studio_rig(2, (160, 120)).expect("a rig")
}

fn config(rig: &Rig) -> NodeConfig {
    let camera = |(index, camera): (usize, &hull::Camera)| NodeCamera {
        camera: camera.clone(),
        rig_index: index as u16,
        source: SourceConfig::Stage(StageConfig::default()),
        background: None,
        segmentation: SegmentSettings::default(),
        ignored: None,
    };
    NodeConfig {
        cameras: rig.cameras().iter().enumerate().map(camera).collect(),
        settings: ProbeSettings::default(),
        fps: FPS,
    }
}

#[tokio::test]
async fn a_node_in_this_process_keeps_the_contract() {
    let rig = rig();
    let loopback = SocketAddr::from(([127, 0, 0, 1], 0));
    let node = Node::open(config(&rig), loopback, false).await.expect("opens");
    let address = node.address().expect("bound");
    let (stop, stopped) = tokio::sync::oneshot::channel::<()>();
    let serving = tokio::spawn(node.serve(async { drop(stopped.await) }));
    suite(address, &rig).await;
    drop(stop);
    tokio::time::timeout(PATIENCE, serving).await.expect("stops").expect("no panic").expect("served");
}

#[tokio::test]
async fn a_node_process_keeps_the_contract() {
    let rig = rig();
    let folder = tempfile::tempdir().expect("folder");
    let process = NodeProcess::start(folder.path(), &rig);
    suite(process.address, &rig).await;
}

/// A node of this program; it ends with its standard input.
struct NodeProcess {
    child: Child,
    address: SocketAddr,
}

impl NodeProcess {
    fn start(folder: &Path, rig: &Rig) -> NodeProcess {
        std::fs::write(folder.join("rig.toml"), rig.to_toml()).expect("written");
        let mut text = format!("rig = \"rig.toml\"\nscene = \"topple\"\nfps = {FPS:?}\n");
        for camera in rig.cameras() {
            text += &format!("[[camera]]\nname = {:?}\nsource = {{ kind = \"stage\" }}\n", camera.name());
        }
        let file = folder.join("cluster.toml");
        std::fs::write(&file, text).expect("written");
        let mut child = Command::new(env!("CARGO_BIN_EXE_hulltouch"))
            .arg("node")
            .arg(&file)
            .args(["--camera", "cam_0", "--camera", "cam_1", "--listen", "127.0.0.1:0", "--stop-with-stdin"])
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .expect("starts");
        let mut line = String::new();
        let stdout = child.stdout.take().expect("piped");
        BufReader::new(stdout).read_line(&mut line).expect("announces");
        let address = line.trim().strip_prefix("listening on ").expect("the line that tells the address");
        NodeProcess { address: address.parse().expect("an address"), child }
    }
}

impl Drop for NodeProcess {
    fn drop(&mut self) {
        drop(self.child.stdin.take());
        let status = self.child.wait().expect("reaped");
        assert!(status.success(), "a node that is asked to end ends well: {status}");
    }
}

type Client = CameraNodeClient<Channel>;

/// One open probe stream.
struct Probe {
    requests: mpsc::Sender<v1::ProbeRequest>,
    replies: Streaming<v1::ProbeReply>,
    next_id: u64,
}

impl Probe {
    async fn open(client: &mut Client) -> Probe {
        let (requests, receiver) = mpsc::channel(4);
        let replies = client.probe(ReceiverStream::new(receiver)).await.expect("opens").into_inner();
        Probe { requests, replies, next_id: 1 }
    }

    async fn raw(&mut self, mut request: v1::ProbeRequest) -> ProbeAnswer {
        request.id = self.next_id;
        self.next_id += 1;
        let id = request.id;
        self.requests.send(request).await.expect("sent");
        let reply = tokio::time::timeout(PATIENCE, self.replies.next()).await.expect("in time");
        let (of, answer, _) = answer_from_wire(reply.expect("a reply").expect("no error")).expect("valid");
        assert_eq!(of, id, "replies carry their question's id");
        answer
    }

    async fn ask(&mut self, frame: u64, question: &Question) -> ProbeAnswer {
        self.raw(question_to_wire(0, frame, question)).await
    }

    async fn refused(&mut self, frame: u64, question: &Question) -> RefusalReason {
        match self.ask(frame, question).await {
            ProbeAnswer::Refused(reason, message) => {
                assert!(!message.is_empty() && !message.contains('\n'), "one line says why: {message:?}");
                reason
            }
            ProbeAnswer::Answer(answer) => panic!("expected a refusal, found {answer:?}"),
        }
    }
}

fn world_points(points: Vec<[f64; 3]>) -> Question {
    Question::Classes(vec![Batch { points: Points::World(points.into()), picked: None }])
}

async fn suite(address: SocketAddr, rig: &Rig) {
    let mut client = CameraNodeClient::connect(format!("http://{address}"))
        .await
        .expect("connects")
        .max_encoding_message_size(proto::MAX_MESSAGE_BYTES);
    describes_its_cameras(&mut client, rig).await;
    let mut probe = Probe::open(&mut client).await;
    let one = world_points(vec![[0.0, 1.0, 0.0]]);
    assert_eq!(probe.refused(0, &one).await, RefusalReason::NotYet, "before film");

    let start = v1::StartRequest { epoch_unix_s: 0.0, lock_step: true };
    client.start(start).await.expect("starts");
    client.start(start).await.expect("starting the run it runs changes nothing");
    let (credits, credited) = mpsc::channel(4);
    let frames = client.watch_frames(ReceiverStream::new(credited)).await.expect("opens");
    let mut frames = frames.into_inner();
    credits.send(v1::FrameCredit { up_to_frame: 2 }).await.expect("sent");
    for number in 0..=2 {
        let info = next_frame(&mut frames).await;
        assert_eq!((info.frame, info.cameras.len()), (number, 2), "every frame, in order, of all cameras");
        assert!((info.capture_time_s - number as f64 / FPS).abs() < 1e-9);
        for camera in &info.cameras {
            pixel_rect_from_wire(camera.admitted.as_ref().expect("a person is there")).expect("a rectangle");
            assert!(camera.area > 100 && camera.silhouette_bytes > 12);
        }
    }
    let more = tokio::time::timeout(Duration::from_millis(200), frames.next()).await;
    assert!(more.is_err(), "without credit there is no frame 3, found {more:?}");

    answers_are_the_hulls_own(&mut client, &mut probe, rig).await;
    refuses_what_makes_no_question(&mut client, &mut probe).await;

    for number in 3..=12 {
        credits.send(v1::FrameCredit { up_to_frame: number }).await.expect("sent");
        assert_eq!(next_frame(&mut frames).await.frame, number);
    }
    assert_eq!(probe.refused(0, &one).await, RefusalReason::Gone, "the ring has moved on");
    let gone = client.fetch_silhouettes(v1::FetchSilhouettesRequest { frame: 0 }).await;
    assert_eq!(gone.expect_err("gone").code(), tonic::Code::OutOfRange);

    survives_strangers(address).await;
    assert!(matches!(probe.ask(12, &one).await, ProbeAnswer::Answer(_)), "it goes on serving");
    tells_its_health_and_its_protocol(address).await;
}

async fn next_frame(frames: &mut Streaming<v1::FrameInfo>) -> v1::FrameInfo {
    let told = tokio::time::timeout(PATIENCE, frames.next()).await.expect("in time");
    told.expect("a frame").expect("no error")
}

async fn describes_its_cameras(client: &mut Client, rig: &Rig) {
    let told = client.describe(v1::DescribeRequest {}).await.expect("describes").into_inner();
    assert_eq!(told.frames_per_s, FPS);
    for (camera, told) in rig.cameras().iter().zip(&told.cameras) {
        assert_eq!(told.name, camera.name());
        assert_eq!(told.calibration_digest[..], camera.digest()[..]);
    }
}

/// The node's answers are those that its own silhouettes give here, bit for bit.
async fn answers_are_the_hulls_own(client: &mut Client, probe: &mut Probe, rig: &Rig) {
    let fetched = client.fetch_silhouettes(v1::FetchSilhouettesRequest { frame: 1 }).await;
    let fetched = fetched.expect("fetches").into_inner().silhouettes;
    let views = config(rig).observers().into_iter().zip(&fetched).map(|(observer, fetched)| {
        let size = (observer.camera().width(), observer.camera().height());
        let silhouette = Silhouette::decode(&fetched.runs, size).expect("valid");
        View::new(observer, &silhouette)
    });
    let views = ViewSet::new(views.collect());
    // A column of points through the person and beyond.
    let samples = (0..60).map(|at| [0.01 * (at % 7) as f32, 0.03 * at as f32, 0.0]).collect();
    let shape = Arc::new(Shape::new(samples).expect("finite"));
    let body = Points::Body { shape: Arc::clone(&shape), pose: Pose::IDENTITY };
    let all = Question::Classes(vec![Batch { points: body.clone(), picked: None }]);
    assert_eq!(probe.refused(1, &all).await, RefusalReason::UnknownShape);
    let register = v1::RegisterShapesRequest { shapes: vec![shape_to_wire(&shape)] };
    client.register_shapes(register).await.expect("registers");

    let mut scratch = Scratch::default();
    let mut expect = |question: &Question| views.answer(question, &mut scratch);
    let classes = expect(&all);
    let inside: Vec<u32> = (0..)
        .zip(classes.classes().expect("classes"))
        .filter(|(_, standing)| standing.inside_count() == Some(2))
        .map(|(index, _)| index)
        .collect();
    assert!(inside.len() > 10, "the column meets the person");
    assert_eq!(probe.ask(1, &all).await, ProbeAnswer::Answer(classes));
    let some = Batch { points: body, picked: Some(inside.clone()) };
    let edges = Question::Edges(vec![some.clone()]);
    let expected = expect(&edges);
    let normals: Vec<[f32; 3]> =
        expected.edges().expect("edges").iter().flatten().map(|edge| edge.normal_world).collect();
    assert_eq!(normals.len(), inside.len());
    assert_eq!(probe.ask(1, &edges).await, ProbeAnswer::Answer(expected));
    for directions in [Directions::Each(normals), Directions::Shared([1.0, 0.0, 0.0])] {
        let exits = Question::Exits(vec![(some.clone(), directions)]);
        let expected = expect(&exits);
        assert!(expected.exits().expect("exits").iter().any(|exit| exit.outside_m.is_some()));
        assert_eq!(probe.ask(1, &exits).await, ProbeAnswer::Answer(expected));
    }
}

async fn refuses_what_makes_no_question(client: &mut Client, probe: &mut Probe) {
    use RefusalReason::{Malformed, TooManyPoints};
    let nan = world_points(vec![[0.0, f64::NAN, 0.0]]);
    assert_eq!(probe.refused(1, &nan).await, Malformed);
    let many = world_points(vec![[0.0; 3]; proto::MAX_POINTS + 1]);
    assert_eq!(probe.refused(1, &many).await, TooManyPoints);
    let nothing = v1::ProbeRequest { id: 0, frame: 1, question: None };
    assert!(matches!(probe.raw(nothing).await, ProbeAnswer::Refused(Malformed, _)));
    let points = Some(v1::batch::Points::World(vec![0; 25].into()));
    let odd = v1::Classes { batches: vec![v1::Batch { points, picked: None }] };
    let odd = v1::ProbeRequest { id: 0, frame: 1, question: Some(v1::probe_request::Question::Classes(odd)) };
    assert!(matches!(probe.raw(odd).await, ProbeAnswer::Refused(Malformed, _)));
    let empty = world_points(vec![]);
    assert_eq!(probe.ask(1, &empty).await, ProbeAnswer::Answer(Answer::Classes(vec![])));

    let mut lie = shape_to_wire(&Shape::new(vec![[0.0; 3]]).expect("finite"));
    lie.digest = vec![7; 32].into();
    let lied = client.register_shapes(v1::RegisterShapesRequest { shapes: vec![lie] }).await;
    assert_eq!(lied.expect_err("a lie").code(), tonic::Code::InvalidArgument);
    let never = v1::StartRequest { epoch_unix_s: f64::NAN, lock_step: true };
    assert_eq!(client.start(never).await.expect_err("NaN").code(), tonic::Code::InvalidArgument);
}

async fn survives_strangers(address: SocketAddr) {
    tokio::task::spawn_blocking(move || {
        let mut stranger = std::net::TcpStream::connect(address).expect("connects");
        // The node may hang up at any time.
        let _ = stranger.write_all(b"GET / HTTP/1.1\r\n\r\n\0\0\xff\xff not a frame at all");
    })
    .await
    .expect("no panic");
}

async fn tells_its_health_and_its_protocol(address: SocketAddr) {
    let channel = Channel::from_shared(format!("http://{address}")).expect("a URI").connect().await;
    let channel = channel.expect("connects");
    let mut health = tonic_health::pb::health_client::HealthClient::new(channel.clone());
    let service = "hulltouch.v1.CameraNode".to_owned();
    let check = tonic_health::pb::HealthCheckRequest { service };
    let status = health.check(check).await.expect("told").into_inner().status();
    assert_eq!(status, tonic_health::pb::health_check_response::ServingStatus::Serving);

    use tonic_reflection::pb::v1::server_reflection_client::ServerReflectionClient;
    use tonic_reflection::pb::v1::server_reflection_request::MessageRequest;
    use tonic_reflection::pb::v1::server_reflection_response::MessageResponse;
    let request = tonic_reflection::pb::v1::ServerReflectionRequest {
        host: String::new(),
        message_request: Some(MessageRequest::ListServices(String::new())),
    };
    let mut reflection = ServerReflectionClient::new(channel);
    let told = reflection.server_reflection_info(tokio_stream::iter([request])).await.expect("told");
    let told = told.into_inner().next().await.expect("a response").expect("no error");
    let Some(MessageResponse::ListServicesResponse(list)) = told.message_response else {
        panic!("expected the list of services, found {told:?}")
    };
    assert!(list.service.iter().any(|service| service.name == "hulltouch.v1.CameraNode"));
}
