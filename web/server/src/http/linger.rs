//! The end of a connection whose peer may still be sending: it receives what it was sent last.
//!
//! A system that closes a socket resets the connection if bytes of the peer are unread, or come later. The peer then loses
//! what was on its way, and an answer that says what was wrong is lost just when a peer sends too much. So the sending
//! half is closed first, and what still comes is read and thrown away (a lingering close).

use std::io;
use std::sync::Arc;
use std::time::Duration;

use socket2::SockRef;
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::TcpStream;
use tokio::runtime::Handle;
use tokio::sync::Semaphore;
use tokio::time::timeout;

/// A peer has so long to stop sending.
const LINGER: Duration = Duration::from_secs(5);
/// Sockets of a port that linger at once. Beyond, they are closed at once.
const MAX_LINGERING: usize = 32;
/// What is thrown away of a peer at most: many times the longest message.
const MAX_DISCARDED_BYTES: u64 = 1 << 20;

/// The places of a port for sockets that linger.
#[derive(Clone, Debug)]
pub(crate) struct Lingering(Arc<Semaphore>);

impl Default for Lingering {
    fn default() -> Lingering {
        Lingering(Arc::new(Semaphore::new(MAX_LINGERING)))
    }
}

impl Lingering {
    /// Waits until no socket lingers.
    pub async fn ended(&self) {
        // Never closed, so it can only succeed.
        let _ = self.0.acquire_many(MAX_LINGERING as u32).await;
    }

    /// Lets a socket linger that is about to be dropped, if a place is free.
    pub fn keep(&self, socket: &TcpStream) {
        let (Ok(place), Ok(runtime)) = (Arc::clone(&self.0).try_acquire_owned(), Handle::try_current())
        else {
            return;
        };
        // Its last descriptor decides when a socket is closed.
        let Ok(socket) = copy(socket) else { return };
        runtime.spawn(async move {
            let _ = timeout(LINGER, discard(socket)).await;
            drop(place);
        });
    }
}

fn copy(socket: &TcpStream) -> io::Result<TcpStream> {
    TcpStream::from_std(SockRef::from(socket).try_clone()?.into())
}

/// Ends the sending half, and reads until the peer has ended its own.
async fn discard(mut socket: TcpStream) {
    let _ = socket.shutdown().await;
    let _ = tokio::io::copy(&mut socket.take(MAX_DISCARDED_BYTES), &mut tokio::io::sink()).await;
}
