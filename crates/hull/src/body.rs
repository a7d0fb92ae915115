//! Bodies as the hull sees them: a shape's samples in the body frame, and a pose.

use nalgebra::{Matrix3, Point3, Vector3};
use thiserror::Error;

/// The most samples one shape may have: bounds the memory that an untrusted peer can pin.
pub const MAX_SAMPLES: usize = 1 << 20;

/// The content hash of a shape.
pub type ShapeDigest = [u8; 32];

/// Why numbers make no shape or pose.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
pub enum BodyError {
    /// A coordinate is NaN or infinite.
    #[error("sample {index} holds {value}, expected finite metres")]
    Sample {
        /// Index of the sample.
        index: usize,
        /// The offending number.
        value: f32,
    },
    /// Too many samples, or none.
    #[error("shape of {found} samples, expected 1 to {MAX_SAMPLES}")]
    SampleCount {
        /// Number of samples.
        found: usize,
    },
    /// A pose that is none.
    #[error("pose holds {value}, expected finite numbers and a unit quaternion")]
    Pose {
        /// The offending number, or the quaternion's squared length.
        value: f64,
    },
}

/// Points on a body's surface in the body frame, metres (paper §5). Immutable; known by its digest.
#[derive(Clone, Debug, PartialEq)]
pub struct Shape {
    samples_body: Vec<[f32; 3]>,
    digest: ShapeDigest,
    radius_m: f64,
    bounds_body: ([f64; 3], [f64; 3]),
}

impl Shape {
    /// A shape of at least one finite sample; the order of samples is kept and is part of the digest.
    pub fn new(samples_body: Vec<[f32; 3]>) -> Result<Shape, BodyError> {
        if samples_body.is_empty() || samples_body.len() > MAX_SAMPLES {
            return Err(BodyError::SampleCount { found: samples_body.len() });
        }
        let mut hasher = blake3::Hasher::new();
        hasher.update(b"hulltouch shape 1");
        let mut radius_squared: f64 = 0.0;
        for (index, sample) in samples_body.iter().enumerate() {
            let mut squared = 0.0;
            for &value in sample {
                if !value.is_finite() {
                    return Err(BodyError::Sample { index, value });
                }
                hasher.update(&value.to_bits().to_le_bytes());
                squared += f64::from(value) * f64::from(value);
            }
            radius_squared = radius_squared.max(squared);
        }
        let digest = *hasher.finalize().as_bytes();
        let side = |pick: fn(f64, f64) -> f64| {
            let first = samples_body[0].map(f64::from);
            samples_body.iter().fold(first, |so_far, sample| {
                std::array::from_fn(|axis| pick(so_far[axis], f64::from(sample[axis])))
            })
        };
        let bounds_body = (side(f64::min), side(f64::max));
        Ok(Shape { samples_body, digest, radius_m: radius_squared.sqrt() * (1.0 + 1e-9), bounds_body })
    }

    /// No sample is farther than this from where it is at the other pose, metres: the least such bound of a box.
    pub fn moved_at_most_m(&self, from: &Pose, to: &Pose) -> f64 {
        let (low, high) = self.bounds_body;
        let turned = to.rotation() - from.rotation();
        let moved = Vector3::from(to.position_m()) - Vector3::from(from.position_m());
        let corner = |index: usize| {
            Vector3::from_fn(|axis, _| if index >> axis & 1 == 0 { low[axis] } else { high[axis] })
        };
        (0..8).map(|index| (turned * corner(index) + moved).norm()).fold(0.0, f64::max)
    }

    /// The samples, body frame, metres.
    pub fn samples_body(&self) -> &[[f32; 3]] {
        &self.samples_body
    }

    /// The content hash.
    pub fn digest(&self) -> ShapeDigest {
        self.digest
    }

    /// The least and the greatest corner of the box around the samples, body frame, metres.
    pub fn bounds_body(&self) -> ([f64; 3], [f64; 3]) {
        self.bounds_body
    }

    /// No sample is farther than this from the body's origin, metres.
    pub fn radius_m(&self) -> f64 {
        self.radius_m
    }
}

/// Where a body stands: world from body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    position_m: [f64; 3],
    rotation_xyzw: [f64; 4],
}

impl Pose {
    /// The body frame on the world frame.
    pub const IDENTITY: Pose = Pose { position_m: [0.0; 3], rotation_xyzw: [0.0, 0.0, 0.0, 1.0] };

    /// A pose from a position in metres and a quaternion `x y z w` that is of unit length within 1e-3.
    /// The numbers are kept as they are, so that every machine computes with the same bits.
    pub fn new(position_m: [f64; 3], rotation_xyzw: [f64; 4]) -> Result<Pose, BodyError> {
        if let Some(&value) = position_m.iter().chain(&rotation_xyzw).find(|value| !value.is_finite()) {
            return Err(BodyError::Pose { value });
        }
        let squared: f64 = rotation_xyzw.iter().map(|q| q * q).sum();
        if (squared - 1.0).abs() > 1e-3 {
            return Err(BodyError::Pose { value: squared });
        }
        Ok(Pose { position_m, rotation_xyzw })
    }

    /// The body frame's origin in the world, metres.
    pub fn position_m(&self) -> [f64; 3] {
        self.position_m
    }

    /// World-from-body rotation, a quaternion `x y z w`.
    pub fn rotation_xyzw(&self) -> [f64; 4] {
        self.rotation_xyzw
    }

    /// World-from-body rotation as a matrix: products and sums alone.
    pub fn rotation(&self) -> Matrix3<f64> {
        let [x, y, z, w] = self.rotation_xyzw;
        Matrix3::new(
            1.0 - 2.0 * (y * y + z * z),
            2.0 * (x * y - z * w),
            2.0 * (x * z + y * w),
            2.0 * (x * y + z * w),
            1.0 - 2.0 * (x * x + z * z),
            2.0 * (y * z - x * w),
            2.0 * (x * z - y * w),
            2.0 * (y * z + x * w),
            1.0 - 2.0 * (x * x + y * y),
        )
    }

    /// The same pose moved by `offset_m` in the world, metres.
    pub fn moved(&self, offset_m: [f64; 3]) -> Pose {
        let position_m = std::array::from_fn(|axis| self.position_m[axis] + offset_m[axis]);
        Pose { position_m, rotation_xyzw: self.rotation_xyzw }
    }

    /// The map from body to world for many points.
    pub fn world_from_body(&self) -> impl Fn([f32; 3]) -> Point3<f64> + use<> {
        let (r, t) = (self.rotation(), self.position_m);
        move |body| {
            let [x, y, z] = body.map(f64::from);
            Point3::new(
                r[(0, 0)] * x + r[(0, 1)] * y + r[(0, 2)] * z + t[0],
                r[(1, 0)] * x + r[(1, 1)] * y + r[(1, 2)] * z + t[1],
                r[(2, 0)] * x + r[(2, 1)] * y + r[(2, 2)] * z + t[2],
            )
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_quarter_turn_about_y_takes_z_to_x() {
        let half = std::f64::consts::FRAC_1_SQRT_2;
        let pose = Pose::new([1.0, 2.0, 3.0], [0.0, half, 0.0, half]).expect("unit");
        let world = pose.world_from_body()([0.0, 0.0, 1.0]);
        assert!((world - Point3::new(2.0, 2.0, 3.0)).amax() < 1e-12);
    }

    #[test]
    fn numbers_that_are_none_are_refused() {
        assert!(Shape::new(vec![]).is_err());
        assert!(matches!(Shape::new(vec![[0.0, f32::NAN, 0.0]]), Err(BodyError::Sample { index: 0, .. })));
        assert!(Pose::new([0.0, f64::INFINITY, 0.0], [0.0, 0.0, 0.0, 1.0]).is_err());
        assert!(Pose::new([0.0; 3], [0.0, 0.0, 0.0, 1.1]).is_err());
    }

    #[test]
    fn the_digest_knows_order_and_bits() {
        let digest = |samples: &[[f32; 3]]| Shape::new(samples.to_vec()).expect("finite").digest();
        let (a, b) = ([0.1, 0.2, 0.3], [0.3, 0.2, 0.1]);
        assert_eq!(digest(&[a, b]), digest(&[a, b]));
        assert_ne!(digest(&[a, b]), digest(&[b, a]));
    }
}
