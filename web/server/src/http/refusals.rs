//! Connections that come to nothing, in the log.

use std::net::IpAddr;
use std::time::Duration;

use net::HandshakeError;
use net::admission::RateLimitedLog;
use thiserror::Error;

use super::{MAX_BEGINNING, MAX_PASSING};

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
    System(String),
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
    log: RateLimitedLog,
}

impl Refusals {
    /// Of a port of this name.
    pub fn new(port: &'static str) -> Refusals {
        Refusals { port, log: RateLimitedLog::default() }
    }

    /// Logs it, or counts it for the next line.
    pub fn log(&self, from: Option<IpAddr>, why: &Refusal) {
        let connection = self.connection(from);
        if why.is_usual() {
            tracing::debug!("{connection} ends: {why}");
        } else {
            self.log.warn(&format_args!("{connection} was refused"), why);
        }
    }

    fn connection(&self, from: Option<IpAddr>) -> String {
        let from = from.map_or_else(|| "an unknown address".to_owned(), |from| from.to_string());
        format!("{}: a connection from {from}", self.port)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_refusal_names_the_port_the_peer_and_the_reason() {
        let connection = Refusals::new("the page").connection(Some(IpAddr::from([192, 0, 2, 7])));
        assert_eq!(connection, "the page: a connection from 192.0.2.7");
        assert_eq!(Refusal::Slow(Duration::from_secs(5)).to_string(), "no whole request head within 5 s");
        assert_eq!(Refusal::GaveWay.to_string(), "it had asked nothing when 64 others came");
    }
}
