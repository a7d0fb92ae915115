//! A node on its port: it listens, learns its backgrounds, serves, and ends.

use std::sync::Arc;
use std::time::Duration;

use proto::v1::camera_node_server::CameraNodeServer;
use proto::{MAX_FRAME_BYTES, MAX_MESSAGE_BYTES, v1};
use thiserror::Error;
use tokio::io::{AsyncRead, AsyncWrite};
use tokio_stream::Stream;
use tonic::service::interceptor::InterceptedService;
use tonic::transport::Server;
use tonic::transport::server::{Connected, Router};
use tower::layer::util::{Identity, Stack};

use super::Service;
use super::counted::counted;
use super::incoming::{Access, incoming};
use super::metered::MeterLayer;
use super::permission::Permission;
use super::status::StatusService;
use super::watch::NodeWatch;
use super::worker::Worker;
use crate::capture::{CaptureError, Filming};
use crate::config::NodeConfig;
use crate::cores::Cores;
use crate::frames::FrameRing;
use crate::listen::{Listen, Listener};

/// A silent peer is noticed within twice this.
const KEEP_ALIVE: Duration = Duration::from_secs(5);

/// Streams of one connection: a run has three, and pictures.
const MAX_STREAMS: u32 = 16;
/// Far more than any call's.
const MAX_HEADER_BYTES: u32 = 8 * 1024;
/// What a connection may send before it is read, and each of its streams: a local network has no more under way.
const CONNECTION_WINDOW_BYTES: u32 = 512 << 10;
const STREAM_WINDOW_BYTES: u32 = 256 << 10;

/// A node that is asked to end lets calls finish for so long; streams would go on for ever.
const SHUTDOWN_GRACE: Duration = Duration::from_millis(300);

/// Why a node cannot serve.
#[derive(Debug, Error)]
pub enum ServeError {
    /// Film cannot begin.
    #[error(transparent)]
    Capture(#[from] CaptureError),
    /// A port that other machines reach, without consent.
    #[error(
        "listen address {0} is reachable from other machines and the protocol is not encrypted: \
         expected a loopback address, --certs, or --insecure"
    )]
    Exposed(Listen),
    /// The address cannot be had.
    #[error("cannot listen on {address}: {error}")]
    Listen {
        /// The address to listen on.
        address: Listen,
        /// The system's reason.
        error: std::io::Error,
    },
    /// The system gives no thread.
    #[error("cannot start a thread: {0}")]
    Thread(std::io::Error),
    /// Learning the backgrounds panicked.
    #[error("learning the backgrounds failed: {0}")]
    Panicked(tokio::task::JoinError),
    /// The transport broke.
    #[error("serving failed: {0}")]
    Transport(#[from] tonic::transport::Error),
}

/// A node that holds its port and has learnt its backgrounds, ready to serve.
pub struct Node {
    listener: Listener,
    service: Service,
    access: Access,
    watch: NodeWatch,
}

impl Node {
    /// Binds the address (port 0: any free one) and learns the backgrounds. Must run within a tokio
    /// runtime. Any address but a loopback one or a Unix socket needs more than [`Access::ThisMachine`].
    pub async fn open(
        config: NodeConfig,
        address: impl Into<Listen>,
        access: Access,
    ) -> Result<Node, ServeError> {
        let address = address.into();
        if matches!(address, Listen::Tcp(address) if !address.ip().is_loopback()) {
            match access {
                Access::ThisMachine => return Err(ServeError::Exposed(address)),
                Access::AnyPeer => tracing::warn!(
                    "listening on {address} without encryption or passwords: anyone who reaches it may ask"
                ),
                Access::Certified(_) => {}
            }
        }
        let bound = Listener::bind(&address).await;
        let listener = bound.map_err(|error| ServeError::Listen { address, error })?;
        // Learning reads whole clips; meanwhile the runtime must be able to end.
        let (service, watch) = tokio::task::spawn_blocking(move || Service::new(&config))
            .await
            .map_err(ServeError::Panicked)??;
        Ok(Node { listener, service, watch: watch.with(&access), access })
    }

    /// The address it listens on.
    pub fn address(&self) -> std::io::Result<Listen> {
        self.listener.address()
    }

    /// The node as others watch it, also while it serves.
    pub fn watch(&self) -> NodeWatch {
        self.watch.clone()
    }

    /// Serves until `stop` completes.
    pub async fn serve(self, stop: impl Future<Output = ()>) -> Result<(), ServeError> {
        let router = router(self.service, &self.access).await;
        let incoming = counted(incoming(self.listener, &self.access), Arc::clone(&self.watch.port));
        let (shut_down, shutting_down) = tokio::sync::oneshot::channel::<()>();
        let shutting_down = async { drop(shutting_down.await) };
        let serving = router.serve_with_incoming_shutdown(incoming, shutting_down);
        let end = async {
            stop.await;
            drop(shut_down);
            tokio::time::sleep(SHUTDOWN_GRACE).await;
        };
        tokio::select! {
            served = serving => served.map_err(ServeError::from),
            () = end => Ok(()),
        }
    }
}

/// Serves film of the caller's over connections of the caller's, until those end. No thread is started: questions are
/// answered by the task that polls this, and time is the runtime's, so that both may be simulated. There are no pictures.
pub async fn serve_film<C>(
    config: &NodeConfig,
    film: Arc<dyn Filming>,
    ring: Arc<FrameRing>,
    connections: impl Stream<Item = std::io::Result<C>>,
) -> Result<(), ServeError>
where
    C: AsyncRead + AsyncWrite + Connected<ConnectInfo: Clone + Send + Sync> + Send + Unpin + 'static,
{
    let worker = Worker::without_thread(Arc::clone(&ring), config.cameras.len(), Cores::new(1));
    let service = Service::of(config, film, ring, worker);
    Ok(router(service, &Access::default()).await.serve_with_incoming(connections).await?)
}

/// The node's services: its own, health and reflection.
async fn router(service: Service, access: &Access) -> Router<Stack<MeterLayer, Identity>> {
    let (reporter, health) = tonic_health::server::health_reporter();
    reporter.set_serving::<CameraNodeServer<Service>>().await;
    let reflection = || {
        tonic_reflection::server::Builder::configure().register_encoded_file_descriptor_set(v1::DESCRIPTORS)
    };
    let describe_error = "the protocol's own description is valid";
    let status = StatusService::of(&service, access);
    let service = CameraNodeServer::new(service)
        .max_decoding_message_size(MAX_MESSAGE_BYTES)
        .max_encoding_message_size(MAX_MESSAGE_BYTES);
    let look = Permission::to_look(access);
    let mut server = Server::builder();
    if let Access::Certified(credentials) = access {
        let age = credentials.max_connection_age();
        server = server.max_connection_age(age.mul_f64(0.9)).max_connection_age_grace(age.mul_f64(0.1));
    }
    server
        .layer(MeterLayer::default())
        .initial_connection_window_size(CONNECTION_WINDOW_BYTES)
        .initial_stream_window_size(STREAM_WINDOW_BYTES)
        .max_frame_size(MAX_FRAME_BYTES)
        .http2_keepalive_interval(Some(KEEP_ALIVE))
        .http2_keepalive_timeout(Some(KEEP_ALIVE))
        .http2_max_header_list_size(Some(MAX_HEADER_BYTES))
        .max_concurrent_streams(Some(MAX_STREAMS))
        .add_service(InterceptedService::new(health, look.clone()))
        .add_service(InterceptedService::new(status, look.clone()))
        .add_service(InterceptedService::new(reflection().build_v1().expect(describe_error), look.clone()))
        .add_service(InterceptedService::new(reflection().build_v1alpha().expect(describe_error), look))
        .add_service(InterceptedService::new(service, Permission::to_lead(access)))
}
