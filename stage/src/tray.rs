//! The tray that is carried: its size, where it stands, and where it is.

use nalgebra::{Matrix3, Vector3};

use crate::lifted_box::TABLE_HEIGHT_M;
use crate::solid::{Material, Solid};

/// The tray's board: across (x), thick (y), deep (z), metres.
pub const TRAY_SIZE_M: [f64; 3] = [0.56, 0.02, 0.34];
/// The middle of the board while the tray stands on the table.
pub const TRAY_REST_M: [f64; 3] = [0.0, TABLE_HEIGHT_M + FOOT_M + 0.5 * TRAY_SIZE_M[1], 0.46];
/// How far the board stands above the table, on two feet as wide as this, at this place of either side.
const FOOT_M: f64 = 0.14;
const FOOT_WIDTH_M: f64 = 0.02;
const FOOT_X_M: f64 = 0.15;
const FOOT_DEPTH_M: f64 = 0.24;

/// The tray's solids when the middle of its board is there, world, metres.
pub(crate) fn tray(middle: Vector3<f64>, solids: &mut Vec<Solid>) {
    let half = Vector3::from(TRAY_SIZE_M) * 0.5;
    let mut push = |centre: Vector3<f64>, half: Vector3<f64>| {
        solids.push(Solid::cuboid(centre, Matrix3::identity(), half, Material::Wood));
    };
    push(middle, half);
    for side in [1.0, -1.0] {
        let below = Vector3::new(side * FOOT_X_M, -half.y - 0.5 * FOOT_M, 0.0);
        push(middle + below, Vector3::new(FOOT_WIDTH_M, FOOT_M, FOOT_DEPTH_M) * 0.5);
    }
}
