//! Our types to messages.

use hull::Shape;
use hull::body::ShapeDigest;
use hull::silhouette::PixelRect;
use hull::{NormalWindow, OutOfView, ProbeSettings};

use super::bulk::pack_f32;
use super::{ConvertError, RefusalReason};
use crate::v1;

/// What a question names a registered shape by: the first eight bytes of its digest.
pub fn shape_key(digest: &ShapeDigest) -> u64 {
    let [a, b, c, d, e, f, g, h, ..] = *digest;
    u64::from_le_bytes([a, b, c, d, e, f, g, h])
}

/// A shape to register.
pub fn shape_to_wire(shape: &Shape) -> v1::Shape {
    v1::Shape {
        digest: shape.digest().to_vec().into(),
        samples: pack_f32(shape.samples_body().iter().flatten().copied()),
    }
}

/// A rectangle of pixels.
pub fn pixel_rect_to_wire(rect: PixelRect) -> v1::PixelRect {
    let PixelRect { left, top, right, bottom } = rect;
    v1::PixelRect { left, top, right, bottom }
}

/// The settings of the probes.
pub fn settings_to_wire(settings: &ProbeSettings) -> v1::ProbeSettings {
    v1::ProbeSettings {
        abstain: settings.rule().out_of_view == OutOfView::Abstain,
        min_views: settings.rule().min_views,
        normal_window: match settings.normal_window() {
            NormalWindow::Auto => 0,
            NormalWindow::Pixels(k) => k,
        },
        max_depth_m: settings.max_depth_m(),
    }
}

/// A question that is not answered, and why.
pub fn refusal(id: u64, reason: RefusalReason, message: impl Into<String>) -> v1::ProbeReply {
    use v1::refusal::Reason;
    let reason = match reason {
        RefusalReason::Gone => Reason::Gone,
        RefusalReason::NotYet => Reason::NotYet,
        RefusalReason::UnknownShape => Reason::UnknownShape,
        RefusalReason::TooManyPoints => Reason::TooManyPoints,
        RefusalReason::Malformed => Reason::Malformed,
        RefusalReason::Busy => Reason::Busy,
        RefusalReason::UnknownList => Reason::UnknownList,
        RefusalReason::Held => Reason::Held,
    };
    let refusal = v1::Refusal { reason: reason.into(), message: message.into() };
    v1::ProbeReply { id, answer: Some(v1::probe_reply::Answer::Refusal(refusal)), compute_ms: 0.0 }
}

impl From<&ConvertError> for RefusalReason {
    fn from(error: &ConvertError) -> RefusalReason {
        match error {
            ConvertError::UnknownShape(_) => RefusalReason::UnknownShape,
            ConvertError::UnknownList => RefusalReason::UnknownList,
            ConvertError::TooManyPoints { .. } => RefusalReason::TooManyPoints,
            ConvertError::Missing { .. } | ConvertError::Length { .. } | ConvertError::Value { .. } => {
                RefusalReason::Malformed
            }
        }
    }
}
