//! How long a node's replies may be: no longer than what it was asked can take. A longer one is refused at its announcement,
//! before any of it is kept.

use std::error::Error;
use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::task::{Context, Poll, ready};

use bytes::Bytes;
use futures::future::BoxFuture;
use http_body::{Frame, SizeHint};
use proto::convert::{most_picture_bytes, most_silhouette_bytes};
use proto::framing::Messages;
use proto::v1::camera_node_client::CameraNodeClient;
use proto::{CameraDescription, MAX_CHECKPOINT_BYTES};
use tonic::body::Body;
use tonic::transport::Channel;
use tower::Service;

/// The calls of a node.
pub(crate) type NodeCalls = CameraNodeClient<Limited>;

/// A reply of most calls: a thousand cameras are described in a quarter of that.
const MAX_SHORT_BYTES: usize = 1 << 20;
/// Two checkpoints and their lengths.
const MAX_WORLDS_BYTES: usize = 2 * MAX_CHECKPOINT_BYTES + 64;

/// The longest replies of one node.
#[derive(Debug)]
pub(crate) struct ReplyLimits {
    silhouette_bytes: usize,
    picture_bytes: usize,
    /// Of the questions that are open.
    answer_bytes: AtomicUsize,
}

/// What a call is about.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Reply {
    Answers,
    Silhouettes,
    Pictures,
    Worlds,
    Short,
}

impl Reply {
    /// By the call's path.
    fn of(path: &str) -> Reply {
        match path.rsplit('/').next().unwrap_or_default() {
            "Probe" => Reply::Answers,
            "FetchSilhouettes" => Reply::Silhouettes,
            "FetchPictures" => Reply::Pictures,
            "FetchWorld" => Reply::Worlds,
            _ => Reply::Short,
        }
    }
}

impl ReplyLimits {
    /// Of a node with these cameras, which was asked nothing.
    pub fn of(cameras: &[CameraDescription]) -> Arc<ReplyLimits> {
        let largest = |bytes: fn((u32, u32)) -> usize| {
            cameras.iter().map(|camera| bytes(camera.size)).max().unwrap_or_default()
        };
        Arc::new(ReplyLimits {
            silhouette_bytes: largest(most_silhouette_bytes),
            picture_bytes: largest(most_picture_bytes),
            answer_bytes: AtomicUsize::default(),
        })
    }

    /// A question was asked whose answer may be so long, bytes; while others are open, theirs may come before.
    pub fn asked(&self, most_bytes: usize, others_are_open: bool) {
        if others_are_open {
            self.answer_bytes.fetch_max(most_bytes, Ordering::Relaxed);
        } else {
            self.answer_bytes.store(most_bytes, Ordering::Relaxed);
        }
    }

    fn most(&self, reply: Reply) -> usize {
        match reply {
            Reply::Answers => self.answer_bytes.load(Ordering::Relaxed),
            Reply::Silhouettes => self.silhouette_bytes,
            Reply::Pictures => self.picture_bytes,
            Reply::Worlds => MAX_WORLDS_BYTES,
            Reply::Short => MAX_SHORT_BYTES,
        }
    }
}

/// A connection whose replies are limited.
#[derive(Clone)]
pub(crate) struct Limited {
    channel: Channel,
    limits: Arc<ReplyLimits>,
}

impl Limited {
    pub fn new(channel: Channel, limits: Arc<ReplyLimits>) -> Limited {
        Limited { channel, limits }
    }
}

impl Service<http::Request<Body>> for Limited {
    type Response = http::Response<Body>;
    type Error = tonic::transport::Error;
    type Future = BoxFuture<'static, Result<Self::Response, Self::Error>>;

    fn poll_ready(&mut self, context: &mut Context<'_>) -> Poll<Result<(), Self::Error>> {
        self.channel.poll_ready(context)
    }

    fn call(&mut self, request: http::Request<Body>) -> Self::Future {
        let (reply, limits) = (Reply::of(request.uri().path()), Arc::clone(&self.limits));
        let replied = self.channel.call(request);
        Box::pin(async move {
            let limited =
                |body| Body::new(LimitedBody { body, limits, reply, messages: Messages::default() });
            Ok(replied.await?.map(limited))
        })
    }
}

/// What a node sends in a call.
struct LimitedBody {
    body: Body,
    limits: Arc<ReplyLimits>,
    reply: Reply,
    messages: Messages,
}

impl http_body::Body for LimitedBody {
    type Data = Bytes;
    type Error = Box<dyn Error + Send + Sync>;

    fn poll_frame(
        self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, Self::Error>>> {
        let this = self.get_mut();
        let Some(frame) = ready!(Pin::new(&mut this.body).poll_frame(context)) else {
            return Poll::Ready(None);
        };
        let frame = frame?;
        if let Some(data) = frame.data_ref() {
            this.messages.read(data, this.limits.most(this.reply))?;
        }
        Poll::Ready(Some(Ok(frame)))
    }

    fn is_end_stream(&self) -> bool {
        self.body.is_end_stream()
    }

    fn size_hint(&self) -> SizeHint {
        self.body.size_hint()
    }
}

#[cfg(test)]
mod tests {
    use hull::question::QuestionKind;
    use proto::convert::ExpectedAnswer;
    use proto::framing::announcement;

    use super::*;
    use crate::error::NodeError;

    /// What becomes of a reply that announces so many bytes, before any of them has come.
    async fn announced(limits: &Arc<ReplyLimits>, reply: Reply, bytes: u32) -> Option<NodeError> {
        use http_body::Body as _;
        let prefix = String::from_utf8(announcement(bytes).to_vec()).expect("bytes below 128");
        let (body, limits) = (Body::new(prefix), Arc::clone(limits));
        let mut body = Body::new(LimitedBody { body, limits, reply, messages: Messages::default() });
        let frame = std::future::poll_fn(|context| Pin::new(&mut body).poll_frame(context)).await;
        frame.expect("a frame").err().map(NodeError::from)
    }

    #[tokio::test]
    async fn an_answer_longer_than_its_question_allows_is_refused_at_its_announcement() {
        let limits = ReplyLimits::of(&[]);
        let question = |points| {
            let points_world = Arc::default();
            ExpectedAnswer { kind: QuestionKind::Edges, points, cameras: vec![], points_world }.most_bytes()
        };
        limits.asked(question(100), false);
        assert_eq!(announced(&limits, Reply::Answers, 0x1000).await, None);
        let refused = announced(&limits, Reply::Answers, 0x0200_0000).await.expect("32 MiB");
        assert_eq!(refused.to_string(), "invalid reply: a message of 33554432 bytes, expected at most 6896");
        assert!(refused.is_invalid() && !refused.is_absence());
        limits.asked(question(1_000_000), false);
        assert_eq!(announced(&limits, Reply::Answers, 0x0100_0000).await, None);
        limits.asked(question(100), true);
        assert_eq!(announced(&limits, Reply::Answers, 0x0100_0000).await, None, "the longer one is open");
        limits.asked(question(100), false);
        assert!(announced(&limits, Reply::Answers, 0x0100_0000).await.is_some(), "it was answered");
    }

    #[tokio::test]
    async fn other_replies_have_limits_of_their_own() {
        let calls = [
            ("Describe", Reply::Short),
            ("WatchFrames", Reply::Short),
            ("Probe", Reply::Answers),
            ("FetchSilhouettes", Reply::Silhouettes),
            ("FetchPictures", Reply::Pictures),
            ("FetchWorld", Reply::Worlds),
        ];
        let limits = ReplyLimits::of(&[]);
        for (name, reply) in calls {
            assert_eq!(Reply::of(&format!("/hulltouch.v1.CameraNode/{name}")), reply);
            assert!(announced(&limits, reply, 0x0300_0000).await.is_some(), "48 MiB of {name}");
        }
        assert_eq!(announced(&limits, Reply::Short, 0x0010_0000).await, None);
    }
}
