//! The server: a thread of its own and one port.

use std::net::SocketAddr;
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Duration;

use axum::Router;
use axum::extract::{Request, State};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use coordinator::live::Follower;
use net::Credentials;
use thiserror::Error;
use tokio::sync::watch;

use crate::http::{Access, Guesses, Origin, Port, RandomError, Token, random_hex};
use crate::message_cache::MessageCache;
use crate::pictures::Pictures;
use crate::run_info::RunInfo;
use crate::shared::{Seats, Shared};
use crate::{http, page, programs};

/// How long the end waits for requests that are being answered.
const SHUTDOWN_GRACE: Duration = Duration::from_millis(300);
/// And then until pages have read their last message: a browser that is busy with drawing reads late.
const LAST_MESSAGE_GRACE: Duration = Duration::from_secs(1);

/// Threads that read files of certificates.
const MAX_BLOCKING_THREADS: usize = 4;

/// Where to serve, and who steers.
#[derive(Clone, Debug)]
pub struct FeedSettings {
    /// The address to listen on; port 0 is any free one.
    pub listen: SocketAddr,
    /// If that port is taken, any free one will do.
    pub or_any_port: bool,
    /// The secret that lets its holder steer.
    pub token: Token,
    /// The certificate that the page is encrypted with, if it is.
    pub credentials: Option<Arc<Credentials>>,
    /// Where a proxy in front of this server shows it.
    pub origin: Option<Origin>,
    /// The first page sees the scene from its start, if none has steered the run before.
    pub begins_for_first_page: bool,
}

/// Why there is no feed.
#[derive(Debug, Error)]
pub enum FeedError {
    /// The address cannot be had.
    #[error("cannot listen on {address}: {error}")]
    Listen {
        /// The address to listen on.
        address: SocketAddr,
        /// The system's error.
        error: std::io::Error,
    },
    /// The system gave no thread or no runtime.
    #[error("cannot serve: {0}")]
    System(#[from] std::io::Error),
    /// The system gave no random bytes for the session.
    #[error("cannot serve: {0}")]
    Random(#[from] RandomError),
}

/// A server that runs until it is dropped.
#[derive(Debug)]
pub struct Feed {
    address: SocketAddr,
    pages: Seats,
    end: watch::Sender<bool>,
    thread: Option<JoinHandle<()>>,
}

impl Feed {
    /// Binds the address and begins to serve. `pictures` is called once, within the server's own runtime; its
    /// result is asked only while a page is connected.
    pub fn start(
        settings: &FeedSettings,
        info: RunInfo,
        follower: Follower,
        pictures: impl FnOnce() -> Arc<dyn Pictures>,
    ) -> Result<Feed, FeedError> {
        let listener = bind(settings)?;
        let address = listener.local_addr()?;
        listener.set_nonblocking(true)?;
        let (end, ending) = watch::channel(false);
        let runtime = tokio::runtime::Builder::new_current_thread()
            .enable_all()
            .max_blocking_threads(MAX_BLOCKING_THREADS)
            .build()?;
        let (pictures, port) = {
            let _within = runtime.enter();
            (pictures(), Port::new(listener, "the page", settings.credentials.clone())?)
        };
        let pages = Seats::default();
        let shared = Arc::new(Shared {
            messages: MessageCache::new(pictures, info.fps, info.rig.cameras().len()),
            volume: info.volume(),
            info,
            follower,
            begins_for_first_page: settings.begins_for_first_page,
            pages: pages.clone(),
            programs: Seats::default(),
            access: Access::new(settings.token.clone(), address, settings.origin.clone()),
            guesses: Guesses::default(),
            session: random_hex()?,
            ending,
        });
        let thread = std::thread::Builder::new().name("feed".into()).spawn(move || {
            runtime.block_on(serve(port, shared));
            runtime.shutdown_timeout(SHUTDOWN_GRACE);
        });
        Ok(Feed { address, pages, end, thread: Some(thread?) })
    }

    /// Where it listens.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// How many pages look now.
    pub fn pages(&self) -> usize {
        self.pages.taken()
    }
}

impl Drop for Feed {
    fn drop(&mut self) {
        self.end.send_replace(true);
        if let Some(thread) = self.thread.take() {
            // A panic of the thread is on standard error already.
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

/// All routes; each part has its own.
async fn router(shared: &Arc<Shared>) -> Router {
    let guarded = axum::middleware::from_fn_with_state(Arc::clone(shared), guard);
    // Other paths are the page's.
    let calls: Router<Arc<Shared>> = programs::grpc_routes(shared).await.with_state(());
    let routes = Router::new().merge(page::routes()).merge(programs::json_routes());
    routes.merge(http::routes()).merge(calls).layer(guarded).with_state(Arc::clone(shared))
}

async fn guard(State(shared): State<Arc<Shared>>, request: Request, next: Next) -> Response {
    match shared.access.check(request.uri(), request.headers()) {
        Ok(()) => next.run(request).await,
        Err(denied) => (denied.status(), format!("{denied}\n")).into_response(),
    }
}

/// Keeps the pictures of the frame at which a paused world stands: its nodes drop its colours within a quarter of
/// a second, and a page that joins later must not show the person of another moment.
async fn keep_frozen_frame(shared: Arc<Shared>) {
    let mut world = shared.follower.world.clone();
    while world.changed().await.is_ok() {
        let frozen = world.borrow_and_update().as_ref().filter(|world| world.paused).map(|world| world.frame);
        match frozen.flatten() {
            Some(frame) => {
                let shared = Arc::clone(&shared);
                // Beside the next step, which may pause at another frame.
                tokio::spawn(async move { shared.messages.freeze(frame).await });
            }
            None => shared.messages.thaw(),
        }
    }
}

async fn serve(port: Port, shared: Arc<Shared>) {
    tokio::spawn(keep_frozen_frame(Arc::clone(&shared)));
    let lingering = port.lingering();
    let mut ended = shared.ending.clone();
    let deadline = async {
        // An end whose sender is gone is an end.
        let _ = ended.wait_for(|ended| *ended).await;
        tokio::time::sleep(SHUTDOWN_GRACE).await;
    };
    tokio::select! {
        () = port.serve(router(&shared).await, shared.ending.clone()) => {}
        () = deadline => {}
    }
    let pages_closed = async {
        while shared.pages.taken() > 0 {
            tokio::time::sleep(Duration::from_millis(5)).await;
        }
        // A socket that is closed while its page still speaks is reset, and the last message with it.
        lingering.ended().await;
    };
    // Pages that do not read are not waited for.
    let _ = tokio::time::timeout(LAST_MESSAGE_GRACE, pages_closed).await;
}
