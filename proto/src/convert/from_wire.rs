//! Messages to our types; nothing that arrives is trusted.

use hull::silhouette::PixelRect;
use hull::{HullRule, NormalWindow, OutOfView, ProbeSettings, Shape};

use super::bulk::{Field, unpack_f32x3};
use super::{ConvertError, RefusalReason};
use crate::v1;

/// A shape to register; its samples must have the digest it claims.
pub fn shape_from_wire(shape: &v1::Shape) -> Result<Shape, ConvertError> {
    let v1::Shape { digest, samples } = shape;
    let samples = unpack_f32x3(samples, Field("Shape", "samples"))?;
    let shape = Shape::new(samples).map_err(|error| Field("Shape", "samples").value(error.to_string()))?;
    if shape.digest()[..] != digest[..] {
        return Err(Field("Shape", "digest").value("is not that of the samples"));
    }
    Ok(shape)
}

/// A rectangle of pixels, not empty.
pub fn pixel_rect_from_wire(rect: &v1::PixelRect) -> Result<PixelRect, ConvertError> {
    let &v1::PixelRect { left, top, right, bottom } = rect;
    if left >= right || top >= bottom {
        let what = format!("is {left}..{right} x {top}..{bottom}, expected pixels");
        return Err(Field("CameraFrame", "admitted").value(what));
    }
    Ok(PixelRect { left, top, right, bottom })
}

/// The settings of the probes.
pub fn settings_from_wire(settings: &v1::ProbeSettings) -> Result<ProbeSettings, ConvertError> {
    let &v1::ProbeSettings { abstain, min_views, normal_window, max_depth_m } = settings;
    let out_of_view = if abstain { OutOfView::Abstain } else { OutOfView::Outside };
    let window = if normal_window == 0 { NormalWindow::Auto } else { NormalWindow::Pixels(normal_window) };
    ProbeSettings::new(HullRule { out_of_view, min_views }, window, max_depth_m)
        .map_err(|error| Field("DescribeReply", "settings").value(error.to_string()))
}

/// A reason that this version does not know is the message's fault.
pub(super) fn reason_from_wire(refusal: &v1::Refusal) -> RefusalReason {
    use v1::refusal::Reason;
    match refusal.reason() {
        Reason::Gone => RefusalReason::Gone,
        Reason::NotYet => RefusalReason::NotYet,
        Reason::UnknownShape => RefusalReason::UnknownShape,
        Reason::TooManyPoints => RefusalReason::TooManyPoints,
        Reason::Busy => RefusalReason::Busy,
        Reason::UnknownList => RefusalReason::UnknownList,
        Reason::Held => RefusalReason::Held,
        Reason::Malformed | Reason::Unspecified => RefusalReason::Malformed,
    }
}

/// Why a reply is no answer, if it is none.
pub fn refusal_of(reply: &v1::ProbeReply) -> Option<RefusalReason> {
    match &reply.answer {
        Some(v1::probe_reply::Answer::Refusal(refusal)) => Some(reason_from_wire(refusal)),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::super::to_wire::shape_to_wire;
    use super::*;

    #[test]
    fn a_shape_under_another_digest_is_refused() {
        let shape = Shape::new(vec![[0.5, 0.25, 0.0]]).expect("finite");
        let mut wire = shape_to_wire(&shape);
        assert_eq!(shape_from_wire(&wire), Ok(shape));
        wire.digest = vec![0; 32].into();
        let error = shape_from_wire(&wire).expect_err("another digest");
        assert_eq!(error.to_string(), "Shape.digest: is not that of the samples");
    }
}
