//! Calibration: other programs' camera files to rigs, and how well a rig fits its silhouettes.

pub mod check;
pub mod file;
pub mod import;
pub mod sync;
