//! The viewing rays through edge pixels, eight at a time: how far they pass points, and the hull's normals
//! there. The same operations in the same order as those of [`Camera`], so the same bits.

use crate::camera::Camera;
use crate::probe::coefficients::CameraCoefficients;

/// Rays that are looked at together.
pub const LANES: usize = 8;

/// A number of each ray.
pub type Lanes = [f64; LANES];

/// The undistorted normalised coordinates of pixels; not numbers where the lens sees nothing.
#[inline(always)]
pub fn normalised(
    camera: &Camera,
    coefficients: &CameraCoefficients,
    column: &[i32; LANES],
    row: &[i32; LANES],
) -> [Lanes; 2] {
    let [fx, skew, cx, fy, cy] = coefficients.affine;
    let (mut x, mut y) = ([0.0; LANES], [0.0; LANES]);
    for at in 0..LANES {
        y[at] = (f64::from(row[at]) - cy) / fy;
        x[at] = (f64::from(column[at]) - cx - skew * y[at]) / fx;
    }
    camera.lens().undistort_lanes(x, y)
}

/// How far the rays through normalised coordinates pass points of the world, metres.
#[inline(always)]
pub fn distances(
    coefficients: &CameraCoefficients,
    [x, y, z]: &[Lanes; 3],
    [across, down]: &[Lanes; 2],
) -> [f32; LANES] {
    let [r0, r1, r2] = coefficients.rotation;
    let [tx, ty, tz] = coefficients.translation;
    let mut distances_m = [0.0; LANES];
    for at in 0..LANES {
        let xc = r0[0] * x[at] + r0[1] * y[at] + r0[2] * z[at] + tx;
        let yc = r1[0] * x[at] + r1[1] * y[at] + r1[2] * z[at] + ty;
        let zc = r2[0] * x[at] + r2[1] * y[at] + r2[2] * z[at] + tz;
        let length = (across[at] * across[at] + down[at] * down[at] + 1.0).sqrt();
        let (rx, ry, rz) = (across[at] / length, down[at] / length, 1.0 / length);
        let (cx, cy, cz) = (yc * rz - zc * ry, zc * rx - xc * rz, xc * ry - yc * rx);
        distances_m[at] = (cx * cx + cy * cy + cz * cz).sqrt() as f32;
    }
    distances_m
}

/// The hull's outward unit normals in the world at normalised coordinates, where the silhouette's are `m`;
/// not numbers where there are none. See [`Camera::hull_normal_world`].
#[inline(always)]
pub fn hull_normals(
    coefficients: &CameraCoefficients,
    [x, y]: &[Lanes; 2],
    [mx, my]: &[Lanes; 2],
) -> [[f32; 3]; LANES] {
    let [fx, skew, _, fy, _] = coefficients.affine;
    let [k1, k2, p1, p2, k3] = coefficients.lens;
    let [r0, r1, r2] = coefficients.rotation;
    let mut normals = [[0.0; 3]; LANES];
    for at in 0..LANES {
        let (x, y) = (x[at], y[at]);
        let radius = x * x + y * y;
        let c = 1.0 + radius * (k1 + radius * (k2 + radius * k3));
        let slope = k1 + radius * (2.0 * k2 + radius * 3.0 * k3);
        let off = 2.0 * (x * y * slope + p1 * x + p2 * y);
        let bent_x = c + 2.0 * (x * x * slope + p1 * y + 3.0 * p2 * x);
        let bent_y = c + 2.0 * (y * y * slope + 3.0 * p1 * y + p2 * x);
        // The image's derivative by normalised coordinates, then by those of the camera.
        let (j00, j01) = (fx * bent_x + skew * off, fx * off + skew * bent_y);
        let (j10, j11) = (fy * off, fy * bent_y);
        let (j02, j12) = (j00 * -x + j01 * -y, j10 * -x + j11 * -y);
        let gx = j00 * mx[at] + j10 * my[at];
        let gy = j01 * mx[at] + j11 * my[at];
        let gz = j02 * mx[at] + j12 * my[at];
        let world = |axis: usize| r0[axis] * gx + r1[axis] * gy + r2[axis] * gz;
        let (nx, ny, nz) = (world(0), world(1), world(2));
        let length = (nx * nx + ny * ny + nz * nz).sqrt();
        normals[at] = [(nx / length) as f32, (ny / length) as f32, (nz / length) as f32];
    }
    normals
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix3, Point3, Vector2, Vector3};
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn lanes_are_what_the_camera_says(
            lens in prop_oneof![Just([0.0; 5]), Just([-0.12, 0.03, 0.0005, -0.0007, 0.001])],
            skew in prop_oneof![Just(0.0), -3.0..3.0f64],
            turn in proptest::array::uniform3(-2.0..2.0f64),
            at in proptest::array::uniform3(-1.0..1.0f64),
            column in -20i32..660, row in -20i32..500, m in (-90i32..90, -90i32..90),
        ) {
            let intrinsics = Matrix3::new(521.3, skew, 320.4, 0.0, 518.9, 239.1, 0.0, 0.0, 1.0);
            let (turn, away) = (Vector3::from(turn), Vector3::new(0.1, -0.2, 3.0));
            let camera = Camera::new("a", (640, 480), intrinsics, lens, turn, away).expect("a camera");
            let coefficients = CameraCoefficients::of(&camera);
            let found = normalised(&camera, &coefficients, &[column; LANES], &[row; LANES]);
            let image = nalgebra::Point2::new(f64::from(column), f64::from(row));
            let expected = camera.normalised(&image).expect("seen");
            prop_assert_eq!([found[0][3], found[1][3]], [expected.x, expected.y]);
            let distance_m = distances(&coefficients, &at.map(|axis| [axis; LANES]), &found)[5];
            let ray = Vector3::new(expected.x, expected.y, 1.0).normalize();
            let point = camera.camera_from_world(&Point3::from(at));
            prop_assert_eq!(distance_m, point.cross(&ray).norm() as f32);
            let m = Vector2::new(f64::from(m.0), f64::from(m.1));
            let normal = hull_normals(&coefficients, &found, &[[m.x; LANES], [m.y; LANES]])[7];
            match camera.hull_normal_world(&expected, &m) {
                Some(n) => {
                    prop_assert_eq!(normal.map(f32::to_bits), [n.x, n.y, n.z].map(|n| (n as f32).to_bits()));
                }
                None => prop_assert!(normal[0].is_nan()),
            }
        }
    }
}
