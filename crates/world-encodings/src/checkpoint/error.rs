//! Why bytes are no world.

use proto::codec::TooManyEntries;
use sim::{SceneError, ValueError};
use thiserror::Error;

/// Why bytes make no world. Every message is one line.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum WorldBytesError {
    /// They are no message.
    #[error("no world: {0}")]
    Message(#[from] prost::DecodeError),
    /// More bodies, or forms of them, than a world has.
    #[error(transparent)]
    Entries(#[from] TooManyEntries),
    /// A field that is not there, or holds another count of numbers.
    #[error("{field} holds {found} numbers, expected {expected}")]
    Count {
        /// Its name in the message.
        field: &'static str,
        /// Numbers found.
        found: usize,
        /// Numbers expected.
        expected: usize,
    },
    /// A field that must be there is not.
    #[error("{0} is missing")]
    Missing(&'static str),
    /// A form that no body has.
    #[error("body {body}: no form of a body has this place")]
    Solid {
        /// The body's number.
        body: u32,
    },
    /// A pose without numbers, or with a quaternion of another length than 1.
    #[error("body {body}: {error}")]
    Pose {
        /// The body's number.
        body: u32,
        /// What was found and expected.
        error: hull::body::BodyError,
    },
    /// A value that cannot be.
    #[error(transparent)]
    Value(#[from] ValueError),
    /// A scene that cannot be.
    #[error(transparent)]
    Scene(#[from] SceneError),
}
