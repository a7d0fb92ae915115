//! Every change of class along a ray, in steps under a pixel and bisected: for cameras that can fall silent,
//! and for the rays that a lens loses.

use nalgebra::{Point3, Vector3};

use crate::camera::Pixel;
use crate::view::{Class, View};

/// How finely a change of class is located on a curve, metres.
const RESOLUTION_M: f64 = 1e-8;
/// The longest step where the ray is behind the camera or beyond its lens, metres.
const BLIND_STEP_M: f64 = 0.005;
/// From the greatest depth to the resolution.
const MAX_HALVINGS: usize = 48;

impl View {
    /// Follows the ray and reports each change of class (`t`, from, to) until `report` returns false. Steps do not
    /// depend on the limit: what is found is the same however early the search may end.
    pub(super) fn follow(
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
                // The distance to the image is unknown: no step may jump over it.
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

/// Pixels between two places, diagonals counting one; unseen places are next to everything.
fn stride_pixels(from: Option<Pixel>, to: Option<Pixel>) -> i64 {
    match (from, to) {
        (Some(a), Some(b)) => {
            let across = (i64::from(a.column) - i64::from(b.column)).abs();
            across.max((i64::from(a.row) - i64::from(b.row)).abs())
        }
        _ => 0,
    }
}
