//! The paper's text done literally on dense masks: square windows that grow at speeds d_max / d, and
//! rays walked pixel by pixel. The baseline of the benchmarks; it finds nearly the same edges (§4.2 is
//! exact only up to a window), so it is no oracle.

use nalgebra::{Point2, Point3, Vector2, Vector3};

use super::DenseView;
use crate::camera::Pixel;

/// Paper §4.1: foreground in every camera.
pub fn is_inside(views: &[DenseView], point: &Point3<f64>) -> bool {
    views.iter().all(|view| view.camera.pixel(point).is_some_and(|pixel| view.is_foreground(pixel)))
}

/// Paper §4.2: the vector from `a` to the hull's surface along the surface's normal; `None` if `a` is
/// outside or no surface is within `max_depth_m`.
pub fn response(views: &[DenseView], a: &Point3<f64>, window: i32, max_depth_m: f64) -> Option<Vector3<f64>> {
    if !is_inside(views, a) {
        return None;
    }
    let (camera, edge) = grow_windows(views, a)?;
    let normal = normal(&views[camera], edge, a, window)?;
    let depth = exit_along(views, a, &normal, max_depth_m)?;
    Some(normal * depth)
}

/// Paper §5: the exit along a given direction, metres.
pub fn exit_along(
    views: &[DenseView],
    a: &Point3<f64>,
    direction: &Vector3<f64>,
    max_depth_m: f64,
) -> Option<f64> {
    // The search line grows by the least step that moves the point a pixel in some camera.
    let step = views.iter().filter_map(|view| metres_per_pixel(view, a)).fold(f64::INFINITY, f64::min);
    let mut t = 0.0;
    while t <= max_depth_m {
        t += step;
        if !is_inside(views, &(a + direction * t)) {
            return Some(t);
        }
    }
    None
}

/// The camera and background pixel that growing windows meet first.
fn grow_windows(views: &[DenseView], a: &Point3<f64>) -> Option<(usize, Pixel)> {
    let starts: Vec<Pixel> = views.iter().map(|view| view.camera.pixel(a)).collect::<Option<_>>()?;
    let spans: Vec<f64> = views.iter().map(|view| metres_per_pixel(view, a)).collect::<Option<_>>()?;
    let widest = spans.iter().copied().fold(0.0, f64::max);
    let mut reach = vec![0i32; views.len()];
    let mut sizes = vec![0.0f64; views.len()];
    for _ in 0..10_000 {
        for camera in 0..views.len() {
            sizes[camera] += widest / spans[camera];
            while f64::from(reach[camera] + 1) <= sizes[camera] {
                reach[camera] += 1;
                if let Some(pixel) = background_on_ring(&views[camera], starts[camera], reach[camera]) {
                    return Some((camera, pixel));
                }
            }
        }
    }
    None
}

/// A background pixel on the border of a square window, if any.
fn background_on_ring(view: &DenseView, centre: Pixel, reach: i32) -> Option<Pixel> {
    for across in -reach..=reach {
        for (dx, dy) in [(across, -reach), (across, reach), (-reach, across), (reach, across)] {
            let pixel = Pixel { column: centre.column + dx, row: centre.row + dy };
            if !view.is_foreground(pixel) {
                return Some(pixel);
            }
        }
    }
    None
}

/// The smallest distance between `a` and the rays of the pixels below and to the right of its own.
fn metres_per_pixel(view: &DenseView, a: &Point3<f64>) -> Option<f64> {
    let image = view.camera.project(a)?;
    let centre = view.camera.centre_world();
    let to = |du: f64, dv: f64| {
        let ray = view.camera.ray_world(&Point2::new(image.x + du, image.y + dv))?;
        Some((a - centre).cross(&ray).norm())
    };
    Some(to(1.0, 0.0)?.min(to(0.0, 1.0)?))
}

/// The average vector to the background pixels of the window, back-projected.
fn normal(view: &DenseView, edge: Pixel, a: &Point3<f64>, window: i32) -> Option<Vector3<f64>> {
    let mut sum = Vector2::zeros();
    for dy in -window..=window {
        for dx in -window..=window {
            if !view.is_foreground(Pixel { column: edge.column + dx, row: edge.row + dy }) {
                sum += Vector2::new(f64::from(dx), f64::from(dy));
            }
        }
    }
    if sum == Vector2::zeros() {
        sum = edge.centre() - view.camera.pixel(a)?.centre();
    }
    view.camera.hull_normal_world(&view.camera.normalised(&edge.centre())?, &sum)
}
