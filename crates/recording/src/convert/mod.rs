//! Our own types as messages and back. A file is not trusted: what comes back is checked.

mod command;
mod contacts;
mod header;
mod numbers;
mod solid;
mod world;

pub(crate) use command::{command_from_message, command_to_message};
pub(crate) use contacts::{contacts_from_bytes, contacts_to_bytes};
pub use header::RunHeader;
pub(crate) use numbers::{SEGMENT_MS, UNIX_S, finite, vector, within};
pub(crate) use world::{bodies, patches, scene, touches};

use thiserror::Error;

/// A message with an impossible value.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error("{message}: {problem}")]
pub struct ConvertError {
    /// Which message.
    pub message: &'static str,
    /// What was found and expected.
    pub problem: String,
}

impl ConvertError {
    pub(crate) fn new(message: &'static str, problem: impl std::fmt::Display) -> ConvertError {
        ConvertError { message, problem: problem.to_string() }
    }

    /// A field that must be there is not.
    pub(crate) fn missing(message: &'static str, field: &'static str) -> ConvertError {
        ConvertError::new(message, format_args!("{field} is missing"))
    }
}
