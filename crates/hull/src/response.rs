//! Point vectors to one body vector (paper §5, spec §4).

use nalgebra::Vector3;

/// Below this length, metres, the mean of the point responses has no direction.
const VANISHING_M: f64 = 1e-6;

/// The direction in which a body is moved out, from the responses `w = t n` of its points in sample
/// order.
#[derive(Clone, Copy, Debug, Default)]
pub struct BodyDirection {
    sum: Vector3<f64>,
    count: u32,
    longest: Option<(f64, Vector3<f64>)>,
}

impl BodyDirection {
    /// Adds a point's response, metres.
    pub fn add(&mut self, response_m: [f64; 3]) {
        let response = Vector3::from(response_m);
        self.sum += response;
        self.count += 1;
        let squared = response.norm_squared();
        if self.longest.is_none_or(|(most, _)| squared > most) {
            self.longest = Some((squared, response));
        }
    }

    /// The unit direction of the mean; if it vanishes, that of the longest response (ties: the first).
    /// `None` without any response.
    pub fn unit(&self) -> Option<[f32; 3]> {
        let mean = self.sum / f64::from(self.count.max(1));
        let chosen = if mean.norm() < VANISHING_M { self.longest?.1 } else { mean };
        let length = chosen.norm();
        (length > 0.0).then(|| {
            let unit = chosen / length;
            [unit.x as f32, unit.y as f32, unit.z as f32]
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn body_direction(responses_m: &[[f64; 3]]) -> Option<[f32; 3]> {
        let mut direction = BodyDirection::default();
        responses_m.iter().for_each(|&response_m| direction.add(response_m));
        direction.unit()
    }

    #[test]
    fn the_mean_gives_the_direction() {
        let direction = body_direction(&[[0.1, 0.0, 0.0], [0.0, 0.1, 0.0]]).expect("two responses");
        assert!((direction[0] - direction[1]).abs() < 1e-7 && direction[2] == 0.0);
    }

    #[test]
    fn opposite_responses_leave_the_longest_then_the_first() {
        assert_eq!(body_direction(&[[0.1, 0.0, 0.0], [-0.1, 0.0, 0.0]]), Some([1.0, 0.0, 0.0]));
        assert_eq!(body_direction(&[[0.1, 0.0, 0.0], [-0.1000001, 0.0, 0.0]]), Some([-1.0, 0.0, 0.0]));
        assert_eq!(body_direction(&[]), None);
    }
}
