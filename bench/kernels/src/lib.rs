//! The hull's kernels on a drawn person: the same work for criterion, which times it, and for callgrind,
//! which counts its instructions.

mod drawing;
mod kernels;

pub use drawing::Studio;
pub use kernels::{KERNELS, Kernels};
