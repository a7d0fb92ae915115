//! The server: a thread of its own, one port, everything behind the gate.

use std::net::SocketAddr;
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Duration;

use axum::Router;
use axum::extract::{Request, State};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use axum::serve::ListenerExt as _;
use coordinator::live::Follower;
use thiserror::Error;
use tokio::net::TcpListener;
use tokio::sync::watch;

use crate::facts::RunFacts;
use crate::gate::{Gate, Token, random_hex};
use crate::page;
use crate::pictures::Pictures;
use crate::{state_socket, world_service};

/// Pages get so long to hear that the run ends.
const LAST_WORDS: Duration = Duration::from_millis(300);
/// What the kernel keeps for a page that reads slowly, bytes: beyond, what is sent would be old when it comes.
const SEND_BUFFER_BYTES: usize = 256 << 10;

/// Where to serve, and who steers.
#[derive(Clone, Debug)]
pub struct FeedSettings {
    /// The address to listen on; port 0 is any free one.
    pub listen: SocketAddr,
    /// If that port is taken, any free one will do.
    pub or_any_port: bool,
    /// What lets its holder steer.
    pub token: Token,
}

/// Why there is no feed.
#[derive(Debug, Error)]
pub enum FeedError {
    /// The address cannot be had.
    #[error("cannot listen on {address}: {error}")]
    Listen {
        /// Which address.
        address: SocketAddr,
        /// What the system says.
        error: std::io::Error,
    },
    /// The system gave no thread, no runtime or no chance.
    #[error("cannot serve: {0}")]
    System(String),
}

/// What every part of the server shares.
#[expect(dead_code, reason = "the sockets read them")]
pub(crate) struct Shared {
    pub facts: RunFacts,
    pub follower: Follower,
    pub pictures: Arc<dyn Pictures>,
    pub gate: Gate,
    /// New with every start of a server, so that a page sees that it talks to another run.
    pub session: String,
    /// True once the server ends.
    pub ending: watch::Receiver<bool>,
}

/// A server that runs until it is dropped.
#[derive(Debug)]
pub struct Feed {
    address: SocketAddr,
    end: watch::Sender<bool>,
    thread: Option<JoinHandle<()>>,
}

impl Feed {
    /// Binds the address and begins to serve. `pictures` is asked only while somebody looks.
    pub fn start(
        settings: &FeedSettings,
        facts: RunFacts,
        follower: Follower,
        pictures: Arc<dyn Pictures>,
    ) -> Result<Feed, FeedError> {
        let listener = bind(settings)?;
        let system = |error: std::io::Error| FeedError::System(error.to_string());
        let address = listener.local_addr().map_err(system)?;
        listener.set_nonblocking(true).map_err(system)?;
        let (end, ending) = watch::channel(false);
        let shared = Arc::new(Shared {
            facts,
            follower,
            pictures,
            gate: Gate::new(settings.token.clone(), address),
            session: random_hex().map_err(FeedError::System)?,
            ending,
        });
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().map_err(system)?;
        let thread = std::thread::Builder::new().name("feed".into()).spawn(move || {
            runtime.block_on(serve(listener, shared));
            runtime.shutdown_timeout(LAST_WORDS);
        });
        Ok(Feed { address, end, thread: Some(thread.map_err(system)?) })
    }

    /// Where it listens.
    pub fn address(&self) -> SocketAddr {
        self.address
    }
}

impl Drop for Feed {
    fn drop(&mut self) {
        self.end.send_replace(true);
        if let Some(thread) = self.thread.take() {
            // A panic of the thread was told on standard error.
            let _ = thread.join();
        }
    }
}

fn bind(settings: &FeedSettings) -> Result<std::net::TcpListener, FeedError> {
    let address = settings.listen;
    let bound = std::net::TcpListener::bind(address).or_else(|error| {
        if settings.or_any_port && error.kind() == std::io::ErrorKind::AddrInUse {
            return std::net::TcpListener::bind((address.ip(), 0));
        }
        Err(error)
    });
    bound.map_err(|error| FeedError::Listen { address, error })
}

/// Everything that is served. Each part brings its own routes.
async fn router(shared: &Arc<Shared>) -> Router {
    let guarded = axum::middleware::from_fn_with_state(Arc::clone(shared), guard);
    let calls: Router<Arc<Shared>> = world_service::routes(shared).await.with_state(());
    let routes = Router::new().merge(page::routes()).merge(state_socket::routes()).merge(calls);
    routes.layer(guarded).with_state(Arc::clone(shared))
}

async fn guard(State(shared): State<Arc<Shared>>, request: Request, next: Next) -> Response {
    match shared.gate.check(request.uri(), request.headers()) {
        Ok(()) => next.run(request).await,
        Err((status, why)) => (status, why + "\n").into_response(),
    }
}

async fn serve(listener: std::net::TcpListener, shared: Arc<Shared>) {
    let listener = match TcpListener::from_std(listener) {
        Ok(listener) => listener.tap_io(|stream| {
            // A socket that takes neither setting still works, only later.
            let _ = stream.set_nodelay(true);
            let _ = socket2::SockRef::from(&*stream).set_send_buffer_size(SEND_BUFFER_BYTES);
        }),
        Err(error) => return tracing::error!("the page cannot be served: {error}"),
    };
    let mut ending = shared.ending.clone();
    let mut ended = ending.clone();
    let serving = axum::serve(listener, router(&shared).await).with_graceful_shutdown(async move {
        // An end whose sender is gone is an end.
        let _ = ending.wait_for(|ended| *ended).await;
    });
    let hurry = async {
        let _ = ended.wait_for(|ended| *ended).await;
        tokio::time::sleep(LAST_WORDS).await;
    };
    tokio::select! {
        served = serving => if let Err(error) = served { tracing::error!("serving the page failed: {error}") },
        () = hurry => {}
    }
}
