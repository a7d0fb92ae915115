//! Rotations as calibration files and poses write them, the same bits on every machine.

use nalgebra::{Matrix3, Vector3};

/// The rotation matrix of a Rodrigues vector (direction = axis, length = angle in radians).
pub fn matrix_from_rodrigues(vector_rad: &Vector3<f64>) -> Matrix3<f64> {
    let angle_rad = vector_rad.dot(vector_rad).sqrt();
    let cross = vector_rad.cross_matrix();
    if angle_rad < 1e-12 {
        return Matrix3::identity() + cross;
    }
    let (sine, cosine) = libm::sincos(angle_rad);
    let axis = cross / angle_rad;
    Matrix3::identity() + axis * sine + axis * axis * (1.0 - cosine)
}

/// The Rodrigues vector of a rotation matrix, radians; its length is at most pi.
pub fn rodrigues_from_matrix(rotation: &Matrix3<f64>) -> Vector3<f64> {
    let r = rotation;
    let twice_sine_axis = Vector3::new(r[(2, 1)] - r[(1, 2)], r[(0, 2)] - r[(2, 0)], r[(1, 0)] - r[(0, 1)]);
    let twice_sine = twice_sine_axis.norm();
    let twice_cosine = r.trace() - 1.0;
    let angle_rad = libm::atan2(twice_sine, twice_cosine);
    if twice_sine > 1e-6 {
        return twice_sine_axis * (angle_rad / twice_sine);
    }
    if twice_cosine > 0.0 {
        return twice_sine_axis * 0.5;
    }
    // Half a turn: the axis is the longest column of R + I.
    let sum = r + Matrix3::identity();
    let longest = (0..3).max_by(|&a, &b| sum.column(a).norm().total_cmp(&sum.column(b).norm())).unwrap_or(0);
    sum.column(longest).normalize() * angle_rad
}

/// How far a matrix is from a rotation: the largest entry of `R Rᵀ − I`, or 2 for a mirrored one.
pub fn rotation_defect(matrix: &Matrix3<f64>) -> f64 {
    if matrix.determinant() <= 0.0 {
        return 2.0;
    }
    (matrix * matrix.transpose() - Matrix3::identity()).amax()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rodrigues_goes_to_a_matrix_and_back() {
        for vector in [
            Vector3::new(0.3, -1.2, 0.7),
            Vector3::new(1e-14, 0.0, 0.0),
            Vector3::zeros(),
            Vector3::new(0.0, 3.1, 0.0),
            Vector3::new(std::f64::consts::PI, 0.0, 0.0),
        ] {
            let matrix = matrix_from_rodrigues(&vector);
            assert!(rotation_defect(&matrix) < 1e-12);
            let back = matrix_from_rodrigues(&rodrigues_from_matrix(&matrix));
            assert!((matrix - back).amax() < 1e-9, "{vector}");
        }
    }

    #[test]
    fn a_mirror_is_no_rotation() {
        assert!(rotation_defect(&Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, -1.0))) > 1.0);
    }
}
