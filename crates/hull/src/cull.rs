//! Bounding volumes (paper §4.1 and §5): what cannot be inside is not asked. Culling never changes an
//! answer: every bound here is conservative, also under lens distortion.

use nalgebra::{Point2, Point3, Vector3};

use crate::body::{Pose, Shape};
use crate::camera::Camera;
use crate::rule::{HullRule, OutOfView};
use crate::silhouette::PixelRect;

/// Beyond this, metres, a box counts as unbounded.
const FAR_M: f64 = 1e4;
/// How much boxes grow to cover rounding, metres.
const SLACK_M: f64 = 1e-6;

/// An axis-aligned box of the world, metres; sides may be infinite.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WorldBox {
    /// Least corner.
    pub min: [f64; 3],
    /// Greatest corner.
    pub max: [f64; 3],
}

impl WorldBox {
    /// All of space.
    pub const EVERYWHERE: WorldBox = WorldBox { min: [f64::NEG_INFINITY; 3], max: [f64::INFINITY; 3] };

    /// True if the boxes share a point.
    pub fn meets(&self, other: &WorldBox) -> bool {
        (0..3).all(|axis| self.min[axis] <= other.max[axis] && other.min[axis] <= self.max[axis])
    }

    /// The smallest box that holds both.
    pub fn union(&self, other: &WorldBox) -> WorldBox {
        WorldBox {
            min: std::array::from_fn(|axis| self.min[axis].min(other.min[axis])),
            max: std::array::from_fn(|axis| self.max[axis].max(other.max[axis])),
        }
    }

    /// The box around all samples of a body.
    pub fn of_body(shape: &Shape, pose: &Pose) -> WorldBox {
        let (low, high) = shape.bounds_body();
        let rotation = pose.rotation();
        let position = pose.position_m();
        let mut result = WorldBox { min: position, max: position };
        for axis in 0..3 {
            for side in 0..3 {
                let (a, b) = (rotation[(axis, side)] * low[side], rotation[(axis, side)] * high[side]);
                result.min[axis] += a.min(b);
                result.max[axis] += a.max(b);
            }
            result.min[axis] -= SLACK_M;
            result.max[axis] += SLACK_M;
        }
        result
    }
}

/// The half-space `normal · x ≤ offset` of the world, `normal` of unit length.
#[derive(Clone, Copy, Debug, PartialEq)]
struct HalfSpace {
    normal: Vector3<f64>,
    offset: f64,
}

/// The bounding frustum of one silhouette: the centre of projection and the four planes around the
/// undistorted border of its bounding rectangle (paper §4.1).
#[derive(Clone, Debug, PartialEq)]
pub struct Frustum {
    sides: [HalfSpace; 5],
}

impl Frustum {
    /// The frustum of a rectangle of the image.
    pub fn of(camera: &Camera, rect: PixelRect) -> Frustum {
        let (low, high) = normalised_bounds(camera, rect);
        let centre = camera.centre_world();
        let side = |normal_camera: Vector3<f64>| {
            let normal = camera.rotation().tr_mul(&normal_camera).normalize();
            HalfSpace { normal, offset: normal.dot(&centre.coords) + SLACK_M }
        };
        Frustum {
            sides: [
                side(Vector3::new(-1.0, 0.0, low.x)),
                side(Vector3::new(1.0, 0.0, -high.x)),
                side(Vector3::new(0.0, -1.0, low.y)),
                side(Vector3::new(0.0, 1.0, -high.y)),
                side(Vector3::new(0.0, 0.0, -1.0)),
            ],
        }
    }

    /// True if no point of the ball is within the frustum's planes for a certainty.
    pub fn misses_ball(&self, centre_world: &Point3<f64>, radius_m: f64) -> bool {
        self.sides.iter().any(|side| side.normal.dot(&centre_world.coords) - side.offset > radius_m)
    }
}

/// The least box of normalised coordinates that holds everything seen on the rectangle's pixels.
fn normalised_bounds(camera: &Camera, rect: PixelRect) -> (Point2<f64>, Point2<f64>) {
    const STEPS: usize = 48;
    let (left, right) = (f64::from(rect.left) - 0.5, f64::from(rect.right) - 0.5);
    let (top, bottom) = (f64::from(rect.top) - 0.5, f64::from(rect.bottom) - 0.5);
    let steps = if camera.lens().is_straight() { 1 } else { STEPS };
    let corners = [(left, top), (right, top), (right, bottom), (left, bottom)];
    let mut low = Point2::new(f64::INFINITY, f64::INFINITY);
    let mut high = -low;
    let mut margin: f64 = 0.0;
    let mut before: Option<nalgebra::Vector2<f64>> = None;
    for side in 0..4 {
        let (from, to) = (corners[side], corners[(side + 1) % 4]);
        for step in 0..=steps {
            let share = step as f64 / steps as f64;
            let image = Point2::new(from.0 + (to.0 - from.0) * share, from.1 + (to.1 - from.1) * share);
            let Some(seen) = camera.normalised(&image) else {
                // Part of the border sees nothing: bound by all that the lens can see.
                let reach = camera.lens().max_radius_squared().sqrt();
                return (Point2::new(-reach, -reach), Point2::new(reach, reach));
            };
            low = low.inf(&seen.into());
            high = high.sup(&seen.into());
            if let Some(before) = before {
                margin = margin.max((seen - before).norm());
            }
            before = Some(seen);
        }
    }
    // Between two samples the curve strays less than their distance; a straight lens strays nowhere.
    let margin = if camera.lens().is_straight() { 1e-9 } else { margin };
    (low.map(|value| value - margin), high.map(|value| value + margin))
}

/// The box around the visual hull, from each camera's frustum of what it does not reject (`None`: it
/// rejects all it sees). `None` if nothing can be inside.
pub fn hull_box(frusta: &[Option<Frustum>], rule: HullRule) -> Option<WorldBox> {
    if frusta.len() < rule.min_views as usize {
        return None;
    }
    match rule.out_of_view {
        OutOfView::Outside => {
            let all: Option<Vec<&Frustum>> = frusta.iter().map(Option::as_ref).collect();
            intersection_box(&all?)
        }
        // A silent camera rejects nothing, so only those that must agree bound the hull.
        OutOfView::Abstain if rule.min_views == 1 => Some(WorldBox::EVERYWHERE),
        OutOfView::Abstain => {
            let seeing: Vec<&Frustum> = frusta.iter().flatten().collect();
            let pairs = (0..seeing.len()).flat_map(|a| (a + 1..seeing.len()).map(move |b| (a, b)));
            pairs.filter_map(|(a, b)| intersection_box(&[seeing[a], seeing[b]])).reduce(|a, b| a.union(&b))
        }
    }
}

/// The box around the common points of frusta: its corners are the corners of a convex polytope, which
/// lie on the lines in which two planes meet.
fn intersection_box(frusta: &[&Frustum]) -> Option<WorldBox> {
    let mut sides: Vec<HalfSpace> = frusta.iter().flat_map(|frustum| frustum.sides).collect();
    for axis in 0..3 {
        for sign in [1.0, -1.0] {
            let mut normal = Vector3::zeros();
            normal[axis] = sign;
            sides.push(HalfSpace { normal, offset: FAR_M });
        }
    }
    let mut found: Option<WorldBox> = None;
    for (index, a) in sides.iter().enumerate() {
        for b in &sides[index + 1..] {
            for corner in edge_ends(a, b, &sides).into_iter().flatten() {
                let point: [f64; 3] = corner.into();
                let point = WorldBox { min: point, max: point };
                found = Some(found.map_or(point, |found| found.union(&point)));
            }
        }
    }
    found.map(|found| WorldBox {
        min: found.min.map(|value| if value < -0.99 * FAR_M { f64::NEG_INFINITY } else { value - SLACK_M }),
        max: found.max.map(|value| if value > 0.99 * FAR_M { f64::INFINITY } else { value + SLACK_M }),
    })
}

/// The two ends of the polytope's edge on the line where two planes meet.
fn edge_ends(a: &HalfSpace, b: &HalfSpace, sides: &[HalfSpace]) -> Option<[Vector3<f64>; 2]> {
    let direction = a.normal.cross(&b.normal);
    let squared = direction.norm_squared();
    if squared < 1e-16 {
        return None;
    }
    let start = (b.normal.cross(&direction) * a.offset + direction.cross(&a.normal) * b.offset) / squared;
    let (mut from, mut to) = (f64::NEG_INFINITY, f64::INFINITY);
    for side in sides {
        let slope = side.normal.dot(&direction);
        let room = side.offset + SLACK_M - side.normal.dot(&start);
        if slope.abs() < 1e-12 {
            if room < -SLACK_M {
                return None;
            }
        } else if slope > 0.0 {
            to = to.min(room / slope);
        } else {
            from = from.max(room / slope);
        }
    }
    (from <= to).then(|| [start + direction * from, start + direction * to])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::tests::plain_camera;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn what_a_rectangle_shows_lies_in_its_frustum(
            left in 0u32..600, top in 0u32..440, width in 1u32..40, height in 1u32..40,
            across in 0.0..1.0f64, down in 0.0..1.0f64, depth in 0.1..20.0f64, bent in any::<bool>(),
        ) {
            let camera = plain_camera(if bent { [-0.3, 0.1, 0.002, -0.002, 0.0] } else { [0.0; 5] });
            let rect = PixelRect { left, top, right: left + width, bottom: top + height };
            let frustum = Frustum::of(&camera, rect);
            let image = Point2::new(
                f64::from(left) - 0.5 + across * f64::from(width),
                f64::from(top) - 0.5 + down * f64::from(height),
            );
            let ray = camera.ray_world(&image).expect("seen");
            prop_assert!(!frustum.misses_ball(&(camera.centre_world() + ray * depth), 0.0));
            let box_ = intersection_box(&[&frustum]).expect("not empty");
            let point: [f64; 3] = (camera.centre_world() + ray * depth).into();
            prop_assert!(box_.meets(&WorldBox { min: point, max: point }), "{box_:?} {point:?}");
        }
    }

    #[test]
    fn a_ball_beside_or_behind_the_frustum_is_missed() {
        let camera = plain_camera([0.0; 5]);
        let frustum = Frustum::of(&camera, PixelRect { left: 300, top: 220, right: 340, bottom: 260 });
        assert!(!frustum.misses_ball(&Point3::new(0.0, 0.0, 0.0), 0.1));
        assert!(frustum.misses_ball(&Point3::new(1.0, 0.0, 0.0), 0.1));
        assert!(frustum.misses_ball(&Point3::new(0.0, 0.0, -4.0), 0.5));
    }
}
