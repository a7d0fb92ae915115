//! Choices of the command line.

use clap::ValueEnum;
use cluster::Sockets;

/// Sockets by name.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum SocketName {
    /// Loopback TCP.
    Tcp,
    /// Unix sockets.
    Unix,
}

impl SocketName {
    /// As on the command line.
    pub fn name(self) -> &'static str {
        match self {
            SocketName::Tcp => "tcp",
            SocketName::Unix => "unix",
        }
    }

    /// As a local cluster has them.
    pub fn sockets(self) -> Sockets {
        match self {
            SocketName::Tcp => Sockets::Tcp,
            SocketName::Unix => Sockets::Unix,
        }
    }
}
