//! A Unix socket without needless wake-ups. Linux tells a writer whenever its peer has read something; a task that waits
//! for answers on such a socket is woken once more a message, and pays for waking the other. So this one waits for room
//! only where there was none.

use std::io::{self, ErrorKind, IoSlice, Read as _, Write as _};
use std::net::Shutdown;
use std::os::unix::net::UnixStream;
use std::pin::Pin;
use std::task::{Context, Poll, ready};

use tokio::io::unix::AsyncFd;
use tokio::io::{AsyncRead, AsyncWrite, Interest, ReadBuf};

/// Bytes read at once at most.
const READ_BYTES: usize = 16 * 1024;

/// A connection over a Unix socket.
pub struct UnixSocket {
    socket: AsyncFd<UnixStream>,
    read: Box<[u8; READ_BYTES]>,
    /// The same socket, while there is no room to write.
    full: Option<AsyncFd<UnixStream>>,
}

impl UnixSocket {
    /// A connection; must be made and used within a tokio runtime.
    pub fn new(socket: tokio::net::UnixStream) -> io::Result<UnixSocket> {
        let socket = watched(socket.into_std()?, Interest::READABLE)?;
        Ok(UnixSocket { socket, read: Box::new([0; READ_BYTES]), full: None })
    }

    fn poll_write_with(
        &mut self,
        context: &mut Context<'_>,
        write: impl Fn(&mut &UnixStream) -> io::Result<usize>,
    ) -> Poll<io::Result<usize>> {
        loop {
            let room = match &self.full {
                Some(full) => Some(ready!(full.poll_write_ready(context))?),
                None => None,
            };
            match (write(&mut self.socket.get_ref()), room) {
                (Err(error), _) if error.kind() == ErrorKind::Interrupted => {}
                (Err(error), Some(mut room)) if error.kind() == ErrorKind::WouldBlock => room.clear_ready(),
                (Err(error), None) if error.kind() == ErrorKind::WouldBlock => {
                    let again = self.socket.get_ref().try_clone()?;
                    self.full = Some(watched(again, Interest::WRITABLE)?);
                }
                (written, _) => {
                    self.full = None;
                    return Poll::Ready(written);
                }
            }
        }
    }
}

/// The runtime hears of one thing alone about a socket.
#[allow(
    deprecated,
    reason = "what replaces it is unsafe; a UnixStream is one open socket for as long as it lives"
)]
fn watched(socket: UnixStream, interest: Interest) -> io::Result<AsyncFd<UnixStream>> {
    AsyncFd::with_interest(socket, interest)
}

impl AsyncRead for UnixSocket {
    fn poll_read(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        into: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        let UnixSocket { socket, read, .. } = &mut *self;
        let most = into.remaining().min(READ_BYTES);
        loop {
            let mut there = ready!(socket.poll_read_ready(context))?;
            match socket.get_ref().read(&mut read[..most]) {
                Ok(count) => {
                    if count > 0 && count < most {
                        // That was all: what comes later is announced again.
                        there.clear_ready();
                    }
                    into.put_slice(&read[..count]);
                    return Poll::Ready(Ok(()));
                }
                Err(error) if error.kind() == ErrorKind::WouldBlock => there.clear_ready(),
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) => return Poll::Ready(Err(error)),
            }
        }
    }
}

impl AsyncWrite for UnixSocket {
    fn poll_write(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        bytes: &[u8],
    ) -> Poll<io::Result<usize>> {
        self.poll_write_with(context, |socket| socket.write(bytes))
    }

    fn poll_write_vectored(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        slices: &[IoSlice<'_>],
    ) -> Poll<io::Result<usize>> {
        self.poll_write_with(context, |socket| socket.write_vectored(slices))
    }

    fn is_write_vectored(&self) -> bool {
        true
    }

    fn poll_flush(self: Pin<&mut Self>, _context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Poll::Ready(Ok(()))
    }

    fn poll_shutdown(self: Pin<&mut Self>, _context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Poll::Ready(self.socket.get_ref().shutdown(Shutdown::Write))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _, split};

    fn pair() -> [UnixSocket; 2] {
        let (a, b) = tokio::net::UnixStream::pair().expect("a pair");
        [a, b].map(|socket| UnixSocket::new(socket).expect("a socket"))
    }

    /// Far more than the system keeps for a reader.
    fn many() -> Vec<u8> {
        (0..8_000_000u32).map(|at| (at.wrapping_mul(2_654_435_761) >> 24) as u8).collect()
    }

    #[tokio::test]
    async fn all_arrives_both_ways_at_once_and_the_end_is_seen() {
        let [a, b] = pair();
        let send_and_read = async |socket: UnixSocket| {
            let (mut reads, mut writes) = split(socket);
            let sent = async {
                writes.write_all(&many()).await.expect("written");
                writes.shutdown().await.expect("closed");
            };
            let mut found = Vec::new();
            let (read, ()) = tokio::join!(reads.read_to_end(&mut found), sent);
            read.expect("read");
            found
        };
        let (of_b, of_a) = tokio::join!(send_and_read(a), send_and_read(b));
        assert!(of_a == many() && of_b == many());
    }

    #[tokio::test]
    async fn who_has_gone_is_told_to_reader_and_writer() {
        let [mut a, b] = pair();
        drop(b);
        assert_eq!(a.read(&mut [0; 8]).await.expect("the end"), 0);
        assert_eq!(a.write(&[1; 8]).await.expect_err("the reader is gone").kind(), ErrorKind::BrokenPipe);
    }

    #[tokio::test]
    async fn a_message_that_comes_later_wakes_the_reader() {
        let [mut a, mut b] = pair();
        for message in 0..50u8 {
            let wait = async {
                tokio::task::yield_now().await;
                b.write_all(&[message; 3]).await.expect("written");
            };
            let mut found = [0; 3];
            let (read, ()) = tokio::join!(a.read_exact(&mut found), wait);
            assert_eq!((read.expect("read"), found), (3, [message; 3]));
        }
    }
}
