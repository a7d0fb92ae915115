//! The coordinator's side of one node: connects with backoff, checks who answers, keeps its streams
//! open and what it told. Besides the node's service the only place that speaks the protocol.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use hull::{ProbeSettings, Shape, Silhouette};
use hyper_util::rt::TokioIo;
use proto::convert::{
    ProbeAnswer, SilhouetteEncoding, StreamKnows, WrittenQuestion, answer_from_wire, pixel_rect_from_wire,
    settings_from_wire, shape_to_wire, silhouette_from_data,
};
use proto::v1::camera_node_client::CameraNodeClient;
use proto::{Address, MAX_FRAME_BYTES, MAX_MESSAGE_BYTES, v1};
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::{TcpStream, UnixStream};
use tokio::sync::{Notify, mpsc};
use tokio_stream::StreamExt;
use tokio_stream::wrappers::ReceiverStream;
use tonic::transport::{Channel, Endpoint, Uri};

use crate::counting::{ByteCounters, CountingStream};
use crate::facts::{CameraFacts, FilmState, FrameFacts, Pace};

/// Frames remembered of a node: twice what its ring holds, so that nodes out of step still share some.
const REMEMBERED_FRAMES: usize = 16;
/// Requests on their way: a pass has one question at a time, and a stalled node must not collect more.
const MAX_SENDING: usize = 8;
const CONNECT_TIMEOUT: Duration = Duration::from_secs(2);
const FIRST_BACKOFF: Duration = Duration::from_millis(50);
const LONGEST_BACKOFF: Duration = Duration::from_secs(2);
const KEEP_ALIVE: Duration = Duration::from_secs(5);
/// All calls of a connection's beginning together: sources open, programs start.
const CALLS_TIMEOUT: Duration = Duration::from_secs(30);

/// A camera that a node must serve.
#[derive(Clone, Debug, PartialEq)]
pub struct ExpectedCamera {
    /// Its name in the rig.
    pub name: String,
    /// Its place in the rig.
    pub rig_index: u16,
    /// Width and height, pixels.
    pub size: (u32, u32),
    /// The digest of its calibration.
    pub calibration_digest: [u8; 32],
}

/// A node that must be there.
#[derive(Clone, Debug, PartialEq)]
pub struct ExpectedNode {
    /// Where it listens.
    pub address: Address,
    /// Its cameras in rig order.
    pub cameras: Vec<ExpectedCamera>,
}

/// What a link tells the pass in flight.
pub(crate) enum Event {
    /// A node's reply to the question of that id, and the milliseconds that it computed.
    Reply(usize, u64, ProbeAnswer, f64),
    /// A node's connection broke.
    Down(usize),
}

/// What every connection of a run needs.
pub(crate) struct Common {
    pub settings: ProbeSettings,
    pub fps: f64,
    /// What bodies there are; a node that comes back is told.
    pub shapes: Mutex<Vec<Arc<Shape>>>,
    pub counters: Arc<ByteCounters>,
    pub pace: Mutex<Option<Pace>>,
    /// Wakes the loop when any node told anything.
    pub told: Arc<Notify>,
}

impl Common {
    fn shapes(&self) -> Vec<Arc<Shape>> {
        self.shapes.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }
}

/// One node as the coordinator sees it.
pub(crate) struct Link {
    pub node: ExpectedNode,
    index: usize,
    common: Arc<Common>,
    events: mpsc::Sender<Event>,
    state: Mutex<LinkState>,
}

#[derive(Default)]
struct LinkState {
    connection: Option<Connection>,
    frames: VecDeque<FrameFacts>,
    film: FilmState,
    problem: Option<String>,
    /// What the probe stream has told.
    knows: StreamKnows,
}

#[derive(Clone)]
struct Connection {
    client: CameraNodeClient<Channel>,
    probes: mpsc::Sender<v1::ProbeRequest>,
    credits: mpsc::Sender<v1::FrameCredit>,
}

impl Link {
    /// Begins to connect, and does so again whenever the connection breaks.
    pub fn spawn(
        node: ExpectedNode,
        index: usize,
        common: Arc<Common>,
        events: mpsc::Sender<Event>,
    ) -> Arc<Link> {
        let link = Arc::new(Link { node, index, common, events, state: Mutex::default() });
        tokio::spawn(Arc::clone(&link).keep_connected());
        link
    }

    /// True while the node answers.
    pub fn is_up(&self) -> bool {
        self.state().connection.is_some()
    }

    /// Why the node is not there, if it is known.
    pub fn problem(&self) -> Option<String> {
        self.state().problem.clone()
    }

    /// How its film stands.
    pub fn film(&self) -> FilmState {
        self.state().film.clone()
    }

    /// The facts of a frame.
    pub fn facts(&self, frame: u64) -> Option<FrameFacts> {
        self.state().frames.iter().find(|facts| facts.frame == frame).cloned()
    }

    /// The numbers of remembered frames, ascending.
    pub fn frames(&self) -> Vec<u64> {
        self.state().frames.iter().map(|facts| facts.frame).collect()
    }

    /// Begins a run at this node; forgets the frames of the one before.
    pub async fn start(&self, pace: Pace) -> Result<(), tonic::Status> {
        let client = {
            let mut state = self.state();
            state.frames.clear();
            state.film = FilmState::Running;
            state.connection.as_ref().map(|connection| connection.client.clone())
        };
        let Some(mut client) = client else { return Err(tonic::Status::unavailable("not connected")) };
        client.start(start_request(pace)).await.map(|_| ())
    }

    /// Lets a lock-step node go on up to a frame. A credit that does not fit is dropped: a later one says
    /// more.
    pub fn credit(&self, up_to_frame: u64) {
        if let Some(connection) = &self.state().connection {
            let _ = connection.credits.try_send(v1::FrameCredit { up_to_frame });
        }
    }

    /// Puts a question on its way; false if the node is not there, or does not read.
    pub fn ask(&self, id: u64, frame: u64, question: &WrittenQuestion) -> bool {
        let mut state = self.state();
        let message = question.message(&state.knows, id, frame);
        let sent =
            state.connection.as_ref().is_some_and(|connection| connection.probes.try_send(message).is_ok());
        if sent {
            state.knows.learn(question);
        }
        sent
    }

    /// Tells everything anew with the next question: one was refused, so who knows what was understood.
    pub fn forget(&self) {
        self.state().knows = StreamKnows::default();
    }

    /// The facts of its newest frame.
    pub fn newest(&self) -> Option<FrameFacts> {
        self.state().frames.back().cloned()
    }

    /// Registers the run's shapes once more.
    pub async fn register_shapes(&self) -> Result<(), tonic::Status> {
        self.register(&self.common.shapes()).await
    }

    /// Registers shapes.
    pub async fn register(&self, shapes: &[Arc<Shape>]) -> Result<(), tonic::Status> {
        let client = self.state().connection.as_ref().map(|connection| connection.client.clone());
        let Some(mut client) = client else { return Err(tonic::Status::unavailable("not connected")) };
        register(&mut client, shapes).await
    }

    /// Has the node's cameras learn their backgrounds anew from so many frames; or only asks whether they could.
    pub async fn take_background(
        &self,
        first_frame: u64,
        frames: u64,
        check_only: bool,
    ) -> Result<(), String> {
        let client = self.state().connection.as_ref().map(|connection| connection.client.clone());
        let mut client = client.ok_or("not connected")?;
        let request = v1::TakeBackgroundRequest { first_frame, frames, check_only };
        client.take_background(request).await.map(drop).map_err(|status| status.message().to_owned())
    }

    /// The silhouettes of a frame by place in the rig, and how many bytes they travelled as.
    pub async fn silhouettes(
        &self,
        frame: u64,
        encoding: SilhouetteEncoding,
    ) -> Result<(Vec<(u16, Silhouette)>, u64), String> {
        let client = self.state().connection.as_ref().map(|connection| connection.client.clone());
        let mut client = client.ok_or("not connected")?;
        let said = |status: tonic::Status| status.message().to_owned();
        let request =
            v1::FetchSilhouettesRequest { frame, encoding: v1::SilhouetteEncoding::from(encoding).into() };
        let mut told = client.fetch_silhouettes(request).await.map_err(said)?.into_inner();
        let mut bytes = 0;
        let mut found = Vec::new();
        while let Some(silhouette) = told.message().await.map_err(said)? {
            let v1::Silhouette { rig_index, data } = silhouette;
            let camera = self.node.cameras.iter().find(|camera| u32::from(camera.rig_index) == rig_index);
            let camera =
                camera.ok_or_else(|| format!("silhouette of camera {rig_index}, not one of its own"))?;
            if found.iter().any(|(known, _)| *known == camera.rig_index) {
                return Err(format!("two silhouettes of camera {rig_index}"));
            }
            bytes += data.len() as u64;
            let silhouette = silhouette_from_data(&data, camera.size, encoding);
            found.push((camera.rig_index, silhouette.map_err(|error| error.to_string())?));
        }
        if found.len() != self.node.cameras.len() {
            return Err(format!("{} silhouettes, expected {}", found.len(), self.node.cameras.len()));
        }
        Ok((found, bytes))
    }

    fn state(&self) -> MutexGuard<'_, LinkState> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    async fn keep_connected(self: Arc<Link>) {
        let mut backoff = FIRST_BACKOFF;
        // The loop ends with the run: then nobody receives events any more.
        while !self.events.is_closed() {
            let connected = tokio::time::timeout(CALLS_TIMEOUT, self.connect()).await;
            match connected.unwrap_or_else(|_| Err("it took too long to answer".into())) {
                Ok((connection, replies, frames)) => {
                    backoff = FIRST_BACKOFF;
                    // What it told before it went is no longer true.
                    *self.state() = LinkState { connection: Some(connection), ..LinkState::default() };
                    self.common.told.notify_one();
                    tracing::debug!("node {} is up", self.node.address);
                    let problem = tokio::select! {
                        problem = self.read_replies(replies) => problem,
                        problem = self.read_frames(frames) => problem,
                    };
                    self.state().connection = None;
                    self.state().problem = Some(problem);
                    // Whoever asks next finds it missing anyway; only a pass in flight must hear of it.
                    let _ = self.events.try_send(Event::Down(self.index));
                }
                Err(problem) => self.state().problem = Some(problem),
            }
            self.common.told.notify_one();
            tokio::time::sleep(backoff).await;
            backoff = (backoff * 2).min(LONGEST_BACKOFF);
        }
    }

    async fn connect(
        &self,
    ) -> Result<(Connection, tonic::Streaming<v1::ProbeReply>, tonic::Streaming<v1::FrameInfo>), String> {
        let channel = self.channel().await?;
        let mut client = CameraNodeClient::new(channel)
            .max_decoding_message_size(MAX_MESSAGE_BYTES)
            .max_encoding_message_size(MAX_MESSAGE_BYTES);
        let said = |status: tonic::Status| status.message().to_owned();
        let described = client.describe(v1::DescribeRequest {}).await.map_err(said)?.into_inner();
        self.check(&described)?;
        register(&mut client, &self.common.shapes()).await.map_err(said)?;
        let pace = *self.common.pace.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(pace) = pace {
            client.start(start_request(pace)).await.map_err(said)?;
        }
        let (credits, credited) = mpsc::channel(MAX_SENDING);
        let (probes, probed) = mpsc::channel(MAX_SENDING);
        let frames = client.watch_frames(ReceiverStream::new(credited)).await.map_err(said)?.into_inner();
        let replies = client.probe(ReceiverStream::new(probed)).await.map_err(said)?.into_inner();
        Ok((Connection { client, probes, credits }, replies, frames))
    }

    async fn channel(&self) -> Result<Channel, String> {
        let endpoint = Endpoint::from_static("http://node.invalid")
            .connect_timeout(CONNECT_TIMEOUT)
            .max_frame_size(MAX_FRAME_BYTES)
            .http2_keep_alive_interval(KEEP_ALIVE)
            .keep_alive_timeout(KEEP_ALIVE)
            .keep_alive_while_idle(true);
        match self.node.address.clone() {
            Address::Tcp(address) => {
                let open = move || {
                    let address = address.clone();
                    async move {
                        let socket = TcpStream::connect(address).await?;
                        socket.set_nodelay(true)?;
                        Ok(socket)
                    }
                };
                self.connected(endpoint, open).await
            }
            Address::Unix(path) => self.connected(endpoint, move || UnixStream::connect(path.clone())).await,
        }
    }

    /// A channel over sockets that `open` opens, whose bytes are counted.
    async fn connected<S, F>(
        &self,
        endpoint: Endpoint,
        open: impl Fn() -> F + Send + 'static,
    ) -> Result<Channel, String>
    where
        S: AsyncRead + AsyncWrite + Send + Unpin + 'static,
        F: Future<Output = std::io::Result<S>> + Send + 'static,
    {
        let counters = Arc::clone(&self.common.counters);
        let connector = tower::service_fn(move |_: Uri| {
            let (opening, counters) = (open(), Arc::clone(&counters));
            async move {
                Ok::<_, std::io::Error>(TokioIo::new(CountingStream { inner: opening.await?, counters }))
            }
        });
        endpoint.connect_with_connector(connector).await.map_err(|error| chain(&error))
    }

    /// Is this the node that the cluster file means?
    fn check(&self, described: &v1::DescribeReply) -> Result<(), String> {
        let v1::DescribeReply { version: _, cameras, settings, frames_per_s } = described;
        let settings = settings.as_ref().ok_or("it did not tell its settings")?;
        let settings = settings_from_wire(settings).map_err(|error| error.to_string())?;
        if settings != self.common.settings {
            return Err(format!("it judges by {settings:?}, expected {:?}", self.common.settings));
        }
        if *frames_per_s != self.common.fps {
            return Err(format!("it films {frames_per_s} frames/s, expected {}", self.common.fps));
        }
        for expected in &self.node.cameras {
            let name = &expected.name;
            let found = cameras.iter().find(|camera| camera.name == *name);
            let found = found.ok_or_else(|| format!("it has no camera {name:?}"))?;
            if found.calibration_digest[..] != expected.calibration_digest[..] {
                return Err(format!("its calibration of camera {name:?} is not the rig's"));
            }
            if found.rig_index != u32::from(expected.rig_index) {
                let place = found.rig_index;
                return Err(format!(
                    "it has camera {name:?} at place {place}, expected {}",
                    expected.rig_index
                ));
            }
        }
        if cameras.len() != self.node.cameras.len() {
            return Err(format!("it has {} cameras, expected {}", cameras.len(), self.node.cameras.len()));
        }
        Ok(())
    }

    async fn read_replies(&self, mut replies: tonic::Streaming<v1::ProbeReply>) -> String {
        loop {
            match replies.next().await {
                Some(Ok(reply)) => {
                    let (id, answer, compute_ms) = match answer_from_wire(reply) {
                        Ok(converted) => converted,
                        Err(error) => return format!("it answers nonsense: {error}"),
                    };
                    if self.events.send(Event::Reply(self.index, id, answer, compute_ms)).await.is_err() {
                        return "the run is over".into();
                    }
                }
                Some(Err(status)) => return status.message().to_owned(),
                None => return "it closed the stream".into(),
            }
        }
    }

    async fn read_frames(&self, mut frames: tonic::Streaming<v1::FrameInfo>) -> String {
        loop {
            match frames.next().await {
                Some(Ok(info)) => {
                    if let Err(error) = self.note_frame(&info) {
                        return error.to_string();
                    }
                    self.common.told.notify_one();
                }
                Some(Err(status)) => return status.message().to_owned(),
                None => return "it closed the stream".into(),
            }
        }
    }

    fn note_frame(&self, info: &v1::FrameInfo) -> Result<(), proto::convert::ConvertError> {
        let v1::FrameInfo { frame, capture_time_s, captured_unix_s, cameras, skipped, ended, failure } = info;
        if *ended {
            let failed = !failure.is_empty();
            self.state().film = if failed { FilmState::Failed(failure.clone()) } else { FilmState::Ended };
            return Ok(());
        }
        let camera = |camera: &v1::CameraFrame| {
            Ok(CameraFacts {
                rig_index: camera.rig_index as u16,
                admitted: camera.admitted.as_ref().map(pixel_rect_from_wire).transpose()?,
                area: camera.area,
                silhouette_bytes: camera.silhouette_bytes,
                segment_ms: camera.segment_ms,
            })
        };
        let facts = FrameFacts {
            frame: *frame,
            capture_time_s: *capture_time_s,
            captured_unix_s: *captured_unix_s,
            cameras: cameras.iter().map(camera).collect::<Result<_, _>>()?,
            skipped: *skipped,
        };
        let mut state = self.state();
        if state.frames.back().is_some_and(|newest| newest.frame >= facts.frame) {
            // A node that began anew: what it told before is gone.
            state.frames.clear();
        }
        state.frames.push_back(facts);
        if state.frames.len() > REMEMBERED_FRAMES {
            state.frames.pop_front();
        }
        Ok(())
    }
}

fn start_request(pace: Pace) -> v1::StartRequest {
    v1::StartRequest { epoch_unix_s: pace.epoch_unix_s, lock_step: pace.lock_step }
}

async fn register(
    client: &mut CameraNodeClient<Channel>,
    shapes: &[Arc<Shape>],
) -> Result<(), tonic::Status> {
    let shapes = shapes.iter().map(|shape| shape_to_wire(shape)).collect();
    client.register_shapes(v1::RegisterShapesRequest { shapes }).await.map(|_| ())
}

/// An error with its causes: tonic's own words alone say only "transport error".
fn chain(error: &dyn std::error::Error) -> String {
    let mut text = error.to_string();
    let mut cause = error.source();
    while let Some(error) = cause {
        text = error.to_string();
        cause = error.source();
    }
    text
}
