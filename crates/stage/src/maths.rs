//! Rotations and easing on `libm`, so that every platform gets the same bits.

use nalgebra::{Matrix3, Vector3};

/// Turns about +X: +Y towards +Z.
pub(crate) fn turn_x(angle_rad: f64) -> Matrix3<f64> {
    let (s, c) = libm::sincos(angle_rad);
    Matrix3::new(1.0, 0.0, 0.0, 0.0, c, -s, 0.0, s, c)
}

/// Turns about +Y: +Z towards +X.
pub(crate) fn turn_y(angle_rad: f64) -> Matrix3<f64> {
    let (s, c) = libm::sincos(angle_rad);
    Matrix3::new(c, 0.0, s, 0.0, 1.0, 0.0, -s, 0.0, c)
}

/// Turns about +Z: +X towards +Y.
pub(crate) fn turn_z(angle_rad: f64) -> Matrix3<f64> {
    let (s, c) = libm::sincos(angle_rad);
    Matrix3::new(c, -s, 0.0, s, c, 0.0, 0.0, 0.0, 1.0)
}

/// From 0 at `from_s` to 1 at `to_s` with least jerk; flat outside. Its steepest slope is
/// 1.875 / (to_s − from_s).
pub(crate) fn ease(time_s: f64, from_s: f64, to_s: f64) -> f64 {
    let u = ((time_s - from_s) / (to_s - from_s)).clamp(0.0, 1.0);
    u * u * u * (10.0 + u * (6.0 * u - 15.0))
}

/// Cubic step of a share in 0..=1.
pub(crate) fn smooth(share: f64) -> f64 {
    let u = share.clamp(0.0, 1.0);
    u * u * (3.0 - 2.0 * u)
}

/// The part of `hint` across the unit vector `axis`, normalised; some perpendicular if there is none.
pub(crate) fn across(axis: &Vector3<f64>, hint: &Vector3<f64>) -> Vector3<f64> {
    let part = hint - axis * axis.dot(hint);
    if part.norm_squared() > 1e-12 {
        return part.normalize();
    }
    let other = if axis.x.abs() < 0.7 { Vector3::x() } else { Vector3::z() };
    (other - axis * axis.dot(&other)).normalize()
}

/// Well-mixed bits of a number (the finaliser of splitmix64).
pub(crate) fn mixed(number: u64) -> u64 {
    let mut bits = number.wrapping_add(0x9e37_79b9_7f4a_7c15);
    bits = (bits ^ (bits >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    bits = (bits ^ (bits >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    bits ^ (bits >> 31)
}
