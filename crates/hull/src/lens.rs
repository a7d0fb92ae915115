//! The lens: OpenCV's five-coefficient plumb-bob distortion, and back.
//!
//! Normalised coordinates are `(x / z, y / z)` in the camera frame. The radial polynomial folds back
//! beyond its first stationary radius; points out there are off the image whatever the formula says.

use nalgebra::{Matrix2, Vector2};

/// Distortion coefficients `k1 k2 p1 p2 k3`, and where they stop making sense.
#[derive(Clone, Debug, PartialEq)]
pub struct Lens {
    coefficients: [f64; 5],
    straight: bool,
    max_radius_squared: f64,
}

impl Lens {
    /// A lens from `k1 k2 p1 p2 k3`; the values must be finite.
    pub fn new(coefficients: [f64; 5]) -> Lens {
        let [k1, k2, _, _, k3] = coefficients;
        let straight = coefficients.iter().all(|&k| k == 0.0);
        Lens { coefficients, straight, max_radius_squared: first_stationary_radius_squared(k1, k2, k3) }
    }

    /// The coefficients `k1 k2 p1 p2 k3`.
    pub fn coefficients(&self) -> [f64; 5] {
        self.coefficients
    }

    /// True if the lens does nothing: lines stay lines in the image.
    pub fn is_straight(&self) -> bool {
        self.straight
    }

    /// Squared normalised radius of the first stationary point, or infinity.
    pub fn max_radius_squared(&self) -> f64 {
        self.max_radius_squared
    }

    /// Undistorted to distorted normalised coordinates; call only within [`Self::max_radius_squared`].
    #[inline]
    pub fn distort(&self, x: f64, y: f64) -> (f64, f64) {
        if self.straight { (x, y) } else { self.bend(x, y) }
    }

    #[inline(always)]
    fn bend(&self, x: f64, y: f64) -> (f64, f64) {
        let [k1, k2, p1, p2, k3] = self.coefficients;
        let r2 = x * x + y * y;
        let c = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
        let xy = x * y;
        (c * x + 2.0 * p1 * xy + p2 * (r2 + 2.0 * x * x), c * y + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * xy)
    }

    /// The derivative of [`Self::distort`] by `(x, y)`.
    #[inline(always)]
    pub fn jacobian(&self, x: f64, y: f64) -> Matrix2<f64> {
        let [k1, k2, p1, p2, k3] = self.coefficients;
        let r2 = x * x + y * y;
        let c = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
        // dc/dr²; dr²/dx = 2x.
        let dc = k1 + r2 * (2.0 * k2 + r2 * 3.0 * k3);
        let off = 2.0 * (x * y * dc + p1 * x + p2 * y);
        Matrix2::new(
            c + 2.0 * (x * x * dc + p1 * y + 3.0 * p2 * x),
            off,
            off,
            c + 2.0 * (y * y * dc + 3.0 * p1 * y + p2 * x),
        )
    }

    /// Distorted to undistorted normalised coordinates by Newton's method to 1e-12; `None` where no
    /// point within the first stationary radius is seen (corners of very wide lenses).
    #[inline(always)]
    pub fn undistort(&self, xd: f64, yd: f64) -> Option<(f64, f64)> {
        let [[x], [y]] = self.undistort_lanes([xd], [yd]);
        (!x.is_nan()).then_some((x, y))
    }

    /// The same for some places at once; not numbers where nothing is seen.
    #[inline(always)]
    pub(crate) fn undistort_lanes<const N: usize>(&self, xd: [f64; N], yd: [f64; N]) -> [[f64; N]; 2] {
        if self.straight {
            return [xd, yd];
        }
        let ([mut x, mut y], is_found) = self.unbend(&xd, &yd);
        for at in 0..N {
            if !is_found[at] {
                let target = Vector2::new(xd[at], yd[at]);
                (x[at], y[at]) = self.unbend_safely(&target).unwrap_or((f64::NAN, f64::NAN));
            }
        }
        [x, y]
    }

    /// Few steps from a quick start do for lenses as they are made; false where they do not, or may have led
    /// beyond the first stationary radius.
    #[inline(always)]
    fn unbend<const N: usize>(&self, xd: &[f64; N], yd: &[f64; N]) -> ([[f64; N]; 2], [bool; N]) {
        let [k1, k2, _, _, k3] = self.coefficients;
        let ([mut x, mut y], mut is_fair) = ([[0.0; N]; 2], [false; N]);
        for at in 0..N {
            let squared = xd[at] * xd[at] + yd[at] * yd[at];
            let mut scale = 1.0;
            for _ in 0..2 {
                let s = squared * scale * scale;
                scale = 1.0 / (1.0 + s * (k1 + s * (k2 + s * k3)));
            }
            is_fair[at] = (scale > 0.0) & (squared * scale * scale < 0.8 * self.max_radius_squared);
            (x[at], y[at]) = (xd[at] * scale, yd[at] * scale);
        }
        let mut is_found = [false; N];
        for _ in 0..5 {
            for at in 0..N {
                let (near, moved) = self.newton((xd[at], yd[at]), (x[at], y[at]));
                is_found[at] = near;
                (x[at], y[at]) = moved;
            }
            if is_found.iter().all(|&found| found) {
                break;
            }
        }
        for at in 0..N {
            let seen = x[at] * x[at] + y[at] * y[at] < 0.9 * self.max_radius_squared;
            is_found[at] &= is_fair[at] & seen;
        }
        ([x, y], is_found)
    }

    /// Whether a place's distorted coordinates are the target to 1e-12; if not, Newton's next place.
    #[inline(always)]
    fn newton(&self, (xd, yd): (f64, f64), (x, y): (f64, f64)) -> (bool, (f64, f64)) {
        let greater = |a: f64, b: f64| if a.abs() > b.abs() { a.abs() } else { b.abs() };
        let (bent_x, bent_y) = self.bend(x, y);
        let (miss_x, miss_y) = (xd - bent_x, yd - bent_y);
        let near = greater(miss_x, miss_y) <= 1e-12 * (1.0 + greater(xd, yd));
        // The inverse of a two by two matrix, written out.
        let j = self.jacobian(x, y);
        let (a, b, c, d) = (j[(0, 0)], j[(0, 1)], j[(1, 0)], j[(1, 1)]);
        let over = 1.0 / (a * d - b * c);
        let (next_x, next_y) = (x + (d * miss_x - b * miss_y) * over, y + (a * miss_y - c * miss_x) * over);
        (near, (if near { x } else { next_x }, if near { y } else { next_y }))
    }

    #[cold]
    fn unbend_safely(&self, target: &Vector2<f64>) -> Option<(f64, f64)> {
        let mut point = target * self.radial_scale(target.norm());
        for _ in 0..50 {
            let (x, y) = self.distort(point.x, point.y);
            let miss = target - Vector2::new(x, y);
            if miss.amax() <= 1e-12 * (1.0 + target.amax()) {
                let seen = point.norm_squared() < self.max_radius_squared;
                return seen.then_some((point.x, point.y));
            }
            let step = self.jacobian(point.x, point.y).try_inverse()? * miss;
            let limit = 0.5 * (0.1 + point.norm());
            let length = step.norm();
            if !length.is_finite() {
                return None;
            }
            point += if length > limit { step * (limit / length) } else { step };
        }
        None
    }

    /// Undistorted over distorted radius when the tangential part is left out: a safe start for Newton.
    fn radial_scale(&self, radius: f64) -> f64 {
        if radius == 0.0 {
            return 1.0;
        }
        let [k1, k2, _, _, k3] = self.coefficients;
        let bend = |r: f64| r * (1.0 + r * r * (k1 + r * r * (k2 + r * r * k3)));
        let (mut low, mut high) = (0.0, self.max_radius_squared.sqrt());
        if high.is_infinite() {
            high = radius.max(1.0);
            for _ in 0..60 {
                if bend(high) >= radius {
                    break;
                }
                high *= 2.0;
            }
        }
        if bend(high) <= radius {
            return high * 0.999 / radius;
        }
        for _ in 0..24 {
            let middle = 0.5 * (low + high);
            if bend(middle) < radius { low = middle } else { high = middle }
        }
        0.5 * (low + high) / radius
    }
}

/// The least positive root `s = r²` of `1 + 3 k1 s + 5 k2 s² + 7 k3 s³`, or infinity.
fn first_stationary_radius_squared(k1: f64, k2: f64, k3: f64) -> f64 {
    let slope = |s: f64| 1.0 + s * (3.0 * k1 + s * (5.0 * k2 + s * 7.0 * k3));
    // Between its turning points the cubic is monotone, so each piece holds at most one root.
    let (a, b, c) = (21.0 * k3, 10.0 * k2, 3.0 * k1);
    let mut turns = [f64::INFINITY; 2];
    if a != 0.0 {
        let discriminant = b * b - 4.0 * a * c;
        if discriminant >= 0.0 {
            let q = -0.5 * (b + discriminant.sqrt().copysign(b));
            turns = [q / a, if q == 0.0 { f64::INFINITY } else { c / q }];
        }
    } else if b != 0.0 {
        turns[0] = -c / b;
    }
    turns.sort_by(f64::total_cmp);
    let mut from: f64 = 0.0;
    for turn in turns.into_iter().filter(|&s| s.is_finite() && s > 0.0).chain([f64::INFINITY]) {
        let mut to = turn;
        if to.is_infinite() {
            to = from.max(1.0);
            while slope(to) > 0.0 && to < 1e12 {
                to *= 2.0;
            }
        }
        if slope(to) <= 0.0 {
            return bisect(from, to, slope);
        }
        from = to;
    }
    f64::INFINITY
}

fn bisect(mut low: f64, mut high: f64, value: impl Fn(f64) -> f64) -> f64 {
    for _ in 0..200 {
        let middle = 0.5 * (low + high);
        if middle <= low || middle >= high {
            break;
        }
        if value(middle) > 0.0 { low = middle } else { high = middle }
    }
    low
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_straight_lens_changes_nothing() {
        let lens = Lens::new([0.0; 5]);
        assert!(lens.is_straight());
        assert_eq!(lens.distort(0.3, -0.7), (0.3, -0.7));
        assert_eq!(lens.max_radius_squared(), f64::INFINITY);
    }

    #[test]
    fn barrel_distortion_folds_at_its_stationary_radius() {
        // 1 + 3 k1 s = 0 at s = 1 / 0.9.
        let lens = Lens::new([-0.3, 0.0, 0.0, 0.0, 0.0]);
        assert!((lens.max_radius_squared() - 1.0 / 0.9).abs() < 1e-12);
        let radius = lens.max_radius_squared().sqrt();
        let (edge, _) = lens.distort(radius, 0.0);
        assert!(lens.undistort(edge * 0.999, 0.0).is_some());
        assert_eq!(lens.undistort(edge * 1.001, 0.0), None, "nothing is seen beyond the fold");
    }

    /// Where the radial polynomial nearly turns, the tangential part can fold the plane within the stationary
    /// radius: behind such a fold a point is seen where a nearer one is.
    fn is_folded(lens: &Lens, x: f64, y: f64) -> bool {
        (0..=256).map(|at| f64::from(at) / 256.0).any(|at| lens.jacobian(at * x, at * y).determinant() < 1e-3)
    }

    #[test]
    fn of_two_points_that_a_fold_lays_on_each_other_the_nearer_is_seen() {
        let lens = Lens::new([-0.33352125, -0.05956008, 0.00261751, -0.00068838, 0.0527859]);
        let (x, y) = (1.1326067627627312, -0.2013555934062421);
        assert!(is_folded(&lens, x, y));
        let (xd, yd) = lens.distort(x, y);
        let (near_x, near_y) = lens.undistort(xd, yd).expect("seen");
        assert!(near_x * near_x + near_y * near_y < 0.95 * (x * x + y * y), "{near_x} {near_y}");
        assert!(!is_folded(&lens, near_x, near_y));
    }

    proptest! {
        #[test]
        fn undistorting_a_distorted_point_gives_it_back(
            k1 in -0.45..0.3f64, k2 in -0.3..0.4f64, k3 in -0.2..0.2f64,
            p1 in -0.003..0.003f64, p2 in -0.003..0.003f64,
            angle in 0.0..std::f64::consts::TAU, share in 0.0..0.97f64,
        ) {
            let lens = Lens::new([k1, k2, p1, p2, k3]);
            let radius = share * lens.max_radius_squared().sqrt().min(1.2);
            let (x, y) = (radius * libm::cos(angle), radius * libm::sin(angle));
            prop_assume!(!is_folded(&lens, x, y));
            let (xd, yd) = lens.distort(x, y);
            let (bx, by) = lens.undistort(xd, yd).expect("a distorted point has its origin");
            prop_assert!((bx - x).abs() < 1e-9 && (by - y).abs() < 1e-9, "{bx} {by} for {x} {y}");
        }

        #[test]
        fn the_jacobian_is_the_slope(x in -0.6..0.6f64, y in -0.6..0.6f64) {
            let lens = Lens::new([-0.2, 0.1, 0.002, -0.001, 0.01]);
            let h = 1e-6;
            let (a, b) = (lens.distort(x + h, y), lens.distort(x - h, y));
            let (c, d) = (lens.distort(x, y + h), lens.distort(x, y - h));
            let slope = Matrix2::new(a.0 - b.0, c.0 - d.0, a.1 - b.1, c.1 - d.1) / (2.0 * h);
            prop_assert!((slope - lens.jacobian(x, y)).amax() < 1e-8);
        }
    }
}
