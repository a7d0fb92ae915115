//! Choices of the command line.

use clap::ValueEnum;
use setup::Sockets;

/// Sockets by name.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum SocketName {
    /// Loopback TCP.
    Tcp,
    /// Unix sockets.
    Unix,
    /// Loopback TCP with certificates: TLS 1.3, both sides show one.
    Tls,
}

impl SocketName {
    /// As on the command line.
    pub fn name(self) -> &'static str {
        match self {
            SocketName::Tcp => "tcp",
            SocketName::Unix => "unix",
            SocketName::Tls => "tls",
        }
    }

    /// As a local cluster has them.
    pub fn sockets(self) -> Sockets {
        match self {
            SocketName::Tcp | SocketName::Tls => Sockets::Tcp,
            SocketName::Unix => Sockets::Unix,
        }
    }
}
