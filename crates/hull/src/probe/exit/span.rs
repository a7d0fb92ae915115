//! A piece of a ray whose bent image is so nearly a parabola that its pixels are known.

use nalgebra::Vector2;

use super::parabola::Parabola;
use super::ray::{OutOfSight, Ray, RayPoint};
use super::walk::{Crossing, Track};
use crate::camera::{Camera, floor};
use crate::silhouette::Index;
use crate::view::Bounds;

/// A piece of a ray, from 0 to 1 in normalised coordinates.
pub(super) struct Span<'a> {
    camera: &'a Camera,
    here: RayPoint,
    there: RayPoint,
    /// Normalised: where it begins, and how far it goes.
    from: Vector2<f64>,
    across: Vector2<f64>,
    /// Bounds on its second and third derivative, pixels.
    bend: f64,
    twist: f64,
}

/// A span bends at most so much of its length along the axis that it is walked along.
const MOST_BEND: f64 = 0.1;
/// A span that bends more, or goes beyond the lens, is halved so often before it is given up.
const HALVINGS: usize = 10;
/// A crossing is as near to the pixel's edge as this, pixels.
const ROOT_PIXELS: f64 = 1e-9;
const ROOT_STEPS: usize = 60;

impl<'a> Span<'a> {
    /// The span that begins at a place.
    #[inline(always)]
    pub fn from(ray: &Ray<'a>, here: RayPoint, bounds: &Bounds) -> Result<Span<'a>, OutOfSight> {
        let mut length_m = ray.travel_m(&here, bounds.span);
        let from = here.camera.xy() / here.camera.z;
        for _ in 0..HALVINGS {
            let seen = ray.seen(here.t + length_m);
            length_m *= 0.5;
            let Ok(there) = seen else { continue };
            let across = there.camera.xy() / there.camera.z - from;
            let squared = across.norm_squared();
            let (bend, twist) = (bounds.bend * squared, bounds.twist * squared * squared.sqrt());
            if bend <= MOST_BEND * (there.image - here.image).amax() {
                return Ok(Span { camera: ray.view.camera(), here, there, from, across, bend, twist });
            }
        }
        Err(OutOfSight)
    }

    /// Where it ends.
    #[inline(always)]
    pub fn end(&self) -> RayPoint {
        self.there
    }

    /// The `t` at which the ray enters a background pixel; it may be beyond the limit.
    #[inline(always)]
    pub fn exit(&self, foreground: &Index, limit_m: f64) -> Option<f64> {
        let length = self.there.image - self.here.image;
        if length.x.abs() >= length.y.abs() {
            self.exit_along::<true>(foreground, limit_m)
        } else {
            self.exit_along::<false>(foreground, limit_m)
        }
    }

    #[inline(always)]
    fn exit_along<const ACROSS: bool>(&self, foreground: &Index, limit_m: f64) -> Option<f64> {
        let (major, minor) = if ACROSS { (0, 1) } else { (1, 0) };
        let (here, there) = (&self.here, &self.there);
        let pixel = |of: &RayPoint| {
            if ACROSS { [of.pixel.column, of.pixel.row] } else { [of.pixel.row, of.pixel.column] }
        };
        let ([first, start], [last, end]) = (pixel(here), pixel(there));
        let parabola = self.parabola(major, minor);
        if parabola.length == 0.0 {
            return None;
        }
        let sign = if parabola.length > 0.0 { 1 } else { -1 };
        let edge_of = |step: i32| f64::from(first) + f64::from(sign) * (f64::from(step) - 0.5);
        let last = (last - first).abs();
        let limit = self.share(limit_m);
        let steps = last.min(parabola.steps_until(limit));
        let entered = |step: i32| {
            if step > last {
                return end;
            }
            let edge = edge_of(step);
            let beside = parabola.beside(edge - parabola.from) + 0.5;
            let (low, high) = (floor(beside - parabola.error), floor(beside + parabola.error));
            if low == high {
                return low;
            }
            self.entered(major, edge, sign, parabola.share(edge - parabola.from))
        };
        let track = Track { first, sign, steps, shrink: parabola.shrink(self.bend) };
        let crossing = track.first_crossing::<ACROSS>(foreground, start, entered)?;
        // A share along the parabola is off by less than a tenth of a pixel.
        let slack = 0.1 / parabola.length.abs();
        let (axis, edge, sign, guess, range) = match crossing {
            Crossing::Along(left) => {
                let edge = f64::from(left) + 0.5 * f64::from(sign);
                let guess = parabola.share(edge - parabola.from);
                // Along the major axis the image only goes one way.
                (major, edge, sign, guess, (0.0, 1.0))
            }
            Crossing::Beside { step, left, down } => {
                let edge = f64::from(left) + 0.5 * f64::from(down);
                let low = if step == 0 { 0.0 } else { edge_of(step) - parabola.from };
                let high = if step >= last { parabola.length } else { edge_of(step + 1) - parabola.from };
                let (a, b) = (parabola.beside(low), parabola.beside(high));
                let guess = low + (high - low) * ((edge - a) / (b - a));
                let range = (parabola.share(low) - slack, parabola.share(high) + slack);
                (minor, edge, down, parabola.share(guess), range)
            }
        };
        // Between two steps the guess is coarse, and all after the first of them may be meant.
        let least = if axis == major { guess - slack } else { range.0 };
        (least <= limit).then(|| self.t(self.root(axis, edge, sign, guess, range)))
    }

    /// The pixel of the other axis in which the image crosses an edge, where the parabola leaves that in doubt.
    #[cold]
    #[inline(never)]
    fn entered(&self, major: usize, edge: f64, sign: i32, guess: f64) -> i32 {
        let share = self.root(major, edge, sign, guess, (0.0, 1.0));
        floor(self.image(share).0[1 - major] + 0.5)
    }

    /// Where the image crosses an edge of an axis, upwards if `sign` is one: Newton's steps from a guess,
    /// kept in a range.
    #[inline(always)]
    fn root(&self, axis: usize, edge: f64, sign: i32, guess: f64, (mut low, mut high): (f64, f64)) -> f64 {
        let mut share = guess;
        for _ in 0..ROOT_STEPS {
            if !(share >= low && share <= high) {
                share = 0.5 * (low + high);
            }
            let (image, slope) = self.image(share);
            let miss = edge - image[axis];
            if (miss > 0.0) == (sign > 0) {
                low = share;
            } else {
                high = share;
            }
            let step = miss / slope[axis];
            share += step;
            // The step takes the slope as the same all the way.
            if self.bend * step * step <= ROOT_PIXELS {
                break;
            }
        }
        if share < low {
            low
        } else if share < high {
            share
        } else {
            high
        }
    }

    #[inline(always)]
    fn parabola(&self, major: usize, minor: usize) -> Parabola {
        let middle = self.image(0.5).0;
        let [here, middle, there] = [self.here.image.coords, middle, self.there.image.coords];
        let place = |at: Vector2<f64>| (at[major], at[minor]);
        Parabola::through([place(here), place(middle), place(there)], self.bend, self.twist)
    }

    /// The image and its slope at a place.
    #[inline(always)]
    fn image(&self, share: f64) -> (Vector2<f64>, Vector2<f64>) {
        self.camera.image_along(&(self.from + self.across * share), &self.across)
    }

    /// The place of that `t`.
    #[inline(always)]
    fn share(&self, t: f64) -> f64 {
        let (before, after) = (t - self.here.t, self.there.t - t);
        let (before, after) = (before * self.there.camera.z, after * self.here.camera.z);
        if after > 0.0 { before / (before + after) } else { 1.0 }
    }

    /// The `t` of that place.
    #[inline(always)]
    fn t(&self, share: f64) -> f64 {
        let (here, there) = (share * self.here.camera.z, (1.0 - share) * self.there.camera.z);
        self.here.t + (self.there.t - self.here.t) * (here / (here + there))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::tests::plain_camera;
    use crate::silhouette::tests::random_mask;
    use crate::view::{Class, View};
    use crate::{Observer, ProbeSettings, Silhouette};
    use nalgebra::{Point3, Vector3};
    use proptest::prelude::*;
    use std::sync::Arc;

    fn view(distortion: [f64; 5], mask: &[u8]) -> View {
        let silhouette = Silhouette::from_mask(640, 480, mask).expect("size");
        let observer = Observer::new(plain_camera(distortion), 0, ProbeSettings::default(), None);
        View::new(Arc::new(observer), &silhouette)
    }

    fn lenses() -> impl Strategy<Value = [f64; 5]> {
        let tangential = || -0.004..0.004f64;
        (-0.4..0.35f64, -0.2..0.3f64, tangential(), tangential(), -0.1..0.1f64)
            .prop_map(|(k1, k2, p1, p2, k3)| [k1, k2, p1, p2, k3])
    }

    fn places() -> impl Strategy<Value = (Point3<f64>, Vector3<f64>)> {
        let part = || -1.0..1.0f64;
        (part(), part(), -2.0..1.5f64, part(), part(), part()).prop_filter_map("has a direction", |place| {
            let (x, y, z, nx, ny, nz) = place;
            let a = Point3::new(0.6 * x * (z + 3.0), 0.45 * y * (z + 3.0), z);
            let n = Vector3::new(nx, ny, nz);
            (n.norm() > 0.1).then(|| (a, n.normalize()))
        })
    }

    #[test]
    fn a_ray_into_the_camera_leaves_there() {
        let view = view([-0.12, 0.03, 0.0005, -0.0007, 0.001], &[255; 640 * 480]);
        for beside in [0.0, 1e-9, 1e-3] {
            let (a, n) = (Point3::new(beside, 0.0, -2.5), Vector3::new(-2.0 * beside, 0.0, -1.0));
            let t = view.first_outside(&a, &n.normalize(), 1.0).expect("behind the camera nothing is inside");
            assert!((t - 0.5).abs() < 1e-5, "{t} of {beside}");
        }
    }

    #[test]
    fn a_ray_beyond_the_lens_leaves_there_however_near_the_limit_is() {
        // All of the image is foreground, and the lens folds within it.
        let view = view([-0.32, -0.2, -0.001, 0.001, -0.055], &[255; 640 * 480]);
        let a = Point3::new(2.0, 0.6, 0.45);
        for n in [[0.235, 0.966, -0.107], [0.9, 0.1, 0.4], [0.3, -0.5, -0.8]] {
            let n = Vector3::from(n).normalize();
            let t = view.first_outside(&a, &n, 2.0).expect("beyond the lens nothing is inside");
            for factor in [1.000_01, 1.0001, 1.001, 1.1] {
                let limit_m = f64::from(t) * factor;
                assert_eq!(view.first_outside(&a, &n, limit_m), Some(t), "limit {limit_m}, {n:?}");
            }
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]
        #[test]
        fn a_span_is_as_near_to_its_parabola_as_it_says(
            lens in lenses(), rays in proptest::collection::vec(places(), 100), share in 0.0..1.0f64,
        ) {
            let view = view(lens, &[0; 640 * 480]);
            for (a, n) in rays {
            let bounds = view.observer().bounds();
            let ray = Ray::new(&view, &a, &n);
            let Ok(here) = ray.seen(0.0) else { continue };
            let Ok(span) = Span::from(&ray, here, bounds) else { continue };
            let length = span.there.image - span.here.image;
            let axes = if length.x.abs() >= length.y.abs() { (0, 1) } else { (1, 0) };
            let parabola = span.parabola(axes.0, axes.1);
            let (image, slope) = span.image(share);
            let miss = (parabola.beside(image[axes.0] - parabola.from) - image[axes.1]).abs();
            prop_assert!(miss <= parabola.error, "{miss} not {}", parabola.error);
            prop_assert!(parabola.error < 0.05);
            prop_assert!((slope / slope.norm())[axes.0].abs() >= parabola.shrink(span.bend));
            let t = span.t(share);
            let seen = ray.seen(t).map_err(|_| ()).expect("between two places that are seen");
            prop_assert!((seen.image.coords - image).amax() < 1e-9);
            prop_assert!((span.share(t) - share).abs() < 1e-9);
            }
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]
        #[test]
        fn an_exit_is_the_first_place_outside(
            lens in lenses(), rays in proptest::collection::vec(places(), 40), seed in any::<u64>(),
        ) {
            let view = view(lens, &random_mask(640, 480, seed));
            let inside = |a: &Point3<f64>| view.classify(a) == Class::Inside;
            let (mut exits, mut grazes) = (0, 0);
            for (a, n) in rays.iter().filter(|(a, _)| inside(a)) {
                let found = view.first_outside(a, n, 1.0);
                let march = 2e-4;
                let marched = (1..=5000).map(|at| f64::from(at) * march).find(|&t| !inside(&(a + n * t)));
                exits += 1;
                let holds = match (found, marched) {
                    (None, marched) => marched.is_none(),
                    (Some(t), marched) => {
                        let end = f64::from(t);
                        !inside(&(a + n * end)) && inside(&(a + n * (end - 1e-6)))
                            && marched.is_none_or(|marched| end <= marched + 1e-9)
                    }
                };
                grazes += usize::from(!holds);
                if let Some(t) = found.filter(|&t| t < 0.99) {
                    prop_assert_eq!(view.first_outside(a, n, f64::from(t) * 1.0001), Some(t));
                    prop_assert!(view.first_outside(a, n, f64::from(t) * 0.9999).is_none());
                }
            }
            // A ray that grazes a corner of the noise may be one of few.
            prop_assert!(grazes <= 1 + exits / 20, "{} of {}", grazes, exits);
        }
    }
}
