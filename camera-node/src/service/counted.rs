//! Connections whose bytes are counted.

use std::io::{self, IoSlice};
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll, ready};

use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio_stream::{Stream, StreamExt as _};
use tonic::transport::server::Connected;

use crate::metrics::TrafficMeter;

/// A connection that counts what crosses it, and itself while it is open.
pub(super) struct CountedConnection<C> {
    connection: C,
    meter: Arc<TrafficMeter>,
}

/// The same connections, counted.
pub(super) fn counted<C>(
    connections: impl Stream<Item = io::Result<C>>,
    meter: Arc<TrafficMeter>,
) -> impl Stream<Item = io::Result<CountedConnection<C>>> {
    connections.map(move |connection| {
        connection.map(|connection| {
            meter.opened();
            CountedConnection { connection, meter: Arc::clone(&meter) }
        })
    })
}

impl<C> Drop for CountedConnection<C> {
    fn drop(&mut self) {
        self.meter.closed();
    }
}

impl<C: Connected> Connected for CountedConnection<C> {
    type ConnectInfo = C::ConnectInfo;

    fn connect_info(&self) -> C::ConnectInfo {
        self.connection.connect_info()
    }
}

impl<C: AsyncRead + Unpin> AsyncRead for CountedConnection<C> {
    fn poll_read(
        self: Pin<&mut Self>,
        context: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        let this = self.get_mut();
        let before = buffer.filled().len();
        let read = ready!(Pin::new(&mut this.connection).poll_read(context, buffer));
        this.meter.received(buffer.filled().len() - before);
        Poll::Ready(read)
    }
}

impl<C: AsyncWrite + Unpin> CountedConnection<C> {
    fn count(&self, written: Poll<io::Result<usize>>) -> Poll<io::Result<usize>> {
        if let Poll::Ready(Ok(bytes)) = &written {
            self.meter.sent(*bytes);
        }
        written
    }
}

impl<C: AsyncWrite + Unpin> AsyncWrite for CountedConnection<C> {
    fn poll_write(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        bytes: &[u8],
    ) -> Poll<io::Result<usize>> {
        let written = Pin::new(&mut self.connection).poll_write(context, bytes);
        self.count(written)
    }

    fn poll_write_vectored(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        slices: &[IoSlice<'_>],
    ) -> Poll<io::Result<usize>> {
        let written = Pin::new(&mut self.connection).poll_write_vectored(context, slices);
        self.count(written)
    }

    fn is_write_vectored(&self) -> bool {
        self.connection.is_write_vectored()
    }

    fn poll_flush(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.connection).poll_flush(context)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.connection).poll_shutdown(context)
    }
}
