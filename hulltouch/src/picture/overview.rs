//! A viewpoint that is no camera's, from which person and bodies are all in the picture.

use hull::cull::WorldBox;
use hull::merge::contains;
use hull::{Camera, CameraError, Rig, View};
use nalgebra::{Matrix3, Point3, Vector3};
use sim::Body;

use super::hull_ray::bounds;

/// Points along the longest side of the hull's box when looking for the hull within it.
const GRID: f64 = 56.0;
/// Bodies farther than this from the person are let go, metres.
const COMPANY_M: f64 = 1.6;
/// Bodies larger than this are furniture of the room and frame nothing, metres.
const LARGEST_RADIUS_M: f64 = 1.5;
/// Focal length over image height: about 41° from top to bottom.
const FOCAL: f64 = 1.35;
/// How much the viewpoint rises for each metre that it is away: 17°.
const RISE: f64 = 0.3;
/// Person and bodies fill at most this share of the picture, either way.
const FILL: f64 = 0.98;
/// Cameras closer in azimuth than this cosine (11°) leave no room between them.
const BESIDE_COSINE: f64 = 0.98;
/// Cosine and sine of the most that the viewpoint turns away from the first camera (20°): a hull looks
/// best near a camera.
const ASIDE: (f64, f64) = (0.94, 0.34);

/// The box of the world that a picture should show: the hull itself, closer than its frusta tell, and the
/// bodies near it; metres.
pub fn interest(views: &[View], bodies: &[Body]) -> WorldBox {
    let person = hull_extent(views);
    let reference = person.map(|person| centre(&person));
    let near = bodies.iter().filter(|body| body.solid.radius_m() < LARGEST_RADIUS_M).filter_map(|body| {
        let (position, radius) = (body.pose.position_m(), body.solid.radius_m());
        let distance_m = reference.map_or(0.0, |centre| (Point3::from(position) - centre).norm());
        (distance_m < COMPANY_M)
            .then(|| WorldBox { min: position.map(|c| c - radius), max: position.map(|c| c + radius) })
    });
    let all = person.into_iter().chain(near).reduce(|a, b| a.union(&b));
    all.unwrap_or(WorldBox { min: [-1.0; 3], max: [1.0; 3] })
}

/// The box around the hull's points of a grid, one cell larger each way.
fn hull_extent(views: &[View]) -> Option<WorldBox> {
    let rule = views.first()?.observer().settings().rule();
    let around = bounds(views, rule)?;
    let sides: [f64; 3] = std::array::from_fn(|axis| around.max[axis] - around.min[axis]);
    let cell = sides.iter().fold(0.0, |a: f64, &b| a.max(b)) / GRID;
    if !cell.is_finite() {
        return None;
    }
    let count = sides.map(|side| (side / cell).ceil() as usize + 1);
    let mut found: Option<WorldBox> = None;
    for x in 0..count[0] {
        for y in 0..count[1] {
            for z in 0..count[2] {
                let at = [x as f64, y as f64, z as f64];
                let point: [f64; 3] = std::array::from_fn(|axis| around.min[axis] + cell * at[axis]);
                if contains(views, &Point3::from(point), rule) {
                    let here = WorldBox { min: point.map(|c| c - cell), max: point.map(|c| c + cell) };
                    found = Some(found.map_or(here, |found| found.union(&here)));
                }
            }
        }
    }
    found
}

/// A camera of `size` pixels between the rig's first camera and its neighbour, a little higher
/// than what it looks at, and as far as it takes to have all of `interest` in the picture. Up is a unit vector of the world.
/// Fails only for a size that no camera has.
pub fn overview_camera(
    rig: &Rig,
    interest: &WorldBox,
    up: &Vector3<f64>,
    size: (u32, u32),
) -> Result<Camera, CameraError> {
    let centre = centre(interest);
    let towards = (towards_viewer(rig, &centre, up) + up * RISE).normalize();
    let forward = -towards;
    let right = forward.cross(up).normalize();
    let rotation =
        Matrix3::from_rows(&[right.transpose(), forward.cross(&right).transpose(), forward.transpose()]);
    let (width, height) = (f64::from(size.0), f64::from(size.1));
    let focal = FOCAL * height.min(width);
    let mut distance_m: f64 = 1.0;
    for corner in 0..8 {
        let corner: Point3<f64> = std::array::from_fn(|axis| {
            if corner >> axis & 1 == 0 { interest.min[axis] } else { interest.max[axis] }
        })
        .into();
        let p = rotation * (corner - centre);
        let across = (p.x.abs() / width).max(p.y.abs() / height) * 2.0 * focal / FILL;
        distance_m = distance_m.max(across - p.z);
    }
    let eye = centre + towards * distance_m;
    let intrinsics =
        Matrix3::new(focal, 0.0, 0.5 * (width - 1.0), 0.0, focal, 0.5 * (height - 1.0), 0.0, 0.0, 1.0);
    Camera::from_matrices("overview", size, intrinsics, [0.0; 5], &rotation, -(rotation * eye.coords))
}

/// The horizontal unit vector from the centre to between the first camera and the one next to it.
fn towards_viewer(rig: &Rig, centre: &Point3<f64>, up: &Vector3<f64>) -> Vector3<f64> {
    let level = |v: Vector3<f64>| (v - up * up.dot(&v)).try_normalize(1e-6);
    let around: Vec<Vector3<f64>> =
        rig.cameras().iter().filter_map(|camera| level(camera.centre_world() - centre)).collect();
    let Some(first) = around.first() else {
        // All cameras hang straight above: any side will do.
        return level(Vector3::new(0.48, 0.6, 0.64)).unwrap_or_else(Vector3::x);
    };
    let beside = around.iter().filter(|other| first.dot(other) < BESIDE_COSINE);
    let beside = beside.max_by(|a, b| first.dot(a).total_cmp(&first.dot(b)));
    let half_way = beside.and_then(|beside| (first + beside).try_normalize(1e-3));
    if let Some(half_way) = half_way.filter(|half_way| half_way.dot(first) > ASIDE.0) {
        return half_way;
    }
    let to_left = up.cross(first);
    let side = beside.map_or(1.0, |beside| to_left.dot(beside).signum());
    (first * ASIDE.0 + to_left * (side * ASIDE.1)).normalize()
}

fn centre(bounds: &WorldBox) -> Point3<f64> {
    nalgebra::center(&Point3::from(bounds.min), &Point3::from(bounds.max))
}
