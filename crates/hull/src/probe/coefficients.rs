//! A camera's coefficients in the order that the inner loops read them.

use crate::camera::{Camera, floor};

/// A camera's coefficients, flat.
#[derive(Clone, Copy, Debug)]
pub struct CameraCoefficients {
    pub(crate) rotation: [[f64; 3]; 3],
    pub(crate) translation: [f64; 3],
    /// fx, skew, cx, fy, cy.
    pub(crate) affine: [f64; 5],
    pub(crate) lens: [f64; 5],
    pub(crate) straight: bool,
    pub(crate) max_radius_squared: f64,
}

/// What is not on any image.
pub(crate) const OFF_IMAGE: i32 = i32::MIN;

impl CameraCoefficients {
    /// The coefficients of a camera.
    pub fn of(camera: &Camera) -> CameraCoefficients {
        let (r, t, k) = (camera.rotation(), camera.translation_m(), camera.intrinsics());
        CameraCoefficients {
            rotation: std::array::from_fn(|row| std::array::from_fn(|column| r[(row, column)])),
            translation: [t.x, t.y, t.z],
            affine: [k[(0, 0)], k[(0, 1)], k[(0, 2)], k[(1, 1)], k[(1, 2)]],
            lens: camera.lens().coefficients(),
            straight: camera.lens().is_straight(),
            max_radius_squared: camera.lens().max_radius_squared(),
        }
    }

    /// The pixels of many points, [`OFF_IMAGE`] for those that are behind the camera or beyond its lens.
    /// The same operations in the same order as [`crate::Camera::pixel`], so the same bits.
    #[inline(always)]
    pub fn pixels(&self, x: &[f64], y: &[f64], z: &[f64], column: &mut [i32], row: &mut [i32]) {
        let count = column.len();
        let (x, y, z, row) = (&x[..count], &y[..count], &z[..count], &mut row[..count]);
        if self.straight {
            for i in 0..count {
                (column[i], row[i]) = self.pixel::<true>(x[i], y[i], z[i]);
            }
        } else {
            for i in 0..count {
                (column[i], row[i]) = self.pixel::<false>(x[i], y[i], z[i]);
            }
        }
    }

    /// The depths of many points in the camera, and their distances from its centre, metres, roughly.
    #[inline(always)]
    pub fn ranges(&self, x: &[f64], y: &[f64], z: &[f64], depth_m: &mut [f32], range_m: &mut [f32]) {
        let count = depth_m.len();
        let (x, y, z, range_m) = (&x[..count], &y[..count], &z[..count], &mut range_m[..count]);
        let [r0, r1, r2] = self.rotation;
        let [tx, ty, tz] = self.translation;
        for i in 0..count {
            let xc = (r0[0] * x[i] + r0[1] * y[i] + r0[2] * z[i] + tx) as f32;
            let yc = (r1[0] * x[i] + r1[1] * y[i] + r1[2] * z[i] + ty) as f32;
            let zc = (r2[0] * x[i] + r2[1] * y[i] + r2[2] * z[i] + tz) as f32;
            depth_m[i] = zc;
            range_m[i] = (xc * xc + yc * yc + zc * zc).sqrt();
        }
    }

    /// The image coordinates of many points, not numbers for those that are behind the camera or beyond its
    /// lens.
    #[inline(always)]
    pub fn images(&self, x: &[f64], y: &[f64], z: &[f64], u: &mut [f64], v: &mut [f64]) {
        let count = u.len();
        let (x, y, z, v) = (&x[..count], &y[..count], &z[..count], &mut v[..count]);
        for i in 0..count {
            let (across, down, seen) = self.image::<false>(x[i], y[i], z[i]);
            u[i] = if seen { across } else { f64::NAN };
            v[i] = if seen { down } else { f64::NAN };
        }
    }

    #[inline(always)]
    fn pixel<const STRAIGHT: bool>(&self, x: f64, y: f64, z: f64) -> (i32, i32) {
        let (u, v, seen) = self.image::<STRAIGHT>(x, y, z);
        let (column, row) = (floor(u + 0.5), floor(v + 0.5));
        (if seen { column } else { OFF_IMAGE }, if seen { row } else { OFF_IMAGE })
    }

    #[inline(always)]
    fn image<const STRAIGHT: bool>(&self, x: f64, y: f64, z: f64) -> (f64, f64, bool) {
        let [r0, r1, r2] = self.rotation;
        let [tx, ty, tz] = self.translation;
        let xc = r0[0] * x + r0[1] * y + r0[2] * z + tx;
        let yc = r1[0] * x + r1[1] * y + r1[2] * z + ty;
        let zc = r2[0] * x + r2[1] * y + r2[2] * z + tz;
        let inverse_depth = 1.0 / zc;
        let (mut xn, mut yn) = (xc * inverse_depth, yc * inverse_depth);
        let mut seen = zc > 0.0;
        if !STRAIGHT {
            let [k1, k2, p1, p2, k3] = self.lens;
            let radius_squared = xn * xn + yn * yn;
            seen &= radius_squared < self.max_radius_squared;
            let c = 1.0 + radius_squared * (k1 + radius_squared * (k2 + radius_squared * k3));
            let xy = xn * yn;
            let bent = (
                c * xn + 2.0 * p1 * xy + p2 * (radius_squared + 2.0 * xn * xn),
                c * yn + p1 * (radius_squared + 2.0 * yn * yn) + 2.0 * p2 * xy,
            );
            (xn, yn) = bent;
        }
        let [fx, skew, cx, fy, cy] = self.affine;
        (fx * xn + skew * yn + cx, fy * yn + cy, seen)
    }
}
