//! Admission: connections are accepted, encrypted where certificates are in use, and counted.
//!
//! An unauthenticated connection is evicted when the next one needs its slot, oldest first of the machine that
//! has most of them, so that no number of silent ones keeps a coordinator out.

use std::fmt::Display;
use std::io;
use std::net::IpAddr;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll};
use std::time::{Duration, Instant};

use net::admission::{Policy, RateLimitedLog, Registry, TLS_HANDSHAKE, accept_next};
use net::{Credentials, HandshakeError, HandshakeLimit, Identity, Peer, ServerSocket, UnixSocket};
use thiserror::Error;
use tokio::io::{AsyncRead, AsyncReadExt as _, AsyncWrite, ReadBuf};
use tokio::net::TcpStream;
use tokio::sync::mpsc;
use tokio::task::JoinSet;
use tokio_stream::Stream;
use tokio_stream::wrappers::ReceiverStream;
use tonic::transport::server::Connected;

use super::seats::{NoSeat, Seat, SharedSeats};
use crate::listen::{Accepted, Listener};

/// Connections that have not said yet who they are. Those that have are counted by their seats.
const POLICY: Policy = Policy { beginning: 64, passing: None };
/// A peer that has said nothing of the protocol by then is dropped.
const BEGIN_TIMEOUT: Duration = Duration::from_secs(5);
/// What a client of HTTP/2 says first.
const PREFACE: &[u8; 24] = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n";
/// Connections without a call are looked for so often.
const IDLE_CHECK: Duration = Duration::from_secs(1);

/// The peers from which a node accepts connections.
#[derive(Clone, Default)]
pub enum Access {
    /// Processes of this machine.
    #[default]
    ThisMachine,
    /// Any peer that reaches the address: nothing is encrypted.
    AnyPeer,
    /// Over TCP, peers with a certificate of the same authority.
    Certified(Arc<Credentials>),
}

/// Who is at the other end of a connection.
#[derive(Clone, Debug, Default)]
pub(super) struct Caller {
    /// Nothing is known of it without certificates.
    pub peer: Option<Peer>,
    /// Where what it holds is counted.
    pub seat: Option<Arc<Seat>>,
}

/// A connection with a seat.
pub(super) struct Connection {
    socket: Box<dyn Socket>,
    /// What was read to see that it speaks the protocol.
    read_ahead: Option<[u8; PREFACE.len()]>,
    caller: Caller,
    /// Completes when the node ends it.
    ended: Pin<Box<dyn Future<Output = ()> + Send>>,
}

trait Socket: AsyncRead + AsyncWrite + Send + Unpin {}
impl Socket for TcpStream {}
impl Socket for UnixSocket {}
impl Socket for ServerSocket<TcpStream> {}

/// The connections of a listener, for as long as the stream is read.
pub(super) fn incoming(
    listener: Listener,
    access: &Access,
) -> impl Stream<Item = io::Result<Connection>> + use<> {
    let credentials = match access {
        Access::Certified(credentials) => Some(Arc::clone(credentials)),
        Access::ThisMachine | Access::AnyPeer => None,
    };
    let (sender, receiver) = mpsc::channel(1);
    let door =
        Door { credentials, handshakes: Arc::default(), seats: SharedSeats::default(), log: Arc::default() };
    tokio::spawn(accept(listener, door, sender));
    ReceiverStream::new(receiver)
}

/// Accepts until the receiver is dropped.
async fn accept(listener: Listener, door: Door, sender: mpsc::Sender<io::Result<Connection>>) {
    let (mut beginning, registry) = (JoinSet::new(), Registry::new(POLICY));
    let mut idle_check = tokio::time::interval(IDLE_CHECK);
    loop {
        let accepted = tokio::select! {
            accepted = accept_next(|| listener.accept(), |error| door.refuses(None, error)) => accepted,
            Some(_) = beginning.join_next() => continue,
            _ = idle_check.tick() => {
                door.seats.end_idle();
                continue;
            }
            () = sender.closed() => return,
        };
        if let Err(why) = door.may_begin(&accepted) {
            door.refuses(accepted.from(), &why);
            continue;
        }
        let (door, sender, from) = (door.clone(), sender.clone(), accepted.from());
        let begun = registry.begin(from, Arc::new(()));
        beginning.spawn(async move {
            let admit = async {
                match tokio::time::timeout(BEGIN_TIMEOUT, door.let_in(accepted)).await {
                    Ok(Ok(connection)) => drop(sender.send(Ok(connection)).await),
                    Ok(Err(why)) => door.refuses(from, &why),
                    Err(_) => door.refuses(from, &Refusal::Silent),
                }
            };
            tokio::select! {
                () = admit => {}
                () = begun.evicted() => {}
            }
        });
    }
}

/// Why a peer is not admitted.
#[derive(Debug, Error)]
enum Refusal {
    #[error(transparent)]
    Handshake(#[from] HandshakeError),
    #[error("as many TLS handshakes as this node makes in a second have begun, expected it to come later")]
    TooManyHandshakes,
    #[error("it left before it said anything")]
    Left,
    #[error("it said nothing within {} s", BEGIN_TIMEOUT.as_secs())]
    Silent,
    #[error("it speaks TLS, and this node was started without --certs")]
    Encrypted,
    #[error("it does not speak gRPC")]
    Protocol,
    #[error(transparent)]
    NoSeat(#[from] NoSeat),
}

/// Decides who gets in.
#[derive(Clone)]
struct Door {
    credentials: Option<Arc<Credentials>>,
    handshakes: Arc<HandshakeLimit>,
    seats: SharedSeats,
    log: Arc<RateLimitedLog>,
}

impl Door {
    /// Logs that a connection from that machine, or from this one, comes to nothing.
    fn refuses(&self, from: Option<IpAddr>, why: &dyn Display) {
        let from = from.map_or_else(|| "this machine".to_owned(), |from| from.to_string());
        self.log.warn(&format_args!("a connection from {from} was refused"), why);
    }

    /// Refuses a TLS handshake that is one too many, before it costs anything.
    fn may_begin(&self, accepted: &Accepted) -> Result<(), Refusal> {
        let (Accepted::Tcp(_, from), Some(_)) = (accepted, &self.credentials) else { return Ok(()) };
        let is_trusted = self.seats.is_of_lease(other_machine(*from));
        let may_begin = self.handshakes.admit(*from, is_trusted, Instant::now());
        may_begin.then_some(()).ok_or(Refusal::TooManyHandshakes)
    }

    async fn let_in(&self, accepted: Accepted) -> Result<Connection, Refusal> {
        let from = accepted.from();
        // Only this user has a Unix socket.
        let metered = from.is_some();
        let (mut socket, peer): (Box<dyn Socket>, Option<Peer>) = match (accepted, &self.credentials) {
            (Accepted::Unix(socket), _) => (Box::new(socket), None),
            (Accepted::Tcp(socket, _), None) => (Box::new(socket), None),
            (Accepted::Tcp(socket, _), Some(credentials)) => {
                let (socket, peer) = credentials.accept(socket).await?;
                (Box::new(socket), Some(peer))
            }
        };
        let mut preface = [0; PREFACE.len()];
        let read = socket.read_exact(&mut preface).await;
        read.map_err(|_| Refusal::Left)?;
        if preface != *PREFACE {
            let is_tls = preface[0] == TLS_HANDSHAKE && self.credentials.is_none();
            return Err(if is_tls { Refusal::Encrypted } else { Refusal::Protocol });
        }
        let leads = match (&peer, &self.credentials) {
            (Some(peer), Some(own)) => peer.is(&Identity::coordinator(&own.own().room)),
            _ => true,
        };
        let seat = self.seats.take(from.and_then(other_machine), leads, metered)?;
        let ended = seat.ended();
        let ended = Box::pin(async move { ended.notified().await });
        Ok(Connection { socket, read_ahead: Some(preface), caller: Caller { peer, seat: Some(seat) }, ended })
    }
}

/// `None` for an address of this machine.
fn other_machine(from: IpAddr) -> Option<IpAddr> {
    (!from.is_loopback()).then_some(from)
}

impl Connected for Connection {
    type ConnectInfo = Caller;

    fn connect_info(&self) -> Caller {
        self.caller.clone()
    }
}

impl Connection {
    /// Looked at whenever it moves or could: a peer that reads nothing must not stay for that.
    fn check_ended(&mut self, context: &mut Context<'_>) -> io::Result<()> {
        if self.ended.as_mut().poll(context).is_pending() {
            return Ok(());
        }
        self.ended = Box::pin(std::future::ready(()));
        Err(io::Error::other("the node ended it"))
    }
}

impl AsyncRead for Connection {
    fn poll_read(
        self: Pin<&mut Self>,
        context: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        let this = self.get_mut();
        this.check_ended(context)?;
        match this.read_ahead.take() {
            // A reader's first buffer has room for a whole frame.
            Some(ahead) if buffer.remaining() >= ahead.len() => {
                buffer.put_slice(&ahead);
                Poll::Ready(Ok(()))
            }
            Some(_) => Poll::Ready(Err(io::Error::other("a buffer too small for HTTP/2"))),
            None => Pin::new(&mut this.socket).poll_read(context, buffer),
        }
    }
}

impl AsyncWrite for Connection {
    fn poll_write(self: Pin<&mut Self>, context: &mut Context<'_>, bytes: &[u8]) -> Poll<io::Result<usize>> {
        let this = self.get_mut();
        this.check_ended(context)?;
        Pin::new(&mut this.socket).poll_write(context, bytes)
    }

    fn poll_write_vectored(
        self: Pin<&mut Self>,
        context: &mut Context<'_>,
        slices: &[io::IoSlice<'_>],
    ) -> Poll<io::Result<usize>> {
        let this = self.get_mut();
        this.check_ended(context)?;
        Pin::new(&mut this.socket).poll_write_vectored(context, slices)
    }

    fn is_write_vectored(&self) -> bool {
        self.socket.is_write_vectored()
    }

    fn poll_flush(self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        let this = self.get_mut();
        this.check_ended(context)?;
        Pin::new(&mut this.socket).poll_flush(context)
    }

    fn poll_shutdown(self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.get_mut().socket).poll_shutdown(context)
    }
}
