//! Vectors, rotations and poses.

use std::ops::RangeInclusive;

use hull::Pose;

use super::ConvertError;
use crate::messages::{Colour3, Quaternion, Vector3};

/// Unix seconds of any run: up to the year 2286.
pub(crate) const UNIX_S: RangeInclusive<f64> = 0.0..=1e10;
/// No camera's segmentation takes longer, milliseconds.
pub(crate) const SEGMENT_MS: RangeInclusive<f64> = 0.0..=1e7;

/// A number within a range; what is no number is in none.
pub(crate) fn within(
    message: &'static str,
    field: &'static str,
    found: f64,
    allowed: RangeInclusive<f64>,
) -> Result<f64, ConvertError> {
    if allowed.contains(&found) {
        return Ok(found);
    }
    let (low, high) = allowed.into_inner();
    Err(ConvertError::new(message, format_args!("{field} is {found}, expected {low} to {high}")))
}

/// A vector.
pub(crate) fn vector([x, y, z]: [f64; 3]) -> Vector3 {
    Vector3 { x, y, z }
}

/// A rotation.
pub(crate) fn rotation([x, y, z, w]: [f64; 4]) -> Quaternion {
    Quaternion { x, y, z, w }
}

/// Three numbers, all of them finite.
pub(crate) fn finite(message: &'static str, found: &Vector3) -> Result<[f64; 3], ConvertError> {
    let numbers = [found.x, found.y, found.z];
    if numbers.iter().all(|number| number.is_finite()) {
        Ok(numbers)
    } else {
        Err(ConvertError::new(message, format_args!("found {numbers:?}, expected finite numbers")))
    }
}

/// The same of a field that must be there.
pub(crate) fn required(
    message: &'static str,
    field: &'static str,
    found: Option<&Vector3>,
) -> Result<[f64; 3], ConvertError> {
    finite(message, found.ok_or_else(|| ConvertError::missing(message, field))?)
}

/// A pose.
pub(crate) fn pose_from_message(
    message: &'static str,
    position_m: Option<&Vector3>,
    rotation: Option<&Quaternion>,
) -> Result<Pose, ConvertError> {
    let position_m = required(message, "position_m", position_m)?;
    let rotation = rotation.ok_or_else(|| ConvertError::missing(message, "rotation"))?;
    let Quaternion { x, y, z, w } = *rotation;
    Pose::new(position_m, [x, y, z, w]).map_err(|error| ConvertError::new(message, error))
}

/// A colour.
pub(crate) fn colour([red, green, blue]: [f32; 3]) -> Colour3 {
    Colour3 { red, green, blue }
}

/// A colour's numbers.
pub(crate) fn colour_from_message(found: Option<&Colour3>) -> [f32; 3] {
    found.map_or([0.5; 3], |colour| [colour.red, colour.green, colour.blue])
}
