//! Ranges of numbers.

use std::ops::RangeInclusive;

use world_encodings::recording::ConvertError;

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
