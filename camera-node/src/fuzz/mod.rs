//! What must hold of whatever bytes come from outside: one function a decoder, which panics where it does not.
//! Fuzz targets call them, and so do tests with the files that fuzzing has left (`tests/shared/corpora.rs`).

#[cfg(test)]
mod tests;

pub use crate::source::fuzz::{image, y4m};
