//! Admission of connections to a port: how many it keeps, which is evicted, and a log that no flood fills. Each port has a
//! [`Policy`] of its own.

mod log;
mod registry;

use std::future::Future;
use std::io;
use std::time::Duration;

pub use log::RateLimitedLog;
pub use registry::{Activity, ConnectionSlot, Policy, Registry, StayGuard};

/// The first byte of TLS.
pub const TLS_HANDSHAKE: u8 = 0x16;

/// The system has no descriptor, or no memory: it is asked again after this.
const ACCEPT_PAUSE: Duration = Duration::from_millis(50);

/// The next connection of a listener, as `accept` gives it. Connections that their peers aborted are passed over; any other
/// error is given to `log`, and accepting pauses for 50 ms. Cancel safe if `accept` is.
pub async fn accept_next<T, F>(accept: impl Fn() -> F, log: impl Fn(&io::Error)) -> T
where
    F: Future<Output = io::Result<T>>,
{
    loop {
        match accept().await {
            Ok(accepted) => return accepted,
            Err(error) if is_of_the_peer(&error) => {}
            Err(error) => {
                log(&error);
                tokio::time::sleep(ACCEPT_PAUSE).await;
            }
        }
    }
}

/// Whether the peer went away before it was accepted.
fn is_of_the_peer(error: &io::Error) -> bool {
    use io::ErrorKind::{ConnectionAborted, ConnectionRefused, ConnectionReset};
    matches!(error.kind(), ConnectionAborted | ConnectionRefused | ConnectionReset)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::cell::RefCell;
    use std::collections::VecDeque;

    #[tokio::test(start_paused = true)]
    async fn a_port_without_descriptors_accepts_again_and_says_so() {
        let none_left = || io::Error::from_raw_os_error(24);
        let answers = VecDeque::from([
            Err(io::ErrorKind::ConnectionAborted.into()),
            Err(none_left()),
            Err(none_left()),
            Ok(7),
        ]);
        let (answers, said) = (RefCell::new(answers), RefCell::new(0));
        let began = tokio::time::Instant::now();
        let next = || std::future::ready(answers.borrow_mut().pop_front().expect("one more"));
        assert_eq!(accept_next(next, |_| *said.borrow_mut() += 1).await, 7);
        assert_eq!((said.into_inner(), began.elapsed()), (2, 2 * ACCEPT_PAUSE));
    }
}
