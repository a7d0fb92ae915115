//! Both directions of every message. Messages are taken apart field by field, so that a new field
//! breaks the build here. Errors name message and field.

mod answer;
mod bulk;
mod choice;
mod claim;
mod clock;
mod description;
mod film;
mod from_wire;
pub mod fuzz;
mod packed;
mod pictures;
mod question;
mod rounded;
mod silhouette;
mod status;
mod to_wire;
mod trace;

pub use answer::{
    ExpectedAnswer, ExpectedCamera, ProbeAnswer, answer_from_wire, answer_to_wire, asked_world,
};
pub use claim::{claim_from_wire, claim_to_wire};
pub use clock::{
    clock_from_wire, clock_to_wire, node_clock_from_wire, phase_from_wire, start_from_wire, start_to_wire,
};
pub use description::{description_from_wire, description_to_wire};
pub use film::{film_event_from_wire, film_event_to_wire};
pub use from_wire::{pixel_rect_from_wire, refusal_of, settings_from_wire, shape_from_wire};
pub use pictures::{
    frame_pictures_from_wire, most_picture_bytes, picture_request_from_wire, picture_request_to_wire,
    picture_to_wire,
};
pub use question::{QuestionReader, QuestionWriter, StreamKnows, WrittenQuestion};
pub use rounded::Precision;
pub use silhouette::{SilhouetteEncoding, most_silhouette_bytes, silhouette_data, silhouette_from_data};
pub use status::{status_from_wire, status_to_wire};
pub use to_wire::{pixel_rect_to_wire, refusal, settings_to_wire, shape_key, shape_to_wire};
pub use trace::trace_parent_from_wire;

use thiserror::Error;

/// Why a node does not answer a question.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RefusalReason {
    /// The frame has left the ring.
    Gone,
    /// The frame has not come yet.
    NotYet,
    /// A shape is not registered there.
    UnknownShape,
    /// More points than a question may hold.
    TooManyPoints,
    /// The message makes no question.
    Malformed,
    /// Too many questions wait.
    Busy,
    /// The list of bodies is not known there.
    UnknownList,
    /// Another client holds the node.
    Held,
}

impl RefusalReason {
    /// All of them, in this order.
    pub const ALL: [RefusalReason; 8] = [
        RefusalReason::Gone,
        RefusalReason::NotYet,
        RefusalReason::UnknownShape,
        RefusalReason::TooManyPoints,
        RefusalReason::Malformed,
        RefusalReason::Busy,
        RefusalReason::UnknownList,
        RefusalReason::Held,
    ];

    /// As metrics name it.
    pub fn word(self) -> &'static str {
        match self {
            RefusalReason::Gone => "gone",
            RefusalReason::NotYet => "not_yet",
            RefusalReason::UnknownShape => "unknown_shape",
            RefusalReason::TooManyPoints => "too_many_points",
            RefusalReason::Malformed => "malformed",
            RefusalReason::Busy => "busy",
            RefusalReason::UnknownList => "unknown_list",
            RefusalReason::Held => "held",
        }
    }
}

/// Why a message makes no value.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum ConvertError {
    /// A field that must be there is not.
    #[error("{message}.{field} is missing")]
    Missing {
        /// Name of the message type.
        message: &'static str,
        /// Name of the field.
        field: &'static str,
    },
    /// A packed field of the wrong length.
    #[error("{message}.{field} holds {found} bytes, expected {expected}")]
    Length {
        /// Name of the message type.
        message: &'static str,
        /// Name of the field.
        field: &'static str,
        /// Bytes found.
        found: usize,
        /// Bytes expected.
        expected: usize,
    },
    /// A value that cannot be.
    #[error("{message}.{field}: {what}")]
    Value {
        /// Name of the message type.
        message: &'static str,
        /// Name of the field.
        field: &'static str,
        /// What was found and what was expected.
        what: String,
    },
    /// A shape that is not registered.
    #[error("shape {0:016x} is not registered")]
    UnknownShape(u64),
    /// No list of bodies was sent over this stream, or it is not kept any more.
    #[error("no list of bodies is known, expected ProbeRequest.bodies")]
    UnknownList,
    /// More points than a question may hold.
    #[error("question of {found} points, at most {limit} are taken")]
    TooManyPoints {
        /// Points asked.
        found: usize,
        /// The limit.
        limit: usize,
    },
}
