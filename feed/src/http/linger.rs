//! The end of a connection whose peer may still be sending: it receives what it was sent last.
//!
//! A system that closes a socket resets the connection if bytes of the peer are unread, or come later. The peer then loses
//! what was on its way, and an answer that says what was wrong is lost just when a peer sends too much. So the sending
//! half is closed first, and what still comes is read and thrown away (a lingering close).

use std::io;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll};
use std::time::Duration;

use socket2::SockRef;
use tokio::io::{AsyncRead, AsyncReadExt as _, AsyncWrite, AsyncWriteExt as _, ReadBuf};
use tokio::net::TcpStream;
use tokio::runtime::Handle;
use tokio::sync::{OwnedSemaphorePermit, Semaphore};
use tokio::time::timeout;

/// A peer has so long to stop sending.
const LINGER: Duration = Duration::from_secs(5);
/// Sockets of a port that linger at once. Beyond, they are closed at once.
const MAX_LINGERING: usize = 32;
/// What is thrown away of a peer at most: many times the longest message.
const MAX_DISCARDED_BYTES: u64 = 1 << 20;

/// The places of a port for sockets that linger.
#[derive(Clone, Debug)]
pub(super) struct Lingering(Arc<Semaphore>);

impl Default for Lingering {
    fn default() -> Lingering {
        Lingering(Arc::new(Semaphore::new(MAX_LINGERING)))
    }
}

impl Lingering {
    fn place(&self) -> Option<OwnedSemaphorePermit> {
        Arc::clone(&self.0).try_acquire_owned().ok()
    }
}

/// A socket that lingers when it is dropped, if its peer was sent something and has not ended its own half.
#[derive(Debug)]
pub(super) struct LingeringSocket {
    socket: TcpStream,
    lingering: Lingering,
    has_sent: bool,
    has_peer_ended: bool,
}

impl LingeringSocket {
    pub fn new(socket: TcpStream, lingering: &Lingering) -> LingeringSocket {
        LingeringSocket { socket, lingering: lingering.clone(), has_sent: false, has_peer_ended: false }
    }

    fn wrote(&mut self, written: Poll<io::Result<usize>>) -> Poll<io::Result<usize>> {
        match &written {
            Poll::Ready(Ok(bytes)) => self.has_sent |= *bytes > 0,
            Poll::Ready(Err(_)) => self.has_peer_ended = true,
            Poll::Pending => {}
        }
        written
    }

    /// The same socket, to be read after this is dropped.
    fn again(&self) -> io::Result<TcpStream> {
        TcpStream::from_std(SockRef::from(&self.socket).try_clone()?.into())
    }
}

impl Drop for LingeringSocket {
    fn drop(&mut self) {
        if !self.has_sent || self.has_peer_ended {
            return;
        }
        let (Some(place), Ok(runtime)) = (self.lingering.place(), Handle::try_current()) else { return };
        let Ok(socket) = self.again() else { return };
        runtime.spawn(async move {
            let _ = timeout(LINGER, discard(socket)).await;
            drop(place);
        });
    }
}

/// Ends the sending half, and reads until the peer has ended its own.
async fn discard(mut socket: TcpStream) {
    let _ = socket.shutdown().await;
    let _ = tokio::io::copy(&mut socket.take(MAX_DISCARDED_BYTES), &mut tokio::io::sink()).await;
}

impl AsyncRead for LingeringSocket {
    fn poll_read(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        let had = buffer.filled().len();
        let read = Pin::new(&mut self.socket).poll_read(context, buffer);
        if let Poll::Ready(read) = &read {
            self.has_peer_ended |= read.is_err() || (buffer.filled().len() == had && buffer.remaining() > 0);
        }
        read
    }
}

impl AsyncWrite for LingeringSocket {
    fn poll_write(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        bytes: &[u8],
    ) -> Poll<io::Result<usize>> {
        let written = Pin::new(&mut self.socket).poll_write(context, bytes);
        self.wrote(written)
    }

    fn poll_write_vectored(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        slices: &[io::IoSlice<'_>],
    ) -> Poll<io::Result<usize>> {
        let written = Pin::new(&mut self.socket).poll_write_vectored(context, slices);
        self.wrote(written)
    }

    fn is_write_vectored(&self) -> bool {
        self.socket.is_write_vectored()
    }

    fn poll_flush(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.socket).poll_flush(context)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.socket).poll_shutdown(context)
    }
}
