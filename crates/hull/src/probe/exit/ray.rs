//! A ray as a camera sees it, place by place.

use nalgebra::{Point2, Point3, Vector3};

use crate::camera::Pixel;
use crate::view::View;

/// The ray comes behind the camera or beyond its lens.
pub(super) struct OutOfSight;

/// A ray in a camera's frame.
pub(super) struct Ray<'a> {
    pub view: &'a View,
    start: Vector3<f64>,
    step: Vector3<f64>,
    /// How fast it moves in normalised coordinates, times its squared depth: the same everywhere.
    drift: f64,
    pub most_m: f64,
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
    pub fn seen(&self, t: f64) -> Result<RayPoint, OutOfSight> {
        let at = self.start + self.step * t;
        let image = self.view.camera().image_from_camera(&at).ok_or(OutOfSight)?;
        Ok(RayPoint { t, camera: at, image, pixel: Pixel::holding(image.x, image.y) })
    }

    /// True if nothing but foreground is between two places: in the chord's rectangle, larger by as much as
    /// the ray's image may be away from its chord.
    #[inline(always)]
    pub fn is_clear_between(&self, a: &RayPoint, b: &RayPoint) -> bool {
        let across = b.camera.xy() / b.camera.z - a.camera.xy() / a.camera.z;
        let bow = 0.1251 * self.view.observer().bounds().bend * across.norm_squared() + 1e-9;
        let (low, high) = (a.image.inf(&b.image), a.image.sup(&b.image));
        let low = Pixel::holding(low.x - bow, low.y - bow);
        let high = Pixel::holding(high.x + bow, high.y + bow);
        self.view.foreground().map().all_ones(low, high)
    }

    /// How far the ray goes on until it is `apart` from there in normalised coordinates; not so far that
    /// the camera comes near.
    #[inline(always)]
    pub fn travel_m(&self, from: &RayPoint, apart: f64) -> f64 {
        let (depth_m, nearing) = (from.camera.z, -self.step.z);
        let most_m = if nearing > 0.0 { self.most_m.min(0.5 * depth_m / nearing) } else { self.most_m };
        let (over, under) = (apart * depth_m * depth_m, self.drift + apart * depth_m * nearing);
        if over < most_m * under { over / under } else { most_m }
    }
}

/// A place on a ray as a camera sees it.
#[derive(Clone, Copy)]
pub(super) struct RayPoint {
    pub t: f64,
    pub camera: Vector3<f64>,
    pub image: Point2<f64>,
    pub pixel: Pixel,
}
