//! A connection to a node's address, its bytes counted. Encryption belongs here: every call of the program to a
//! node goes through these sockets.

use std::io;
use std::sync::Arc;
use std::time::Duration;

use futures::future::BoxFuture;
use hyper_util::rt::TokioIo;
use proto::v1::camera_node_client::CameraNodeClient;
use proto::{Address, MAX_FRAME_BYTES, MAX_MESSAGE_BYTES};
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::{TcpStream, UnixStream};
use tonic::transport::{Channel, Endpoint, Uri};

use crate::counting::{ByteCounters, counted};
use crate::error::NodeError;

const CONNECT_TIMEOUT: Duration = Duration::from_millis(1500);
/// A connection over which nothing comes for so long is given up, and made anew: a way that was cut may be open again long
/// before the system tries the old connection.
const KEEP_ALIVE: Duration = Duration::from_secs(1);
const SILENT: Duration = Duration::from_secs(2);

/// A client of the node at an address, connected now.
pub(crate) async fn connect(
    address: &Address,
    dial: &Arc<dyn Dial>,
    counters: &Arc<ByteCounters>,
) -> Result<CameraNodeClient<Channel>, NodeError> {
    let connected = endpoint().connect_with_connector(connector(address, dial, counters)).await;
    connected.map(client).map_err(|error| NodeError::Unreachable(root_cause(&error)))
}

/// A client that connects when it is first used, and again whenever its connection breaks.
pub(crate) fn connect_lazily(address: &Address, counters: &Arc<ByteCounters>) -> CameraNodeClient<Channel> {
    let dial: Arc<dyn Dial> = Arc::new(Sockets);
    client(endpoint().connect_with_connector_lazy(connector(address, &dial, counters)))
}

fn client(channel: Channel) -> CameraNodeClient<Channel> {
    CameraNodeClient::new(channel)
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

/// Makes connections to nodes.
pub trait Dial: Send + Sync + 'static {
    /// A connection to the node at an address.
    fn dial(&self, address: Address) -> BoxFuture<'static, io::Result<Box<dyn Socket>>>;
}

/// The sockets of the system.
pub(crate) struct Sockets;

impl Dial for Sockets {
    fn dial(&self, address: Address) -> BoxFuture<'static, io::Result<Box<dyn Socket>>> {
        Box::pin(async move {
            let socket: Box<dyn Socket> = match address {
                Address::Tcp(host_port) => {
                    let socket = TcpStream::connect(host_port).await?;
                    socket.set_nodelay(true)?;
                    Box::new(socket)
                }
                Address::Unix(path) => Box::new(UnixStream::connect(path).await?),
            };
            Ok(socket)
        })
    }
}

fn connector(
    address: &Address,
    dial: &Arc<dyn Dial>,
    counters: &Arc<ByteCounters>,
) -> impl tower::Service<Uri, Response = TokioIo<Box<dyn Socket>>, Error = io::Error, Future: Send>
+ Send
+ 'static
+ use<> {
    let (address, dial, counters) = (address.clone(), Arc::clone(dial), Arc::clone(counters));
    tower::service_fn(move |_: Uri| {
        let (socket, counters) = (dial.dial(address.clone()), Arc::clone(&counters));
        async move {
            let socket: Box<dyn Socket> = Box::new(counted(socket.await?, counters));
            Ok(TokioIo::new(socket))
        }
    })
}

/// The innermost cause: tonic's own words alone say only "transport error".
fn root_cause(error: &dyn std::error::Error) -> String {
    let mut cause = error;
    while let Some(inner) = cause.source() {
        cause = inner;
    }
    cause.to_string()
}
