//! The server: a thread of its own, one port, everything behind the gate.

use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

use axum::Router;
use axum::extract::{Request, State};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use coordinator::live::Follower;
use thiserror::Error;
use tokio::net::TcpListener;
use tokio::sync::watch;

use crate::http::{Access, BytesSent, CountingListener, Origin, Token, random_hex};
use crate::message_cache::MessageCache;
use crate::pictures::Pictures;
use crate::run_info::RunInfo;
use crate::shared::Shared;
use crate::{http, page, programs};

/// Pages get so long to hear that the run ends.
const LAST_WORDS: Duration = Duration::from_millis(300);

/// Where to serve, and who steers.
#[derive(Clone, Debug)]
pub struct FeedSettings {
    /// The address to listen on; port 0 is any free one.
    pub listen: SocketAddr,
    /// If that port is taken, any free one will do.
    pub or_any_port: bool,
    /// What lets its holder steer.
    pub token: Token,
    /// Where a proxy in front of this server shows it.
    pub origin: Option<Origin>,
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

/// A server that runs until it is dropped.
#[derive(Debug)]
pub struct Feed {
    address: SocketAddr,
    pages: Arc<AtomicUsize>,
    end: watch::Sender<bool>,
    thread: Option<JoinHandle<()>>,
}

impl Feed {
    /// Binds the address and begins to serve. `pictures` is called once, within the server's own runtime; what
    /// it returns is asked only while somebody looks.
    pub fn start(
        settings: &FeedSettings,
        facts: RunInfo,
        follower: Follower,
        pictures: impl FnOnce() -> Arc<dyn Pictures>,
    ) -> Result<Feed, FeedError> {
        let listener = bind(settings)?;
        let system = |error: std::io::Error| FeedError::System(error.to_string());
        let address = listener.local_addr().map_err(system)?;
        listener.set_nonblocking(true).map_err(system)?;
        let (end, ending) = watch::channel(false);
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().map_err(system)?;
        let pictures = {
            let _within = runtime.enter();
            pictures()
        };
        let pages: Arc<AtomicUsize> = Arc::default();
        let shared = Arc::new(Shared {
            messages: MessageCache::new(pictures, facts.fps),
            volume: facts.volume(),
            facts,
            follower,
            pages: Arc::clone(&pages),
            programs: Arc::default(),
            access: Access::new(settings.token.clone(), address, settings.origin.clone()),
            session: random_hex().map_err(FeedError::System)?,
            ending,
        });
        let thread = std::thread::Builder::new().name("feed".into()).spawn(move || {
            runtime.block_on(serve(listener, shared));
            runtime.shutdown_timeout(LAST_WORDS);
        });
        Ok(Feed { address, pages, end, thread: Some(thread.map_err(system)?) })
    }

    /// Where it listens.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// How many pages look now.
    pub fn pages(&self) -> usize {
        self.pages.load(Ordering::Relaxed)
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
    // What no route takes is the page's to answer.
    let calls: Router<Arc<Shared>> = programs::grpc_routes(shared).await.with_state(());
    let routes = Router::new().merge(page::routes()).merge(programs::json_routes());
    routes.merge(http::routes()).merge(calls).layer(guarded).with_state(Arc::clone(shared))
}

async fn guard(State(shared): State<Arc<Shared>>, request: Request, next: Next) -> Response {
    match shared.access.check(request.uri(), request.headers()) {
        Ok(()) => next.run(request).await,
        Err((status, why)) => (status, why + "\n").into_response(),
    }
}

async fn serve(listener: std::net::TcpListener, shared: Arc<Shared>) {
    let listener = match TcpListener::from_std(listener) {
        Ok(listener) => CountingListener(listener),
        Err(error) => return tracing::error!("the page cannot be served: {error}"),
    };
    let service = router(&shared).await.into_make_service_with_connect_info::<BytesSent>();
    let mut ending = shared.ending.clone();
    let mut ended = ending.clone();
    let serving = axum::serve(listener, service).with_graceful_shutdown(async move {
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
    let pages_told = async {
        while shared.pages.load(Ordering::Relaxed) > 0 {
            tokio::time::sleep(Duration::from_millis(5)).await;
        }
    };
    // Pages that do not listen are not waited for.
    let _ = tokio::time::timeout(LAST_WORDS, pages_told).await;
}
