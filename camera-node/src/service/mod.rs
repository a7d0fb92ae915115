//! The node's gRPC service: the only place of this crate that speaks the protocol. Probes are computed
//! on a thread of their own; async code moves bytes.

mod counted;
mod credit_receiver;
mod film_events;
mod hold;
mod incoming;
mod metered;
mod node;
mod permission;
mod probe_stream;
mod seats;
mod status;
mod turns;
mod watch;
mod worker;
mod world_memory;

pub use incoming::Access;
pub use node::{Node, ServeError, serve_film};
pub use watch::NodeWatch;

use std::pin::Pin;
use std::sync::Arc;

use bytes::Bytes;
use film_time::{BackgroundFilm, monotonic_s, ring_frames};
use hull::Silhouette;
use prost::Message as _;
use proto::convert::{
    SilhouetteEncoding, claim_from_wire, clock_from_wire, description_to_wire, phase_from_wire,
    picture_request_from_wire, picture_to_wire, shape_from_wire, silhouette_data, silhouette_from_data,
    start_from_wire, trace_parent_from_wire,
};
use proto::v1::camera_node_server::CameraNode;
use proto::{CameraDescription, NodeDescription, v1};
use telemetry::{Pulse, Span};
use tokio::sync::mpsc;
use tokio::time::Instant;
use tokio_stream::StreamExt;
use tokio_stream::wrappers::ReceiverStream;
use tonic::{Request, Response, Status, Streaming};

use crate::capture::{BackgroundError, Film, Filming};
use crate::config::{NodeCamera, NodeConfig};
use crate::frames::{CameraFrame, FrameError, FrameRing};
use crate::pictures::{PictureEncoder, PictureError};
use crate::shapes::Shapes;
use credit_receiver::CreditReceiver;
use hold::{ClaimRefused, SharedHold, held};
use incoming::Caller;
use probe_stream::ProbeStream;
use seats::{BudgetExhausted, Seat, Share};
use worker::{MAX_WAITING, ReplySender, WaitingReply, Worker};
use world_memory::{KeptWorlds, WorldMemory};

/// The state behind every call.
struct Service {
    description: NodeDescription,
    film: Arc<dyn Filming>,
    ring: Arc<FrameRing>,
    shapes: Arc<Shapes>,
    worker: Worker,
    /// `None`: of a film without colours.
    pictures: Option<PictureEncoder>,
    hold: SharedHold,
    world: WorldMemory,
    pulse: Pulse,
}

impl Service {
    /// Learns the backgrounds. Blocks until done.
    fn new(config: &NodeConfig) -> Result<(Service, NodeWatch), ServeError> {
        let ring = Arc::new(FrameRing::new(config.cameras.len()).keeping(ring_frames(config.fps)));
        let film = Arc::new(Film::prepare(config, Arc::clone(&ring))?);
        let pictures = PictureEncoder::new(Arc::clone(&ring), film.colours(), config.rig_indices());
        let pulse = film.pulse();
        let worker = Worker::new(Arc::clone(&ring), config.cameras.len(), pulse.beat("answering questions"));
        let pictures = Some(pictures.map_err(ServeError::Thread)?);
        let meter = film.meter();
        let service = Service { pictures, pulse, ..Service::of(config, film, ring, worker) };
        let watch = NodeWatch::of(&service, meter);
        Ok((service, watch))
    }

    /// Of film that is ready.
    fn of(config: &NodeConfig, film: Arc<dyn Filming>, ring: Arc<FrameRing>, worker: Worker) -> Service {
        Service {
            description: describe(config),
            film,
            ring,
            shapes: Arc::default(),
            worker,
            pictures: None,
            hold: SharedHold::default(),
            world: WorldMemory::default(),
            pulse: Pulse::default(),
        }
    }
}

fn describe(config: &NodeConfig) -> NodeDescription {
    let describe = |camera: &NodeCamera| CameraDescription::new(&camera.camera, camera.rig_index);
    NodeDescription {
        version: env!("CARGO_PKG_VERSION").into(),
        cameras: config.cameras.iter().map(describe).collect(),
        settings: config.settings,
        fps: config.fps,
        term: 0,
    }
}

fn frame_status(error: FrameError) -> Status {
    match error {
        FrameError::Gone { .. } => Status::out_of_range(error.to_string()),
        FrameError::NotYet { .. } | FrameError::Empty => Status::failed_precondition(error.to_string()),
    }
}

fn invalid(error: impl std::fmt::Display) -> Status {
    Status::invalid_argument(error.to_string())
}

fn budget_exhausted(error: BudgetExhausted) -> Status {
    Status::resource_exhausted(error.to_string())
}

/// Where what the caller holds is counted.
fn seat<T>(request: &Request<T>) -> Option<Arc<Seat>> {
    request.extensions().get::<Caller>().and_then(|caller| caller.seat.clone())
}

type Replies<T> = Pin<Box<dyn tokio_stream::Stream<Item = Result<T, Status>> + Send>>;

#[tonic::async_trait]
impl CameraNode for Service {
    async fn describe(&self, _: Request<v1::DescribeRequest>) -> Result<Response<v1::DescribeReply>, Status> {
        let mut description = self.description.clone();
        description.term = self.hold.lock().term();
        Ok(Response::new(description_to_wire(&description)))
    }

    async fn hold(&self, request: Request<v1::HoldRequest>) -> Result<Response<v1::HoldReply>, Status> {
        let seat = seat(&request);
        let claim = claim_from_wire(request.into_inner()).map_err(invalid)?;
        let (name, holder) = (claim.name.clone(), claim.id);
        self.hold.lock().claim(claim, Instant::now()).map_err(|refused| match refused {
            ClaimRefused::Held(by) => held(&by),
            ClaimRefused::Term { .. } => Status::invalid_argument(refused.to_string()),
        })?;
        seat.iter().for_each(|seat| seat.prove_lease(holder));
        tracing::debug!("held by {name}");
        Ok(Response::new(v1::HoldReply {}))
    }

    async fn start(&self, request: Request<v1::StartRequest>) -> Result<Response<v1::StartReply>, Status> {
        self.hold.check_call(request.get_ref().holder, &request)?;
        let start = start_from_wire(request.get_ref()).map_err(invalid)?;
        let film = Arc::clone(&self.film);
        // Opening sources blocks: programs start, files are read.
        let started = film_time::apart(move || film.start(start)).await;
        let started = started.ok_or_else(|| Status::internal("the start of film panicked"))?;
        started.map_err(|error| {
            tracing::error!("film cannot start: {error}");
            Status::failed_precondition(error.to_string())
        })?;
        Ok(Response::new(v1::StartReply {}))
    }

    async fn keep_time(
        &self,
        request: Request<v1::KeepTimeRequest>,
    ) -> Result<Response<v1::KeepTimeReply>, Status> {
        let node_s = monotonic_s();
        self.hold.check_call(request.get_ref().holder, &request)?;
        let v1::KeepTimeRequest { run, clock, holder: _, phase } = request.into_inner();
        if let Some(clock) = clock {
            let line = clock_from_wire(&clock).map_err(invalid)?;
            if !self.film.keep_time(run, line) {
                let film = Arc::clone(&self.film);
                tokio::spawn(async move {
                    // Stopping and opening sources blocks.
                    if let Some(Err(error)) = film_time::apart(move || film.start_again(run, line)).await {
                        tracing::error!("film cannot start again: {error}");
                    }
                });
            }
        }
        if let Some(phase) = phase {
            self.film.cut_at(run, phase_from_wire(phase).map_err(invalid)?);
        }
        Ok(Response::new(v1::KeepTimeReply { node_s }))
    }

    type WatchFramesStream = Replies<v1::FrameInfo>;

    async fn watch_frames(
        &self,
        request: Request<Streaming<v1::FrameCredit>>,
    ) -> Result<Response<Self::WatchFramesStream>, Status> {
        let (hold, film, ring) = (self.hold.clone(), Arc::clone(&self.film), Arc::clone(&self.ring));
        tokio::spawn(CreditReceiver { hold, film, ring }.follow(request.into_inner()));
        // A reader that lags by more than the ring has lost frames anyway.
        let (sender, receiver) = mpsc::channel(self.ring.frames());
        tokio::spawn(film_events::send_film_events(Arc::clone(&self.ring), sender));
        Ok(Response::new(Box::pin(ReceiverStream::new(receiver))))
    }

    async fn register_shapes(
        &self,
        request: Request<v1::RegisterShapesRequest>,
    ) -> Result<Response<v1::RegisterShapesReply>, Status> {
        let seat = seat(&request);
        self.hold.check_call(request.get_ref().holder, &request)?;
        let v1::RegisterShapesRequest { shapes, holder } = request.into_inner();
        // The message, and what is made of it.
        let bytes: usize = shapes.iter().map(|shape| shape.samples.len()).sum();
        let _share = Share::take(&seat, 2 * bytes).map_err(budget_exhausted)?;
        let shapes: Result<Vec<_>, _> = shapes.iter().map(shape_from_wire).collect();
        self.shapes
            .register(shapes.map_err(invalid)?, holder)
            .map_err(|error| Status::resource_exhausted(error.to_string()))?;
        Ok(Response::new(v1::RegisterShapesReply {}))
    }

    type ProbeStream = Replies<v1::ProbeReply>;

    async fn probe(
        &self,
        request: Request<Streaming<v1::ProbeRequest>>,
    ) -> Result<Response<Self::ProbeStream>, Status> {
        let seat = seat(&request);
        let (replies, receiver) = mpsc::channel(MAX_WAITING);
        let stream = ProbeStream::new(self, ReplySender::new(replies, seat.clone()), seat);
        tokio::spawn(stream.serve(request.into_inner()));
        let replies =
            ReceiverStream::new(receiver).map(|waiting| waiting.map(|WaitingReply { reply, .. }| reply));
        Ok(Response::new(Box::pin(replies)))
    }

    async fn take_background(
        &self,
        request: Request<v1::TakeBackgroundRequest>,
    ) -> Result<Response<v1::TakeBackgroundReply>, Status> {
        self.hold.check_call(request.get_ref().holder, &request)?;
        let v1::TakeBackgroundRequest { id, first_frame, frames, check_only, allow_foreground, holder: _ } =
            request.into_inner();
        let film = BackgroundFilm { id, first_frame, frames, allow_foreground };
        let refused = |error: BackgroundError| Status::failed_precondition(error.to_string());
        if check_only {
            self.film.check_background(film).map_err(refused)?;
        } else {
            self.film.take_background(film).map_err(refused)?.finished().await.map_err(refused)?;
        }
        Ok(Response::new(v1::TakeBackgroundReply {}))
    }

    async fn restore_background(
        &self,
        request: Request<v1::RestoreBackgroundRequest>,
    ) -> Result<Response<v1::RestoreBackgroundReply>, Status> {
        self.hold.check_call(request.get_ref().holder, &request)?;
        self.film.restore_background(request.get_ref().id);
        Ok(Response::new(v1::RestoreBackgroundReply {}))
    }

    type FetchSilhouettesStream = Replies<v1::Silhouette>;

    async fn fetch_silhouettes(
        &self,
        request: Request<v1::FetchSilhouettesRequest>,
    ) -> Result<Response<Self::FetchSilhouettesStream>, Status> {
        let seat = seat(&request);
        let request = request.into_inner();
        let span = Span::answer("silhouettes", trace_parent_from_wire(&request.traceparent));
        let encoding = SilhouetteEncoding::from(request.encoding());
        let frame = self.ring.get(request.frame).map_err(frame_status)?;
        let size = |silhouette: &Silhouette| (silhouette.width(), silhouette.height());
        // Compact bytes alone: a reader that is slow keeps no frame.
        let compact =
            |camera: &CameraFrame| (camera.rig_index, size(&camera.silhouette), camera.bytes.clone());
        let cameras: Vec<_> = frame.cameras.iter().map(compact).collect();
        let bytes = cameras.iter().map(|(_, _, bytes)| bytes.len()).sum();
        let share = Share::take(&seat, bytes).map_err(budget_exhausted)?;
        // Encoded one at a time, as they are sent: eight 8K images at once would be 265 MB.
        let silhouette = move |(rig_index, size, compact): (u16, _, Bytes)| {
            // They end when the last silhouette is on its way.
            let _until = (&span, &share);
            let data = match encoding {
                SilhouetteEncoding::RunsLz4 => compact,
                other => {
                    let silhouette = silhouette_from_data(&compact, size, SilhouetteEncoding::RunsLz4);
                    let silhouette = silhouette.map_err(|error| Status::internal(error.to_string()))?;
                    silhouette_data(&silhouette, other)
                }
            };
            Ok(v1::Silhouette { rig_index: rig_index.into(), data })
        };
        Ok(Response::new(Box::pin(tokio_stream::iter(cameras).map(silhouette))))
    }

    type FetchPicturesStream = Replies<v1::Picture>;

    async fn fetch_pictures(
        &self,
        request: Request<v1::FetchPicturesRequest>,
    ) -> Result<Response<Self::FetchPicturesStream>, Status> {
        let seat = seat(&request);
        let request = picture_request_from_wire(request.into_inner()).map_err(invalid)?;
        // Room for all of them: the encoder never waits for a reader.
        let (sender, receiver) = mpsc::channel(self.description.cameras.len());
        let deliver = move |picture| {
            let picture = picture_to_wire(picture);
            let share = Share::take(&seat, picture.encoded_len());
            let picture = share.map(|share| (picture, share)).map_err(budget_exhausted);
            if sender.try_send(picture).is_err() {
                tracing::debug!("a picture found no reader");
            }
        };
        let pictures =
            self.pictures.as_ref().ok_or_else(|| Status::unimplemented("there are no pictures"))?;
        pictures.request(request, deliver).map_err(|error| match error {
            PictureError::Frame(error) => frame_status(error),
            PictureError::Cameras { .. } => invalid(error),
            PictureError::Busy => Status::resource_exhausted(error.to_string()),
        })?;
        let pictures = ReceiverStream::new(receiver).map(|picture| picture.map(|(picture, _)| picture));
        Ok(Response::new(Box::pin(pictures)))
    }

    async fn keep_world(
        &self,
        request: Request<v1::KeepWorldRequest>,
    ) -> Result<Response<v1::KeepWorldReply>, Status> {
        self.hold.check_call(request.get_ref().holder, &request)?;
        let v1::KeepWorldRequest { checkpoint, holder: _ } = request.into_inner();
        self.world.keep(&checkpoint).map_err(invalid)?;
        Ok(Response::new(v1::KeepWorldReply {}))
    }

    async fn fetch_world(
        &self,
        _: Request<v1::FetchWorldRequest>,
    ) -> Result<Response<v1::FetchWorldReply>, Status> {
        let KeptWorlds { newest, previous } = self.world.kept();
        Ok(Response::new(v1::FetchWorldReply { checkpoint: newest, previous }))
    }
}
