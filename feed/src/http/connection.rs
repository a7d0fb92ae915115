//! Connections that count the bytes sent to their peer.

use std::io;
use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use axum::extract::connect_info::Connected;
use axum::serve::{IncomingStream, Listener};
use tokio::net::{TcpListener, TcpStream};
use tokio_util::io::InspectWriter;

/// Bytes that the kernel buffers for a slow peer: more would be old when it arrives.
/// A page in the same building takes hundreds of megabits a second through so much.
const SEND_BUFFER_BYTES: usize = 128 << 10;

/// Accepts connections.
pub(crate) struct CountingListener(pub TcpListener);

/// One connection; what the kernel has taken is counted.
type CountingStream = InspectWriter<TcpStream, Box<dyn FnMut(&[u8]) + Send>>;

/// Bytes that the kernel has taken for a peer.
#[derive(Clone, Debug, Default)]
pub(crate) struct BytesSent(Arc<AtomicU64>);

impl BytesSent {
    /// So many so far.
    pub fn bytes(&self) -> u64 {
        self.0.load(Ordering::Relaxed)
    }
}

impl Listener for CountingListener {
    type Io = CountingStream;
    /// The peer's address, and the count of its connection.
    type Addr = (SocketAddr, BytesSent);

    async fn accept(&mut self) -> (CountingStream, (SocketAddr, BytesSent)) {
        let (stream, address) = Listener::accept(&mut self.0).await;
        // A socket that takes neither setting still works, only later.
        let _ = stream.set_nodelay(true);
        let _ = socket2::SockRef::from(&stream).set_send_buffer_size(SEND_BUFFER_BYTES);
        let bytes_sent = BytesSent::default();
        let counter = Arc::clone(&bytes_sent.0);
        let count = move |bytes: &[u8]| _ = counter.fetch_add(bytes.len() as u64, Ordering::Relaxed);
        (InspectWriter::new(stream, Box::new(count)), (address, bytes_sent))
    }

    fn local_addr(&self) -> io::Result<(SocketAddr, BytesSent)> {
        self.0.local_addr().map(|address| (address, BytesSent::default()))
    }
}

impl Connected<IncomingStream<'_, CountingListener>> for BytesSent {
    fn connect_info(stream: IncomingStream<'_, CountingListener>) -> BytesSent {
        stream.remote_addr().1.clone()
    }
}
