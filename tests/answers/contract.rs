//! One contract, several shells: the same suite drives a node served in this process and a real node
//! process, over TCP and over Unix sockets.

use std::io::{BufRead as _, BufReader, Write as _};
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::sync::Arc;
use std::time::Duration;

use camera_node::listen::Listen;
use camera_node::service::{Access, Node};
use camera_node::source::{SourceConfig, StageConfig};
use camera_node::{NodeCamera, NodeConfig};
use film_time::{Pace, RunStart};
use hull::question::{Answer, Batch, NO_EXIT_M, Points, Question, QuestionKind};
use hull::view_set::Scratch;
use hull::{Pose, ProbeSettings, Rig, Shape, Silhouette, View, ViewSet};
use proto::convert::{
    ExpectedAnswer, ExpectedCamera, ProbeAnswer, QuestionWriter, RefusalReason, SilhouetteEncoding,
    StreamKnows, answer_from_wire, asked_world, pixel_rect_from_wire, shape_to_wire, silhouette_from_data,
    start_to_wire,
};
use proto::v1;
use proto::v1::camera_node_client::CameraNodeClient;
use segment::SegmentSettings;
use testkit::Running;
use tokio::sync::mpsc;
use tokio_stream::StreamExt as _;
use tokio_stream::wrappers::ReceiverStream;
use tonic::transport::Channel;
use tonic::{Request, Streaming};

/// Nodes keep eight frames of it.
const FPS: f64 = 16.0;
const TIMEOUT: Duration = Duration::from_secs(120);

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
    in_this_process(SocketAddr::from(([127, 0, 0, 1], 0)).into()).await;
}

#[tokio::test]
async fn a_node_on_a_unix_socket_keeps_the_contract() {
    let folder = tempfile::tempdir().expect("folder");
    let path = folder.path().join("node.sock");
    in_this_process(Listen::Unix(path.clone())).await;
    assert!(!path.exists(), "it takes its socket with it");
}

async fn in_this_process(listen: Listen) {
    let rig = rig();
    let node = Node::open(config(&rig), listen, Access::default()).await.expect("opens");
    let address = node.address().expect("bound");
    let (stop, stopped) = tokio::sync::oneshot::channel::<()>();
    let serving = tokio::spawn(node.serve(async { drop(stopped.await) }));
    suite(address, &rig).await;
    drop(stop);
    tokio::time::timeout(TIMEOUT, serving).await.expect("stops").expect("no panic").expect("served");
}

#[tokio::test]
async fn a_node_process_keeps_the_contract() {
    let rig = rig();
    let folder = tempfile::tempdir().expect("folder");
    let process = NodeProcess::start(folder.path(), &rig, "127.0.0.1:0");
    suite(process.address.clone(), &rig).await;
}

#[tokio::test]
async fn a_node_process_on_a_unix_socket_keeps_the_contract_and_cleans_up() {
    let rig = rig();
    let folder = tempfile::tempdir().expect("folder");
    let path = folder.path().join("node.sock");
    let listen = format!("unix:{}", path.display());
    // What a killed process leaves behind is no obstacle.
    drop(std::os::unix::net::UnixListener::bind(&path).expect("bound"));
    let process = NodeProcess::start(folder.path(), &rig, &listen);
    assert_eq!(process.address.to_string(), listen);
    suite(process.address.clone(), &rig).await;
    drop(process);
    assert!(!path.exists(), "it takes its socket with it");
}

/// A node of this program; it ends with its standard input.
struct NodeProcess {
    running: Running,
    address: Listen,
}

impl NodeProcess {
    fn start(folder: &Path, rig: &Rig, listen: &str) -> NodeProcess {
        std::fs::write(folder.join("rig.toml"), rig.to_toml()).expect("written");
        let mut text = format!("rig = \"rig.toml\"\nscene = \"topple\"\nfps = {FPS:?}\n");
        for camera in rig.cameras() {
            text += &format!("[[camera]]\nname = {:?}\nsource = {{ kind = \"stage\" }}\n", camera.name());
        }
        let file = folder.join("cluster.toml");
        std::fs::write(&file, text).expect("written");
        let mut command = testkit::command(env!("CARGO_BIN_EXE_hulltouch"));
        command
            .arg("node")
            .arg(&file)
            .args(["--camera", "cam_0", "--camera", "cam_1", "--listen", listen, "--stop-with-stdin"])
            .stdin(Stdio::piped())
            .stdout(Stdio::piped());
        let mut running = Running::start(&mut command);
        let mut line = String::new();
        let stdout = running.child().stdout.take().expect("piped");
        BufReader::new(stdout).read_line(&mut line).expect("announces");
        let address = line.trim().strip_prefix("listening on ").expect("the line that tells the address");
        NodeProcess { address: address.parse().expect("an address"), running }
    }
}

impl Drop for NodeProcess {
    fn drop(&mut self) {
        drop(self.running.child().stdin.take());
        let status = self.running.child().wait().expect("reaped");
        assert!(status.success(), "a node that is asked to end ends well: {status}");
    }
}

type Client = CameraNodeClient<Channel>;

async fn connect(address: &Listen) -> Channel {
    match address {
        Listen::Tcp(address) => {
            let channel = Channel::from_shared(format!("http://{address}")).expect("a URI").connect().await;
            channel.expect("connects")
        }
        Listen::Unix(path) => {
            let path: PathBuf = path.clone();
            let connector = tower::service_fn(move |_: tonic::transport::Uri| {
                let path = path.clone();
                async move { tokio::net::UnixStream::connect(path).await.map(hyper_util::rt::TokioIo::new) }
            });
            let endpoint = tonic::transport::Endpoint::from_static("http://node.invalid");
            endpoint.connect_with_connector(connector).await.expect("connects")
        }
    }
}

/// One open probe stream.
struct Probe {
    requests: mpsc::Sender<v1::ProbeRequest>,
    replies: Streaming<v1::ProbeReply>,
    next_id: u64,
    /// The node's cameras.
    cameras: Vec<ExpectedCamera>,
}

impl Probe {
    async fn open(client: &mut Client, rig: &Rig) -> Probe {
        let camera = |(place, camera): (usize, &hull::Camera)| ExpectedCamera::new(camera, place as u16);
        let cameras = rig.cameras().iter().enumerate().map(camera).collect();
        let (requests, receiver) = mpsc::channel(4);
        let replies = client.probe(ReceiverStream::new(receiver)).await.expect("opens").into_inner();
        Probe { requests, replies, next_id: 1, cameras }
    }

    /// A message that makes no question.
    async fn raw(&mut self, request: v1::ProbeRequest) -> ProbeAnswer {
        self.send(request, &Question::default()).await
    }

    async fn send(&mut self, mut request: v1::ProbeRequest, question: &Question) -> ProbeAnswer {
        request.id = self.next_id;
        self.next_id += 1;
        let id = request.id;
        self.requests.send(request).await.expect("sent");
        let reply = tokio::time::timeout(TIMEOUT, self.replies.next()).await.expect("in time");
        let reply = reply.expect("a reply").expect("no error");
        assert_eq!(reply.id, id, "replies carry their question's id");
        let expected = ExpectedAnswer::new(question, &asked_world(question), self.cameras.clone());
        answer_from_wire(reply, &expected).expect("valid").0
    }

    async fn ask(&mut self, frame: u64, question: &Question) -> ProbeAnswer {
        self.send(question_to_wire(frame, question), question).await
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
    Question { batches: vec![Batch::all(Points::World(points.into()))], ..Question::default() }
}

async fn suite(address: Listen, rig: &Rig) {
    let channel = connect(&address).await;
    let mut client = CameraNodeClient::new(channel).max_encoding_message_size(proto::MAX_MESSAGE_BYTES);
    describes_its_cameras(&mut client, rig).await;
    refuses_another_major_version(connect(&address).await).await;
    let mut probe = Probe::open(&mut client, rig).await;
    let one = world_points(vec![[0.0, 1.0, 0.0]]);
    assert_eq!(probe.refused(0, &one).await, RefusalReason::NotYet, "before film");

    let start = start_to_wire(RunStart::of_this_process(Pace::lock_step(1)));
    client.start(start).await.expect("starts");
    client.start(start).await.expect("starting the run it runs changes nothing");
    let (credits, credited) = mpsc::channel(4);
    let frames = client.watch_frames(ReceiverStream::new(credited)).await.expect("opens");
    let mut frames = frames.into_inner();
    credits.send(v1::FrameCredit { up_to_frame: 2, ..v1::FrameCredit::default() }).await.expect("sent");
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
    refuses_absurd_numbers(&mut client).await;
    let early = pictures(&mut client, 1, v1::fetch_pictures_request::Kind::Crops).await;
    assert!(early.iter().all(|picture| picture.jpeg.is_empty()), "colours are kept from the first ask on");

    for number in 3..=12 {
        credits
            .send(v1::FrameCredit { up_to_frame: number, ..v1::FrameCredit::default() })
            .await
            .expect("sent");
        assert_eq!(next_frame(&mut frames).await.frame, number);
    }
    assert_eq!(probe.refused(0, &one).await, RefusalReason::Gone, "the ring has moved on");
    let gone = v1::FetchSilhouettesRequest { frame: 0, ..v1::FetchSilhouettesRequest::default() };
    let gone = client.fetch_silhouettes(gone).await;
    assert_eq!(gone.expect_err("gone").code(), tonic::Code::OutOfRange);

    makes_pictures_of_frame_12(&mut client, rig).await;
    remembers_the_last_two_whole_worlds(&mut client).await;
    survives_untrusted_peers(&address).await;
    assert!(matches!(probe.ask(12, &one).await, ProbeAnswer::Answer(_)), "it goes on serving");
    tells_its_health_and_its_protocol(&address).await;
    obeys_one_coordinator_at_a_time(&mut client, &mut probe, &one).await;
}

async fn next_frame(frames: &mut Streaming<v1::FrameInfo>) -> v1::FrameInfo {
    let told = tokio::time::timeout(TIMEOUT, frames.next()).await.expect("in time");
    told.expect("a frame").expect("no error")
}

async fn remembers_the_last_two_whole_worlds(client: &mut Client) {
    let fetch = v1::FetchWorldRequest {};
    assert!(client.fetch_world(fetch).await.expect("fetches").into_inner().checkpoint.is_empty());
    let sealed = |text: &str| proto::seal_checkpoint(text.as_bytes()).expect("short");
    for world in ["first", "second"] {
        let keep = v1::KeepWorldRequest { checkpoint: sealed(world).into(), holder: 0 };
        client.keep_world(keep).await.expect("keeps");
    }
    let cut = sealed("third")[..30].to_vec();
    let large = vec![0; proto::MAX_CHECKPOINT_BYTES + 1];
    for (wrong, expected) in [
        (cut, "a checkpoint of 30 bytes, expected 53"),
        (large, "a checkpoint of 1048577 bytes, expected at most 1048576"),
    ] {
        let keep = v1::KeepWorldRequest { checkpoint: wrong.into(), holder: 0 };
        let refused = client.keep_world(keep).await.expect_err("not whole");
        assert_eq!((refused.code(), refused.message()), (tonic::Code::InvalidArgument, expected));
    }
    let kept = client.fetch_world(fetch).await.expect("fetches").into_inner();
    assert_eq!((&kept.checkpoint[..], &kept.previous[..]), (&sealed("second")[..], &sealed("first")[..]));
}

async fn describes_its_cameras(client: &mut Client, rig: &Rig) {
    let told = client.describe(v1::DescribeRequest {}).await.expect("describes").into_inner();
    assert_eq!(told.frames_per_s, FPS);
    for (camera, told) in rig.cameras().iter().zip(&told.cameras) {
        assert_eq!(told.name, camera.name());
        assert_eq!(told.calibration_digest[..], camera.digest()[..]);
    }
}

/// The silhouettes of frame 1, which are the same however they travel.
async fn silhouettes(client: &mut Client, rig: &Rig) -> Vec<Silhouette> {
    let mut found: Vec<Vec<Silhouette>> = Vec::new();
    for encoding in [
        SilhouetteEncoding::RunsLz4,
        SilhouetteEncoding::Runs,
        SilhouetteEncoding::Mask,
        SilhouetteEncoding::Grey,
    ] {
        let request = v1::FetchSilhouettesRequest {
            frame: 1,
            encoding: v1::SilhouetteEncoding::from(encoding).into(),
            ..v1::FetchSilhouettesRequest::default()
        };
        let told = client.fetch_silhouettes(request).await.expect("fetches").into_inner();
        let told: Vec<v1::Silhouette> = told.collect::<Result<_, _>>().await.expect("no error");
        assert_eq!(told.len(), rig.cameras().len());
        let decoded = rig.cameras().iter().zip(&told).map(|(camera, told)| {
            let size = (camera.width(), camera.height());
            silhouette_from_data(&told.data, size, encoding).expect("valid")
        });
        found.push(decoded.collect());
    }
    assert!(found.iter().all(|silhouettes| *silhouettes == found[0]));
    found.swap_remove(0)
}

/// The node's answers are those that its own silhouettes give here, bit for bit.
async fn answers_are_the_hulls_own(client: &mut Client, probe: &mut Probe, rig: &Rig) {
    let fetched = silhouettes(client, rig).await;
    let views = config(rig).observers().into_iter().zip(&fetched);
    let views = ViewSet::new(views.map(|(observer, fetched)| View::new(observer, fetched)).collect());
    // A column of points through the person and beyond.
    let samples = (0..60).map(|at| [0.01 * (at % 7) as f32, 0.03 * at as f32, 0.0]).collect();
    let shape = Arc::new(Shape::new(samples).expect("finite"));
    let body = Points::Body { shape: Arc::clone(&shape), pose: Pose::IDENTITY };
    let all = Question { batches: vec![Batch::all(body.clone())], ..Question::default() };
    assert_eq!(probe.refused(1, &all).await, RefusalReason::UnknownShape);
    let register = v1::RegisterShapesRequest { shapes: vec![shape_to_wire(&shape)], holder: 0 };
    client.register_shapes(register).await.expect("registers");

    let mut scratch = Scratch::default();
    let mut expect = |question: &Question| {
        let mut answer = Answer::default();
        views.answer(question, &mut scratch, &mut answer);
        answer
    };
    let classes = expect(&all);
    let inside: Vec<u32> = (0..)
        .zip(&classes.standings)
        .filter(|(_, standing)| standing.inside_count() == Some(2))
        .map(|(index, _)| index)
        .collect();
    assert!(inside.len() > 10, "the column meets the person");
    assert_eq!(probe.ask(1, &all).await, ProbeAnswer::Answer(classes));
    let mut edges = Question { kind: QuestionKind::Edges, ..Question::default() };
    edges.pick(&body, [0.0; 3], inside.iter().copied());
    let expected = expect(&edges);
    let normals: Vec<[f32; 3]> = expected.edges.iter().flatten().map(|edge| edge.normal_world).collect();
    assert_eq!(normals.len(), inside.len());
    assert_eq!(probe.ask(1, &edges).await, ProbeAnswer::Answer(expected));
    for (kind, directions) in
        [(QuestionKind::Exits, normals), (QuestionKind::SharedExits, vec![[1.0, 0.0, 0.0]])]
    {
        let exits = Question { kind, directions, ..edges.clone() };
        let expected = Answer { kind: QuestionKind::Exits, ..expect(&exits) };
        assert!(expected.exits_m.iter().any(|&exit_m| exit_m != NO_EXIT_M));
        assert_eq!(probe.ask(1, &exits).await, ProbeAnswer::Answer(expected));
    }
}

async fn obeys_one_coordinator_at_a_time(client: &mut Client, probe: &mut Probe, question: &Question) {
    let hold = |holder, term, name: &str| v1::HoldRequest { holder, term, name: name.into() };
    assert_eq!(
        client.hold(hold(0, 1, "anonymous")).await.expect_err("no id").code(),
        tonic::Code::InvalidArgument
    );
    client.hold(hold(7, 1, "the first")).await.expect("it has no lease holder");
    let start =
        v1::StartRequest { holder: 8, ..start_to_wire(RunStart::of_this_process(Pace::lock_step(9))) };
    let background = v1::TakeBackgroundRequest { check_only: true, holder: 8, ..Default::default() };
    let refused = [
        client.hold(hold(8, 1, "the second")).await.map(drop),
        client.start(start).await.map(drop),
        client.keep_time(v1::KeepTimeRequest { holder: 8, ..Default::default() }).await.map(drop),
        client.register_shapes(v1::RegisterShapesRequest { shapes: vec![], holder: 8 }).await.map(drop),
        client.keep_world(v1::KeepWorldRequest { holder: 8, ..Default::default() }).await.map(drop),
        client.take_background(background).await.map(drop),
        client
            .restore_background(v1::RestoreBackgroundRequest { holder: 8, ..Default::default() })
            .await
            .map(drop),
    ];
    for refused in refused {
        let refused = refused.expect_err("held");
        assert_eq!(refused.code(), tonic::Code::Aborted, "{refused}");
        assert_eq!(
            refused.message(),
            "held by the first for 0 s, expected it to end, --take-over or --observe"
        );
    }
    assert_eq!(probe.refused(12, question).await, RefusalReason::Held);
    let description = client.describe(v1::DescribeRequest {}).await.expect("every peer may ask").into_inner();
    assert_eq!(description.term, 1);
    client.hold(hold(8, 2, "the second")).await.expect("a higher term");
    let late = client.keep_time(v1::KeepTimeRequest { holder: 7, ..Default::default() }).await;
    assert_eq!(late.expect_err("displaced").code(), tonic::Code::Aborted);
    client.start(start).await.expect("it leads now");
}

async fn refuses_another_major_version(channel: Channel) {
    let mut client = tonic::client::Grpc::new(channel);
    client.ready().await.expect("connected");
    let path = "/hulltouch.v2.CameraNode/Describe".parse().expect("a path");
    let codec = proto::codec::BoundedCodec::<v1::DescribeRequest, v1::DescribeReply>::default();
    let refused = client.unary(Request::new(v1::DescribeRequest {}), path, codec).await.expect_err("refused");
    assert_eq!(refused.code(), tonic::Code::Unimplemented);
    assert_eq!(refused.message(), "hulltouch.v2: this node speaks hulltouch.v1");
}

async fn refuses_absurd_numbers(client: &mut Client) {
    let start = start_to_wire(RunStart::of_this_process(Pace::lock_step(2)));
    for epoch_unix_s in [f64::NAN, f64::INFINITY, 1e300, -1.0] {
        let never = v1::StartRequest { epoch_unix_s, ..start };
        assert_eq!(client.start(never).await.expect_err("no date").code(), tonic::Code::InvalidArgument);
    }
    let mad = v1::ClockLine { node_s: 0.0, film_s: f64::NAN, rate: 1.0, bound_s: 0.0 };
    for clock in [None, Some(mad)] {
        let never = v1::StartRequest { clock, ..start };
        assert_eq!(client.start(never).await.expect_err("no clock").code(), tonic::Code::InvalidArgument);
    }
    let told = v1::KeepTimeRequest { run: 1, clock: Some(mad), ..Default::default() };
    assert_eq!(client.keep_time(told).await.expect_err("no clock").code(), tonic::Code::InvalidArgument);
    let read = v1::KeepTimeRequest::default();
    let first = client.keep_time(read).await.expect("a clock").into_inner().node_s;
    assert!(client.keep_time(read).await.expect("a clock").into_inner().node_s > first);
    for frames in [0, 3601, u64::MAX] {
        let background = v1::TakeBackgroundRequest {
            first_frame: u64::MAX,
            frames,
            ..v1::TakeBackgroundRequest::default()
        };
        let refused = client.take_background(background).await.expect_err("no such length");
        assert_eq!(refused.code(), tonic::Code::FailedPrecondition);
    }
    let cameras = vec![0; 60_000];
    let pictures =
        v1::FetchPicturesRequest { jpeg_quality: 80, cameras, ..v1::FetchPicturesRequest::default() };
    let refused = client.fetch_pictures(pictures).await.expect_err("no such cameras");
    assert_eq!(refused.code(), tonic::Code::InvalidArgument);
}

/// A question about a frame for a stream that knows nothing.
fn question_to_wire(frame: u64, question: &Question) -> v1::ProbeRequest {
    QuestionWriter::default().write(question).message(&StreamKnows::default(), 0, frame)
}

async fn refuses_what_makes_no_question(client: &mut Client, probe: &mut Probe) {
    use RefusalReason::{Malformed, TooManyPoints, UnknownList};
    let nan = world_points(vec![[0.0, f64::NAN, 0.0]]);
    assert_eq!(probe.refused(1, &nan).await, Malformed);
    let many = world_points(vec![[0.0; 3]; proto::MAX_POINTS + 1]);
    assert_eq!(probe.refused(1, &many).await, TooManyPoints);
    let nothing = v1::ProbeRequest { frame: 1, ..v1::ProbeRequest::default() };
    assert!(matches!(probe.raw(nothing).await, ProbeAnswer::Refused(UnknownList, _)));
    let mut odd = question_to_wire(1, &world_points(vec![[0.0; 3]]));
    odd.bodies.as_mut().expect("told").world[0] = vec![0; 25].into();
    assert!(matches!(probe.raw(odd).await, ProbeAnswer::Refused(Malformed, _)));
    let empty = world_points(vec![]);
    assert_eq!(probe.ask(1, &empty).await, ProbeAnswer::Answer(Answer::default()));

    let mut lie = shape_to_wire(&Shape::new(vec![[0.0; 3]]).expect("finite"));
    lie.digest = vec![7; 32].into();
    let lied = client.register_shapes(v1::RegisterShapesRequest { shapes: vec![lie], holder: 0 }).await;
    assert_eq!(lied.expect_err("a lie").code(), tonic::Code::InvalidArgument);
}

async fn pictures(
    client: &mut Client,
    frame: u64,
    kind: v1::fetch_pictures_request::Kind,
) -> Vec<v1::Picture> {
    let (kind, cameras) = (kind.into(), vec![]);
    let request = v1::FetchPicturesRequest { frame, scale_log2: 1, jpeg_quality: 80, kind, cameras };
    let told = client.fetch_pictures(request).await.expect("fetches").into_inner();
    told.collect::<Result<_, _>>().await.expect("no error")
}

/// After the first ask: silhouettes, and the colours of the person; whole images were never asked for.
async fn makes_pictures_of_frame_12(client: &mut Client, rig: &Rig) {
    use v1::fetch_pictures_request::Kind;
    for frame in [12, u64::MAX] {
        let crops = pictures(client, frame, Kind::Crops).await;
        assert_eq!(crops.len(), rig.cameras().len());
        for (camera, picture) in rig.cameras().iter().zip(&crops) {
            assert_eq!((picture.frame, picture.scale_log2), (12, 1));
            let size = (camera.width(), camera.height());
            let silhouette =
                silhouette_from_data(&picture.runs, size, SilhouetteEncoding::Runs).expect("runs");
            let bounds = silhouette.bounds().expect("a person is there");
            assert!(picture.left <= bounds.left && picture.top <= bounds.top);
            assert!(picture.left + picture.width >= bounds.right);
            assert!(picture.top + picture.height >= bounds.bottom);
            let image = image::load_from_memory(&picture.jpeg).expect("a JPEG");
            assert_eq!((image.width(), image.height()), (picture.width / 2, picture.height / 2));
        }
    }
    let whole = pictures(client, 12, Kind::Whole).await;
    assert!(whole.iter().all(|picture| picture.runs.is_empty() && picture.jpeg.is_empty()));
    let lone = pictures(client, 12, Kind::Silhouettes).await;
    assert!(lone.iter().all(|picture| !picture.runs.is_empty() && picture.jpeg.is_empty()));
    for (frame, scale_log2, expected) in [
        (0, 1, tonic::Code::OutOfRange),
        (13, 1, tonic::Code::FailedPrecondition),
        (12, 9, tonic::Code::InvalidArgument),
        (12, 1000, tonic::Code::InvalidArgument),
    ] {
        let (jpeg_quality, kind, cameras) = (80, Kind::Crops.into(), vec![]);
        let request = v1::FetchPicturesRequest { frame, scale_log2, jpeg_quality, kind, cameras };
        let refused = client.fetch_pictures(request).await.expect_err("refused");
        assert_eq!(refused.code(), expected, "{refused}");
    }
}

async fn survives_untrusted_peers(address: &Listen) {
    let address = address.clone();
    tokio::task::spawn_blocking(move || {
        let noise = b"GET / HTTP/1.1\r\n\r\n\0\0\xff\xff not a frame at all";
        // The node may hang up at any time.
        let _ = match address {
            Listen::Tcp(address) => std::net::TcpStream::connect(address).expect("connects").write_all(noise),
            Listen::Unix(path) => {
                std::os::unix::net::UnixStream::connect(path).expect("connects").write_all(noise)
            }
        };
    })
    .await
    .expect("no panic");
}

async fn tells_its_health_and_its_protocol(address: &Listen) {
    let channel = connect(address).await;
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
