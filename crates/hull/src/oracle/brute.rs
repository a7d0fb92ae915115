//! The exact twin of spec §3: every search exhaustive, every ray marched densely.

use nalgebra::{Point2, Point3, Vector2, Vector3};

use super::DenseView;
use crate::camera::Pixel;
use crate::rule::{OutOfView, ProbeSettings};
use crate::view::Class;

/// From outside no plane is searched farther, pixels squared: 256, and what rounding up adds.
const MOST_SQUARED: i32 = 256 * 256 + 1;

/// What the twin finds for a point inside the hull.
#[derive(Clone, Debug, PartialEq)]
pub struct BrutePoint {
    /// The winning camera and its edge; `None` if no camera has one.
    pub edge: Option<BruteEdge>,
    /// The exit along the edge's normal, metres.
    pub exit_m: Option<f64>,
}

/// The winning camera's edge.
#[derive(Clone, Debug, PartialEq)]
pub struct BruteEdge {
    /// Index of the camera in the rig.
    pub camera: usize,
    /// Its edge pixel.
    pub pixel: Pixel,
    /// From the point to the pixel's viewing ray, metres.
    pub distance_m: f64,
    /// The hull's outward unit normal in the world.
    pub normal_world: Vector3<f64>,
}

/// What one camera says of a point.
pub fn class(view: &DenseView, settings: &ProbeSettings, point: &Point3<f64>) -> Class {
    match view.camera.pixel(point) {
        None if settings.rule().out_of_view == OutOfView::Outside => Class::Outside,
        None => Class::Unknown,
        Some(pixel) if view.is_ignored(pixel) => Class::Unknown,
        Some(pixel) if view.is_foreground(pixel) => Class::Inside,
        Some(_) => Class::Outside,
    }
}

/// The hull rule over all cameras.
pub fn is_inside(views: &[DenseView], settings: &ProbeSettings, point: &Point3<f64>) -> bool {
    let classes: Vec<Class> = views.iter().map(|view| class(view, settings, point)).collect();
    let count = classes.iter().filter(|&&class| class == Class::Inside).count();
    !classes.contains(&Class::Outside) && count >= settings.rule().min_views as usize
}

/// Everything about one point; `None` if it is not inside. Rays are marched at `march_m`.
pub fn point(
    views: &[DenseView],
    settings: &ProbeSettings,
    a: &Point3<f64>,
    march_m: f64,
) -> Option<BrutePoint> {
    if !is_inside(views, settings, a) {
        return None;
    }
    let mut best: Option<BruteEdge> = None;
    for (camera, view) in views.iter().enumerate() {
        if class(view, settings, a) != Class::Inside {
            continue;
        }
        let Some(edge) = camera_edge(view, camera, settings, a) else { continue };
        if best.as_ref().is_none_or(|best| edge.distance_m < best.distance_m) {
            best = Some(edge);
        }
    }
    let exit_m = best.as_ref().and_then(|edge| exit(views, settings, a, &edge.normal_world, march_m));
    Some(BrutePoint { edge: best, exit_m })
}

/// Of a point that cameras say is outside: the plane of the foreground nearest to it, in the camera where that is
/// farthest from the point.
pub fn plane_from_outside(
    views: &[DenseView],
    settings: &ProbeSettings,
    a: &Point3<f64>,
) -> Option<BruteEdge> {
    let mut best: Option<BruteEdge> = None;
    for (camera, view) in views.iter().enumerate() {
        let Some(start) = view.camera.pixel(a).filter(|_| class(view, settings, a) == Class::Outside) else {
            continue;
        };
        let rows = 0..view.camera.height() as i32;
        let columns = 0..view.camera.width() as i32;
        let pixels = rows.flat_map(|row| columns.clone().map(move |column| Pixel { column, row }));
        let way = |pixel: Pixel| (start.column - pixel.column, start.row - pixel.row);
        let rank = |pixel: &Pixel| {
            let (across, down) = way(*pixel);
            (across * across + down * down, pixel.row, pixel.column)
        };
        let nearest = pixels.filter(|&pixel| view.is_foreground(pixel)).min_by_key(rank);
        let Some(nearest) = nearest.filter(|pixel| rank(pixel).0 <= MOST_SQUARED) else { continue };
        let (across, down) = way(nearest);
        let (right, below) =
            if across.abs() >= down.abs() { (across.signum(), 0) } else { (0, down.signum()) };
        let pixel = Pixel { column: nearest.column + right, row: nearest.row + below };
        if !is_candidate(view, settings, pixel) {
            continue;
        }
        let Some(normal_world) = plane_normal(view, settings, nearest, pixel) else { continue };
        let distance_m = normal_world.dot(&(view.camera.centre_world() - a)).min(0.0);
        if best.as_ref().is_none_or(|best| distance_m < best.distance_m) {
            best = Some(BruteEdge { camera, pixel, distance_m, normal_world });
        }
    }
    best
}

/// The outward normal of the hull's surface as a plane near a camera's edge, which is nearest to `start`; `None` where
/// the lens sees nothing.
pub fn plane_normal(
    view: &DenseView,
    settings: &ProbeSettings,
    start: Pixel,
    edge: Pixel,
) -> Option<Vector3<f64>> {
    let most = settings.normal_window().half_side_pixels(view.camera.width(), view.camera.height()) as i32;
    let (_, normal) = disc_line(view, settings, start, edge, 2.min(most));
    let is_foreground = |step: i32| {
        let place = edge.centre() - normal * f64::from(step);
        !is_candidate(view, settings, Pixel::holding(place.x, place.y))
    };
    let mut radius = most;
    if let Some(entry) = [1, 2].into_iter().find(|&step| is_foreground(step)) {
        for step in (entry + 1..=most + 1).rev() {
            if !is_foreground(step) && !is_foreground(step + 1) {
                radius = (step - 2).max(1);
            }
        }
    }
    let (image, normal) = disc_line(view, settings, start, edge, radius);
    view.camera.hull_normal_world(&view.camera.normalised(&image)?, &normal)
}

/// The straight edge that leaves a disc's background on its other side.
fn disc_line(
    view: &DenseView,
    settings: &ProbeSettings,
    start: Pixel,
    edge: Pixel,
    radius: i32,
) -> (Point2<f64>, Vector2<f64>) {
    let (mut sum, mut background, mut all) = (Vector2::zeros(), 0.0, 0.0);
    for dy in -radius..=radius {
        for dx in -radius..=radius {
            if dx * dx + dy * dy > radius * radius + radius {
                continue;
            }
            all += 1.0;
            if is_candidate(view, settings, Pixel { column: edge.column + dx, row: edge.row + dy }) {
                sum += Vector2::new(f64::from(dx), f64::from(dy));
                background += 1.0;
            }
        }
    }
    let m = if sum == Vector2::zeros() { edge.centre() - start.centre() } else { sum };
    let (mut low, mut high) = (-1.0, 1.0);
    for _ in 0..60 {
        let x: f64 = 0.5 * (low + high);
        let share = (libm::acos(x) - x * (1.0 - x * x).sqrt()) / std::f64::consts::PI;
        if share > background / all { low = x } else { high = x }
    }
    let normal = m.normalize();
    (edge.centre() + normal * (low * (all / std::f64::consts::PI).sqrt()), normal)
}

/// True if the pixel counts as background for edges and normals.
fn is_candidate(view: &DenseView, settings: &ProbeSettings, pixel: Pixel) -> bool {
    let off_image = !view.camera.holds(pixel);
    if off_image && settings.rule().out_of_view == OutOfView::Abstain {
        return false;
    }
    !view.is_foreground(pixel) && !view.is_ignored(pixel) && view.camera.normalised(&pixel.centre()).is_some()
}

fn camera_edge(
    view: &DenseView,
    camera: usize,
    settings: &ProbeSettings,
    a: &Point3<f64>,
) -> Option<BruteEdge> {
    let start = view.camera.pixel(a)?;
    let rank = |pixel: Pixel| {
        let (dx, dy) = (i64::from(pixel.column - start.column), i64::from(pixel.row - start.row));
        (dx * dx + dy * dy, pixel.row, pixel.column)
    };
    let mut nearest: Option<Pixel> = None;
    // A pixel off the image is nearest only if it touches the image.
    for row in -1..=view.camera.height() as i32 {
        for column in -1..=view.camera.width() as i32 {
            let pixel = Pixel { column, row };
            let nearer = nearest.is_none_or(|nearest| rank(pixel) < rank(nearest));
            if nearer && is_candidate(view, settings, pixel) {
                nearest = Some(pixel);
            }
        }
    }
    let nearest = nearest?;
    let centre_world = view.camera.centre_world();
    let ray = view.camera.ray_world(&nearest.centre())?;
    let normalised = view.camera.normalised(&nearest.centre())?;
    let k = settings.normal_window().half_side_pixels(view.camera.width(), view.camera.height()) as i32;
    let mut sum = Vector2::zeros();
    for dy in -k..=k {
        for dx in -k..=k {
            let pixel = Pixel { column: nearest.column + dx, row: nearest.row + dy };
            if is_candidate(view, settings, pixel) {
                sum += Vector2::new(f64::from(dx), f64::from(dy));
            }
        }
    }
    let m = if sum == Vector2::zeros() { nearest.centre() - start.centre() } else { sum };
    Some(BruteEdge {
        camera,
        pixel: nearest,
        distance_m: (a - centre_world).cross(&ray).norm(),
        normal_world: view.camera.hull_normal_world(&normalised, &m)?,
    })
}

/// The first `t` at which the hull rule no longer says inside: marched, then bisected.
pub fn exit(
    views: &[DenseView],
    settings: &ProbeSettings,
    a: &Point3<f64>,
    n: &Vector3<f64>,
    march_m: f64,
) -> Option<f64> {
    let inside = |t: f64| is_inside(views, settings, &(a + n * t));
    let steps = (settings.max_depth_m() / march_m).ceil() as u64;
    for step in 1..=steps {
        let t = (step as f64 * march_m).min(settings.max_depth_m());
        if inside(t) {
            continue;
        }
        let (mut low, mut high) = ((step - 1) as f64 * march_m, t);
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if inside(middle) { low = middle } else { high = middle }
        }
        return Some(high);
    }
    None
}
