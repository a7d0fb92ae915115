//! The questions that one camera answers about points at one frame (paper §4, spec §3).

pub mod classify;
pub mod coefficients;
pub mod edge_line;
pub mod edge_normal;
pub mod edge_ray;
pub mod exit;
pub mod nearest_edge;
