//! The exit through a lens that keeps lines straight: the ray's image is a line of pixels, in closed form.

use nalgebra::{Point3, Vector3};

use super::walk::{Crossing, Track};
use crate::camera::floor;
use crate::view::View;

impl View {
    /// Walks the straight image of the ray from pixel edge to pixel edge, along the axis that it crosses
    /// more pixels of, and skips what lies deep inside.
    #[inline(always)]
    pub(super) fn walk(&self, a: &Point3<f64>, n: &Vector3<f64>, limit_m: f64) -> Option<f64> {
        let camera = self.camera();
        let start = camera.camera_from_world(a);
        let step = camera.camera_direction(n);
        let k = camera.intrinsics();
        let column = |v: &Vector3<f64>| k[(0, 0)] * v.x + k[(0, 1)] * v.y + k[(0, 2)] * v.z;
        let row = |v: &Vector3<f64>| k[(1, 1)] * v.y + k[(1, 2)] * v.z;
        let columns = Axis::new(column(&start), column(&step), start.z, step.z);
        let rows = Axis::new(row(&start), row(&step), start.z, step.z);
        let behind = if step.z < 0.0 { -start.z / step.z } else { f64::INFINITY };
        let limit = limit_m.min(behind);
        let crossed = if columns.slope.abs() >= rows.slope.abs() {
            self.walk_along::<true>(&columns, &rows, limit)
        } else {
            self.walk_along::<false>(&rows, &columns, limit)
        };
        crossed.or((behind <= limit_m).then_some(behind))
    }

    /// The `t` of the first crossing into a background pixel, if it is before the limit. `major` is the
    /// columns' axis if `ACROSS`, else the rows'.
    #[inline(always)]
    fn walk_along<const ACROSS: bool>(&self, major: &Axis, minor: &Axis, limit: f64) -> Option<f64> {
        if major.slope == 0.0 {
            return None;
        }
        let (from, beside) = (major.q / major.z, minor.q / minor.z);
        let slope = minor.slope / major.slope;
        let first = floor(from + 0.5);
        let sign = if major.slope > 0.0 { 1 } else { -1 };
        let sign_f64 = f64::from(sign);
        // Where the ray enters pixel `step` of the major axis, on the minor.
        let entered = beside + slope * (f64::from(first) - 0.5 * sign_f64 - from) + 0.5;
        let entered_at = |step: i32| floor(entered + slope * sign_f64 * f64::from(step));
        let steps = major.steps_until(limit, first);
        let track = Track { first, sign, steps, shrink: 1.0 - 0.2929 * slope.abs() };
        match track.first_crossing::<ACROSS>(self.foreground(), floor(beside + 0.5), entered_at)? {
            Crossing::Along(left) => major.crossing(left, sign, limit),
            Crossing::Beside { left, down, .. } => minor.crossing(left, down, limit),
        }
    }
}

/// One image coordinate of the ray, `(q + qn t) / (z + zn t)`: monotone in `t`.
struct Axis {
    q: f64,
    qn: f64,
    z: f64,
    zn: f64,
    /// Its sign is that of the motion.
    slope: f64,
}

impl Axis {
    #[inline(always)]
    fn new(q: f64, qn: f64, z: f64, zn: f64) -> Axis {
        Axis { q, qn, z, zn, slope: qn * z - q * zn }
    }

    /// Where the ray leaves pixel `index` of this axis towards `direction`, if it does so before the limit.
    #[inline(always)]
    fn crossing(&self, index: i32, direction: i32, limit: f64) -> Option<f64> {
        let direction = f64::from(direction);
        let edge = f64::from(index) + 0.5 * direction;
        let under = (self.qn - edge * self.zn) * direction;
        let over = (edge * self.z - self.q) * direction;
        // Past the vanishing point the divisor's sign no longer is the direction's.
        (under > 0.0 && over < limit * under).then(|| (over / under).max(0.0))
    }

    /// How many pixels past the first the ray can enter before the limit; two more, for rounding.
    #[inline(always)]
    fn steps_until(&self, limit: f64, first: i32) -> i32 {
        let depth = self.z + limit * self.zn;
        if limit == f64::INFINITY || depth <= 0.0 {
            return i32::MAX / 4;
        }
        let end = floor((self.q + limit * self.qn) / depth + 0.5);
        (end - first).abs() + 2
    }
}
