//! A viewing ray among the silhouettes of the other cameras: does it meet their common hull, and by
//! how many pixels does it miss?

use hull::{Camera, Pixel, Silhouette};
use nalgebra::{Point2, Point3, Vector2, Vector3};

use super::field::Blend;

/// One other camera as a ray sees it: the camera, its silhouette and the distance
/// to that.
#[derive(Clone, Copy)]
pub(crate) struct Other<'a> {
    pub(crate) index: usize,
    pub(crate) camera: &'a Camera,
    pub(crate) silhouette: &'a Silhouette,
    pub(crate) field: Blend<'a>,
    /// How far apart the field's grid points are, pixels: what bilinear values may be off by.
    pub(crate) spacing_px: f64,
}

/// A ray in the world; `direction` is a unit vector.
#[derive(Clone, Copy)]
pub(crate) struct Ray {
    pub(crate) origin: Point3<f64>,
    pub(crate) direction: Vector3<f64>,
}

/// Where a ray comes nearest to the hull.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Miss {
    /// The least over the ray of the greatest distance to a silhouette, pixels.
    pub(crate) gap_px: f64,
    /// Metres along the ray.
    pub(crate) depth_m: f64,
}

/// Nothing is looked at nearer than this to a camera, metres.
const NEAR_M: f64 = 0.02;
/// Steps after which a ray is given up: it crosses the largest image in 0.4 pixel steps twice. Ordinary
/// rays take some tens.
const MAX_STEPS: usize = 100_000;

/// How a point of the ray looks in one other camera.
struct Sight {
    image: Option<Point2<f64>>,
    speed_px_per_m: f64,
    depth_m: f64,
    approach: f64,
    /// Undistorted pixels from the edge of what the lens sees, for a point beyond it.
    beyond_px: f64,
}

impl Ray {
    pub(crate) fn at(&self, depth_m: f64) -> Point3<f64> {
        self.origin + self.direction * depth_m
    }

    /// The depths at which every other camera has the ray in front of it.
    fn span(&self, others: &[Other]) -> (f64, f64) {
        let (mut from, mut to) = (NEAR_M, f64::INFINITY);
        for other in others {
            let start = other.camera.camera_from_world(&self.origin).z - NEAR_M;
            let slope = other.camera.camera_direction(&self.direction).z;
            if slope > 0.0 {
                from = from.max(-start / slope);
            } else if slope < 0.0 {
                to = to.min(-start / slope);
            } else if start <= 0.0 {
                to = f64::NEG_INFINITY;
            }
        }
        (from, to)
    }

    fn sight(&self, other: &Other, point_world: &Point3<f64>) -> Sight {
        let p = other.camera.camera_from_world(point_world);
        let d = other.camera.camera_direction(&self.direction);
        let normalised = Vector2::new(p.x / p.z, p.y / p.z);
        let image = other.camera.image_from_camera(&p);
        // A bent lens stands still at its fold and moves at the pinhole's speed further in.
        let k = other.camera.intrinsics();
        let straight = Vector2::new(d.x - normalised.x * d.z, d.y - normalised.y * d.z).norm() * k[(0, 0)];
        let speed = (other.camera.image_jacobian(&normalised) * d).norm().max(straight);
        let edge = other.camera.lens().max_radius_squared().sqrt();
        let beyond_px = other.camera.intrinsics()[(0, 0)] * (normalised.norm() - edge).max(0.0);
        // The derivative by metres at depth 1 becomes one at depth z.
        let speed_px_per_m = speed / p.z;
        Sight { image, speed_px_per_m, depth_m: p.z, approach: d.z, beyond_px }
    }
}

impl Sight {
    /// Metres along the ray until the image has moved by `distance_px`; exact without distortion.
    fn metres_for(&self, distance_px: f64) -> f64 {
        let slowing = self.speed_px_per_m * self.depth_m - distance_px * self.approach;
        if slowing <= 0.0 { f64::INFINITY } else { distance_px * self.depth_m / slowing }
    }
}

/// True if some point of the ray falls on foreground of all the others at once (steps of under half a
/// pixel wherever an outline is near).
pub(crate) fn meets_hull(ray: &Ray, others: &[Other]) -> bool {
    let (mut depth_m, end_m) = ray.span(others);
    for _ in 0..MAX_STEPS {
        if depth_m > end_m || depth_m.is_infinite() {
            return false;
        }
        let point = ray.at(depth_m);
        let (mut inside, mut skip_m, mut crawl_m) = (true, 0f64, f64::INFINITY);
        for other in others {
            let sight = ray.sight(other, &point);
            crawl_m = crawl_m.min(sight.metres_for(0.4));
            let Some(image) = sight.image else {
                inside = false;
                skip_m = skip_m.max(sight.metres_for(0.5 * sight.beyond_px + 4.0));
                continue;
            };
            let pixel = Pixel::holding(image.x, image.y);
            inside &= other.silhouette.contains(pixel.column, pixel.row);
            // A pixel reaches 0.71 beyond its centre, and a bent lens moves faster further out.
            let clear_px = 0.8 * (other.field.distance_px(image.x, image.y) - other.spacing_px) - 1.0;
            if clear_px > 0.4 {
                skip_m = skip_m.max(sight.metres_for(clear_px));
            }
        }
        if inside {
            return true;
        }
        depth_m += skip_m.max(crawl_m);
    }
    false
}

/// Where the ray comes nearest to the hull of the others. The search ends at the first depth whose gap
/// is `floor_px` or less, and gaps above `cap_px` are reported as that, with an infinite depth. A good
/// `hint_m` (a depth that was near before the cameras moved a little) only makes it quicker.
pub(crate) fn nearest(ray: &Ray, others: &[Other], (floor_px, cap_px): (f64, f64), hint_m: f64) -> Miss {
    let (mut depth_m, end_m) = ray.span(others);
    let mut best = Miss { gap_px: cap_px, depth_m: f64::INFINITY };
    let mut reach_m = 0.0;
    let mut look = |at_m: f64| {
        let point = ray.at(at_m);
        let (mut gap_px, mut skip_m, mut crawl_m) = (f64::NEG_INFINITY, 0f64, f64::INFINITY);
        for other in others {
            let sight = ray.sight(other, &point);
            crawl_m = crawl_m.min(sight.metres_for(other.spacing_px));
            let Some(image) = sight.image else {
                gap_px = f64::INFINITY;
                skip_m = skip_m.max(sight.metres_for(0.5 * sight.beyond_px + 4.0));
                continue;
            };
            let distance_px = other.field.distance_px(image.x, image.y);
            gap_px = gap_px.max(distance_px);
            // Nothing nearer than the best can come before the outline has moved by the difference.
            skip_m = skip_m.max(sight.metres_for((distance_px - best.gap_px).max(0.0)));
        }
        if gap_px < best.gap_px {
            best = Miss { gap_px, depth_m: at_m };
            reach_m = crawl_m;
        }
        (best.gap_px <= floor_px, skip_m.max(crawl_m))
    };
    if hint_m.is_finite() && (depth_m..=end_m).contains(&hint_m) && look(hint_m).0 {
        return best;
    }
    for _ in 0..MAX_STEPS {
        if depth_m > end_m || depth_m.is_infinite() {
            break;
        }
        let (done, step_m) = look(depth_m);
        if done {
            return best;
        }
        depth_m += step_m;
    }
    if best.depth_m.is_finite() && reach_m.is_finite() { refined(ray, others, best, reach_m) } else { best }
}

/// Ternary search around the best step.
fn refined(ray: &Ray, others: &[Other], best: Miss, reach_m: f64) -> Miss {
    let gap_px = |depth_m: f64| {
        let point = ray.at(depth_m);
        others.iter().map(|other| distance_px(other, &point)).fold(f64::NEG_INFINITY, f64::max)
    };
    let (mut low, mut high) = (best.depth_m - reach_m, best.depth_m + reach_m);
    for _ in 0..8 {
        let (a, b) = (low + 0.4 * (high - low), low + 0.6 * (high - low));
        if gap_px(a) < gap_px(b) { high = b } else { low = a }
    }
    let depth_m = 0.5 * (low + high);
    let found = Miss { gap_px: gap_px(depth_m), depth_m };
    if found.gap_px < best.gap_px { found } else { best }
}

/// The signed distance, pixels, of a world point's image to the other camera's silhouette.
pub(crate) fn distance_px(other: &Other, point_world: &Point3<f64>) -> f64 {
    match other.camera.project(point_world) {
        Some(image) => other.field.distance_px(image.x, image.y),
        None => f64::INFINITY,
    }
}
