//! A node that lies: it stands before an honest one, and changes what that one says.

use std::net::Ipv4Addr;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use http::header::{DATE, HeaderValue};
use parking_lot::{Mutex, MutexGuard};
use proto::v1::camera_node_client::CameraNodeClient;
use proto::v1::camera_node_server::{CameraNode, CameraNodeServer};
use proto::v1::{self, probe_reply, refusal::Reason};
use tokio::sync::mpsc;
use tokio_stream::wrappers::ReceiverStream;
use tokio_stream::{Stream, StreamExt as _};
use tonic::transport::{Channel, Endpoint, Server};
use tonic::{Code, Request, Response, Status, Streaming};
use tower::util::MapResponseLayer;
use turmoil::net::TcpStream;

use crate::poison::Poison;
use crate::room::{Random, accepted};

/// Messages of one stream that wait.
const MAX_WAITING: usize = 64;

/// What it does with a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Lie {
    None,
    Late,
    Lost,
    Twice,
    Refused,
    OtherFrame,
    OtherCount,
    Ended,
    Long,
    /// It reads nothing more of the stream.
    Unread,
    /// It breaks the stream whenever it is to answer.
    Breaks,
    /// It repeats what it says without end.
    Flood,
}

const LIES: [Lie; 12] = [
    Lie::None,
    Lie::Late,
    Lie::Lost,
    Lie::Twice,
    Lie::Refused,
    Lie::OtherFrame,
    Lie::OtherCount,
    Lie::Ended,
    Lie::Long,
    Lie::Unread,
    Lie::Breaks,
    Lie::Flood,
];

/// How often a flood repeats a message.
const REPEATS: usize = 400;

/// What a long lie adds to a message, bytes: more than any of these may have.
const LONG_BYTES: usize = 2 << 20;

/// The text of a refusal, bytes: near what a header may have.
const LONG_STATUS_BYTES: usize = 12 << 10;

/// How it refuses a call.
const CODES: [Code; 7] = [
    Code::Aborted,
    Code::Unavailable,
    Code::FailedPrecondition,
    Code::PermissionDenied,
    Code::Internal,
    Code::ResourceExhausted,
    Code::Unimplemented,
];

/// How a seed's node lies: one way alone, or any of them.
pub struct Habit {
    random: Random,
    always: Option<Lie>,
    honest_of_8: u64,
    poison: Option<Poison>,
}

impl Habit {
    /// One that lies about the world that it remembers, and about nothing else.
    pub fn poisoning(random: Random, poison: Poison) -> Habit {
        Habit { random, always: None, honest_of_8: 8, poison: Some(poison) }
    }

    pub fn new(mut random: Random) -> Habit {
        let always = (random.below(2) == 0).then(|| LIES[1 + random.below(LIES.len() as u64 - 1) as usize]);
        let honest_of_8 = random.below(8);
        Habit { random, always, honest_of_8, poison: None }
    }

    fn next(&mut self) -> Lie {
        if self.random.below(8) < self.honest_of_8 {
            return Lie::None;
        }
        self.always.unwrap_or_else(|| LIES[self.random.below(LIES.len() as u64) as usize])
    }

    fn frame(&mut self, frame: u64) -> u64 {
        match self.random.below(3) {
            0 => frame + 1000,
            1 => frame + 1 + self.random.below(4),
            _ => frame.saturating_sub(1 + self.random.below(40)),
        }
    }
}

/// The lying node.
pub struct Liar {
    honest: CameraNodeClient<Channel>,
    habit: Arc<Mutex<Habit>>,
    /// Whether it was told to film.
    has_begun: AtomicBool,
}

impl Liar {
    fn habit(&self) -> MutexGuard<'_, Habit> {
        self.habit.lock()
    }

    /// What it does with a call that has one reply: late, lost and refused ones are so already.
    async fn lied_of_call(&self) -> Result<Lie, Status> {
        let (lie, delay, code) = {
            let mut habit = self.habit();
            (habit.next(), habit.random.ms(20, 400), CODES[habit.random.below(CODES.len() as u64) as usize])
        };
        match lie {
            Lie::Late => tokio::time::sleep(delay).await,
            Lie::Lost => std::future::pending().await,
            Lie::Refused => return Err(Status::new(code, "no")),
            Lie::Long => return Err(Status::unavailable("x".repeat(LONG_STATUS_BYTES))),
            _ => {}
        }
        Ok(lie)
    }
}

/// Serves lies at a port, of the honest node at another of the same host.
pub async fn serve(port: u16, honest: u16, habit: Habit) -> Result<(), Box<dyn std::error::Error>> {
    let connect = tower::service_fn(move |_: tonic::transport::Uri| async move {
        let stream = TcpStream::connect((Ipv4Addr::LOCALHOST, honest)).await?;
        Ok::<_, std::io::Error>(hyper_util::rt::TokioIo::new(stream))
    });
    let channel = Endpoint::from_static("http://honest").connect_with_connector_lazy(connect);
    let limit = proto::MAX_MESSAGE_BYTES;
    let honest =
        CameraNodeClient::new(channel).max_decoding_message_size(limit).max_encoding_message_size(limit);
    let liar = Liar { honest, habit: Arc::new(Mutex::new(habit)), has_begun: AtomicBool::new(false) };
    let service =
        CameraNodeServer::new(liar).max_decoding_message_size(limit).max_encoding_message_size(limit);
    // Otherwise hyper adds the wall clock's, and the same seed sends other bytes.
    let dated = MapResponseLayer::new(|mut reply: http::Response<tonic::body::Body>| {
        reply.headers_mut().insert(DATE, HeaderValue::from_static("Thu, 01 Jan 1970 00:00:00 GMT"));
        reply
    });
    Server::builder().layer(dated).add_service(service).serve_with_incoming(accepted(port).await?).await?;
    Ok(())
}

/// Hands on the messages of a stream; each becomes what `lied` makes of it.
fn forward<T: Clone + Send + 'static>(
    mut from: Streaming<T>,
    habit: Arc<Mutex<Habit>>,
    lied: impl Fn(&mut Habit, Lie, T) -> Result<T, Status> + Send + 'static,
) -> Response<ReceiverStream<Result<T, Status>>> {
    let (sender, receiver) = mpsc::channel(MAX_WAITING);
    tokio::spawn(async move {
        while let Some(message) = from.next().await {
            let (lie, delay, message) = {
                let mut habit = habit.lock();
                let lie = habit.next();
                let delay = habit.random.ms(20, 400);
                let message = message.and_then(|message| lied(&mut habit, lie, message));
                (lie, delay, message)
            };
            match lie {
                Lie::Lost => continue,
                Lie::Late => tokio::time::sleep(delay).await,
                _ => {}
            }
            let repeats = match lie {
                Lie::Twice => 1,
                Lie::Flood => REPEATS,
                _ => 0,
            };
            for _ in 0..repeats {
                if sender.send(message.clone()).await.is_err() {
                    return;
                }
            }
            if sender.send(message).await.is_err() {
                return;
            }
        }
    });
    Response::new(ReceiverStream::new(receiver))
}

/// Requests go on as they are; a stream that breaks ends.
fn requests<T: Send + 'static>(from: Request<Streaming<T>>) -> impl Stream<Item = T> + Send + 'static {
    from.into_inner().take_while(Result::is_ok).filter_map(Result::ok)
}

fn lied_of_film(habit: &mut Habit, lie: Lie, mut info: v1::FrameInfo) -> Result<v1::FrameInfo, Status> {
    match lie {
        Lie::OtherFrame => info.frame = habit.frame(info.frame),
        Lie::OtherCount => info.cameras.truncate(1),
        Lie::Ended => (info.ended, info.cameras) = (true, vec![]),
        Lie::Refused => return Err(Status::invalid_argument("no")),
        Lie::Long => info.failure = "x".repeat(LONG_BYTES),
        Lie::None | Lie::Late | Lie::Lost | Lie::Twice | Lie::Unread | Lie::Breaks | Lie::Flood => {}
    }
    Ok(info)
}

fn lied_of_answer(habit: &mut Habit, lie: Lie, mut reply: v1::ProbeReply) -> Result<v1::ProbeReply, Status> {
    match (lie, &mut reply.answer) {
        (Lie::Breaks, _) => return Err(Status::unavailable("gone")),
        (Lie::Refused, answer) => {
            let reason = Reason::try_from(1 + habit.random.below(8) as i32).unwrap_or(Reason::Busy);
            let refusal = v1::Refusal { reason: reason.into(), message: "no".into() };
            *answer = Some(probe_reply::Answer::Refusal(refusal));
        }
        (Lie::OtherCount, Some(probe_reply::Answer::Classes(classes))) => classes.count += 1,
        (Lie::OtherCount, Some(probe_reply::Answer::Edges(edges))) => edges.count += 1,
        (Lie::OtherCount, Some(probe_reply::Answer::Planes(planes))) => planes.count += 1,
        (Lie::OtherCount, Some(probe_reply::Answer::Exits(exits))) => exits.count += 1,
        (Lie::OtherFrame, _) => reply.id += 1,
        (Lie::Ended, answer) => *answer = None,
        (Lie::Long, answer) => {
            let refusal = v1::Refusal { reason: Reason::Busy.into(), message: "x".repeat(LONG_BYTES) };
            *answer = Some(probe_reply::Answer::Refusal(refusal));
        }
        _ => {}
    }
    Ok(reply)
}

#[tonic::async_trait]
impl CameraNode for Liar {
    type WatchFramesStream = ReceiverStream<Result<v1::FrameInfo, Status>>;
    type ProbeStream = ReceiverStream<Result<v1::ProbeReply, Status>>;
    type FetchSilhouettesStream = ReceiverStream<Result<v1::Silhouette, Status>>;
    type FetchPicturesStream = Streaming<v1::Picture>;

    async fn describe(
        &self,
        request: Request<v1::DescribeRequest>,
    ) -> Result<Response<v1::DescribeReply>, Status> {
        let lie = self.lied_of_call().await?;
        let described = self.honest.clone().describe(request.into_inner()).await?;
        // With a node that differs from the cluster file no run begins, by design.
        let has_begun = self.has_begun.load(Ordering::Relaxed);
        Ok(described.map(|mut described| {
            if lie == Lie::OtherCount && has_begun {
                described.cameras.truncate(1);
            }
            described
        }))
    }

    async fn hold(&self, request: Request<v1::HoldRequest>) -> Result<Response<v1::HoldReply>, Status> {
        self.lied_of_call().await?;
        self.honest.clone().hold(request.into_inner()).await
    }

    async fn start(&self, request: Request<v1::StartRequest>) -> Result<Response<v1::StartReply>, Status> {
        self.has_begun.store(true, Ordering::Relaxed);
        self.lied_of_call().await?;
        self.honest.clone().start(request.into_inner()).await
    }

    async fn keep_time(
        &self,
        request: Request<v1::KeepTimeRequest>,
    ) -> Result<Response<v1::KeepTimeReply>, Status> {
        let lie = self.lied_of_call().await?;
        let kept = self.honest.clone().keep_time(request.into_inner()).await?;
        let mut habit = self.habit();
        Ok(kept.map(|mut kept| {
            if lie == Lie::OtherFrame {
                kept.node_s =
                    [kept.node_s + 1000.0, kept.node_s - 1.0, f64::NAN][habit.random.below(3) as usize];
            }
            kept
        }))
    }

    async fn register_shapes(
        &self,
        request: Request<v1::RegisterShapesRequest>,
    ) -> Result<Response<v1::RegisterShapesReply>, Status> {
        self.lied_of_call().await?;
        self.honest.clone().register_shapes(request.into_inner()).await
    }

    async fn take_background(
        &self,
        request: Request<v1::TakeBackgroundRequest>,
    ) -> Result<Response<v1::TakeBackgroundReply>, Status> {
        self.honest.clone().take_background(request.into_inner()).await
    }

    async fn restore_background(
        &self,
        request: Request<v1::RestoreBackgroundRequest>,
    ) -> Result<Response<v1::RestoreBackgroundReply>, Status> {
        self.honest.clone().restore_background(request.into_inner()).await
    }

    async fn keep_world(
        &self,
        request: Request<v1::KeepWorldRequest>,
    ) -> Result<Response<v1::KeepWorldReply>, Status> {
        self.lied_of_call().await?;
        self.honest.clone().keep_world(request.into_inner()).await
    }

    async fn fetch_world(
        &self,
        request: Request<v1::FetchWorldRequest>,
    ) -> Result<Response<v1::FetchWorldReply>, Status> {
        self.lied_of_call().await?;
        let honest = self.honest.clone().fetch_world(request.into_inner()).await?;
        let poison = self.habit().poison;
        let Some(poison) = poison else { return Ok(honest) };
        Ok(honest.map(|v1::FetchWorldReply { checkpoint, previous }| {
            let (checkpoint, previous) = poison.spoil(&checkpoint, previous);
            v1::FetchWorldReply { checkpoint, previous }
        }))
    }

    async fn watch_frames(
        &self,
        request: Request<Streaming<v1::FrameCredit>>,
    ) -> Result<Response<Self::WatchFramesStream>, Status> {
        let frames = self.honest.clone().watch_frames(requests(request)).await?.into_inner();
        Ok(forward(frames, Arc::clone(&self.habit), lied_of_film))
    }

    async fn probe(
        &self,
        request: Request<Streaming<v1::ProbeRequest>>,
    ) -> Result<Response<Self::ProbeStream>, Status> {
        let (sender, read) = mpsc::channel(1);
        let habit = Arc::clone(&self.habit);
        tokio::spawn(async move {
            let mut questions = std::pin::pin!(requests(request));
            while let Some(question) = questions.next().await {
                let lie = habit.lock().next();
                if lie == Lie::Unread {
                    return sender.closed().await;
                }
                if sender.send(question).await.is_err() {
                    return;
                }
            }
        });
        let replies = self.honest.clone().probe(ReceiverStream::new(read)).await?.into_inner();
        Ok(forward(replies, Arc::clone(&self.habit), lied_of_answer))
    }

    async fn fetch_silhouettes(
        &self,
        request: Request<v1::FetchSilhouettesRequest>,
    ) -> Result<Response<Self::FetchSilhouettesStream>, Status> {
        let silhouettes = self.honest.clone().fetch_silhouettes(request.into_inner()).await?.into_inner();
        Ok(forward(silhouettes, Arc::clone(&self.habit), |habit, lie, silhouette| match lie {
            Lie::Refused => Err(Status::new(CODES[habit.random.below(CODES.len() as u64) as usize], "no")),
            _ => Ok(silhouette),
        }))
    }

    async fn fetch_pictures(
        &self,
        request: Request<v1::FetchPicturesRequest>,
    ) -> Result<Response<Self::FetchPicturesStream>, Status> {
        self.honest.clone().fetch_pictures(request.into_inner()).await
    }
}
