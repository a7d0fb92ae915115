//! A socket that counts what is sent over it, and knows whether some of an answer is still unsent.

use std::io::{self, IoSlice};
use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::task::{Context, Poll};

use net::admission::Activity;
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::TcpStream;

use super::linger::Lingering;

/// What a connection is doing for its peer.
#[derive(Debug, Default)]
pub(super) struct Progress {
    bytes_sent: AtomicU64,
    /// The kernel did not take what was written last: its peer is still reading.
    is_unsent: AtomicBool,
    requests: AtomicUsize,
}

impl Progress {
    /// What the kernel has taken.
    pub fn bytes_sent(self: &Arc<Self>) -> BytesSent {
        BytesSent(Arc::clone(self))
    }

    /// A request is being answered for as long as the result lives.
    pub fn begin_request(self: &Arc<Self>) -> Request {
        self.requests.fetch_add(1, Ordering::Relaxed);
        Request(Arc::clone(self))
    }

    fn written(&self, written: Poll<io::Result<usize>>) -> Poll<io::Result<usize>> {
        self.is_unsent.store(written.is_pending(), Ordering::Relaxed);
        if let Poll::Ready(Ok(bytes)) = &written {
            self.bytes_sent.fetch_add(*bytes as u64, Ordering::Relaxed);
        }
        written
    }
}

impl Activity for Progress {
    fn is_answering(&self) -> bool {
        self.is_unsent.load(Ordering::Relaxed) || self.requests.load(Ordering::Relaxed) > 0
    }
}

/// Bytes that the kernel has taken for a peer, encrypted ones if the connection is.
#[derive(Clone, Debug)]
pub(crate) struct BytesSent(Arc<Progress>);

impl BytesSent {
    /// So many so far.
    pub fn bytes(&self) -> u64 {
        self.0.bytes_sent.load(Ordering::Relaxed)
    }
}

/// A request whose answer is being made.
#[derive(Debug)]
pub(super) struct Request(Arc<Progress>);

impl Drop for Request {
    fn drop(&mut self) {
        self.0.requests.fetch_sub(1, Ordering::Relaxed);
    }
}

/// The socket. It lingers when it is dropped, if its peer was sent something and has not ended its own half.
#[derive(Debug)]
pub(super) struct ProgressSocket {
    socket: TcpStream,
    progress: Arc<Progress>,
    lingering: Lingering,
    has_peer_ended: bool,
}

impl ProgressSocket {
    /// Notes there what happens on the socket.
    pub fn new(socket: TcpStream, progress: Arc<Progress>, lingering: &Lingering) -> ProgressSocket {
        ProgressSocket { socket, progress, lingering: lingering.clone(), has_peer_ended: false }
    }

    fn wrote(&mut self, written: Poll<io::Result<usize>>) -> Poll<io::Result<usize>> {
        self.has_peer_ended |= matches!(written, Poll::Ready(Err(_)));
        self.progress.written(written)
    }
}

impl Drop for ProgressSocket {
    fn drop(&mut self) {
        if self.progress.bytes_sent().bytes() > 0 && !self.has_peer_ended {
            self.lingering.keep(&self.socket);
        }
    }
}

impl AsyncRead for ProgressSocket {
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

impl AsyncWrite for ProgressSocket {
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
        slices: &[IoSlice<'_>],
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_connection_is_answering_until_its_last_request_is_answered_and_sent() {
        let progress = Arc::<Progress>::default();
        assert!(!progress.is_answering());
        let (one, other) = (progress.begin_request(), progress.begin_request());
        drop(one);
        assert!(progress.is_answering());
        drop(other);
        assert!(!progress.is_answering());
        assert!(
            progress.written(Poll::Pending).is_pending() && progress.is_answering(),
            "its peer is still reading"
        );
        let _ = progress.written(Poll::Ready(Ok(7)));
        assert!(!progress.is_answering());
        assert_eq!(progress.bytes_sent().bytes(), 7);
    }
}
