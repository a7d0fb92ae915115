//! How numbers travel, on the command line.

use clap::ValueEnum;
use proto::convert::Precision;

/// How numbers travel between coordinator and nodes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum PrecisionName {
    /// Every bit: the same run over every transport.
    Exact,
    /// About half the bytes; responses within 0.1 mm but for rays that graze a pixel's corner.
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
}

impl From<PrecisionName> for Precision {
    fn from(name: PrecisionName) -> Precision {
        match name {
            PrecisionName::Exact => Precision::Exact,
            PrecisionName::Quantised => Precision::Quantised,
        }
    }
}
