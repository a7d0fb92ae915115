//! Where a ray from inside leaves the silhouette (paper §4.2, point c; spec §3.3).
//!
//! Without distortion the ray is a line in the image and is walked from pixel edge to pixel edge in
//! closed form. With distortion, or when the camera can fall silent, the curve is followed in steps
//! under a pixel and every change of class is bisected to 1e-8 m.

use nalgebra::{Point3, Vector3};

use crate::camera::Pixel;
use crate::question::{Change, NO_EXIT_M};
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
    pub fn first_outside(&self, a: &Point3<f64>, n: &Vector3<f64>, limit_m: f64) -> Option<f32> {
        if self.camera().lens().is_straight() {
            return self.walk(a, n, limit_m).map(|t| self.settled(a, n, t));
        }
        let mut found = None;
        self.follow(a, n, limit_m, &mut |t, _, to| {
            found = (to == Class::Outside).then_some(t);
            found.is_none()
        });
        found.map(|t| self.settled(a, n, t))
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

    /// Walks the straight image of the ray from pixel edge to pixel edge.
    fn walk(&self, a: &Point3<f64>, n: &Vector3<f64>, limit_m: f64) -> Option<f64> {
        let camera = self.camera();
        let start = camera.camera_from_world(a);
        let step = camera.camera_direction(n);
        let k = camera.intrinsics();
        let image = camera.image_from_camera(&start)?;
        let mut pixel = Pixel::holding(image.x, image.y);
        let row_of = |v: &Vector3<f64>| k[(1, 1)] * v.y + k[(1, 2)] * v.z;
        let column_of = |v: &Vector3<f64>| k[(0, 0)] * v.x + k[(0, 1)] * v.y + k[(0, 2)] * v.z;
        let behind = if step.z < 0.0 { -start.z / step.z } else { f64::INFINITY };
        let limit = limit_m.min(behind);
        let foreground = self.foreground().map();
        if limit < self.observer().settings().max_depth_m() {
            // Most cameras see nothing but foreground as far as the ray is wanted.
            let end = camera.image_from_camera(&(start + step * limit));
            let end = end.map(|image| Pixel::holding(image.x, image.y));
            if end.is_some_and(|end| foreground.all_ones(pixel, end)) {
                return None;
            }
        }
        let columns = Axis::new(column_of(&start), column_of(&step), start.z, step.z);
        let rows = Axis::new(row_of(&start), row_of(&step), start.z, step.z);
        let mut next_column = columns.crossing(pixel.column);
        let mut next_row = rows.crossing(pixel.row);
        loop {
            let crossed;
            if next_column.is_not_after(&next_row) {
                crossed = next_column;
                pixel.column += columns.direction;
                next_column = columns.crossing(pixel.column);
            } else {
                crossed = next_row;
                pixel.row += rows.direction;
                next_row = rows.crossing(pixel.row);
            }
            // Also true when neither axis moves any more.
            if crossed.over >= limit * crossed.under {
                return (behind <= limit_m).then_some(behind);
            }
            if !foreground.get(pixel) {
                return Some((crossed.over / crossed.under).max(0.0));
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
        let mut ends = vec![next];
        while let Some(end) = ends.pop() {
            if self.uniform(here, end) {
                here = end;
            } else if end.t - here.t <= RESOLUTION_M {
                if end.class != class {
                    return Some(end);
                }
                here = end;
            } else {
                let middle = at(0.5 * (here.t + end.t));
                ends.push(end);
                ends.push(middle);
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
    direction: i32,
}

impl Axis {
    fn new(q: f64, qn: f64, z: f64, zn: f64) -> Axis {
        let slope = qn * z - q * zn;
        let direction = if slope > 0.0 {
            1
        } else if slope < 0.0 {
            -1
        } else {
            0
        };
        Axis { q, qn, z, zn, direction }
    }

    /// Where the ray leaves pixel `index` of this axis.
    #[inline]
    fn crossing(&self, index: i32) -> Crossing {
        let direction = f64::from(self.direction);
        let edge = f64::from(index) + 0.5 * direction;
        let under = (self.qn - edge * self.zn) * direction;
        // Past the vanishing point the divisor's sign no longer is the direction's.
        if under > 0.0 {
            Crossing { over: (edge * self.z - self.q) * direction, under }
        } else {
            Crossing::NEVER
        }
    }
}

/// A crossing at `t = over / under`: divided only when it is wanted.
#[derive(Clone, Copy)]
struct Crossing {
    over: f64,
    under: f64,
}

impl Crossing {
    const NEVER: Crossing = Crossing { over: 1.0, under: 0.0 };

    #[inline]
    fn is_not_after(&self, other: &Crossing) -> bool {
        self.over * other.under <= other.over * self.under
    }
}
