//! Values on the command line.

use thiserror::Error;

/// A value that an option does not take.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error("found {found:?}, expected {expected}")]
pub struct ArgumentError {
    found: String,
    expected: String,
}

impl ArgumentError {
    /// What was found and expected.
    pub fn new(found: &str, expected: impl Into<String>) -> ArgumentError {
        ArgumentError { found: found.to_owned(), expected: expected.into() }
    }
}

/// `WxH` in pixels.
pub fn parse_size(text: &str) -> Result<(u32, u32), ArgumentError> {
    let wrong = || ArgumentError::new(text, "WxH in pixels, like 640x480");
    let (width, height) = text.split_once('x').ok_or_else(wrong)?;
    Ok((width.parse().map_err(|_| wrong())?, height.parse().map_err(|_| wrong())?))
}
