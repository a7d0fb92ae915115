//! The node's gRPC service: the only place of this crate that speaks the protocol. Probes are computed
//! on a thread of their own; async code moves bytes.

use std::pin::Pin;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use hull::question::Question;
use proto::convert::{
    Precision, QuestionReader, RefusalReason, SilhouetteEncoding, answer_to_wire, pixel_rect_to_wire,
    refusal, settings_to_wire, silhouette_data,
};
use proto::v1::camera_node_server::{CameraNode, CameraNodeServer};
use proto::{MAX_FRAME_BYTES, MAX_MESSAGE_BYTES, v1};
use thiserror::Error;
use tokio::sync::mpsc;
use tokio_stream::StreamExt;
use tokio_stream::wrappers::{ReceiverStream, UnixListenerStream};
use tonic::transport::server::TcpIncoming;
use tonic::{Request, Response, Status, Streaming};

use crate::NodeConfig;
use crate::capture::{CaptureError, Film, Lesson, Pace};
use crate::cores::{Cores, work_ns};
use crate::frames::{FilmState, Frame, FrameError, FrameRing};
use crate::listen::{Listen, Listener};
use crate::pictures::{Darkroom, Picture, PictureError, PictureKind, PictureOrder};
use crate::shapes::Shapes;

/// Questions that wait at most: more than the bodies of a pass ever overlap; beyond, the node says busy
/// instead of growing.
const MAX_WAITING: usize = 64;

/// Up to so much work, nanoseconds, the network thread does itself: waking another one and being woken by it
/// takes a tenth of a millisecond, in which bytes could as well wait.
const AT_ONCE_NS: usize = 400_000;

/// A silent peer is noticed within twice this.
const KEEP_ALIVE: Duration = Duration::from_secs(5);

/// A node that is asked to end lets calls finish for so long; streams would go on for ever.
const LAST_WORDS: Duration = Duration::from_millis(300);

/// Why a node cannot serve.
#[derive(Debug, Error)]
pub enum ServeError {
    /// Film cannot begin.
    #[error(transparent)]
    Capture(#[from] CaptureError),
    /// A port that others reach, without being told so.
    #[error(
        "listen address {0} is reachable from other machines and the protocol is not encrypted: \
         expected a loopback address, or --insecure"
    )]
    Exposed(Listen),
    /// The address cannot be had.
    #[error("cannot listen on {address}: {error}")]
    Listen {
        /// Which address.
        address: Listen,
        /// What the system says.
        error: std::io::Error,
    },
    /// The system gives no thread.
    #[error("cannot start a thread: {0}")]
    Thread(std::io::Error),
    /// Learning the backgrounds panicked.
    #[error("learning the backgrounds failed: {0}")]
    Panicked(String),
    /// The transport broke.
    #[error("serving failed: {0}")]
    Transport(#[from] tonic::transport::Error),
}

/// A node that holds its port and has learnt its backgrounds, ready to serve.
pub struct Node {
    listener: Listener,
    service: Service,
    ring: Arc<FrameRing>,
}

impl Node {
    /// Binds the address (port 0: any free one) and learns the backgrounds. Must run within a tokio
    /// runtime. Any address but a loopback one or a Unix socket needs `insecure`.
    pub async fn open(
        config: NodeConfig,
        address: impl Into<Listen>,
        insecure: bool,
    ) -> Result<Node, ServeError> {
        let address = address.into();
        if matches!(address, Listen::Tcp(address) if !address.ip().is_loopback()) {
            if !insecure {
                return Err(ServeError::Exposed(address));
            }
            tracing::warn!(
                "listening on {address} without encryption or passwords: anyone who reaches it may ask"
            );
        }
        let bound = Listener::bind(&address).await;
        let listener = bound.map_err(|error| ServeError::Listen { address, error })?;
        let ring = Arc::new(FrameRing::new(config.cameras.len()));
        let shared = Arc::clone(&ring);
        // Learning reads whole clips; meanwhile the runtime must hear that it should end.
        let service = tokio::task::spawn_blocking(move || Service::new(config, shared))
            .await
            .map_err(|error| ServeError::Panicked(error.to_string()))??;
        Ok(Node { listener, service, ring })
    }

    /// The address it listens on.
    pub fn address(&self) -> std::io::Result<Listen> {
        self.listener.address()
    }

    /// Its frames.
    pub fn ring(&self) -> Arc<FrameRing> {
        Arc::clone(&self.ring)
    }

    /// Serves until `stop` completes.
    pub async fn serve(self, stop: impl Future<Output = ()>) -> Result<(), ServeError> {
        let (reporter, health) = tonic_health::server::health_reporter();
        reporter.set_serving::<CameraNodeServer<Service>>().await;
        let reflection = || {
            tonic_reflection::server::Builder::configure()
                .register_encoded_file_descriptor_set(v1::DESCRIPTORS)
        };
        let describe_error = "the protocol's own description is valid";
        let service = CameraNodeServer::new(self.service)
            .max_decoding_message_size(MAX_MESSAGE_BYTES)
            .max_encoding_message_size(MAX_MESSAGE_BYTES);
        let (tell, told) = tokio::sync::oneshot::channel::<()>();
        let router = tonic::transport::Server::builder()
            .max_frame_size(MAX_FRAME_BYTES)
            .http2_keepalive_interval(Some(KEEP_ALIVE))
            .http2_keepalive_timeout(Some(KEEP_ALIVE))
            .add_service(health)
            .add_service(reflection().build_v1().expect(describe_error))
            .add_service(reflection().build_v1alpha().expect(describe_error))
            .add_service(service);
        let told = async { drop(told.await) };
        let serving = async {
            match self.listener {
                Listener::Tcp(listener) => {
                    // The server's own setting does not reach sockets that it is handed.
                    let incoming = TcpIncoming::from(listener).with_nodelay(Some(true));
                    router.serve_with_incoming_shutdown(incoming, told).await
                }
                Listener::Unix(listener, file) => {
                    let incoming = UnixListenerStream::new(listener);
                    let served = router.serve_with_incoming_shutdown(incoming, told).await;
                    drop(file);
                    served
                }
            }
        };
        let end = async {
            stop.await;
            drop(tell);
            tokio::time::sleep(LAST_WORDS).await;
        };
        tokio::select! {
            served = serving => served.map_err(ServeError::from),
            () = end => Ok(()),
        }
    }
}

/// A question on its way to the worker, and where its reply goes.
struct Job {
    asked: Asked,
    replies: mpsc::Sender<Result<v1::ProbeReply, Status>>,
}

/// A question that was read.
struct Asked {
    id: u64,
    frame: u64,
    precision: Precision,
    question: Question,
}

/// The state behind every call.
pub struct Service {
    config: NodeConfig,
    film: Arc<Film>,
    ring: Arc<FrameRing>,
    shapes: Arc<Shapes>,
    worker: Arc<Mutex<Worker>>,
    /// Questions that were put into the queue and are not answered.
    waiting: Arc<AtomicUsize>,
    jobs: SyncSender<Job>,
    darkroom: Darkroom,
}

impl Service {
    fn new(config: NodeConfig, ring: Arc<FrameRing>) -> Result<Service, ServeError> {
        let film = Arc::new(Film::prepare(&config, Arc::clone(&ring))?);
        let shapes = Arc::new(Shapes::default());
        let (jobs, queue) = sync_channel(MAX_WAITING);
        let worker = Worker { ring: Arc::clone(&ring), cores: Cores::of_this_machine() };
        let (worker, waiting) = (Arc::new(Mutex::new(worker)), Arc::new(AtomicUsize::new(0)));
        let (working, count) = (Arc::clone(&worker), Arc::clone(&waiting));
        // The thread ends when the last sender is gone.
        std::thread::spawn(move || work(&working, &queue, &count));
        let rig_indices = config.cameras.iter().map(|camera| camera.rig_index).collect();
        let darkroom = Darkroom::new(Arc::clone(&ring), rig_indices).map_err(ServeError::Thread)?;
        Ok(Service { config, film, ring, shapes, worker, waiting, jobs, darkroom })
    }
}

/// Answers queued questions in their order.
fn work(worker: &Mutex<Worker>, queue: &Receiver<Job>, waiting: &AtomicUsize) {
    while let Ok(Job { asked, replies }) = queue.recv() {
        let reply = worker.lock().unwrap_or_else(PoisonError::into_inner).answer_or_say(&asked);
        // The asker may have gone, or read nothing: that is no reason to keep others waiting.
        if replies.try_send(Ok(reply)).is_err() {
            tracing::debug!("a reply found no reader");
        }
        waiting.fetch_sub(1, Ordering::Release);
    }
}

/// Computes answers, one question at a time.
struct Worker {
    ring: Arc<FrameRing>,
    cores: Cores,
}

impl Worker {
    fn answer_or_say(&mut self, asked: &Asked) -> v1::ProbeReply {
        let answered = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| self.answer(asked)));
        answered.unwrap_or_else(|_| {
            // No message may end the node, not even one that finds a bug.
            tracing::error!("a question made the computation panic");
            self.cores = Cores::of_this_machine();
            refusal(asked.id, RefusalReason::Malformed, "the computation panicked")
        })
    }

    fn answer(&mut self, asked: &Asked) -> v1::ProbeReply {
        let began = Instant::now();
        let &Asked { id, frame, precision, ref question } = asked;
        let frame = match self.ring.get(frame) {
            Ok(frame) => frame,
            Err(error) => {
                let reason = match error {
                    FrameError::Gone { .. } => RefusalReason::Gone,
                    FrameError::NotYet { .. } => RefusalReason::NotYet,
                };
                return refusal(id, reason, error.to_string());
            }
        };
        let answer = self.cores.answer(&frame.views, question);
        let camera_count = frame.views.views().len();
        answer_to_wire(id, answer, camera_count, precision, began.elapsed().as_secs_f64() * 1e3)
    }
}

/// One probe stream.
struct Stream {
    reader: QuestionReader,
    shapes: Arc<Shapes>,
    worker: Arc<Mutex<Worker>>,
    waiting: Arc<AtomicUsize>,
    jobs: SyncSender<Job>,
    replies: mpsc::Sender<Result<v1::ProbeReply, Status>>,
    cameras: usize,
}

impl Stream {
    async fn serve(mut self, mut requests: Streaming<v1::ProbeRequest>) {
        while let Some(Ok(request)) = requests.next().await {
            let reply = match self.read(request) {
                Ok(asked) => match self.answer_at_once(&asked) {
                    Some(reply) => Some(reply),
                    None => match self.queue(asked) {
                        Ok(reply) => reply,
                        Err(Closed) => return,
                    },
                },
                Err(reply) => Some(*reply),
            };
            if let Some(reply) = reply
                && self.replies.send(Ok(reply)).await.is_err()
            {
                return;
            }
        }
    }

    fn read(&mut self, request: v1::ProbeRequest) -> Result<Asked, Box<v1::ProbeReply>> {
        let (id, frame) = (request.id, request.frame);
        let precision = if request.rounded { Precision::Quantised } else { Precision::Exact };
        let mut question = Question::default();
        let read = self.reader.read(request, |key| self.shapes.get(key), &mut question);
        read.map_err(|error| Box::new(refusal(id, RefusalReason::from(&error), error.to_string())))?;
        Ok(Asked { id, frame, precision, question })
    }

    /// A small question is answered here and now if nothing waits: handing it to another thread and back would
    /// take as long.
    fn answer_at_once(&self, asked: &Asked) -> Option<v1::ProbeReply> {
        let is_idle = self.waiting.load(Ordering::Acquire) == 0;
        let is_small = work_ns(&asked.question, self.cameras) <= AT_ONCE_NS;
        let mut worker = if is_idle && is_small { self.worker.try_lock().ok()? } else { return None };
        Some(worker.answer_or_say(asked))
    }

    /// Puts a question into the queue; a reply, if that is full.
    fn queue(&self, asked: Asked) -> Result<Option<v1::ProbeReply>, Closed> {
        let id = asked.id;
        self.waiting.fetch_add(1, Ordering::Release);
        let queued = self.jobs.try_send(Job { asked, replies: self.replies.clone() });
        if queued.is_err() {
            self.waiting.fetch_sub(1, Ordering::Release);
        }
        match queued {
            Ok(()) => Ok(None),
            Err(TrySendError::Full(_)) => {
                let busy = format!("{MAX_WAITING} questions wait");
                Ok(Some(refusal(id, RefusalReason::Busy, busy)))
            }
            Err(TrySendError::Disconnected(_)) => Err(Closed),
        }
    }
}

/// The node is ending.
struct Closed;

type Replies<T> = Pin<Box<dyn tokio_stream::Stream<Item = Result<T, Status>> + Send>>;

#[tonic::async_trait]
impl CameraNode for Service {
    async fn describe(&self, _: Request<v1::DescribeRequest>) -> Result<Response<v1::DescribeReply>, Status> {
        let describe = |camera: &crate::NodeCamera| v1::CameraDescription {
            name: camera.camera.name().into(),
            rig_index: camera.rig_index.into(),
            width: camera.camera.width(),
            height: camera.camera.height(),
            calibration_digest: camera.camera.digest().to_vec().into(),
        };
        Ok(Response::new(v1::DescribeReply {
            version: env!("CARGO_PKG_VERSION").into(),
            cameras: self.config.cameras.iter().map(describe).collect(),
            settings: Some(settings_to_wire(&self.config.settings)),
            frames_per_s: self.config.fps,
        }))
    }

    async fn start(&self, request: Request<v1::StartRequest>) -> Result<Response<v1::StartReply>, Status> {
        let v1::StartRequest { epoch_unix_s, lock_step } = request.into_inner();
        if !epoch_unix_s.is_finite() {
            let found = format!("StartRequest.epoch_unix_s is {epoch_unix_s}, expected unix seconds");
            return Err(Status::invalid_argument(found));
        }
        let film = Arc::clone(&self.film);
        // Opening sources blocks: programs start, files are read.
        tokio::task::spawn_blocking(move || film.start(Pace { epoch_unix_s, lock_step }))
            .await
            .map_err(|error| Status::internal(error.to_string()))?
            .map_err(|error| Status::failed_precondition(error.to_string()))?;
        Ok(Response::new(v1::StartReply {}))
    }

    type WatchFramesStream = Replies<v1::FrameInfo>;

    async fn watch_frames(
        &self,
        request: Request<Streaming<v1::FrameCredit>>,
    ) -> Result<Response<Self::WatchFramesStream>, Status> {
        let mut credits = request.into_inner();
        let film = Arc::clone(&self.film);
        tokio::spawn(async move {
            while let Some(Ok(v1::FrameCredit { up_to_frame })) = credits.next().await {
                film.credit(up_to_frame);
            }
        });
        // A reader that lags by more than the ring has lost frames anyway.
        let (sender, receiver) = mpsc::channel(crate::frames::RING_FRAMES);
        tokio::spawn(tell_frames(Arc::clone(&self.ring), sender));
        Ok(Response::new(Box::pin(ReceiverStream::new(receiver))))
    }

    async fn register_shapes(
        &self,
        request: Request<v1::RegisterShapesRequest>,
    ) -> Result<Response<v1::RegisterShapesReply>, Status> {
        let v1::RegisterShapesRequest { shapes } = request.into_inner();
        let shapes: Result<Vec<_>, _> = shapes.iter().map(proto::convert::shape_from_wire).collect();
        let shapes = shapes.map_err(|error| Status::invalid_argument(error.to_string()))?;
        self.shapes.register(shapes).map_err(|error| Status::resource_exhausted(error.to_string()))?;
        Ok(Response::new(v1::RegisterShapesReply {}))
    }

    type ProbeStream = Replies<v1::ProbeReply>;

    async fn probe(
        &self,
        request: Request<Streaming<v1::ProbeRequest>>,
    ) -> Result<Response<Self::ProbeStream>, Status> {
        let (replies, receiver) = mpsc::channel(MAX_WAITING);
        let stream = Stream {
            reader: QuestionReader::default(),
            shapes: Arc::clone(&self.shapes),
            worker: Arc::clone(&self.worker),
            waiting: Arc::clone(&self.waiting),
            jobs: self.jobs.clone(),
            replies,
            cameras: self.config.cameras.len(),
        };
        tokio::spawn(stream.serve(request.into_inner()));
        Ok(Response::new(Box::pin(ReceiverStream::new(receiver))))
    }

    async fn take_background(
        &self,
        request: Request<v1::TakeBackgroundRequest>,
    ) -> Result<Response<v1::TakeBackgroundReply>, Status> {
        let v1::TakeBackgroundRequest { first_frame, frames, check_only } = request.into_inner();
        let lesson = Lesson { first_frame, frames };
        let taken = if check_only {
            self.film.can_take_background(lesson)
        } else {
            self.film.take_background(lesson)
        };
        taken.map_err(Status::failed_precondition)?;
        Ok(Response::new(v1::TakeBackgroundReply {}))
    }

    type FetchSilhouettesStream = Replies<v1::Silhouette>;

    async fn fetch_silhouettes(
        &self,
        request: Request<v1::FetchSilhouettesRequest>,
    ) -> Result<Response<Self::FetchSilhouettesStream>, Status> {
        let request = request.into_inner();
        let encoding = SilhouetteEncoding::from(request.encoding());
        let frame = self.ring.get(request.frame).map_err(|error| match error {
            FrameError::Gone { .. } => Status::out_of_range(error.to_string()),
            FrameError::NotYet { .. } => Status::unavailable(error.to_string()),
        })?;
        // Encoded one at a time, as they are sent: eight 8K images at once would be 265 MB.
        let silhouette = move |index: usize| {
            let camera = &frame.cameras[index];
            let data = match encoding {
                SilhouetteEncoding::RunsLz4 => camera.bytes.clone(),
                other => silhouette_data(&camera.silhouette, other),
            };
            Ok(v1::Silhouette { rig_index: camera.rig_index.into(), data })
        };
        let cameras = tokio_stream::iter(0..self.config.cameras.len());
        Ok(Response::new(Box::pin(cameras.map(silhouette))))
    }

    type FetchPicturesStream = Replies<v1::Picture>;

    async fn fetch_pictures(
        &self,
        request: Request<v1::FetchPicturesRequest>,
    ) -> Result<Response<Self::FetchPicturesStream>, Status> {
        let order = picture_order(request.into_inner())?;
        // Room for all of them: the darkroom never waits for a reader.
        let (sender, receiver) = mpsc::channel(self.config.cameras.len());
        let deliver = move |picture| {
            if sender.try_send(Ok(picture_to_wire(picture))).is_err() {
                tracing::debug!("a picture found no reader");
            }
        };
        self.darkroom.order(order, deliver).map_err(|error| match error {
            PictureError::Frame(FrameError::Gone { .. }) => Status::out_of_range(error.to_string()),
            PictureError::Frame(FrameError::NotYet { .. }) => Status::unavailable(error.to_string()),
            PictureError::Order { .. } => Status::invalid_argument(error.to_string()),
            PictureError::Busy => Status::resource_exhausted(error.to_string()),
        })?;
        Ok(Response::new(Box::pin(ReceiverStream::new(receiver))))
    }
}

fn picture_order(request: v1::FetchPicturesRequest) -> Result<PictureOrder, Status> {
    use v1::fetch_pictures_request::Kind;
    let kind = match request.kind() {
        Kind::Silhouettes => PictureKind::Silhouettes,
        Kind::Crops => PictureKind::Crops,
        Kind::Whole => PictureKind::Whole,
    };
    let v1::FetchPicturesRequest { frame, scale_log2, jpeg_quality, kind: _, cameras } = request;
    let wrong = |field: &str, found: u32| {
        Status::invalid_argument(format!("FetchPicturesRequest.{field} is {found}, expected less"))
    };
    Ok(PictureOrder {
        frame: (frame != u64::MAX).then_some(frame),
        kind,
        scale_log2: scale_log2.try_into().map_err(|_| wrong("scale_log2", scale_log2))?,
        jpeg_quality: jpeg_quality.try_into().map_err(|_| wrong("jpeg_quality", jpeg_quality))?,
        cameras: cameras
            .into_iter()
            .map(|camera| camera.try_into().map_err(|_| wrong("cameras", camera)))
            .collect::<Result<_, _>>()?,
    })
}

fn picture_to_wire(picture: Picture) -> v1::Picture {
    let Picture { rig_index, frame, captured_unix_s, runs, crop, scale_log2, jpeg } = picture;
    let ([left, top, width, height], rig_index, scale_log2) = (crop, rig_index.into(), scale_log2.into());
    v1::Picture { rig_index, runs, left, top, width, height, jpeg, frame, captured_unix_s, scale_log2 }
}

/// Sends every frame as it comes, then how the film ended.
async fn tell_frames(ring: Arc<FrameRing>, sender: mpsc::Sender<Result<v1::FrameInfo, Status>>) {
    let mut changes = ring.watch();
    // The run and number of the last frame that was told, and the run whose end was.
    let mut last: Option<(u64, u64)> = None;
    let mut told_end: Option<u64> = None;
    loop {
        let (run, frames) = ring.news(last);
        for frame in frames {
            last = Some((run, frame.number));
            if sender.send(Ok(frame_to_wire(&frame))).await.is_err() {
                return;
            }
        }
        // Read before the frames once more: an end that is seen here comes after all of them.
        let state = ring.state();
        let (run_now, left) = ring.news(last);
        if state != FilmState::Running && told_end != Some(run) && run_now == run && left.is_empty() {
            told_end = Some(run);
            let failure = if let FilmState::Failed(why) = state { why } else { String::new() };
            let frame = last.map_or(0, |(_, number)| number);
            let info = v1::FrameInfo { frame, ended: true, failure, ..v1::FrameInfo::default() };
            if sender.send(Ok(info)).await.is_err() {
                return;
            }
        }
        if run_now != run || !left.is_empty() {
            continue;
        }
        tokio::select! {
            changed = changes.changed() => if changed.is_err() { return },
            () = sender.closed() => return,
        }
    }
}

fn frame_to_wire(frame: &Frame) -> v1::FrameInfo {
    let camera = |camera: &crate::frames::CameraFrame| v1::CameraFrame {
        rig_index: camera.rig_index.into(),
        admitted: camera.admitted.map(pixel_rect_to_wire),
        area: camera.silhouette.area(),
        silhouette_bytes: camera.bytes.len() as u32,
        segment_ms: camera.segment_ms,
    };
    v1::FrameInfo {
        frame: frame.number,
        capture_time_s: frame.capture_time_s,
        captured_unix_s: frame.captured_unix_s,
        cameras: frame.cameras.iter().map(camera).collect(),
        skipped: frame.skipped,
        ended: false,
        failure: String::new(),
    }
}
