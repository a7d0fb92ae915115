//! Vectors, rotations and poses of a recording.

use hull::Pose;
use proto::recording::{Colour3, Quaternion, Vector3};
use thiserror::Error;

/// A message of a recording with an impossible value.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error("{message}: {problem}")]
pub struct ConvertError {
    /// Name of the message type.
    pub message: &'static str,
    /// What was found and expected.
    pub problem: String,
}

impl ConvertError {
    /// What is wrong with a message.
    pub fn new(message: &'static str, problem: impl std::fmt::Display) -> ConvertError {
        ConvertError { message, problem: problem.to_string() }
    }

    /// A field that must be there is not.
    pub fn missing(message: &'static str, field: &'static str) -> ConvertError {
        ConvertError::new(message, format_args!("{field} is missing"))
    }
}

/// Numbers as a vector.
pub fn vector([x, y, z]: [f64; 3]) -> Vector3 {
    Vector3 { x, y, z }
}

/// A quaternion.
pub fn rotation([x, y, z, w]: [f64; 4]) -> Quaternion {
    Quaternion { x, y, z, w }
}

/// Three numbers, all of them finite.
pub fn finite(message: &'static str, found: &Vector3) -> Result<[f64; 3], ConvertError> {
    let numbers = [found.x, found.y, found.z];
    if numbers.iter().all(|number| number.is_finite()) {
        Ok(numbers)
    } else {
        Err(ConvertError::new(message, format_args!("found {numbers:?}, expected finite numbers")))
    }
}

/// The same of a field that must be there.
pub fn required(
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
pub fn colour([red, green, blue]: [f32; 3]) -> Colour3 {
    Colour3 { red, green, blue }
}

/// A colour's numbers; grey without one.
pub(crate) fn colour_from_message(found: Option<&Colour3>) -> [f32; 3] {
    found.map_or([0.5; 3], |colour| [colour.red, colour.green, colour.blue])
}
