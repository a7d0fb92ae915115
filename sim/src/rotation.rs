//! Quaternions of start poses, the same bits on every machine.

use nalgebra::{Quaternion, UnitQuaternion, Vector3};

/// The rotation about `axis` (of any length but zero) by an angle.
pub(crate) fn about(axis: Vector3<f64>, angle_rad: f64) -> UnitQuaternion<f64> {
    let (sine, cosine) = libm::sincos(0.5 * angle_rad);
    let v = axis * (sine / axis.norm());
    UnitQuaternion::new_normalize(Quaternion::new(cosine, v.x, v.y, v.z))
}

/// The rotation of a Rodrigues vector: direction is the axis, length the angle in degrees.
pub(crate) fn from_rodrigues_deg(vector_deg: [f64; 3]) -> UnitQuaternion<f64> {
    let vector = Vector3::from(vector_deg);
    let angle_deg = vector.norm();
    if angle_deg == 0.0 { UnitQuaternion::identity() } else { about(vector, angle_deg.to_radians()) }
}

/// The shortest rotation that takes body +Y to the unit vector `up`.
pub(crate) fn y_to(up: Vector3<f64>) -> UnitQuaternion<f64> {
    if up.y < -1.0 + 1e-12 {
        return UnitQuaternion::new_unchecked(Quaternion::new(0.0, 1.0, 0.0, 0.0));
    }
    let half = Vector3::new(up.x, up.y + 1.0, up.z);
    let axis = Vector3::y().cross(&half);
    UnitQuaternion::new_normalize(Quaternion::new(half.y, axis.x, axis.y, axis.z))
}

/// A rotation evenly spread over all, from three numbers in `0..1` (Shoemake's subgroup algorithm).
pub(crate) fn from_units([a, b, c]: [f64; 3]) -> UnitQuaternion<f64> {
    let (sine_b, cosine_b) = libm::sincos(core::f64::consts::TAU * b);
    let (sine_c, cosine_c) = libm::sincos(core::f64::consts::TAU * c);
    let (low, high) = ((1.0 - a).sqrt(), a.sqrt());
    UnitQuaternion::new_normalize(Quaternion::new(
        high * cosine_c,
        low * sine_b,
        low * cosine_b,
        high * sine_c,
    ))
}

/// Two unit vectors that stand on the unit vector `up` and on each other.
pub(crate) fn level_axes(up: Vector3<f64>) -> [Vector3<f64>; 2] {
    let start = if up.x.abs() < 0.9 { Vector3::x() } else { Vector3::y() };
    let first = (start - up * up.dot(&start)).normalize();
    [first, up.cross(&first)]
}

/// The angle between two vectors, degrees; well conditioned near 0 and 180.
pub(crate) fn angle_deg(a: Vector3<f64>, b: Vector3<f64>) -> f64 {
    libm::atan2(a.cross(&b).norm(), a.dot(&b)).to_degrees()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn body_y_is_turned_to_any_up() {
        for up in [Vector3::y(), -Vector3::y(), Vector3::z(), Vector3::new(0.6, 0.0, -0.8)] {
            assert!((y_to(up) * Vector3::y() - up).norm() < 1e-12, "{up}");
        }
    }

    #[test]
    fn a_rodrigues_vector_turns_by_its_length() {
        let turned = from_rodrigues_deg([0.0, 90.0, 0.0]) * Vector3::z();
        assert!((turned - Vector3::x()).norm() < 1e-12);
        assert_eq!(from_rodrigues_deg([0.0; 3]), UnitQuaternion::identity());
        assert!((angle_deg(Vector3::z(), turned) - 90.0).abs() < 1e-12);
    }

    #[test]
    fn level_axes_are_level() {
        for up in [Vector3::y(), Vector3::x(), Vector3::new(0.6, 0.0, -0.8)] {
            let [a, b] = level_axes(up);
            assert!(a.dot(&up).abs() + b.dot(&up).abs() + a.dot(&b).abs() < 1e-12);
            assert!((a.norm() - 1.0).abs() + (b.norm() - 1.0).abs() < 1e-12);
        }
    }

    #[test]
    fn spread_rotations_point_everywhere() {
        let mut seeded = crate::seeded::Seeded::new(3, "rotations");
        let mut sum = Vector3::zeros();
        for _ in 0..2000 {
            let units = [seeded.unit(), seeded.unit(), seeded.unit()];
            sum += from_units(units) * Vector3::new(0.0, 1.0, 0.0);
        }
        assert!(sum.norm() / 2000.0 < 0.05, "mean direction {sum}");
    }
}
