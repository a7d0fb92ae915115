//! Samples of solids with flat faces.

use crate::solid::ConvexHull;
use nalgebra::Vector3;

/// The points of an even lattice on a box's faces, edges and corners: a face's lattice cell has its
/// centre no farther than `reach_m` from its corners.
pub(super) fn box_lattice(size_m: [f64; 3], reach_m: f64) -> Vec<[f64; 3]> {
    let steps = size_m.map(|length_m| steps(length_m, reach_m));
    let mut points = vec![];
    for i in 0..=steps[0] {
        for j in 0..=steps[1] {
            let on_side = i == 0 || i == steps[0] || j == 0 || j == steps[1];
            let stride = if on_side { 1 } else { steps[2] };
            for k in (0..=steps[2]).step_by(stride) {
                let index = [i, j, k];
                points.push(core::array::from_fn(|axis| {
                    size_m[axis] * (index[axis] as f64 / steps[axis] as f64 - 0.5)
                }));
            }
        }
    }
    points
}

/// Into how many equal steps of at most `reach_m · √2` (the side of a square whose corners are
/// `reach_m` from its centre) a length is cut.
pub(super) fn steps(length_m: f64, reach_m: f64) -> usize {
    (length_m / (reach_m * core::f64::consts::SQRT_2)).ceil().max(1.0) as usize
}

/// The corners of a polyhedron, and points on every triangle of it.
pub(super) fn hull_points(hull: &ConvexHull, reach_m: f64) -> Vec<[f64; 3]> {
    let mut points = hull.corners_m().to_vec();
    for triangle in hull.triangle_corners_m() {
        triangle_points(&triangle, reach_m, &mut points);
    }
    points
}

/// A square grid is laid over the triangle; each cell's centre is moved to the nearest point of the
/// triangle. Moving to a convex set brings no two points farther apart, so a point of the triangle
/// stays as near to its cell's sample as it was to the centre: half the cell's diagonal, `reach_m`.
fn triangle_points(triangle: &[Vector3<f64>; 3], reach_m: f64, points: &mut Vec<[f64; 3]>) {
    let [a, b, c] = *triangle;
    let Some(x_axis) = (b - a).try_normalize(1e-9) else { return };
    let Some(normal) = (b - a).cross(&(c - a)).try_normalize(1e-12) else { return };
    let y_axis = normal.cross(&x_axis);
    let side_m = reach_m * core::f64::consts::SQRT_2;
    let flat = triangle.map(|p| [x_axis.dot(&(p - a)), y_axis.dot(&(p - a))]);
    let range = |axis: usize| {
        let low = flat.iter().map(|p| p[axis]).fold(f64::INFINITY, f64::min);
        let high = flat.iter().map(|p| p[axis]).fold(f64::NEG_INFINITY, f64::max);
        (low, steps(high - low, reach_m))
    };
    let ((x_low, columns), (y_low, rows)) = (range(0), range(1));
    for row in 0..rows {
        for column in 0..columns {
            let x = x_low + side_m * (column as f64 + 0.5);
            let y = y_low + side_m * (row as f64 + 0.5);
            let centre = a + x_axis * x + y_axis * y;
            let nearest = nearest_on_triangle(centre, triangle);
            if (nearest - centre).norm() <= reach_m * (1.0 + 1e-9) {
                points.push(nearest.into());
            }
        }
    }
}

/// The point of a triangle nearest to a point of its plane.
fn nearest_on_triangle(point: Vector3<f64>, [a, b, c]: &[Vector3<f64>; 3]) -> Vector3<f64> {
    let normal = (b - a).cross(&(c - a));
    let edges = [(a, b), (b, c), (c, a)];
    if edges.iter().all(|(from, to)| normal.dot(&(**to - **from).cross(&(point - **from))) >= 0.0) {
        return point;
    }
    let mut best = (f64::INFINITY, *a);
    for (from, to) in edges {
        let along = to - from;
        let t = (along.dot(&(point - from)) / along.norm_squared()).clamp(0.0, 1.0);
        let foot = from + along * t;
        let squared = (foot - point).norm_squared();
        if squared < best.0 {
            best = (squared, foot);
        }
    }
    best.1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_lattice_holds_corners_and_no_inner_points() {
        let points = box_lattice([0.2, 0.2, 0.2], 0.1);
        assert_eq!(points.len(), 3 * 3 * 3 - 1);
        assert!(points.contains(&[0.1, -0.1, 0.1]));
    }

    #[test]
    fn the_nearest_point_of_a_triangle_is_inside_on_an_edge_or_a_corner() {
        let triangle = [Vector3::zeros(), Vector3::x(), Vector3::y()];
        let nearest = |x, y| nearest_on_triangle(Vector3::new(x, y, 0.0), &triangle);
        assert_eq!(nearest(0.25, 0.25), Vector3::new(0.25, 0.25, 0.0));
        assert_eq!(nearest(0.5, -1.0), Vector3::new(0.5, 0.0, 0.0));
        assert_eq!(nearest(-1.0, -1.0), Vector3::zeros());
        assert!((nearest(1.0, 1.0) - Vector3::new(0.5, 0.5, 0.0)).norm() < 1e-15);
    }
}
