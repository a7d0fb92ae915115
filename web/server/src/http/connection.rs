//! One connection of a port: encrypted or not, HTTP/1.1 or HTTP/2.
//!
//! A peer that has not sent a whole request head within 5 s (a TLS handshake before it included) is dropped, and one that then
//! asks nothing for a minute, unless it holds a socket or a stream.

use std::net::IpAddr;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use axum::Router;
use axum::body::Body;
use coordinator::live::{Client, ClientKind};
use hyper::Request;
use hyper::body::Incoming;
use hyper::service::service_fn;
use hyper_util::rt::{TokioExecutor, TokioIo, TokioTimer};
use hyper_util::server::conn::auto::Builder;
use net::admission::{Activity, ConnectionSlot, Registry, StayGuard, TLS_HANDSHAKE};
use net::{Credentials, HandshakeLimit};
use parking_lot::Mutex;
use socket2::SockRef;
use tokio::io::{AsyncRead, AsyncWrite, AsyncWriteExt as _};
use tokio::net::TcpStream;
use tokio::sync::watch;
use tokio::time::{Instant, sleep, sleep_until};
use tokio_util::io::InspectReader;
use tower::ServiceExt as _;

use super::linger::Lingering;
use super::progress::{BytesSent, Progress, ProgressSocket};
use super::refusals::{Refusal, Refusals};

/// By then a peer has sent the whole head of its first request.
const HEAD_TIMEOUT: Duration = Duration::from_secs(5);
/// A connection is kept so long for another request.
const IDLE_TIMEOUT: Duration = Duration::from_secs(60);
/// A peer that receives so much meanwhile is not idle, but has a slow link. Pings are less.
const SLOW_LINK_BYTES: u64 = 1 << 10;
/// The longest head of a request, bytes: browsers send one or two thousand.
const MAX_HEAD_BYTES: usize = 8 << 10;
/// Requests at once of one connection of HTTP/2.
const MAX_STREAMS: u32 = 16;
/// What a peer may send ahead: the longest message fits.
const STREAM_WINDOW_BYTES: u32 = 64 << 10;
const CONNECTION_WINDOW_BYTES: u32 = 256 << 10;
/// A peer of HTTP/2 that has vanished is noticed by its missing answer to a ping.
const PING_EVERY: Duration = Duration::from_secs(20);
const PING_TIMEOUT: Duration = Duration::from_secs(10);
/// Bytes that the kernel buffers for a slow peer: more would be old when it arrives.
/// A page in the same building takes hundreds of megabits a second through so much.
const SEND_BUFFER_BYTES: usize = 128 << 10;

/// What the connections of a port share.
#[derive(Debug)]
pub(super) struct PortShared {
    /// Encrypts; clients show no certificates.
    pub credentials: Option<Arc<Credentials>>,
    pub handshakes: HandshakeLimit,
    pub lingering: Lingering,
    pub registry: Registry,
    pub refusals: Refusals,
}

/// One connection, as those see it who answer its requests: an extension of each.
#[derive(Clone, Debug)]
pub(crate) struct Connection(Arc<State>);

#[derive(Debug)]
struct State {
    port: Arc<PortShared>,
    slot: Arc<ConnectionSlot>,
    from: IpAddr,
    progress: Arc<Progress>,
    /// Whether the peer has begun something that it has not ended.
    has_begun: AtomicBool,
    asked: Mutex<Option<Instant>>,
    /// The last token that it offered was the right one.
    has_shown_token: AtomicBool,
    /// What steers by requests of their own; a socket is another client.
    client: Client,
}

/// What HTTP is spoken over.
trait Socket: AsyncRead + AsyncWrite + Send + Unpin {}
impl<S: AsyncRead + AsyncWrite + Send + Unpin> Socket for S {}

impl Connection {
    /// A peer that was accepted.
    pub(super) fn new(port: &Arc<PortShared>, from: IpAddr) -> Connection {
        let progress = Arc::<Progress>::default();
        let activity = Arc::clone(&progress) as Arc<dyn Activity>;
        Connection(Arc::new(State {
            port: Arc::clone(port),
            slot: port.registry.begin(Some(from), activity),
            from,
            progress,
            has_begun: AtomicBool::new(false),
            asked: Mutex::new(None),
            has_shown_token: AtomicBool::new(false),
            client: Client::new(ClientKind::Program),
        }))
    }

    /// The peer's address.
    pub fn from(&self) -> IpAddr {
        self.0.from
    }

    /// Whether the last token that was offered over it was the right one.
    pub fn has_shown_token(&self) -> bool {
        self.0.has_shown_token.load(Ordering::Relaxed)
    }

    /// A token was offered over it: the right one, or another.
    pub fn shows_token(&self, is_right: bool) {
        self.0.has_shown_token.store(is_right, Ordering::Relaxed);
    }

    /// The client whose commands come as requests of their own: gone with the connection.
    pub fn client(&self) -> &Client {
        &self.0.client
    }

    /// What was sent to the peer.
    pub fn bytes_sent(&self) -> BytesSent {
        self.0.progress.bytes_sent()
    }

    /// Keeps it from being dropped for another, or as idle, as long as the result lives. Who asks for this bounds how many
    /// stay.
    pub fn stay(&self) -> StayGuard {
        self.0.slot.stay()
    }

    /// Answers what is asked until the peer leaves, must leave, or everything ends.
    pub(super) async fn serve(self, stream: TcpStream, router: Router, ending: watch::Receiver<bool>) {
        let ended = tokio::select! {
            ended = self.answer(stream, router, ending) => ended,
            () = self.0.slot.evicted() => {
                Err(if self.last_asked().is_some() { Refusal::Outdated } else { Refusal::GaveWay })
            }
            why = self.loses_patience() => Err(why),
        };
        self.0.slot.end();
        if let Err(why) = ended {
            self.0.port.refusals.log(Some(self.0.from), &why);
        }
    }

    async fn answer(
        &self,
        stream: TcpStream,
        router: Router,
        mut ending: watch::Receiver<bool>,
    ) -> Result<(), Refusal> {
        // A socket that takes neither setting still works, only later.
        let _ = stream.set_nodelay(true);
        let _ = SockRef::from(&stream).set_send_buffer_size(SEND_BUFFER_BYTES);
        let socket = self.socket(stream).await?;
        let service = service_fn(|request: Request<Incoming>| {
            self.has_asked();
            let begun = self.0.progress.begin_request();
            let mut request = request.map(Body::new);
            request.extensions_mut().insert(self.clone());
            let answer = router.clone().oneshot(request);
            async move {
                let _until_it_is_made = begun;
                answer.await
            }
        });
        let builder = builder();
        let mut serving =
            std::pin::pin!(builder.serve_connection_with_upgrades(TokioIo::new(socket), service));
        let served = tokio::select! {
            served = serving.as_mut() => Some(served),
            // An end whose sender is gone is an end.
            () = async { _ = ending.wait_for(|ended| *ended).await } => None,
        };
        let served = match served {
            Some(served) => served,
            None => {
                serving.as_mut().graceful_shutdown();
                serving.await
            }
        };
        // Peers leave whenever they like.
        let Err(error) = served else { return Ok(()) };
        match error.downcast::<hyper::Error>() {
            // These are hyper's own words, not the peer's.
            Ok(error) if error.is_parse() => Err(Refusal::Protocol(error.to_string())),
            _ => Ok(()),
        }
    }

    /// What HTTP is spoken over, once it is clear that the peer speaks what this port does.
    async fn socket(&self, stream: TcpStream) -> Result<Box<dyn Socket>, Refusal> {
        let mut first = [0];
        if !matches!(stream.peek(&mut first).await, Ok(1)) {
            return Err(Refusal::Silent);
        }
        let mut socket = ProgressSocket::new(stream, Arc::clone(&self.0.progress), &self.0.port.lingering);
        self.0.has_begun.store(true, Ordering::Relaxed);
        let is_tls = first[0] == TLS_HANDSHAKE;
        let credentials = match &self.0.port.credentials {
            None if is_tls => return Err(Refusal::Encrypted),
            Some(_) if !is_tls => {
                if first[0].is_ascii_uppercase() {
                    say_https(&mut socket).await;
                }
                return Err(Refusal::Plain);
            }
            credentials => credentials,
        };
        let Some(credentials) = credentials else { return Ok(Box::new(socket)) };
        if !self.0.port.handshakes.admit(self.0.from, false, std::time::Instant::now()) {
            return Err(Refusal::TooManyHandshakes);
        }
        let socket = credentials.accept_without_certificate(socket).await?;
        // Browsers connect ahead of what they ask.
        self.0.has_begun.store(false, Ordering::Relaxed);
        let connection = self.clone();
        let begin = move |bytes: &[u8]| {
            if !bytes.is_empty() {
                connection.0.has_begun.store(true, Ordering::Relaxed);
            }
        };
        Ok(Box::new(InspectReader::new(socket, begin)))
    }

    /// The head of a request is whole.
    fn has_asked(&self) {
        self.0.slot.asked();
        *self.asked() = Some(Instant::now());
    }

    fn last_asked(&self) -> Option<Instant> {
        *self.asked()
    }

    fn asked(&self) -> parking_lot::MutexGuard<'_, Option<Instant>> {
        self.0.asked.lock()
    }

    /// Ends when the peer has been silent for too long.
    async fn loses_patience(&self) -> Refusal {
        sleep(HEAD_TIMEOUT).await;
        let Some(mut last) = self.last_asked() else {
            let has_begun = self.0.has_begun.load(Ordering::Relaxed);
            return if has_begun { Refusal::Slow(HEAD_TIMEOUT) } else { Refusal::Silent };
        };
        let mut sent = self.bytes_sent().bytes();
        loop {
            sleep_until(last + IDLE_TIMEOUT).await;
            let (asked, taken) = (self.last_asked().unwrap_or(last), self.bytes_sent().bytes());
            if asked > last {
                last = asked;
            } else if taken >= sent + SLOW_LINK_BYTES || self.0.slot.stays() {
                last = Instant::now();
            } else {
                return Refusal::Idle;
            }
            sent = taken;
        }
    }
}

/// Both versions of HTTP, with bounds.
fn builder() -> Builder<TokioExecutor> {
    let mut builder = Builder::new(TokioExecutor::new());
    builder.http1().max_buf_size(MAX_HEAD_BYTES);
    builder
        .http2()
        .timer(TokioTimer::new())
        .max_header_list_size(MAX_HEAD_BYTES as u32)
        .max_concurrent_streams(MAX_STREAMS)
        .initial_stream_window_size(STREAM_WINDOW_BYTES)
        .initial_connection_window_size(CONNECTION_WINDOW_BYTES)
        .keep_alive_interval(PING_EVERY)
        .keep_alive_timeout(PING_TIMEOUT);
    // WebSockets over HTTP/2 are not offered: each has a connection of its own, whose bytes are counted.
    builder
}

/// Tells a browser that was given the wrong address.
async fn say_https(socket: &mut ProgressSocket) {
    let text = "this port speaks HTTPS, expected https://\n";
    let head = "HTTP/1.1 400 Bad Request\r\nContent-Type: text/plain\r\nConnection: close";
    let answer = format!("{head}\r\nContent-Length: {}\r\n\r\n{text}", text.len());
    let _ = socket.write_all(answer.as_bytes()).await;
}
