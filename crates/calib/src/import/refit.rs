//! One camera for a chain of two: a projection matrix with its own intrinsics, then a lens with others.
//!
//! MultiCamSelfCal's chain is X → P → pixels → K⁻¹ of the `.rad` → lens → K of the `.rad`. A camera has
//! one K; where the two differ, the camera that is nearest to the chain over the image is found by
//! Gauss–Newton (intrinsics, lens and a small turn about the same centre).

use hull::lens::Lens;
use hull::rotation::matrix_from_rodrigues;
use nalgebra::{Matrix3, Point2, SMatrix, SVector, Vector3};

/// What the file says: P's intrinsics, and the lens with its own.
#[derive(Clone, Debug)]
pub(super) struct Chain {
    pub(super) k_projection: Matrix3<f64>,
    pub(super) k_lens: Matrix3<f64>,
    pub(super) distortion: [f64; 5],
    pub(super) size: (u32, u32),
}

/// The nearest single camera.
#[derive(Clone, Debug)]
pub(super) struct Refit {
    pub(super) k: Matrix3<f64>,
    pub(super) distortion: [f64; 5],
    /// To be applied after the rotation of P.
    pub(super) turn: Matrix3<f64>,
    /// The largest distance to the chain over the image, pixels.
    pub(super) error_px: f64,
}

/// fx, skew, cx, fy, cy, k1, k2, p1, p2, k3, turn about x, y, z (radians).
const PARAMETERS: usize = 13;
type Parameters = SVector<f64, PARAMETERS>;

const GRID: u32 = 16;
const ROUNDS: usize = 15;

impl Chain {
    fn projected(&self, ray: &Point2<f64>) -> Point2<f64> {
        let pixel = self.k_projection * ray.to_homogeneous();
        let k = &self.k_lens;
        let y = (pixel.y - k[(1, 2)]) / k[(1, 1)];
        let x = (pixel.x - k[(0, 2)] - k[(0, 1)] * y) / k[(0, 0)];
        let (x, y) = Lens::new(self.distortion).distort(x, y);
        Point2::new(k[(0, 0)] * x + k[(0, 1)] * y + k[(0, 2)], k[(1, 1)] * y + k[(1, 2)])
    }

    /// Points of the image plane at depth 1 that cover the image: a grid of pixels, taken back.
    fn rays(&self) -> Vec<Point2<f64>> {
        let lens = Lens::new(self.distortion);
        let (k, p) = (&self.k_lens, &self.k_projection);
        let mut rays = Vec::new();
        for row in 0..=GRID {
            for column in 0..=GRID {
                let share = |side: u32, at: u32| f64::from(side - 1) * f64::from(at) / f64::from(GRID);
                let (u, v) = (share(self.size.0, column), share(self.size.1, row));
                let y = (v - k[(1, 2)]) / k[(1, 1)];
                let x = (u - k[(0, 2)] - k[(0, 1)] * y) / k[(0, 0)];
                let Some((x, y)) = lens.undistort(x, y) else { continue };
                let (u, v) = (k[(0, 0)] * x + k[(0, 1)] * y + k[(0, 2)], k[(1, 1)] * y + k[(1, 2)]);
                let y = (v - p[(1, 2)]) / p[(1, 1)];
                rays.push(Point2::new((u - p[(0, 2)] - p[(0, 1)] * y) / p[(0, 0)], y));
            }
        }
        rays
    }

    /// The nearest camera; exact (and no work) where both intrinsics agree or the lens does nothing.
    pub(super) fn refit(&self) -> Refit {
        if self.distortion == [0.0; 5] {
            let turn = Matrix3::identity();
            return Refit { k: self.k_projection, distortion: self.distortion, turn, error_px: 0.0 };
        }
        let rays = self.rays();
        let wanted: Vec<Point2<f64>> = rays.iter().map(|ray| self.projected(ray)).collect();
        let mut best = self.start();
        let mut best_cost = cost(&best, &rays, &wanted);
        for _ in 0..ROUNDS {
            let Some(step) = step(&best, &rays, &wanted) else { break };
            let next = best + step;
            let next_cost = cost(&next, &rays, &wanted);
            if next_cost >= best_cost {
                break;
            }
            (best, best_cost) = (next, next_cost);
        }
        let miss = |(ray, wanted): (&Point2<f64>, &Point2<f64>)| (image(&best, ray) - wanted).norm();
        let error_px = rays.iter().zip(&wanted).map(miss).fold(0.0, f64::max);
        Refit { k: k_of(&best), distortion: lens_of(&best), turn: turn_of(&best), error_px }
    }

    /// P's focal lengths with the lens's coefficients rescaled to them: right but for the centre.
    fn start(&self) -> Parameters {
        let (p, lens) = (&self.k_projection, &self.k_lens);
        let [k1, k2, p1, p2, k3] = self.distortion;
        let a = 0.5 * (p[(0, 0)] / lens[(0, 0)] + p[(1, 1)] / lens[(1, 1)]);
        let a2 = a * a;
        Parameters::from([
            p[(0, 0)],
            p[(0, 1)],
            p[(0, 2)],
            p[(1, 1)],
            p[(1, 2)],
            k1 * a2,
            k2 * a2 * a2,
            p1 * a,
            p2 * a,
            k3 * a2 * a2 * a2,
            0.0,
            0.0,
            0.0,
        ])
    }
}

fn k_of(p: &Parameters) -> Matrix3<f64> {
    Matrix3::new(p[0], p[1], p[2], 0.0, p[3], p[4], 0.0, 0.0, 1.0)
}

fn lens_of(p: &Parameters) -> [f64; 5] {
    [p[5], p[6], p[7], p[8], p[9]]
}

fn turn_of(p: &Parameters) -> Matrix3<f64> {
    matrix_from_rodrigues(&Vector3::new(p[10], p[11], p[12]))
}

fn image(p: &Parameters, ray: &Point2<f64>) -> Point2<f64> {
    let turned = turn_of(p) * ray.to_homogeneous();
    let (x, y) = Lens::new(lens_of(p)).distort(turned.x / turned.z, turned.y / turned.z);
    Point2::new(p[0] * x + p[1] * y + p[2], p[3] * y + p[4])
}

fn cost(p: &Parameters, rays: &[Point2<f64>], wanted: &[Point2<f64>]) -> f64 {
    rays.iter().zip(wanted).map(|(ray, wanted)| (image(p, ray) - wanted).norm_squared()).sum()
}

/// The Gauss–Newton step; `None` if the system is singular.
fn step(p: &Parameters, rays: &[Point2<f64>], wanted: &[Point2<f64>]) -> Option<Parameters> {
    let mut normal = SMatrix::<f64, PARAMETERS, PARAMETERS>::zeros();
    let mut right = Parameters::zeros();
    for (ray, wanted) in rays.iter().zip(wanted) {
        let here = image(p, ray);
        let mut rows = [Parameters::zeros(); 2];
        for k in 0..PARAMETERS {
            // Pixels change by about a thousandth for either kind of parameter.
            let nudge = if k < 5 { 1e-3 } else { 1e-6 };
            let mut moved = *p;
            moved[k] += nudge;
            let change = (image(&moved, ray) - here) / nudge;
            (rows[0][k], rows[1][k]) = (change.x, change.y);
        }
        let miss = wanted - here;
        for (row, miss) in rows.iter().zip([miss.x, miss.y]) {
            normal += row * row.transpose();
            right += row * miss;
        }
    }
    // Turn and principal point, or the lens's higher terms, are nearly interchangeable on some images.
    for k in 0..PARAMETERS {
        normal[(k, k)] *= 1.0 + 1e-9;
    }
    normal.cholesky().map(|solver| solver.solve(&right))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chain() -> Chain {
        let k = Matrix3::new(900.0, 0.0, 330.0, 0.0, 905.0, 236.0, 0.0, 0.0, 1.0);
        Chain { k_projection: k, k_lens: k, distortion: [-0.3, 0.12, 1e-3, -5e-4, 0.0], size: (640, 480) }
    }

    #[test]
    fn equal_intrinsics_are_kept_as_they_are() {
        let refit = chain().refit();
        assert!(refit.error_px < 1e-9 && (refit.k - chain().k_lens).amax() < 1e-9, "{refit:?}");
    }

    #[test]
    fn a_longer_lens_matrix_only_rescales_the_coefficients() {
        let mut chain = chain();
        chain.k_projection[(0, 0)] *= 1.1;
        chain.k_projection[(1, 1)] *= 1.1;
        let refit = chain.refit();
        assert!(refit.error_px < 1e-6, "{refit:?}");
        assert!((refit.distortion[0] + 0.3 * 1.21).abs() < 1e-6, "{refit:?}");
    }

    #[test]
    fn a_principal_point_that_moved_is_followed_to_part_of_a_pixel() {
        let mut chain = chain();
        chain.k_projection[(0, 2)] += 12.0;
        chain.k_projection[(1, 2)] -= 9.0;
        let refit = chain.refit();
        // Taking the lens as centred on P's principal point would miss by pixels.
        let naive = Chain { k_lens: chain.k_projection, ..chain.clone() };
        let far =
            chain.rays().iter().map(|r| (naive.projected(r) - chain.projected(r)).norm()).fold(0.0, f64::max);
        assert!(far > 2.0 && refit.error_px < 0.2, "{far} px without, {} px with", refit.error_px);
    }
}
