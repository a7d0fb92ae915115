//! Points around a body at which the hull is asked too: motion of a surface along itself shows in what else of it is
//! near, not where the body touches.

use std::f64::consts::PI;

use hull::Shape;

/// How many points a body has around it.
const POINTS: usize = 192;
/// How far from the box around the body they go, metres.
const REACH_M: f64 = 0.3;
/// Of the golden section: points of neighbouring numbers lie far apart.
const GOLDEN_TURN_RAD: f64 = PI * 0.763_932_022_500_210_3;
const GOLDEN_SHARE: f64 = 0.618_033_988_749_894_9;

/// The points, body frame: in all directions, and most of them near.
pub fn cloud(shape: &Shape) -> impl Iterator<Item = [f32; 3]> {
    let (low, high) = shape.bounds_body();
    let of_sides = |pick: fn(f64, f64) -> f64| std::array::from_fn(|axis| pick(low[axis], high[axis]));
    let middle: [f64; 3] = of_sides(|low, high| 0.5 * (low + high));
    let half: [f64; 3] = of_sides(|low, high| (0.5 * (high - low)).max(1e-3));
    (0..POINTS).map(move |index| {
        let y = 1.0 - (2.0 * index as f64 + 1.0) / POINTS as f64;
        let (s, c) = libm::sincos(GOLDEN_TURN_RAD * index as f64);
        let level = (1.0 - y * y).sqrt();
        let direction = [level * c, y, level * s];
        let to_box = (0..3).map(|axis| half[axis] / direction[axis].abs()).fold(f64::INFINITY, f64::min);
        let share = (GOLDEN_SHARE * index as f64).fract();
        let out = to_box + REACH_M * share * share;
        std::array::from_fn(|axis| (middle[axis] + out * direction[axis]) as f32)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_lie_around_the_body_on_every_side() {
        let shape = Shape::new(vec![[-0.1, 0.0, -0.2], [0.1, 0.4, 0.2]]).expect("samples");
        let points: Vec<[f32; 3]> = cloud(&shape).collect();
        assert_eq!(points.len(), POINTS);
        for [x, y, z] in &points {
            let beyond = [x.abs() - 0.1, (y - 0.2).abs() - 0.2, z.abs() - 0.2];
            let out_m = beyond.into_iter().fold(f32::NEG_INFINITY, f32::max);
            assert!((-1e-5..0.3).contains(&out_m), "{x} {y} {z}");
        }
        for axis in 0..3 {
            for sign in [-1.0, 1.0] {
                let middle = [0.0, 0.2, 0.0][axis];
                let beyond = points.iter().filter(|point| sign * (point[axis] - middle) > 0.0).count();
                assert!((75..117).contains(&beyond), "{beyond} along {axis}");
            }
        }
    }
}
