//! Where a ray from inside leaves the silhouette (paper §4.2, point c; spec §3.3).
//!
//! Without distortion the ray is a line in the image and is walked from pixel edge to pixel edge in
//! closed form. With distortion, or when the camera can fall silent, the curve is followed in steps
//! under a pixel and every change of class is bisected to 1e-8 m.

use nalgebra::{Point2, Point3, Vector2, Vector3};

use crate::camera::{Pixel, floor};
use crate::probe::frame::Frame;
use crate::question::{Change, NO_EXIT_M};
use crate::silhouette::BitMap;
use crate::view::{Class, View};

/// How finely a change of class is located on a curve, metres.
const RESOLUTION_M: f64 = 1e-8;
/// The longest step where the ray is behind the camera or beyond its lens, metres.
const BLIND_STEP_M: f64 = 0.005;

/// The point `a + t n`; every machine must form it alike.
#[inline]
pub fn along(a_world: &Point3<f64>, n_world: &Vector3<f64>, t_m: f32) -> Point3<f64> {
    let t = f64::from(t_m);
    Point3::new(a_world.x + t * n_world.x, a_world.y + t * n_world.y, a_world.z + t * n_world.z)
}

impl View {
    /// The first `t` in `(0, limit_m]` at which this camera calls `a + t n` outside. `a` must be inside
    /// here, and the camera must always judge.
    #[inline(always)]
    pub fn first_outside(&self, a: &Point3<f64>, n: &Vector3<f64>, limit_m: f64) -> Option<f32> {
        let t = if self.camera().lens().is_straight() {
            self.walk(a, n, limit_m)
        } else {
            self.trace(a, n, limit_m).unwrap_or_else(|Unseen| {
                let mut found = None;
                self.follow(a, n, limit_m, &mut |t, _, to| {
                    found = (to == Class::Outside).then_some(t);
                    found.is_none()
                });
                found
            })
        };
        t.map(|t| self.settled(a, n, t))
    }

    /// All that this camera knows of the ray when cameras may be silent: the first outside, and in
    /// `changes` where the camera falls silent (−1) or sees again (+1) before it.
    pub fn exit_with_silence(
        &self,
        a: &Point3<f64>,
        n: &Vector3<f64>,
        limit_m: f64,
        point: u32,
        changes: &mut Vec<Change>,
    ) -> f32 {
        let mut outside_m = NO_EXIT_M;
        self.follow(a, n, limit_m, &mut |t, from, to| {
            let t_m = round_up(t);
            match (from, to) {
                (_, Class::Outside) => {
                    outside_m = t_m;
                    return false;
                }
                (Class::Inside, _) => changes.push(Change { point, t_m, by: -1 }),
                (_, Class::Inside) => changes.push(Change { point, t_m, by: 1 }),
                _ => {}
            }
            true
        });
        outside_m
    }

    /// `t` in single precision, not before the crossing: rounded up, and nudged until the point there
    /// is outside by the same arithmetic that classifies.
    fn settled(&self, a: &Point3<f64>, n: &Vector3<f64>, t: f64) -> f32 {
        let mut t = round_up(t);
        for _ in 0..4 {
            if self.classify(&along(a, n, t)) != Class::Inside {
                break;
            }
            t = t.next_up();
        }
        t
    }

    /// Walks the straight image of the ray from pixel edge to pixel edge, along the axis that it crosses
    /// more pixels of, and skips what lies deep inside.
    #[inline(always)]
    fn walk(&self, a: &Point3<f64>, n: &Vector3<f64>, limit_m: f64) -> Option<f64> {
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
        let foreground = self.foreground();
        let (map, depth) = (foreground.map(), foreground.depth());
        let pixel = |along: i32, beside: i32| {
            if ACROSS { Pixel { column: along, row: beside } } else { Pixel { column: beside, row: along } }
        };
        let (from, beside) = (major.q / major.z, minor.q / minor.z);
        let slope = minor.slope / major.slope;
        let first = floor(from + 0.5);
        let sign = if major.slope > 0.0 { 1 } else { -1 };
        let sign_f64 = f64::from(sign);
        // Where the ray enters pixel `step` of the major axis, on the minor.
        let entered = beside + slope * (f64::from(first) - 0.5 * sign_f64 - from) + 0.5;
        let entered_at = |step: i32| floor(entered + slope * sign_f64 * f64::from(step));
        let steps = major.steps_until(limit, first);
        let shrink = 1.0 - 0.2929 * slope.abs();
        let mut step = 0;
        let mut at = floor(beside + 0.5);
        while step <= steps {
            let here = pixel(first + sign * step, at);
            let clear = f64::from(depth.clear_pixels(here.column, here.row)) - 1.0 - 1e-6;
            let skipped = (clear * shrink) as i32;
            if skipped > 1 {
                step += skipped;
                at = entered_at(step);
                continue;
            }
            if step > 0 && !map.get(here) {
                return major.crossing(first + sign * (step - 1), sign, limit);
            }
            let next = entered_at(step + 1);
            while at != next {
                let down = if next > at { 1 } else { -1 };
                let left = at;
                at += down;
                if !map.get(pixel(first + sign * step, at)) {
                    return minor.crossing(left, down, limit);
                }
            }
            step += 1;
        }
        None
    }

    /// The same where the lens bends the ray's image: moved on as far as nothing can be, or by about a
    /// pixel, and the crossing found by its pixel's edge. Steps do not depend on the limit: what is found
    /// is the same however early the search may end.
    #[inline(always)]
    fn trace(&self, a: &Point3<f64>, n: &Vector3<f64>, limit_m: f64) -> Result<Option<f64>, Unseen> {
        let foreground = self.foreground();
        let (map, depth) = (foreground.map(), foreground.depth());
        let stretch = 1.000_001 * self.observer().stretch_pixels();
        let camera = self.camera();
        let (start, step) = (camera.camera_from_world(a), camera.camera_direction(n));
        let seen = |t: f64| Sighted::of(self, &(start + step * t), t).ok_or(Unseen);
        let mut here = seen(0.0)?;
        // How far an image point moves per metre, measured step by step.
        let mut pixels_per_m = stretch / here.camera.z;
        let bend = self.observer().bend_pixels();
        if limit_m < self.observer().settings().max_depth_m()
            && seen(limit_m)?.is_clear_from(&here, map, bend)
        {
            return Ok(None);
        }
        let mut ahead = Ahead::default();
        while here.t < limit_m {
            let clear = f64::from(depth.clear_pixels(here.pixel.column, here.pixel.row)) - HALF_DIAGONAL;
            let apart = clear / stretch;
            let free_m = here.camera.z * here.camera.z * apart / (here.camera.norm() + here.camera.z * apart);
            let stride_m = STRIDE_PIXELS / pixels_per_m;
            if free_m > STRIDES as f64 * stride_m {
                here = seen(here.t + free_m)?;
                continue;
            }
            ahead.look(self.frame(), a, n, here.t, stride_m);
            for at in 0..STRIDES {
                let mut there = ahead.sighted(at, &start, &step)?;
                let mut moved = (there.image - here.image).amax();
                let too_far = moved > 1.0;
                while moved > 1.0 {
                    let shorter = 0.5 * (there.t - here.t);
                    there = seen(here.t + shorter)?;
                    moved = (there.image - here.image).amax();
                }
                // A ray that hardly moves in the image gets longer strides, not boundless ones.
                pixels_per_m = (moved / (there.t - here.t)).max(0.25 * pixels_per_m);
                if let Some(t) = self.crossing(map, &here, &there, &seen) {
                    return Ok((t < limit_m).then_some(t));
                }
                here = there;
                if too_far || here.t >= limit_m {
                    break;
                }
            }
        }
        Ok(None)
    }

    /// The `t` at which the ray enters a background pixel between two places at most a pixel apart.
    #[inline(always)]
    fn crossing(
        &self,
        map: &BitMap,
        here: &Sighted,
        there: &Sighted,
        seen: &impl Fn(f64) -> Result<Sighted, Unseen>,
    ) -> Option<f64> {
        let (a, b) = (here.pixel, there.pixel);
        let (across, down) = (a.column != b.column, a.row != b.row);
        let by_column = Pixel { column: b.column, row: a.row };
        let by_row = Pixel { column: a.column, row: b.row };
        if map.get(b) && (!(across && down) || map.get(by_column) && map.get(by_row)) {
            return None;
        }
        let column_edge = 0.5 * (f64::from(a.column) + f64::from(b.column));
        let row_edge = 0.5 * (f64::from(a.row) + f64::from(b.row));
        let column_at = || root(here, there, seen, |sighted| sighted.image.x - column_edge);
        let row_at = || root(here, there, seen, |sighted| sighted.image.y - row_edge);
        match (across, down) {
            (true, false) => Some(column_at()),
            (false, true) => Some(row_at()),
            (false, false) => None,
            (true, true) => {
                let (column_at, row_at) = (column_at(), row_at());
                let first = if column_at <= row_at { by_column } else { by_row };
                let t = if map.get(first) { column_at.max(row_at) } else { column_at.min(row_at) };
                (!map.get(first) || !map.get(b)).then_some(t)
            }
        }
    }

    /// Follows the ray and reports each change of class (`t`, from, to) until told to stop. Steps do not
    /// depend on the limit: what is found is the same however early the search may end.
    fn follow(
        &self,
        a: &Point3<f64>,
        n: &Vector3<f64>,
        limit_m: f64,
        report: &mut dyn FnMut(f64, Class, Class) -> bool,
    ) {
        let at = |t: f64| {
            let point = Point3::new(a.x + t * n.x, a.y + t * n.y, a.z + t * n.z);
            let pixel = self.camera().project(&point).map(|image| Pixel::holding(image.x, image.y));
            Place { t, pixel, class: self.class_at(pixel) }
        };
        let mut here = at(0.0);
        let mut step = 0.001;
        let depth_m = self.observer().settings().max_depth_m();
        // An earlier exit, rounded up to single precision, may lie beyond the depth.
        let limit_m = limit_m.min(depth_m);
        while here.t < limit_m {
            if here.pixel.is_none() {
                // Nothing tells how far the image is: no step may jump over it.
                step = f64::min(step, BLIND_STEP_M);
            }
            let next = at((here.t + step).min(depth_m));
            let stride = stride_pixels(here.pixel, next.pixel);
            let allowed = self.pixels_off_image(here.pixel).max(1);
            if stride > allowed && next.t - here.t > RESOLUTION_M {
                step = 0.5 * (next.t - here.t);
                continue;
            }
            if stride == 0 {
                step *= 1.5;
            }
            if !self.uniform(here, next) {
                let Some(changed) = self.first_change(here, next, &at) else {
                    here = next;
                    continue;
                };
                if !report(changed.t, here.class, changed.class) {
                    return;
                }
                here = changed;
                continue;
            }
            here = next;
        }
    }

    /// Bisects for the first place after `here` of another class, if there is one before `next`.
    fn first_change(&self, mut here: Place, next: Place, at: &dyn Fn(f64) -> Place) -> Option<Place> {
        let class = here.class;
        // Each end halves the distance, and none is nearer than the resolution.
        let mut ends = [next; MAX_HALVINGS];
        let mut count = 1;
        while count > 0 {
            let end = ends[count - 1];
            if self.uniform(here, end) {
                here = end;
                count -= 1;
            } else if end.t - here.t <= RESOLUTION_M || count == MAX_HALVINGS {
                if end.class != class {
                    return Some(end);
                }
                here = end;
                count -= 1;
            } else {
                ends[count] = at(0.5 * (here.t + end.t));
                count += 1;
            }
        }
        None
    }

    /// True if all pixels between two places at most a pixel apart (or both off the image) have the
    /// class of the first.
    fn uniform(&self, from: Place, to: Place) -> bool {
        if from.class != to.class {
            return false;
        }
        let (Some(a), Some(b)) = (from.pixel, to.pixel) else { return from.pixel == to.pixel };
        let class = |column, row| self.class_at(Some(Pixel { column, row }));
        a.column == b.column
            || a.row == b.row
            || class(a.column, b.row) == from.class && class(b.column, a.row) == from.class
    }

    /// How many pixels a pixel is away from the image, zero on it.
    fn pixels_off_image(&self, pixel: Option<Pixel>) -> i64 {
        let Some(pixel) = pixel else { return 0 };
        let off = |at: i32, side: u32| {
            let (at, side) = (i64::from(at), i64::from(side));
            (-at).max(at - (side - 1)).max(0)
        };
        off(pixel.column, self.camera().width()).max(off(pixel.row, self.camera().height()))
    }
}

/// A place on a ray.
#[derive(Clone, Copy)]
struct Place {
    t: f64,
    pixel: Option<Pixel>,
    class: Class,
}

/// Pixels between two places, as a king walks; unseen places are next to everything.
fn stride_pixels(from: Option<Pixel>, to: Option<Pixel>) -> i64 {
    match (from, to) {
        (Some(a), Some(b)) => {
            let across = (i64::from(a.column) - i64::from(b.column)).abs();
            across.max((i64::from(a.row) - i64::from(b.row)).abs())
        }
        _ => 0,
    }
}

/// The least single-precision number that is not less.
fn round_up(t: f64) -> f32 {
    let near = t as f32;
    if f64::from(near) < t { near.next_up() } else { near }
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

/// From the greatest depth to the resolution.
const MAX_HALVINGS: usize = 48;
/// What a pixel's centre and any place in it are at most apart, twice, and a little: a clear distance counts
/// from a centre, and a place in a pixel beyond it may be near.
const HALF_DIAGONAL: f64 = 1.415;
/// How far a ray is moved on near the edge, pixels.
const STRIDE_PIXELS: f64 = 0.9;
/// So many strides are looked ahead at once.
const STRIDES: usize = 8;

/// The next strides of a ray: found together, because one by one each would wait for the one before.
#[derive(Default)]
struct Ahead {
    t: [f64; STRIDES],
    u: [f64; STRIDES],
    v: [f64; STRIDES],
}

impl Ahead {
    #[inline(always)]
    fn look(&mut self, frame: &Frame, a: &Point3<f64>, n: &Vector3<f64>, from: f64, stride_m: f64) {
        let (mut x, mut y, mut z) = ([0.0; STRIDES], [0.0; STRIDES], [0.0; STRIDES]);
        for at in 0..STRIDES {
            let t = from + (at + 1) as f64 * stride_m;
            self.t[at] = t;
            (x[at], y[at], z[at]) = (a.x + t * n.x, a.y + t * n.y, a.z + t * n.z);
        }
        frame.images(&x, &y, &z, &mut self.u, &mut self.v);
    }

    #[inline(always)]
    fn sighted(&self, at: usize, start: &Vector3<f64>, step: &Vector3<f64>) -> Result<Sighted, Unseen> {
        let (t, image) = (self.t[at], Point2::new(self.u[at], self.v[at]));
        if image.x.is_nan() {
            return Err(Unseen);
        }
        Ok(Sighted { t, camera: start + step * t, image, pixel: Pixel::holding(image.x, image.y) })
    }
}

/// The ray comes behind the camera or beyond its lens.
struct Unseen;

/// A place on a ray as a camera sees it.
#[derive(Clone, Copy)]
struct Sighted {
    t: f64,
    camera: Vector3<f64>,
    image: Point2<f64>,
    pixel: Pixel,
}

impl Sighted {
    #[inline(always)]
    fn of(view: &View, camera: &Vector3<f64>, t: f64) -> Option<Sighted> {
        let image = view.camera().image_from_camera(camera)?;
        Some(Sighted { t, camera: *camera, image, pixel: Pixel::holding(image.x, image.y) })
    }

    /// True if nothing but foreground is between two places: in the chord's rectangle, larger by as much as
    /// the ray's image may be away from its chord.
    #[inline(always)]
    fn is_clear_from(&self, from: &Sighted, map: &BitMap, bend_pixels: f64) -> bool {
        let (a, b) = (&from.camera, &self.camera);
        let across = Vector2::new(b.x / b.z - a.x / a.z, b.y / b.z - a.y / a.z);
        let bow = 0.1251 * bend_pixels * across.norm_squared() + 1e-9;
        let (a, b) = (&from.image, &self.image);
        let low = Pixel::holding(a.x.min(b.x) - bow, a.y.min(b.y) - bow);
        let high = Pixel::holding(a.x.max(b.x) + bow, a.y.max(b.y) + bow);
        map.all_ones(low, high)
    }
}

/// Where a smooth function of the ray is zero between two places on whose sides it differs.
#[inline(always)]
fn root(
    here: &Sighted,
    there: &Sighted,
    seen: &impl Fn(f64) -> Result<Sighted, Unseen>,
    value: impl Fn(&Sighted) -> f64,
) -> f64 {
    let (mut low, mut high) = ((here.t, value(here)), (there.t, value(there)));
    for _ in 0..ROOT_STEPS {
        let t = low.0 - low.1 * (high.0 - low.0) / (high.1 - low.1);
        let Ok(middle) = seen(t).map(|sighted| value(&sighted)) else { break };
        if middle == 0.0 || middle.abs() < ROOT_PIXELS {
            return t;
        }
        // The end that stays counts half, or the bracket would close from one side only.
        if (middle < 0.0) == (low.1 < 0.0) {
            low = (t, middle);
            high.1 *= 0.5;
        } else {
            high = (t, middle);
            low.1 *= 0.5;
        }
    }
    high.0
}

/// A crossing is as near to the pixel's edge as this, pixels.
const ROOT_PIXELS: f64 = 1e-9;
const ROOT_STEPS: usize = 40;
