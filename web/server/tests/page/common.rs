//! A run made by hand, a feed that serves it, and pages that look.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use bytes::Bytes;
use coordinator::Progress;
use coordinator::live::{
    BodyLook, BodyState, CameraStatus, Command, HullPatch, Live, Order, Outcome, Parameters, Refusal,
    RunStatus, SceneState, TouchPoint, WeakClient, WorldState, live,
};
use futures::future::BoxFuture;
use futures::stream::SplitSink;
use futures::{SinkExt as _, StreamExt as _};
use hull::{Camera, Pose, ProbeSettings, Rig};
use nalgebra::{Matrix3, Vector3};
use net::Credentials;
use proto::{CameraPicture, FramePictures, PictureKind, PictureRequest};
use serde_json::Value;
use sim::Solid;
use tokio::net::TcpStream;
use tokio::sync::{mpsc, watch};
use tokio::task::AbortHandle;
use tokio_tungstenite::tungstenite::client::IntoClientRequest as _;
use tokio_tungstenite::tungstenite::{self, Message};
use tokio_tungstenite::{MaybeTlsStream, WebSocketStream};
use web_server::pictures::Pictures;
use web_server::{Feed, FeedSettings, RunInfo, Token};

pub const FPS: f64 = 30.0;
pub const TOKEN: &str = "let-me-steer";
/// Longer than any test takes on a machine that does something else.
pub const TIMEOUT: Duration = Duration::from_secs(100);
pub const CAMERAS: usize = 4;

/// Bytes of a camera's JPEG by scale.
pub const JPEG_BYTES: [usize; 4] = [20_000, 8_000, 3_000, 1_200];

/// Pictures of the right sizes, and a record of what was asked.
#[derive(Default)]
pub struct Studio {
    pub asked: Mutex<Vec<PictureRequest>>,
    /// Frames before this are gone.
    pub oldest: AtomicU64,
    pub newest: AtomicU64,
    /// So many requests for whole images are answered without colours, as by nodes that did not keep any.
    pub colourless: AtomicU64,
}

impl Pictures for Studio {
    fn fetch(
        &self,
        request: PictureRequest,
    ) -> BoxFuture<'static, Result<FramePictures, coordinator::BoxError>> {
        self.asked.lock().expect("whole").push(request.clone());
        let frame = request.frame.unwrap_or(self.newest.load(Ordering::SeqCst));
        let is_gone = frame < self.oldest.load(Ordering::SeqCst);
        let count_down = |left: u64| left.checked_sub(1);
        let is_colourless = request.kind == PictureKind::Whole
            && !is_gone
            && self.colourless.fetch_update(Ordering::SeqCst, Ordering::SeqCst, count_down).is_ok();
        let cameras = (0..CAMERAS as u16)
            .filter(|camera| request.cameras.is_empty() || request.cameras.contains(camera))
            .map(|camera| {
                let jpeg = match request.kind {
                    PictureKind::Silhouettes => Bytes::new(),
                    _ if is_colourless => Bytes::new(),
                    _ => Bytes::from(vec![camera as u8; JPEG_BYTES[usize::from(request.scale_log2)]]),
                };
                let runs = match request.kind {
                    PictureKind::Whole => Bytes::new(),
                    _ => Bytes::from(vec![0; 480]),
                };
                let crop = if jpeg.is_empty() { [0; 4] } else { [64, 64, 128, 256] };
                CameraPicture { rig_index: camera, runs, scale_log2: request.scale_log2, crop, jpeg }
            })
            .collect();
        Box::pin(async move {
            if is_gone {
                return Err(format!("frame {frame} is gone").into());
            }
            Ok(FramePictures { frame, captured_unix_s: 1_000.0 + frame as f64 / FPS, cameras })
        })
    }
}

impl Studio {
    pub fn asked(&self) -> Vec<PictureRequest> {
        self.asked.lock().expect("whole").clone()
    }
}

/// A run made by hand.
pub struct Run {
    pub feed: Feed,
    pub studio: Arc<Studio>,
    pub ordered: Arc<Mutex<Vec<Command>>>,
    /// The client of each of them.
    pub clients: Arc<Mutex<Vec<WeakClient>>>,
    world: watch::Sender<Option<Arc<WorldState>>>,
    pub scene: watch::Sender<Option<Arc<SceneState>>>,
    pub status: watch::Sender<Option<Arc<RunStatus>>>,
    step: AtomicU64,
}

fn rig() -> Rig {
    let camera = |index: usize| {
        let angle = index as f64 * std::f64::consts::TAU / CAMERAS as f64;
        let (sine, cosine) = libm::sincos(angle);
        let rotation = Matrix3::new(cosine, 0.0, -sine, 0.0, -1.0, 0.0, -sine, 0.0, -cosine);
        let translation = -(rotation * Vector3::new(3.0 * sine, 1.0, 3.0 * cosine));
        let intrinsics = Matrix3::new(400.0, 0.0, 320.0, 0.0, 400.0, 240.0, 0.0, 0.0, 1.0);
        let distortion = if index == 0 { [-0.3, 0.0, 0.0, 0.0, 0.0] } else { [0.0; 5] };
        let name = format!("cam_{index}");
        Camera::from_matrices(name, (640, 480), intrinsics, distortion, &rotation, translation)
            .expect("a camera")
    };
    Rig::new((0..CAMERAS).map(camera).collect()).expect("a rig")
}

impl Run {
    /// A run that only the test steps. Orders are recorded and done; a removal of body 99 is refused, any other is undone by
    /// seven steps.
    pub fn start() -> Run {
        Run::start_with(None, false)
    }

    /// The same with a page that is encrypted, if there are certificates; and with a scene that begins for the first page.
    pub fn start_with(credentials: Option<Arc<Credentials>>, begins_for_first_page: bool) -> Run {
        let (live, follower) = live();
        let Live { mut orders, world, scene, status, .. } = live;
        let studio = Arc::new(Studio::default());
        let facts = RunInfo {
            rig: rig(),
            ignored: vec![None; CAMERAS],
            probes: ProbeSettings::default(),
            fps: FPS,
            step_s: 1.0 / 120.0,
            response: sim::ResponseMode::Paper,
            latency_s: Some(0.06),
            up: [0.0, 1.0, 0.0],
            floor_m: Some(0.0),
            has_colour: true,
            is_replay: false,
            length_s: None,
            film_waits: false,
            insecure: None,
        };
        let settings = FeedSettings {
            listen: ([127, 0, 0, 1], 0).into(),
            or_any_port: false,
            token: Token::new(TOKEN).expect("a token"),
            credentials,
            origin: None,
            begins_for_first_page,
        };
        let pictures: Arc<dyn Pictures> = studio.clone();
        let feed = Feed::start(&settings, facts, follower, move || pictures).expect("a feed");
        let ordered: Arc<Mutex<Vec<Command>>> = Arc::default();
        let record = Arc::clone(&ordered);
        let clients: Arc<Mutex<Vec<WeakClient>>> = Arc::default();
        let heard_from = Arc::clone(&clients);
        tokio::spawn(async move {
            while let Some(Order { command, client, reply }) = orders.recv().await {
                let answer = match &command {
                    Command::Remove(99) => Err(Refusal::World(sim::CommandError::NoSuchBody(99))),
                    Command::Spawn(_) => Ok(Outcome::Spawned(12)),
                    // What brings it back is refused.
                    Command::Remove(98) => Ok(Outcome::Revocable(Box::new(Command::Remove(99)))),
                    Command::Remove(_) => Ok(Outcome::Revocable(Box::new(Command::Step(7)))),
                    _ => Ok(Outcome::Applied),
                };
                record.lock().expect("whole").push(command);
                heard_from.lock().expect("whole").push(client.downgrade());
                drop(client);
                // The client may have disconnected.
                let _ = reply.send(answer);
            }
        });
        Run { feed, studio, ordered, clients, world, scene, status, step: AtomicU64::new(0) }
    }

    pub fn publish_scene(&self) {
        self.publish_scene_of(1);
    }

    /// The scene of a world, which counts worlds.
    pub fn publish_scene_of(&self, generation: u32) {
        let look = BodyLook {
            id: 7,
            name: "ball".into(),
            solid: Solid::Ball { radius_m: 0.125 },
            color: [1.0, 0.5, 0.25],
            fixed: false,
        };
        let parameters = Parameters { answers_hull: Some(true), ..Parameters::default() };
        let scene = SceneState {
            generation,
            version: 3,
            scene: "by hand".into(),
            bodies: vec![look],
            parameters,
            up: [0.0, 1.0, 0.0],
            floor_m: Some(0.0),
        };
        self.scene.send_replace(Some(Arc::new(scene)));
    }

    pub fn publish_status(&self) {
        let camera = CameraStatus {
            name: "cam_0".into(),
            problem: Some("it sleeps".into()),
            newest_frame: Some(4),
            age_ms: 12.5,
            sync_ms: 0.5,
            stamps: "arrival",
            phase: Some(0.25),
            frames_per_s: Some(30.0),
            clock_bound_ms: 0.1,
            foreground: 0.0625,
            silhouette_bytes: 700,
            segment_ms: 1.5,
            late_ms: Some(21.5),
            costs_ms: 4.5,
            left_out: false,
        };
        let progress = Progress {
            film_s: 2.5,
            frame: Some(4),
            steps_per_s: 120.0,
            passes_per_s: 30.0,
            p50_ms: 1.0,
            p99_ms: 2.0,
            samples: 400,
            contacts: 1,
            hull_age_ms: None,
            latency_ms: 23.5,
            bytes_per_s: 1e5,
            hull_unavailable: Some("no node".into()),
        };
        let status = RunStatus {
            progress,
            cameras: vec![camera],
            frames_missed: 1,
            frames_expected: 75,
            late_steps: 2,
            blind_steps: 3,
            reduced_steps: 0,
            replay: None,
        };
        self.status.send_replace(Some(Arc::new(status)));
    }

    /// A step that saw a frame.
    pub fn publish(&self, frame: u64) {
        self.publish_world(Some(frame), false);
    }

    pub fn publish_world(&self, frame: Option<u64>, paused: bool) {
        if let Some(frame) = frame {
            self.studio.newest.fetch_max(frame, Ordering::SeqCst);
        }
        let step = self.step.fetch_add(1, Ordering::SeqCst) + 1;
        let body = BodyState {
            id: 7,
            pose: Pose::new([0.5, 1.0, -0.25], [0.0, 0.0, 0.0, 1.0]).expect("a pose"),
            velocity_m_s: [0.0; 3],
            spin_rad_s: [0.0; 3],
            inside_samples: 2,
            response_m: Some([0.0, 0.25, 0.0]),
            grabbed: false,
            asleep: false,
        };
        let touch = TouchPoint { body: 0, point_m: [0.5, 1.0, -0.25], response_m: [0.0, 0.25, 0.0] };
        let patch = HullPatch {
            body: 0,
            point_m: [0.5, 0.75, -0.25],
            normal_world: [0.0, 1.0, 0.0],
            velocity_m_s: [0.0, 0.5, 0.0],
            depth_m: 0.0,
            radius_m: 0.125,
            samples: 4,
        };
        let world = WorldState {
            generation: 1,
            step,
            film_s: step as f64 / 120.0,
            frame,
            paused,
            bodies: vec![body],
            touches: vec![touch; 2],
            patches: vec![patch],
        };
        self.world.send_replace(Some(Arc::new(world)));
    }

    pub async fn viewer(&self) -> Page {
        Page::open(&format!("ws://{}/feed", self.feed.address())).await
    }

    pub async fn controller(&self) -> Page {
        self.page_with_token(TOKEN).await
    }

    pub async fn page_with_token(&self, token: &str) -> Page {
        Page::open_with(&format!("ws://{}/feed", self.feed.address()), Some(token)).await
    }
}

pub type Socket = WebSocketStream<MaybeTlsStream<TcpStream>>;

/// Messages that a page has read and its test has not: more than any test waits.
const MAX_UNHEARD: usize = 4096;

/// A page as a test sees it. It reads and answers pings all the time, whatever its test does: one that does not is dropped.
pub struct Page {
    writing: SplitSink<Socket, Message>,
    messages: mpsc::Receiver<Message>,
    reading: AbortHandle,
    /// Whether it acknowledges frame sets by itself.
    pub shows: bool,
    /// By then it has heard all that its test waits for.
    deadline: tokio::time::Instant,
}

/// What a page hears.
#[derive(Clone, Debug)]
pub enum Heard {
    Text(Value),
    Binary(Vec<u8>),
    Close(Option<String>),
}

pub fn u16_at(bytes: &[u8], at: usize) -> u16 {
    u16::from_le_bytes([bytes[at], bytes[at + 1]])
}

pub fn u32_at(bytes: &[u8], at: usize) -> u32 {
    u32::from(u16_at(bytes, at)) | u32::from(u16_at(bytes, at + 2)) << 16
}

pub fn frame_of(bytes: &[u8]) -> u64 {
    u64::from(u32_at(bytes, 16)) | u64::from(u32_at(bytes, 20)) << 32
}

pub fn seq_of(bytes: &[u8]) -> u32 {
    u32_at(bytes, 8)
}

/// Connects as a page does.
pub async fn connect(url: &str, token: Option<&str>) -> Result<Socket, tungstenite::Error> {
    tokio_tungstenite::connect_async(request(url, token)).await.map(|(socket, _)| socket)
}

/// What a page requests first: a token is offered as a subprotocol.
pub fn request(url: &str, token: Option<&str>) -> tungstenite::handshake::client::Request {
    let mut request = url.into_client_request().expect("an address");
    let offered = token.map(|token| format!(", hulltouch.token.{token}")).unwrap_or_default();
    let protocol = format!("hulltouch.feed.v1{offered}").parse().expect("a value");
    request.headers_mut().insert("Sec-WebSocket-Protocol", protocol);
    request
}

impl Drop for Page {
    fn drop(&mut self) {
        self.reading.abort();
    }
}

impl Page {
    pub async fn open(url: &str) -> Page {
        Page::open_with(url, None).await
    }

    async fn open_with(url: &str, token: Option<&str>) -> Page {
        let deadline = tokio::time::Instant::now() + TIMEOUT;
        let (writing, mut socket) = connect(url, token).await.expect("connects").split();
        let (sender, messages) = mpsc::channel(MAX_UNHEARD);
        let reading = tokio::spawn(async move {
            while let Some(Ok(message)) = socket.next().await {
                if sender.send(message).await.is_err() {
                    break;
                }
            }
        });
        Page { writing, messages, reading: reading.abort_handle(), shows: true, deadline }
    }

    pub async fn say(&mut self, text: Value) {
        self.send(Message::text(text.to_string())).await;
    }

    pub async fn send(&mut self, message: Message) {
        self.writing.send(message).await.expect("sent");
    }

    /// The next message but pings.
    pub async fn hear(&mut self) -> Heard {
        loop {
            let message =
                tokio::time::timeout_at(self.deadline, self.messages.recv()).await.expect("in time");
            match message {
                Some(Message::Text(text)) => {
                    return Heard::Text(serde_json::from_str(&text).expect("JSON"));
                }
                Some(Message::Binary(bytes)) => {
                    assert_eq!(u32_at(&bytes, 12) as usize, bytes.len(), "a message knows its length");
                    if bytes[4] == 1 && self.shows {
                        let shown = serde_json::json!({"op": "shown", "seq": seq_of(&bytes)});
                        self.say(shown).await;
                    }
                    return Heard::Binary(bytes.to_vec());
                }
                Some(Message::Close(frame)) => {
                    return Heard::Close(frame.map(|frame| frame.reason.to_string()));
                }
                Some(_) => {}
                None => return Heard::Close(None),
            }
        }
    }

    pub async fn hear_op(&mut self, op: &str) -> Value {
        loop {
            match self.hear().await {
                Heard::Text(text) if text["op"] == op => return text,
                Heard::Close(why) => panic!("closed before {op:?}: {why:?}"),
                _ => {}
            }
        }
    }

    pub async fn hear_kind(&mut self, kind: u8) -> Vec<u8> {
        loop {
            match self.hear().await {
                Heard::Binary(bytes) if bytes[4] == kind => return bytes,
                Heard::Close(why) => panic!("closed before a message of type {kind}: {why:?}"),
                _ => {}
            }
        }
    }

    /// Frame sets until one of this frame or a later one.
    pub async fn hear_frame(&mut self, frame: u64) -> Vec<u8> {
        loop {
            let found = self.hear_kind(1).await;
            if frame_of(&found) >= frame {
                return found;
            }
        }
    }
}

/// Waits until something holds.
pub async fn until(what: &str, mut holds: impl FnMut() -> bool) {
    let patient = async {
        while !holds() {
            tokio::time::sleep(Duration::from_millis(5)).await;
        }
    };
    tokio::time::timeout(TIMEOUT, patient).await.unwrap_or_else(|_| panic!("{what}, in time"));
}
