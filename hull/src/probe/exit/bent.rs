//! The exit through a lens that bends lines: the ray's image is a curve, walked span by span.

use nalgebra::{Point2, Point3, Vector3};

use super::span::Span;
use crate::camera::Pixel;
use crate::view::View;

impl View {
    /// Walks the ray's image: on as far as nothing can be, or by a span that is nearly a parabola. Spans do not
    /// depend on the limit: what is found is the same however early the search may end.
    #[inline(always)]
    pub(super) fn trace(
        &self,
        a: &Point3<f64>,
        n: &Vector3<f64>,
        limit_m: f64,
    ) -> Result<Option<f64>, Unseen> {
        let depth = self.foreground().depth();
        let bounds = self.observer().bounds();
        let per_pixel = 1.0 / (1.000_001 * bounds.stretch);
        let ray = Ray::new(self, a, n);
        let mut here = ray.seen(0.0)?;
        if limit_m < ray.most_m && ray.seen(limit_m).is_ok_and(|end| ray.is_clear_between(&here, &end)) {
            return Ok(None);
        }
        while here.t < limit_m {
            if here.camera.z < NEAREST_M {
                return Err(Unseen);
            }
            let clear = f64::from(depth.clear_pixels(here.pixel.column, here.pixel.row)) - HALF_DIAGONAL;
            let apart = clear * per_pixel;
            if apart >= bounds.span {
                let t = here.t + ray.travel_m(&here, apart);
                if t >= limit_m {
                    return Ok(None);
                }
                here = ray.seen(t)?;
                continue;
            }
            let span = Span::from(&ray, here, bounds)?;
            if let Some(t) = span.exit(self.foreground(), limit_m) {
                return Ok((t < limit_m).then_some(t));
            }
            here = span.end();
        }
        Ok(None)
    }
}

/// What a pixel's centre and any place in it are at most apart, twice, and a little: a clear distance counts
/// from a centre, and a place in a pixel beyond it may be near.
const HALF_DIAGONAL: f64 = 1.415;

/// Nearer to the camera spans no longer go on.
const NEAREST_M: f64 = 1e-6;

/// The ray comes behind the camera or beyond its lens.
pub(super) struct Unseen;

/// A ray in a camera's frame.
pub(super) struct Ray<'a> {
    pub view: &'a View,
    start: Vector3<f64>,
    step: Vector3<f64>,
    /// How fast it moves in normalised coordinates, times its squared depth: the same everywhere.
    drift: f64,
    most_m: f64,
}

impl<'a> Ray<'a> {
    #[inline(always)]
    pub fn new(view: &'a View, a: &Point3<f64>, n: &Vector3<f64>) -> Ray<'a> {
        let camera = view.camera();
        let (start, step) = (camera.camera_from_world(a), camera.camera_direction(n));
        let across = step.xy() * start.z - start.xy() * step.z;
        Ray { view, start, step, drift: across.norm(), most_m: view.observer().settings().max_depth_m() }
    }

    /// The place `t` metres from the start.
    #[inline(always)]
    pub fn seen(&self, t: f64) -> Result<Sighted, Unseen> {
        let at = self.start + self.step * t;
        let image = self.view.camera().image_from_camera(&at).ok_or(Unseen)?;
        Ok(Sighted { t, camera: at, image, pixel: Pixel::holding(image.x, image.y) })
    }

    /// True if nothing but foreground is between two places: in the chord's rectangle, larger by as much as
    /// the ray's image may be away from its chord.
    #[inline(always)]
    fn is_clear_between(&self, a: &Sighted, b: &Sighted) -> bool {
        let across = b.camera.xy() / b.camera.z - a.camera.xy() / a.camera.z;
        let bow = 0.1251 * self.view.observer().bend_pixels() * across.norm_squared() + 1e-9;
        let (low, high) = (a.image.inf(&b.image), a.image.sup(&b.image));
        let low = Pixel::holding(low.x - bow, low.y - bow);
        let high = Pixel::holding(high.x + bow, high.y + bow);
        self.view.foreground().map().all_ones(low, high)
    }

    /// How far the ray goes on until it is `apart` from there in normalised coordinates; not so far that
    /// the camera comes near.
    #[inline(always)]
    pub fn travel_m(&self, from: &Sighted, apart: f64) -> f64 {
        let (depth_m, nearing) = (from.camera.z, -self.step.z);
        let most_m = if nearing > 0.0 { self.most_m.min(0.5 * depth_m / nearing) } else { self.most_m };
        let (over, under) = (apart * depth_m * depth_m, self.drift + apart * depth_m * nearing);
        if over < most_m * under { over / under } else { most_m }
    }
}

/// A place on a ray as a camera sees it.
#[derive(Clone, Copy)]
pub(super) struct Sighted {
    pub t: f64,
    pub camera: Vector3<f64>,
    pub image: Point2<f64>,
    pub pixel: Pixel,
}
