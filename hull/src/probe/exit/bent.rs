//! The exit through a lens that bends lines: the ray's image is a curve, traced stride by stride.

use nalgebra::{Point2, Point3, Vector2, Vector3};

use crate::camera::Pixel;
use crate::probe::frame::Frame;
use crate::silhouette::BitMap;
use crate::view::View;

impl View {
    /// Traces the ray's image: moved on as far as nothing can be, or by about a
    /// pixel, and the crossing found by its pixel's edge. Steps do not depend on the limit: what is found
    /// is the same however early the search may end.
    #[inline(always)]
    pub(super) fn trace(
        &self,
        a: &Point3<f64>,
        n: &Vector3<f64>,
        limit_m: f64,
    ) -> Result<Option<f64>, Unseen> {
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
}

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
pub(super) struct Unseen;

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
