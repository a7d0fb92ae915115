//! The studio's cameras.

use std::f64::consts::{PI, TAU};

use hull::{Camera, Rig, RigError};
use nalgebra::{Matrix3, Vector3};

use crate::maths::turn_y;

/// Cameras stand this far from [`AIM_M`], metres.
pub const RIG_RADIUS_M: f64 = 3.5;
/// What all cameras look at.
pub const AIM_M: [f64; 3] = [0.0, 0.95, 0.0];
/// Opening angle of the image's shorter side, radians (57°).
pub const FIELD_OF_VIEW_RAD: f64 = 57.0 / 180.0 * PI;

/// `camera_count` cameras, `cam_0` and on, of `size` pixels, evenly round a hemisphere about the person:
/// 0.9 to 2.6 m high (2.2 with eight), alike left and right, and with more than eight every fourth up to 3.4 m. `cam_0` sees the face. All that the
/// motions and props fill is in every camera's view, and so is 0.3 to 1.3 m of height within 1.5 m of the
/// origin. An error for no camera, or for a size that no camera has.
pub fn studio_rig(camera_count: usize, size: (u32, u32)) -> Result<Rig, RigError> {
    let cameras =
        (0..camera_count).map(|index| camera(index, camera_count, size)).collect::<Result<_, _>>()?;
    Rig::new(cameras)
}

fn camera(index: usize, camera_count: usize, size: (u32, u32)) -> Result<Camera, RigError> {
    // Left and right of the person are alike: cameras that look along a level face from unequal heights
    // would see the hull's roof over it slope to one side, and what rests there would slide off.
    let share = reversed(index.min(camera_count - 1 - index));
    let high = camera_count > 8 && index % 4 == 3;
    let height_m = if high { 2.7 + 0.7 * share } else { 0.9 + 1.7 * share };
    // Opposite cameras would draw the same outline: each is a little off its even place.
    let azimuth_rad = 0.35 + TAU * (index as f64 + 0.22 * (share - 0.5)) / camera_count as f64;
    let aim = Vector3::from(AIM_M);
    let up_m = height_m - aim.y;
    let out_m = (RIG_RADIUS_M * RIG_RADIUS_M - up_m * up_m).sqrt();
    let centre = turn_y(azimuth_rad) * Vector3::new(0.0, height_m, out_m);
    let forward = (aim - centre).normalize();
    let right = forward.cross(&Vector3::y()).normalize();
    let rotation =
        Matrix3::from_rows(&[right.transpose(), forward.cross(&right).transpose(), forward.transpose()]);
    let name = format!("cam_{index}");
    let (width, height) = (f64::from(size.0), f64::from(size.1));
    let focal = 0.5 * width.min(height) / libm::tan(0.5 * FIELD_OF_VIEW_RAD);
    let intrinsics =
        Matrix3::new(focal, 0.0, 0.5 * (width - 1.0), 0.0, focal, 0.5 * (height - 1.0), 0.0, 0.0, 1.0);
    Camera::from_matrices(name.clone(), size, intrinsics, [0.0; 5], &rotation, -(rotation * centre))
        .map_err(|error| RigError::Camera { section: name, error })
}

/// The index's bits behind the binary point, in reverse: spreads any number of cameras over 0..1.
fn reversed(index: usize) -> f64 {
    f64::from((index as u32).reverse_bits()) / 4_294_967_296.0
}
