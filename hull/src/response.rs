//! Point vectors to one body vector (paper §5, spec §4).

use nalgebra::Vector3;

/// Below this length, metres, the mean of the point responses has no direction.
const VANISHING_M: f64 = 1e-6;

/// The unit direction in which a body is moved out: that of the mean of its point responses
/// `w = t n`, in sample order; if the mean vanishes, that of the longest (ties: lower sample). `None`
/// without any response.
pub fn body_direction(responses_m: &[[f64; 3]]) -> Option<[f32; 3]> {
    let mut sum = Vector3::zeros();
    let mut longest: Option<(f64, Vector3<f64>)> = None;
    for response in responses_m {
        let response = Vector3::from(*response);
        sum += response;
        let squared = response.norm_squared();
        if longest.is_none_or(|(most, _)| squared > most) {
            longest = Some((squared, response));
        }
    }
    let mean = sum / responses_m.len().max(1) as f64;
    let chosen = if mean.norm() < VANISHING_M { longest?.1 } else { mean };
    let length = chosen.norm();
    (length > 0.0).then(|| {
        let unit = chosen / length;
        [unit.x as f32, unit.y as f32, unit.z as f32]
    })
}

#[cfg(test)]
mod tests {
    use super::*;

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
