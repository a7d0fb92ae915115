//! Bytes counted where they cross the socket, protocol overhead and all.

use std::io::{IoSlice, Result};
use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::task::{Context, Poll};

use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};

/// Bytes since the beginning.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ByteCounts {
    /// Written to nodes.
    pub to_nodes: u64,
    /// Read from nodes.
    pub from_nodes: u64,
}

impl ByteCounts {
    /// Both ways together.
    pub fn total(self) -> u64 {
        self.to_nodes + self.from_nodes
    }

    /// What was counted since `before`.
    pub fn since(self, before: ByteCounts) -> ByteCounts {
        ByteCounts {
            to_nodes: self.to_nodes - before.to_nodes,
            from_nodes: self.from_nodes - before.from_nodes,
        }
    }
}

/// Shared by all connections of a run.
#[derive(Debug, Default)]
pub(crate) struct ByteCounters {
    to_nodes: AtomicU64,
    from_nodes: AtomicU64,
}

impl ByteCounters {
    pub fn read(&self) -> ByteCounts {
        ByteCounts {
            to_nodes: self.to_nodes.load(Ordering::Relaxed),
            from_nodes: self.from_nodes.load(Ordering::Relaxed),
        }
    }
}

/// A socket that counts.
pub(crate) struct CountingStream<S> {
    pub inner: S,
    pub counters: Arc<ByteCounters>,
}

impl<S: AsyncRead + Unpin> AsyncRead for CountingStream<S> {
    fn poll_read(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<Result<()>> {
        let before = buffer.filled().len();
        let polled = Pin::new(&mut self.inner).poll_read(context, buffer);
        let read = buffer.filled().len() - before;
        self.counters.from_nodes.fetch_add(read as u64, Ordering::Relaxed);
        polled
    }
}

impl<S> CountingStream<S> {
    fn written(&self, polled: &Poll<Result<usize>>) {
        if let Poll::Ready(Ok(written)) = polled {
            self.counters.to_nodes.fetch_add(*written as u64, Ordering::Relaxed);
        }
    }
}

impl<S: AsyncWrite + Unpin> AsyncWrite for CountingStream<S> {
    fn poll_write(mut self: Pin<&mut Self>, context: &mut Context<'_>, bytes: &[u8]) -> Poll<Result<usize>> {
        let polled = Pin::new(&mut self.inner).poll_write(context, bytes);
        self.written(&polled);
        polled
    }

    fn poll_write_vectored(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        slices: &[IoSlice<'_>],
    ) -> Poll<Result<usize>> {
        let polled = Pin::new(&mut self.inner).poll_write_vectored(context, slices);
        self.written(&polled);
        polled
    }

    fn is_write_vectored(&self) -> bool {
        self.inner.is_write_vectored()
    }

    fn poll_flush(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<Result<()>> {
        Pin::new(&mut self.inner).poll_flush(context)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<Result<()>> {
        Pin::new(&mut self.inner).poll_shutdown(context)
    }
}
