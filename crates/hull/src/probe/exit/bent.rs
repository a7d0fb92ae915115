//! The exit through a lens that bends lines: the ray's image is a curve, walked span by span.

use nalgebra::{Point3, Vector3};

use super::ray::{OutOfSight, Ray};
use super::span::Span;
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
    ) -> Result<Option<f64>, OutOfSight> {
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
                return Err(OutOfSight);
            }
            let clear = f64::from(depth.clear_pixels(here.pixel.column, here.pixel.row)) - HALF_DIAGONAL;
            let apart = clear * per_pixel;
            if apart >= bounds.span {
                let t = here.t + ray.travel_m(&here, apart);
                if t >= limit_m {
                    // All between is foreground if the lens still sees the end: what it sees is convex.
                    return ray.seen(limit_m).map(|_| None);
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
