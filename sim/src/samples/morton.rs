//! Morton order: samples sorted along a curve that keeps neighbours near each other.

/// Bits per axis of the grid that the curve runs through.
const BITS: u32 = 10;

/// Sorts finite points along the curve through their bounding cube; equal cells by coordinates, so
/// that the result does not depend on the order before.
pub(super) fn sort(points: &mut [[f32; 3]]) {
    let mut low = [f32::INFINITY; 3];
    let mut extent = 0.0f32;
    for axis in 0..3 {
        low[axis] = points.iter().map(|p| p[axis]).fold(f32::INFINITY, f32::min);
        let high = points.iter().map(|p| p[axis]).fold(f32::NEG_INFINITY, f32::max);
        extent = extent.max(high - low[axis]);
    }
    let scale = if extent > 0.0 { ((1 << BITS) - 1) as f32 / extent } else { 0.0 };
    points.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])).then(a[2].total_cmp(&b[2])));
    points.sort_by_cached_key(|point| code(point, &low, scale));
}

/// The interleaved bits of a point's cell.
fn code(point: &[f32; 3], low: &[f32; 3], scale: f32) -> u32 {
    let mut code = 0;
    for axis in 0..3 {
        // Non-negative and below 2^BITS by the choice of `low` and `scale`.
        let cell = ((point[axis] - low[axis]) * scale) as u32;
        for bit in 0..BITS {
            code |= (cell >> bit & 1) << (3 * bit + axis as u32);
        }
    }
    code
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_two_by_two_grid_is_walked_in_a_z() {
        let mut points = [[1.0, 1.0, 0.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]];
        sort(&mut points);
        assert_eq!(points, [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0]]);
    }

    #[test]
    fn one_point_is_sorted() {
        let mut points = [[0.5, 0.5, 0.5]];
        sort(&mut points);
        assert_eq!(points, [[0.5, 0.5, 0.5]]);
    }
}
