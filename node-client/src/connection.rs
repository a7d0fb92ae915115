//! A connection to a node's address, its bytes counted. Encryption belongs here: every call of the program to a
//! node goes through these sockets.

use std::io;
use std::sync::Arc;
use std::time::Duration;

use hyper_util::rt::TokioIo;
use proto::v1::camera_node_client::CameraNodeClient;
use proto::{Address, MAX_FRAME_BYTES, MAX_MESSAGE_BYTES};
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::{TcpStream, UnixStream};
use tonic::transport::{Channel, Endpoint, Uri};

use crate::counting::{ByteCounters, counted};
use crate::error::NodeError;

const CONNECT_TIMEOUT: Duration = Duration::from_secs(2);
/// A silent node is noticed within twice this.
const KEEP_ALIVE: Duration = Duration::from_secs(5);

/// A client of the node at an address, connected now.
pub(crate) async fn connect(
    address: &Address,
    counters: &Arc<ByteCounters>,
) -> Result<CameraNodeClient<Channel>, NodeError> {
    let connected = endpoint().connect_with_connector(connector(address, counters)).await;
    connected.map(client).map_err(|error| NodeError::Unreachable(root_cause(&error)))
}

/// A client that connects when it is first used, and again whenever its connection breaks.
pub(crate) fn connect_lazily(address: &Address, counters: &Arc<ByteCounters>) -> CameraNodeClient<Channel> {
    client(endpoint().connect_with_connector_lazy(connector(address, counters)))
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
        .keep_alive_timeout(KEEP_ALIVE)
        .keep_alive_while_idle(true)
}

/// Either kind of socket.
trait Socket: AsyncRead + AsyncWrite + Send + Unpin {}
impl<S: AsyncRead + AsyncWrite + Send + Unpin> Socket for S {}

fn connector(
    address: &Address,
    counters: &Arc<ByteCounters>,
) -> impl tower::Service<Uri, Response = TokioIo<Box<dyn Socket>>, Error = io::Error, Future: Send>
+ Send
+ 'static
+ use<> {
    let (address, counters) = (address.clone(), Arc::clone(counters));
    tower::service_fn(move |_: Uri| {
        let (address, counters) = (address.clone(), Arc::clone(&counters));
        async move {
            let socket: Box<dyn Socket> = match address {
                Address::Tcp(host_port) => {
                    let socket = TcpStream::connect(host_port).await?;
                    socket.set_nodelay(true)?;
                    Box::new(counted(socket, counters))
                }
                Address::Unix(path) => Box::new(counted(UnixStream::connect(path).await?, counters)),
            };
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
