//! The tray that is carried: its size, where it is held first, and where it is.

use nalgebra::{Matrix3, Vector3};

use crate::solid::{Material, Solid};

/// The tray's board: across (x), thick (y), deep (z), metres.
pub const TRAY_SIZE_M: [f64; 3] = [0.56, 0.02, 0.34];
/// The middle of the board before it is raised: over the head, where no camera sees the person behind what stands on it.
pub const TRAY_REST_M: [f64; 3] = [0.0, 1.78, 0.30];

/// The tray's solids when the middle of its board is there, world, metres.
pub(crate) fn tray(middle: Vector3<f64>, solids: &mut Vec<Solid>) {
    let half = Vector3::from(TRAY_SIZE_M) * 0.5;
    solids.push(Solid::cuboid(middle, Matrix3::identity(), half, Material::Wood));
}
