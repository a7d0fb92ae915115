//! Every call's bytes, counted while they come and until they have left: a message is refused at its announcement if it
//! is longer than its call takes, and must be whole in time.

use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll, ready};
use std::time::Duration;

use bytes::Bytes;
use http::header::{DATE, HeaderValue};
use http_body::{Frame, SizeHint};
use net::admission::RateLimitedLog;
use proto::framing::Messages;
use proto::text::{MAX_NAME_CHARS, clean};
use proto::{MAX_CHECKPOINT_BYTES, MAX_MESSAGE_BYTES};
use tokio::time::{Instant, Sleep};
use tonic::Status;
use tonic::body::Body;
use tower::{Layer, Service};

use super::incoming::Caller;
use super::seats::{Seat, Share};

/// The date of replies in simulated time.
const SIMULATED_DATE: &str = "Thu, 01 Jan 1970 00:00:00 GMT";
/// A message of most calls.
const MAX_SHORT_BYTES: usize = 64 << 10;
/// A message is whole within this.
const WHOLE_WITHIN: Duration = Duration::from_secs(20);
/// The calls whose clients send messages one after the other; of all others they send one.
const STREAMS: [&str; 3] = ["Probe", "WatchFrames", "ServerReflectionInfo"];
/// Shorter parts of replies are not counted: of each stream one waits at most.
const UNCOUNTED_BYTES: usize = 4096;

/// What a call takes.
#[derive(Clone, Copy, Debug)]
struct Takes {
    /// The longest message.
    max_message_bytes: usize,
    /// Messages one after the other.
    is_stream: bool,
}

impl Takes {
    /// By the call's path.
    fn of(path: &str) -> Takes {
        let name = path.rsplit('/').next().unwrap_or_default();
        let max_message_bytes = match name {
            "RegisterShapes" | "Probe" => MAX_MESSAGE_BYTES,
            // The checkpoint, and who sends it.
            "KeepWorld" => MAX_CHECKPOINT_BYTES + 64,
            _ => MAX_SHORT_BYTES,
        };
        Takes { max_message_bytes, is_stream: STREAMS.contains(&name) }
    }
}

/// The package of all of this program's calls, with its major version.
const PACKAGE: &str = "hulltouch.v1";

/// Why a call is refused by its path: it is of another major version.
fn other_version(path: &str) -> Option<String> {
    let package = path.strip_prefix('/')?.split('/').next()?.rsplit_once('.')?.0;
    let is_other = package.starts_with("hulltouch.") && package != PACKAGE;
    is_other.then(|| format!("{}: this node speaks {PACKAGE}", clean(package, MAX_NAME_CHARS)))
}

/// Counts the calls of all services, and refuses those of another major version.
#[derive(Clone, Debug, Default)]
pub(super) struct MeterLayer {
    log: Arc<RateLimitedLog>,
}

impl<S> Layer<S> for MeterLayer {
    type Service = Metered<S>;

    fn layer(&self, service: S) -> Metered<S> {
        Metered { service, log: Arc::clone(&self.log) }
    }
}

/// A service whose calls are counted.
#[derive(Clone, Debug)]
pub(super) struct Metered<S> {
    service: S,
    log: Arc<RateLimitedLog>,
}

impl<S> Service<http::Request<Body>> for Metered<S>
where
    S: Service<http::Request<Body>, Response = http::Response<Body>>,
    S::Future: Send + 'static,
{
    type Response = http::Response<Body>;
    type Error = S::Error;
    type Future = Pin<Box<dyn Future<Output = Result<Self::Response, S::Error>> + Send>>;

    fn poll_ready(&mut self, context: &mut Context<'_>) -> Poll<Result<(), S::Error>> {
        self.service.poll_ready(context)
    }

    fn call(&mut self, request: http::Request<Body>) -> Self::Future {
        if let Some(why) = other_version(request.uri().path()) {
            self.log.warn(&"a call was refused", &why);
            return Box::pin(async move { Ok(Status::unimplemented(why).into_http()) });
        }
        let seat = request.extensions().get::<Caller>().and_then(|caller| caller.seat.clone());
        let call = Call::begin(seat.clone());
        let takes = Takes::of(request.uri().path());
        let request = request.map(|body| Body::new(Received::new(body, takes, seat.clone())));
        let reply = self.service.call(request);
        Box::pin(async move {
            let mut reply = reply.await?;
            if film_time::is_simulated() {
                // Otherwise hyper adds the wall clock's, which takes more bytes whenever it has changed.
                reply.headers_mut().insert(DATE, HeaderValue::from_static(SIMULATED_DATE));
            }
            Ok(reply.map(|body| Body::new(Sent { body, seat, _call: call })))
        })
    }
}

/// A call that goes on.
struct Call(Option<Arc<Seat>>);

impl Call {
    fn begin(seat: Option<Arc<Seat>>) -> Call {
        seat.iter().for_each(|seat| seat.call(true));
        Call(seat)
    }
}

impl Drop for Call {
    fn drop(&mut self) {
        self.0.iter().for_each(|seat| seat.call(false));
    }
}

/// What a client sends in a call.
struct Received {
    body: Body,
    seat: Option<Arc<Seat>>,
    takes: Takes,
    messages: Messages,
    share: Share,
    /// What is held beside the message that has begun: of a stream the buffer of its longest message, which stays with it;
    /// of other calls the message, until the client has ended.
    kept_bytes: usize,
    /// For the message that has begun, and for all that a call which is no stream is sent.
    whole_by: Option<Pin<Box<Sleep>>>,
}

impl Received {
    fn new(body: Body, takes: Takes, seat: Option<Arc<Seat>>) -> Received {
        let (share, messages) = (Share::of(seat.clone()), Messages::default());
        let whole_by = (!takes.is_stream).then(whole_by);
        Received { body, seat, takes, messages, share, kept_bytes: 0, whole_by }
    }

    /// What is held while more is waited for: whole messages have been read.
    fn held_bytes(&self) -> usize {
        self.messages.partial().max(self.kept_bytes)
    }

    fn count(&mut self, data: &[u8]) -> Result<(), Status> {
        let held = (self.messages.partial() + data.len()).max(self.kept_bytes);
        let most = self.takes.max_message_bytes;
        let whole = self
            .messages
            .read(data, most)
            .map_err(|too_long| Status::out_of_range(format!("{too_long} of this call")))?;
        if self.takes.is_stream {
            if self.messages.longest() > MAX_SHORT_BYTES {
                self.kept_bytes = self.messages.longest();
            }
            if whole > 0 {
                self.whole_by = None;
            }
            if self.messages.partial() > 0 && self.whole_by.is_none() {
                self.whole_by = Some(whole_by());
            }
        } else {
            if self.messages.count() > 1 || self.messages.count() == 1 && self.messages.partial() > 0 {
                return Err(Status::invalid_argument("a second message, expected one of this call"));
            }
            self.kept_bytes = held;
        }
        if whole > 0 {
            self.seat.iter().for_each(|seat| seat.heard());
        }
        self.share.set(held).map_err(|error| Status::resource_exhausted(error.to_string()))
    }
}

fn whole_by() -> Pin<Box<Sleep>> {
    Box::pin(tokio::time::sleep_until(Instant::now() + WHOLE_WITHIN))
}

impl http_body::Body for Received {
    type Data = Bytes;
    type Error = Status;

    fn poll_frame(
        self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, Status>>> {
        let this = self.get_mut();
        let _ = this.share.set(this.held_bytes());
        if let Some(whole_by) = &mut this.whole_by
            && whole_by.as_mut().poll(context).is_ready()
        {
            let late = format!("a message is not whole after {} s", WHOLE_WITHIN.as_secs());
            return Poll::Ready(Some(Err(Status::deadline_exceeded(late))));
        }
        let frame = ready!(Pin::new(&mut this.body).poll_frame(context));
        if let Some(Ok(frame)) = &frame
            && let Some(data) = frame.data_ref()
            && let Err(refusal) = this.count(data)
        {
            tracing::debug!("a message was refused: {}", refusal.message());
            return Poll::Ready(Some(Err(refusal)));
        }
        Poll::Ready(frame)
    }

    fn is_end_stream(&self) -> bool {
        self.body.is_end_stream()
    }

    fn size_hint(&self) -> SizeHint {
        self.body.size_hint()
    }
}

/// What a node sends in a call.
struct Sent {
    body: Body,
    seat: Option<Arc<Seat>>,
    _call: Call,
}

impl http_body::Body for Sent {
    type Data = Bytes;
    type Error = Status;

    fn poll_frame(
        self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, Status>>> {
        let this = self.get_mut();
        let frame = ready!(Pin::new(&mut this.body).poll_frame(context));
        let Some(Ok(frame)) = frame else { return Poll::Ready(frame) };
        let is_counted =
            this.seat.is_some() && frame.data_ref().is_some_and(|data| data.len() > UNCOUNTED_BYTES);
        if !is_counted {
            return Poll::Ready(Some(Ok(frame)));
        }
        let counted = |data: Bytes| match Share::take(&this.seat, data.len()) {
            Ok(share) => Ok(Bytes::from_owner(Unsent { data, _share: share })),
            Err(error) => Err(Status::resource_exhausted(error.to_string())),
        };
        Poll::Ready(Some(match frame.into_data() {
            Ok(data) => counted(data).map(Frame::data),
            Err(frame) => Ok(frame),
        }))
    }

    fn is_end_stream(&self) -> bool {
        self.body.is_end_stream()
    }

    fn size_hint(&self) -> SizeHint {
        self.body.size_hint()
    }
}

/// Counted until the socket has taken the last of it.
struct Unsent {
    data: Bytes,
    _share: Share,
}

impl AsRef<[u8]> for Unsent {
    fn as_ref(&self) -> &[u8] {
        &self.data
    }
}

#[cfg(test)]
mod tests {
    use proto::framing::{PREFIX_BYTES, announcement};
    use tokio::sync::mpsc;
    use tokio_stream::StreamExt as _;
    use tokio_stream::wrappers::ReceiverStream;

    use super::super::seats::SharedSeats;
    use super::*;

    fn message(length: usize) -> Vec<u8> {
        let mut bytes = announcement(length as u32).to_vec();
        bytes.resize(PREFIX_BYTES + length, 7);
        bytes
    }

    #[test]
    fn calls_of_another_major_version_are_told_apart() {
        for path in ["/hulltouch.v1.CameraNode/Probe", "/grpc.health.v1.Health/Check", "/", "", "/x"] {
            assert_eq!(other_version(path), None, "{path}");
        }
        let why = other_version("/hulltouch.v2.CameraNode/Probe").expect("another");
        assert_eq!(why, "hulltouch.v2: this node speaks hulltouch.v1");
    }

    #[tokio::test]
    async fn a_long_message_is_refused_before_it_comes() {
        let (sender, mut received) = received("/hulltouch.v1.CameraNode/Hold", &SharedSeats::default());
        sender.send(announcement(65 << 10).to_vec().into()).await.expect("open");
        let refused = next(&mut received).await.expect("a frame").expect_err("too long");
        assert_eq!(refused.message(), "a message of 66560 bytes, expected at most 65536 of this call");
        assert_eq!(Takes::of("/hulltouch.v1.CameraNode/Start").max_message_bytes, 64 << 10);
        assert_eq!(Takes::of("/hulltouch.v1.CameraNode/Probe").max_message_bytes, 48 << 20);
    }

    /// What a call is sent, as a connection would.
    fn received(call: &str, seats: &SharedSeats) -> (mpsc::Sender<Bytes>, Received) {
        let seat = seats.take(Some([10, 0, 0, 1].into()), true, true).expect("room");
        let (sender, receiver) = mpsc::channel::<Bytes>(8);
        let frames = ReceiverStream::new(receiver).map(|data| Ok::<_, Status>(Frame::data(data)));
        let body = Body::new(StreamBody { frames: Box::pin(frames) });
        (sender, Received::new(body, Takes::of(call), Some(seat)))
    }

    struct StreamBody {
        frames: Pin<Box<dyn tokio_stream::Stream<Item = Result<Frame<Bytes>, Status>> + Send>>,
    }

    impl http_body::Body for StreamBody {
        type Data = Bytes;
        type Error = Status;

        fn poll_frame(
            mut self: Pin<&mut Self>,
            context: &mut Context<'_>,
        ) -> Poll<Option<Result<Frame<Bytes>, Status>>> {
            self.frames.as_mut().poll_next(context)
        }
    }

    async fn next(received: &mut Received) -> Option<Result<Frame<Bytes>, Status>> {
        use http_body::Body as _;
        std::future::poll_fn(|context| Pin::new(&mut *received).poll_frame(context)).await
    }

    #[tokio::test(start_paused = true)]
    async fn a_message_whose_call_is_never_ended_counts_and_is_given_up() {
        let seats = SharedSeats::default();
        let (sender, mut received) = received("/hulltouch.v1.CameraNode/RegisterShapes", &seats);
        sender.send(message(1 << 20).into()).await.expect("open");
        assert!(next(&mut received).await.is_some_and(|frame| frame.is_ok()));
        // It is whole; the client does not say that it was all.
        let began = Instant::now();
        let ended = next(&mut received).await.expect("an end").expect_err("late");
        assert_eq!(ended.code(), tonic::Code::DeadlineExceeded);
        assert!(began.elapsed() <= WHOLE_WITHIN + Duration::from_millis(10));
        assert_eq!(seats.held_bytes(), (1 << 20) + PREFIX_BYTES, "until the call is over");
        drop(received);
        assert_eq!(seats.held_bytes(), 0);
    }

    #[tokio::test]
    async fn a_call_takes_one_message_and_no_second() {
        let seats = SharedSeats::default();
        let (sender, mut received) = received("/hulltouch.v1.CameraNode/Hold", &seats);
        sender.send([message(9), message(9)].concat().into()).await.expect("open");
        let refused = next(&mut received).await.expect("a frame").expect_err("two messages");
        assert_eq!(refused.message(), "a second message, expected one of this call");
    }

    #[tokio::test]
    async fn a_stream_goes_on_holding_the_buffer_of_its_longest_message() {
        let seats = SharedSeats::default();
        let (sender, mut received) = received("/hulltouch.v1.CameraNode/Probe", &seats);
        for (bytes, held) in [(1000, 0), (1 << 20, (1 << 20) + PREFIX_BYTES), (10, (1 << 20) + PREFIX_BYTES)]
        {
            sender.send(message(bytes).into()).await.expect("open");
            assert!(next(&mut received).await.is_some_and(|frame| frame.is_ok()));
            // It asks for more once it has read that.
            assert!(tokio::time::timeout(Duration::ZERO, next(&mut received)).await.is_err());
            assert_eq!(seats.held_bytes(), held, "after a message of {bytes} bytes");
        }
    }
}
