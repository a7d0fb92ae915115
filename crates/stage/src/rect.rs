//! Which pixels something may touch: rectangles of the image, never too small.

use hull::Camera;
use nalgebra::{Matrix3, Matrix4x3, Point2, Vector2, Vector3};

use crate::solid::{Form, Solid};

/// A rectangle of pixels; the ends are not in it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Rect {
    pub columns: (usize, usize),
    pub rows: (usize, usize),
}

impl Rect {
    pub const EMPTY: Rect = Rect { columns: (0, 0), rows: (0, 0) };

    pub fn is_empty(self) -> bool {
        self.columns.0 >= self.columns.1 || self.rows.0 >= self.rows.1
    }

    pub fn union(self, other: Rect) -> Rect {
        if self.is_empty() {
            return other;
        }
        if other.is_empty() {
            return self;
        }
        let join = |a: (usize, usize), b: (usize, usize)| (a.0.min(b.0), a.1.max(b.1));
        Rect { columns: join(self.columns, other.columns), rows: join(self.rows, other.rows) }
    }
}

/// The pixels that the solid may touch, no fewer.
pub(crate) fn rect_of_solid(solid: &Solid, camera: &Camera) -> Rect {
    match normalised_bounds(solid, camera) {
        Bounds::Behind => Rect::EMPTY,
        Bounds::Everywhere => whole(camera),
        Bounds::Box { low, high } => pixels(camera, low, high),
    }
}

fn whole(camera: &Camera) -> Rect {
    Rect { columns: (0, camera.width() as usize), rows: (0, camera.height() as usize) }
}

enum Bounds {
    Behind,
    Everywhere,
    Box { low: Vector2<f64>, high: Vector2<f64> },
}

fn normalised_bounds(solid: &Solid, camera: &Camera) -> Bounds {
    let scaled = camera.rotation() * solid.frame * Matrix3::from_diagonal(&solid.squash);
    let centre = camera.camera_from_world(&solid.origin.into());
    let (mut low, mut high) = (Vector2::repeat(f64::INFINITY), Vector2::repeat(f64::NEG_INFINITY));
    let mut join = |a: Vector2<f64>, b: Vector2<f64>| {
        low = low.inf(&a);
        high = high.sup(&b);
    };
    let near_m = 0.01;
    let (mut nearest_m, mut farthest_m) = (f64::INFINITY, f64::NEG_INFINITY);
    match solid.form {
        Form::Cuboid { half_m } => {
            for corner in Solid::corners(&half_m) {
                let place = centre + scaled * corner;
                (nearest_m, farthest_m) = (nearest_m.min(place.z), farthest_m.max(place.z));
                let seen = place.xy() / place.z;
                join(seen, seen);
            }
        }
        Form::RoundCone { length_m, start_m, end_m } => {
            // The outline of each end's ellipsoid: planes (1, 0, −x) and (0, 1, −y) that touch it.
            for (along_m, radius_m) in [(0.0, start_m), (length_m, end_m)] {
                let place = centre + scaled * Vector3::new(0.0, along_m, 0.0);
                let spread = scaled * scaled.transpose() * (radius_m * radius_m);
                let reach_m = spread[(2, 2)].sqrt();
                (nearest_m, farthest_m) =
                    (nearest_m.min(place.z - reach_m), farthest_m.max(place.z + reach_m));
                let a = place.z * place.z - spread[(2, 2)];
                let extent = |axis: usize| {
                    let b = place[axis] * place.z - spread[(axis, 2)];
                    let c = place[axis] * place[axis] - spread[(axis, axis)];
                    let root = (b * b - a * c).max(0.0).sqrt();
                    ((b - root) / a, (b + root) / a)
                };
                let ((left, right), (top, bottom)) = (extent(0), extent(1));
                join(Vector2::new(left, top), Vector2::new(right, bottom));
            }
        }
    }
    if farthest_m <= near_m {
        Bounds::Behind
    } else if nearest_m <= near_m {
        Bounds::Everywhere
    } else {
        Bounds::Box { low, high }
    }
}

/// The pixels around a rectangle of undistorted normalised coordinates: its border is followed through
/// the lens. A border that the lens does not see gives the whole image.
fn pixels(camera: &Camera, low: Vector2<f64>, high: Vector2<f64>) -> Rect {
    let steps = if camera.lens().is_straight() { 1 } else { 16 };
    let (mut least, mut most) = (Point2::new(f64::INFINITY, f64::INFINITY), Point2::new(-1.0, -1.0));
    for step in 0..=steps {
        let share = f64::from(step) / f64::from(steps);
        let (x, y) = (low.x + (high.x - low.x) * share, low.y + (high.y - low.y) * share);
        for (x, y) in [(x, low.y), (x, high.y), (low.x, y), (high.x, y)] {
            let Some(image) = camera.image_from_camera(&Vector3::new(x, y, 1.0)) else {
                return whole(camera);
            };
            least = least.inf(&image);
            most = most.sup(&image);
        }
    }
    // Between the steps a bent border bulges a little.
    let margin = if steps == 1 { 1.0 } else { 2.0 + 0.01 * (most - least).amax() };
    let span = |least: f64, most: f64, side: u32| {
        let limit = f64::from(side);
        ((least - margin).clamp(0.0, limit) as usize, (most + margin + 1.0).clamp(0.0, limit).ceil() as usize)
    };
    Rect { columns: span(least.x, most.x, camera.width()), rows: span(least.y, most.y, camera.height()) }
}

/// The pixels around four points of the world, or the whole image if one is not in front of the camera.
pub(crate) fn rect_of_quad(camera: &Camera, corners_world: &Matrix4x3<f64>) -> Rect {
    let mut least = Vector2::repeat(f64::INFINITY);
    let mut most = Vector2::repeat(f64::NEG_INFINITY);
    for corner in corners_world.row_iter() {
        let place = camera.camera_from_world(&corner.transpose().into());
        if place.z <= 0.05 {
            return whole(camera);
        }
        least = least.inf(&(place.xy() / place.z));
        most = most.sup(&(place.xy() / place.z));
    }
    pixels(camera, least, most)
}
