//! Every call's bytes, counted while they come and until they have left: a message is refused at its announcement if it
//! is longer than its call takes, and must be whole in time.

use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll, ready};
use std::time::Duration;

use bytes::Bytes;
use http_body::{Frame, SizeHint};
use proto::{MAX_CHECKPOINT_BYTES, MAX_MESSAGE_BYTES};
use tokio::time::{Instant, Sleep};
use tonic::Status;
use tonic::body::Body;
use tower::{Layer, Service};

use super::incoming::Caller;
use super::seats::{Seat, Share};

/// A message of most calls.
const MAX_SHORT_BYTES: usize = 64 << 10;
/// A message is whole within this.
const WHOLE_WITHIN: Duration = Duration::from_secs(20);
/// Before each message: whether it is compressed, and its length.
const PREFIX_BYTES: usize = 5;
/// Shorter parts of replies are not counted: of each stream one waits at most.
const UNCOUNTED_BYTES: usize = 4096;

/// The longest message that a call takes, by its path.
fn max_message_bytes(path: &str) -> usize {
    match path.rsplit('/').next() {
        Some("RegisterShapes" | "Probe") => MAX_MESSAGE_BYTES,
        // The checkpoint, and who sends it.
        Some("KeepWorld") => MAX_CHECKPOINT_BYTES + 64,
        _ => MAX_SHORT_BYTES,
    }
}

/// Counts the calls of all services.
#[derive(Clone, Copy, Debug)]
pub(super) struct MeterLayer;

impl<S> Layer<S> for MeterLayer {
    type Service = Metered<S>;

    fn layer(&self, service: S) -> Metered<S> {
        Metered { service }
    }
}

/// A service whose calls are counted.
#[derive(Clone, Debug)]
pub(super) struct Metered<S> {
    service: S,
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
        let seat = request.extensions().get::<Caller>().and_then(|caller| caller.seat.clone());
        let call = Call::begin(seat.clone());
        let most = max_message_bytes(request.uri().path());
        let request = request.map(|body| Body::new(Received::new(body, most, seat.clone())));
        let reply = self.service.call(request);
        Box::pin(async move {
            let reply = reply.await?;
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
    messages: Messages,
    share: Share,
    /// For the message that has begun.
    whole_by: Option<Pin<Box<Sleep>>>,
}

impl Received {
    fn new(body: Body, most: usize, seat: Option<Arc<Seat>>) -> Received {
        let (share, messages) = (Share::of(seat.clone()), Messages::of_at_most(most));
        Received { body, seat, messages, share, whole_by: None }
    }

    fn count(&mut self, data: &[u8]) -> Result<(), Status> {
        if self.messages.read(data)? > 0 {
            self.whole_by = None;
            self.seat.iter().for_each(|seat| seat.heard());
        }
        let held = self.share.bytes() + data.len();
        self.share.set(held).map_err(|spent| Status::resource_exhausted(spent.to_string()))?;
        if self.messages.partial > 0 && self.whole_by.is_none() {
            self.whole_by = Some(Box::pin(tokio::time::sleep_until(Instant::now() + WHOLE_WITHIN)));
        }
        Ok(())
    }
}

impl http_body::Body for Received {
    type Data = Bytes;
    type Error = Status;

    fn poll_frame(
        self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, Status>>> {
        let this = self.get_mut();
        // More is wanted: whole messages have been read.
        let _ = this.share.set(this.messages.partial);
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

/// Where messages begin and end in what comes.
#[derive(Debug)]
struct Messages {
    most: usize,
    prefix: [u8; PREFIX_BYTES],
    /// Bytes of the message that has begun, with its prefix.
    partial: usize,
    /// Its whole length, once it is known.
    length: usize,
}

impl Messages {
    fn of_at_most(most: usize) -> Messages {
        Messages { most, prefix: [0; PREFIX_BYTES], partial: 0, length: 0 }
    }

    /// Reads on; how many messages have become whole.
    fn read(&mut self, mut data: &[u8]) -> Result<usize, Status> {
        let mut whole = 0;
        while !data.is_empty() {
            if self.partial < PREFIX_BYTES {
                let take = data.len().min(PREFIX_BYTES - self.partial);
                self.prefix[self.partial..self.partial + take].copy_from_slice(&data[..take]);
                self.partial += take;
                data = &data[take..];
                if self.partial < PREFIX_BYTES {
                    break;
                }
                let [_, length @ ..] = self.prefix;
                self.length = PREFIX_BYTES + self.check(u32::from_be_bytes(length) as usize)?;
            }
            let take = data.len().min(self.length - self.partial);
            self.partial += take;
            data = &data[take..];
            if self.partial == self.length {
                (self.partial, whole) = (0, whole + 1);
            }
        }
        Ok(whole)
    }

    fn check(&self, length: usize) -> Result<usize, Status> {
        if length > self.most {
            let found = format!("a message of {length} bytes, expected at most {} of this call", self.most);
            return Err(Status::out_of_range(found));
        }
        Ok(length)
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
            Err(spent) => Err(Status::resource_exhausted(spent.to_string())),
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
    use super::*;

    fn message(length: usize) -> Vec<u8> {
        let mut bytes = vec![0];
        bytes.extend_from_slice(&(length as u32).to_be_bytes());
        bytes.resize(PREFIX_BYTES + length, 7);
        bytes
    }

    #[test]
    fn messages_are_found_however_they_are_cut() {
        let stream = [message(3), message(0), message(900), message(1)].concat();
        for part in [1, 2, 4, 5, 7, 100, 2000] {
            let mut messages = Messages::of_at_most(1000);
            let whole: usize = stream.chunks(part).map(|data| messages.read(data).expect("short")).sum();
            assert_eq!((whole, messages.partial), (4, 0), "in parts of {part}");
        }
        let mut messages = Messages::of_at_most(1000);
        assert_eq!(messages.read(&stream[..20]).expect("short"), 2);
        assert_eq!(messages.partial, 20 - 13);
    }

    #[test]
    fn a_long_message_is_refused_before_it_comes() {
        let refused = Messages::of_at_most(64).read(&message(65)[..5]).expect_err("too long");
        assert_eq!(refused.message(), "a message of 65 bytes, expected at most 64 of this call");
        assert_eq!(max_message_bytes("/hulltouch.v1.CameraNode/Start"), 64 << 10);
        assert_eq!(max_message_bytes("/hulltouch.v1.CameraNode/Probe"), 48 << 20);
    }
}
