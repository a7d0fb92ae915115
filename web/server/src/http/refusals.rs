//! Connections that come to nothing, in the log.

use std::fmt::Display;
use std::net::IpAddr;
use std::time::Duration;

use net::HandshakeError;
use parking_lot::Mutex;
use thiserror::Error;
use tokio::time::Instant;

use super::registry::{MAX_BEGINNING, MAX_PASSING};

/// A line so often at most, however many are refused.
const LOG_EVERY: Duration = Duration::from_secs(1);

/// Why a connection ended before its peer had what it wanted.
#[derive(Debug, Error)]
pub(super) enum Refusal {
    /// Its certificate is not trusted, or something else is wrong with TLS.
    #[error(transparent)]
    Handshake(#[from] HandshakeError),
    /// Its machine, or all together, begin too many handshakes.
    #[error("as many TLS handshakes as this port makes in a second have begun, expected it to come later")]
    TooManyHandshakes,
    /// TLS on a plain port.
    #[error("it speaks TLS, and this port speaks plain HTTP: expected http://")]
    Encrypted,
    /// Plain text on a port with TLS.
    #[error("it does not speak TLS, and this port speaks HTTPS: expected https://")]
    Plain,
    /// Neither HTTP/1.1 nor HTTP/2, or too much of it.
    #[error("{0}")]
    Protocol(String),
    /// Part of a request, and no more.
    #[error("no whole request head within {} s", .0.as_secs())]
    Slow(Duration),
    /// It opened the port and said nothing, as browsers do to be quicker later.
    #[error("it asked nothing")]
    Silent,
    /// It had asked nothing yet.
    #[error("it had asked nothing when {MAX_BEGINNING} others came")]
    GaveWay,
    /// It had asked something.
    #[error("{MAX_PASSING} others asked after it")]
    Outdated,
    /// Nothing was asked, or taken, for long.
    #[error("it is idle")]
    Idle,
    /// The system's error.
    #[error("cannot accept it: {0}")]
    System(std::io::Error),
}

impl Refusal {
    /// Whether it happens every day.
    fn is_usual(&self) -> bool {
        matches!(self, Refusal::Silent | Refusal::Idle | Refusal::Outdated)
    }
}

/// Logs what was refused, and not each of thousands.
#[derive(Debug)]
pub(super) struct Refusals {
    /// The port's name in the log.
    port: &'static str,
    last: Mutex<Option<(Instant, u64)>>,
}

impl Refusals {
    /// Of a port of this name.
    pub fn new(port: &'static str) -> Refusals {
        Refusals { port, last: Mutex::default() }
    }

    /// Logs it, or counts it for the next line.
    pub fn log(&self, from: Option<IpAddr>, why: &Refusal) {
        let from = from.map_or_else(|| "an unknown address".to_owned(), |from| from.to_string());
        if why.is_usual() {
            tracing::debug!("{}: a connection from {from} ends: {why}", self.port);
        } else if let Some(line) = self.line(&from, why, Instant::now()) {
            tracing::warn!("{line}");
        }
    }

    fn line(&self, from: &str, why: &dyn Display, now: Instant) -> Option<String> {
        let mut last = self.last.lock();
        let more = match *last {
            Some((at, unsaid)) if now - at < LOG_EVERY => {
                *last = Some((at, unsaid + 1));
                return None;
            }
            Some((_, unsaid)) if unsaid > 0 => format!(" (and {unsaid} more since the line before)"),
            _ => String::new(),
        };
        *last = Some((now, 0));
        Some(format!("{}: a connection from {from} was refused: {why}{more}", self.port))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_thousand_refusals_are_two_lines() {
        let refusals = Refusals::new("the page");
        let began = Instant::now();
        let line = |ms| {
            refusals.line(
                "192.0.2.7",
                &Refusal::Slow(Duration::from_secs(5)),
                began + Duration::from_millis(ms),
            )
        };
        let first = line(0).expect("said at once");
        assert_eq!(
            first,
            "the page: a connection from 192.0.2.7 was refused: no whole request head within 5 s"
        );
        assert_eq!((1..999).filter_map(line).count(), 0);
        assert_eq!(line(1000), Some(format!("{first} (and 998 more since the line before)")));
        assert_eq!(line(2000), Some(first));
    }
}
