//! Choices of the command line.

use clap::ValueEnum;
use proto::convert::Precision;

use cluster::Sockets;

/// How numbers travel, by name.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum PrecisionName {
    /// With all their bits.
    Exact,
    /// Rounded: responses stay within 0.1 mm but for rays that graze a pixel's corner.
    Quantised,
}

impl PrecisionName {
    /// As on the command line.
    pub fn name(self) -> &'static str {
        match self {
            PrecisionName::Exact => "exact",
            PrecisionName::Quantised => "quantised",
        }
    }

    /// As the coordinator has it.
    pub fn precision(self) -> Precision {
        match self {
            PrecisionName::Exact => Precision::Exact,
            PrecisionName::Quantised => Precision::Quantised,
        }
    }
}

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
