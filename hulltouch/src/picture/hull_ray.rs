//! Where a ray enters the visual hull of one frame, and the hull's normal there.

use hull::camera::Pixel;
use hull::cull::{WorldBox, hull_box};
use hull::merge::inside_count;
use hull::question::Standing;
use hull::{HullRule, OutOfView, View};
use nalgebra::{Point3, Vector3};
use sim::ray::Ray;

use super::field::{CameraRay, Field, Outline, Verdict};

/// A ray is followed for no more steps than this: bounds what grazing rays cost.
const MAX_STEPS: usize = 4000;
/// No ray is followed farther, metres.
const FAR_M: f64 = 60.0;
/// Where no camera rejects a point but too few see it, rays step so far, metres.
const BLIND_STEP_M: f64 = 0.01;
/// Halvings of the last step before the entry.
const HALVINGS: usize = 10;
/// Cameras whose edge is nearer than about this contribute to the normal, metres: rounds the creases
/// where the cones of two cameras meet.
const ROUNDING_M: f64 = 0.012;
/// Edges farther than this have none worth their cost, metres.
const FAR_EDGE_M: f64 = 0.06;

/// The visual hull of one frame's views, ready for rays.
pub(super) struct HullTracer<'a> {
    fields: Vec<Field<'a>>,
    rule: HullRule,
    bounds: Option<WorldBox>,
}

/// Buffers kept between rays.
#[derive(Default)]
pub(super) struct Scratch {
    rays: Vec<CameraRay>,
    starts_m: Vec<f64>,
    ends_m: Vec<f64>,
}

impl<'a> HullTracer<'a> {
    /// From the views of one frame, in rig order, which share a rule.
    pub fn new(views: &'a [View], outline: Outline) -> HullTracer<'a> {
        let rule = views.first().map(|view| view.observer().settings().rule()).unwrap_or_default();
        let bounds = bounds(views, rule);
        // Without a hull there is nothing to measure.
        let fields = if bounds.is_some() {
            views.iter().map(|view| Field::new(view, outline)).collect()
        } else {
            Vec::new()
        };
        HullTracer { fields, rule, bounds }
    }

    /// The first point of the ray, metres along it, that is inside the hull.
    pub fn first_inside(&self, ray: &Ray, scratch: &mut Scratch) -> Option<f64> {
        let mut range_m = (0.0, FAR_M);
        if !clip_to_box(ray, self.bounds.as_ref()?, &mut range_m)
            || !self.clip_to_views(ray, &mut range_m, scratch)
        {
            return None;
        }
        let rays = &scratch.rays;
        let (mut t_m, end_m) = range_m;
        let mut outside_m = None;
        for _ in 0..MAX_STEPS {
            match self.step_m(rays, t_m) {
                None => return Some(self.entry_m(rays, outside_m, t_m)),
                Some(step_m) => {
                    outside_m = Some(t_m);
                    t_m += step_m;
                }
            }
            if t_m > end_m {
                return None;
            }
        }
        None
    }

    /// Narrows a range of the ray to where enough cameras may answer inside; `false` if nothing is left.
    fn clip_to_views(&self, ray: &Ray, range_m: &mut (f64, f64), scratch: &mut Scratch) -> bool {
        let Scratch { rays, starts_m, ends_m } = scratch;
        rays.clear();
        starts_m.clear();
        ends_m.clear();
        for field in &self.fields {
            let camera = field.view().camera();
            let start = camera.camera_from_world(&ray.start);
            let camera_ray = CameraRay { start, direction: camera.camera_direction(&ray.direction) };
            let (start_m, end_m) = field.span_m(&camera_ray);
            rays.push(camera_ray);
            starts_m.push(start_m);
            ends_m.push(end_m);
        }
        let needed = match self.rule.out_of_view {
            OutOfView::Outside => self.fields.len(),
            OutOfView::Abstain => (self.rule.min_views as usize).min(self.fields.len()),
        };
        let Some(at) = needed.checked_sub(1) else { return false };
        starts_m.sort_by(f64::total_cmp);
        ends_m.sort_by(|a, b| b.total_cmp(a));
        *range_m = (range_m.0.max(starts_m[at]), range_m.1.min(ends_m[at]));
        range_m.0 <= range_m.1
    }

    /// How far it is safe to go on from a point of the ray; `None` if that is inside the hull.
    fn step_m(&self, rays: &[CameraRay], t_m: f64) -> Option<f64> {
        let (mut inside, mut safe_m): (usize, Option<f64>) = (0, None);
        for (field, ray) in self.fields.iter().zip(rays) {
            match field.verdict(ray, t_m) {
                Verdict::Inside => inside += 1,
                Verdict::Unknown => {}
                Verdict::Outside { step_m } => {
                    safe_m = Some(safe_m.map_or(step_m, |so_far| so_far.max(step_m)));
                }
            }
        }
        let is_inside = || inside_count(Standing::inside(inside), self.rule).is_some();
        safe_m.or_else(|| (!is_inside()).then_some(BLIND_STEP_M))
    }

    fn entry_m(&self, rays: &[CameraRay], outside_m: Option<f64>, inside_m: f64) -> f64 {
        let Some(mut outside_m) = outside_m else { return inside_m };
        let mut inside_m = inside_m;
        for _ in 0..HALVINGS {
            let middle_m = 0.5 * (outside_m + inside_m);
            if self.step_m(rays, middle_m).is_none() { inside_m = middle_m } else { outside_m = middle_m }
        }
        inside_m
    }

    /// The hull's outward unit normal at a point of its surface: the back-projected normals of the edges
    /// near it (paper §4.2), the nearest with the most weight.
    pub fn normal(&self, point_world: &Point3<f64>) -> Option<Vector3<f64>> {
        let mut sum = Vector3::zeros();
        for field in &self.fields {
            let camera = field.view().camera();
            let point = camera.camera_from_world(point_world);
            let Some(image) = camera.image_from_camera(&point) else { continue };
            let (pixel, pixel_m) = (Pixel::holding(image.x, image.y), field.pixel_m(point.z));
            if field.depth_pixels(pixel) * pixel_m > FAR_EDGE_M {
                continue;
            }
            let (depth_pixels, slope) = field.depth_and_slope(pixel);
            let normalised = nalgebra::Vector2::new(point.x / point.z, point.y / point.z);
            let Some(normal) = camera.hull_normal_world(&normalised, &slope) else { continue };
            let depth_m = depth_pixels.max(0.0) * pixel_m;
            let nearness = 1.0 / (1.0 + (depth_m / ROUNDING_M).powi(2));
            sum += normal * (nearness * nearness * slope.norm().min(1.0));
        }
        sum.try_normalize(1e-9)
    }
}

/// The box around the hull of a frame's views, `None` if there is no hull.
pub(super) fn bounds(views: &[View], rule: HullRule) -> Option<WorldBox> {
    let frusta: Vec<_> = views.iter().map(|view| view.frustum().cloned()).collect();
    hull_box(&frusta, rule)
}

/// Narrows a range of the ray to a box; `false` if nothing is left.
fn clip_to_box(ray: &Ray, bounds: &WorldBox, range_m: &mut (f64, f64)) -> bool {
    for axis in 0..3 {
        let (start, slope) = (ray.start[axis], ray.direction[axis]);
        let (low, high) = (bounds.min[axis] - start, bounds.max[axis] - start);
        if slope == 0.0 {
            if low > 0.0 || high < 0.0 {
                return false;
            }
            continue;
        }
        let (a, b) = (low / slope, high / slope);
        range_m.0 = range_m.0.max(a.min(b));
        range_m.1 = range_m.1.min(a.max(b));
    }
    range_m.0 <= range_m.1
}
