//! A connection to a node's address, its bytes counted, and encrypted if there are certificates: every call of the
//! program to a node goes through these sockets.

use std::io;
use std::sync::Arc;
use std::time::{Duration, SystemTime};

use futures::future::BoxFuture;
use hyper_util::rt::TokioIo;
use net::{Credentials, Identity, UnixSocket};
use proto::v1::camera_node_client::CameraNodeClient;
use proto::{Address, MAX_FRAME_BYTES, MAX_MESSAGE_BYTES};
use thiserror::Error;
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::{TcpStream, UnixStream};
use tonic::transport::{Channel, Endpoint, Uri};

use crate::counting::{ByteCounters, counted};
use crate::error::{NodeError, root_cause};
use crate::reply_limits::{Limited, NodeCalls, ReplyLimits};

const CONNECT_TIMEOUT: Duration = Duration::from_millis(1500);
/// A connection over which nothing comes for so long is given up, and made again: a way that was cut may be open again long
/// before the system tries the old connection.
const KEEP_ALIVE: Duration = Duration::from_secs(1);
const SILENT: Duration = Duration::from_secs(2);

/// The calls of the node at an address, connected now.
pub(crate) async fn connect(
    to: &Destination,
    dial: &Arc<dyn Dial>,
    counters: &Arc<ByteCounters>,
    limits: &Arc<ReplyLimits>,
) -> Result<NodeCalls, NodeError> {
    Ok(calls(channel(to, dial, counters).await?, limits))
}

/// A connection to the node at an address, made now.
pub(crate) async fn channel(
    to: &Destination,
    dial: &Arc<dyn Dial>,
    counters: &Arc<ByteCounters>,
) -> Result<Channel, NodeError> {
    let connected = endpoint().connect_with_connector(connector(to, dial, counters)).await;
    connected.map_err(|error| NodeError::Unreachable(root_cause(&error)))
}

/// Calls that connect when one is first made, and again whenever the connection breaks.
pub(crate) fn connect_lazily(
    to: &Destination,
    dial: &Arc<dyn Dial>,
    counters: &Arc<ByteCounters>,
    limits: &Arc<ReplyLimits>,
) -> NodeCalls {
    calls(endpoint().connect_with_connector_lazy(connector(to, dial, counters)), limits)
}

fn calls(channel: Channel, limits: &Arc<ReplyLimits>) -> NodeCalls {
    CameraNodeClient::new(Limited::new(channel, Arc::clone(limits)))
        .max_decoding_message_size(MAX_MESSAGE_BYTES)
        .max_encoding_message_size(MAX_MESSAGE_BYTES)
}

fn endpoint() -> Endpoint {
    Endpoint::from_static("http://node.invalid")
        .connect_timeout(CONNECT_TIMEOUT)
        .max_frame_size(MAX_FRAME_BYTES)
        .http2_keep_alive_interval(KEEP_ALIVE)
        .keep_alive_timeout(SILENT)
        .keep_alive_while_idle(true)
}

/// Any kind of socket.
pub trait Socket: AsyncRead + AsyncWrite + Send + Unpin {}
impl<S: AsyncRead + AsyncWrite + Send + Unpin> Socket for S {}

/// Where to connect to, and who must be there.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Destination {
    /// Where the node listens.
    pub address: Address,
    /// Its name, if the cluster file gives it one.
    pub node: Option<String>,
}

/// Makes connections to nodes.
pub trait Dial: Send + Sync + 'static {
    /// A connection to a node.
    fn dial(&self, to: Destination) -> BoxFuture<'static, io::Result<Box<dyn Socket>>>;

    /// A connection is replaced by a new one after so long; `None`: never.
    fn renews_after(&self) -> Option<Duration> {
        None
    }

    /// When the certificate ends that is shown to nodes, if there is one.
    fn certificate_ends(&self) -> Option<SystemTime> {
        None
    }

    /// What may be wrong where a node breaks the connection off as soon as it is made.
    fn hint(&self) -> String;
}

/// The sockets of the system: encrypted if there are certificates, but for Unix sockets.
#[derive(Clone, Default)]
pub struct Sockets {
    credentials: Option<Arc<Credentials>>,
}

impl Sockets {
    /// Those that need a certificate on both sides.
    pub fn encrypted(credentials: Arc<Credentials>) -> Sockets {
        Sockets { credentials: Some(credentials) }
    }
}

impl Dial for Sockets {
    fn renews_after(&self) -> Option<Duration> {
        // Before the node ends it.
        self.credentials.as_ref().map(|credentials| credentials.max_connection_age().mul_f64(0.7))
    }

    fn certificate_ends(&self) -> Option<SystemTime> {
        self.credentials.as_ref().map(Credentials::not_after)
    }

    fn hint(&self) -> String {
        match &self.credentials {
            // Under TLS 1.3 a client is done before the server has looked at its certificate.
            Some(own) => format!("it was shown the certificate of {}, and its log tells why", own.own()),
            None => "no certificate was shown to it, as this program was started without --certs; a node that was \
                     started with --certs expects one"
                .to_owned(),
        }
    }

    fn dial(&self, to: Destination) -> BoxFuture<'static, io::Result<Box<dyn Socket>>> {
        let credentials = self.credentials.clone();
        Box::pin(async move {
            let socket: Box<dyn Socket> = match to.address {
                Address::Tcp(host_port) => {
                    let socket = TcpStream::connect(host_port).await?;
                    socket.set_nodelay(true)?;
                    let Some(credentials) = credentials else {
                        return Ok(Box::new(socket) as Box<dyn Socket>);
                    };
                    let node = to.node.ok_or_else(|| io::Error::other(Nameless))?;
                    let meant = Identity::node(&credentials.own().room, &node);
                    let encrypted = credentials.connect(socket, &meant).await;
                    Box::new(encrypted.map_err(io::Error::other)?)
                }
                Address::Unix(path) => Box::new(UnixSocket::new(UnixStream::connect(path).await?)?),
            };
            Ok(socket)
        })
    }
}

fn connector(
    to: &Destination,
    dial: &Arc<dyn Dial>,
    counters: &Arc<ByteCounters>,
) -> impl tower::Service<Uri, Response = TokioIo<Box<dyn Socket>>, Error = io::Error, Future: Send>
+ Send
+ 'static
+ use<> {
    let (to, dial, counters) = (to.clone(), Arc::clone(dial), Arc::clone(counters));
    tower::service_fn(move |_: Uri| {
        let (socket, counters) = (dial.dial(to.clone()), Arc::clone(&counters));
        async move {
            let socket: Box<dyn Socket> = Box::new(counted(socket.await?, counters));
            Ok(TokioIo::new(socket))
        }
    })
}

/// A node that no certificate can be of.
#[derive(Debug, Error)]
#[error("it has no name in the cluster file, expected a [[node]] entry: certificates are of names")]
struct Nameless;
