//! Where a round solid touches a plane: at its support point, which lies between samples.
//!
//! The surface about a sample is that of a ball, or of a circle about the axis. What of that lies farthest along a
//! direction is a support point, and no support point of a solid is farther from a sample than the covering radius.

use crate::solid::Solid;
use nalgebra::Vector3;

/// A cylinder or cone that stands on its end, or leans by less than 45 degrees, touches with its samples: sine of the angle
/// between its axis and the direction. The circle's support point would turn about the axis at the slightest lean.
const UPRIGHT: f64 = 0.7;
/// A sample is no farther from where it belongs than this, metres: samples are rounded to `f32`.
const ROUNDED_M: f64 = 1e-5;

impl Solid {
    /// The point that lies farthest along a unit vector on the ball or the circle of the surface on which a sample lies,
    /// body frame, metres. On flat faces it is the sample.
    pub(crate) fn support_of(&self, sample: Vector3<f64>, along: &Vector3<f64>) -> Vector3<f64> {
        match *self {
            Solid::Box { .. } | Solid::Hull(_) => sample,
            Solid::Ball { radius_m } => along * radius_m,
            Solid::Capsule { radius_m, length_m } => {
                let end_m = (0.5 * length_m).copysign(sample.y);
                let is_on_end = sample.y.abs() > end_m.abs() - ROUNDED_M;
                if is_on_end && along.y * end_m > 0.0 {
                    return Vector3::new(0.0, end_m, 0.0) + along * radius_m;
                }
                // On an end whose ball has its support point within the cylinder it is where they meet.
                let y = sample.y.clamp(-end_m.abs(), end_m.abs());
                on_circle(Vector3::new(sample.x, y, sample.z), along, radius_m, 0.0)
            }
            Solid::Cylinder { radius_m, .. } => on_circle(sample, along, radius_m, radius_m),
            Solid::Cone { radius_m, height_m } => {
                let radius_m = radius_m * (0.5 - sample.y / height_m);
                on_circle(sample, along, radius_m, radius_m)
            }
        }
    }
}

/// On a circle about body Y at the height of a sample; one nearer to the axis than `from_m` stays, and so do all where the
/// axis is along the direction.
fn on_circle(sample: Vector3<f64>, along: &Vector3<f64>, radius_m: f64, from_m: f64) -> Vector3<f64> {
    let across = Vector3::new(along.x, 0.0, along.z);
    let is_within = sample.xz().norm() < from_m - ROUNDED_M;
    match across.try_normalize(UPRIGHT) {
        Some(across) if !is_within => Vector3::new(0.0, sample.y, 0.0) + across * radius_m,
        _ => sample,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples::shape;
    use crate::seeded::Seeded;
    use proptest::prelude::*;

    const COVERING_M: f64 = 0.025;

    fn round_solid() -> impl Strategy<Value = Solid> {
        let length = || 0.03..0.4f64;
        prop_oneof![
            length().prop_map(|radius_m| Solid::Ball { radius_m }),
            (length(), length()).prop_map(|(radius_m, length_m)| Solid::Capsule { radius_m, length_m }),
            (length(), length()).prop_map(|(radius_m, height_m)| Solid::Cylinder { radius_m, height_m }),
            (length(), length()).prop_map(|(radius_m, height_m)| Solid::Cone { radius_m, height_m }),
        ]
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(60))]
        #[test]
        fn near_a_sample_is_the_solids_own_support_point_and_none_lies_beyond(
            solid in round_solid(), seed in any::<u64>(),
        ) {
            let shape = shape(&solid, COVERING_M).expect("few samples");
            let mut seeded = Seeded::new(seed, "directions");
            let mut checked = 0;
            for _ in 0..50 {
                let along = Vector3::from([(); 3].map(|()| seeded.signed()));
                let Some(along) = along.try_normalize(1e-3) else { continue };
                if along.xz().norm() <= UPRIGHT {
                    continue;
                }
                checked += 1;
                let supports = shape.samples_body().iter().filter_map(|sample| {
                    let sample = Vector3::from(sample.map(f64::from));
                    let found = solid.support_of(sample, &along);
                    ((found - sample).norm() <= COVERING_M).then(|| found.dot(&along))
                });
                let farthest_m = supports.fold(f64::NEG_INFINITY, f64::max);
                let expected_m = solid.reach_m(along);
                prop_assert!((farthest_m - expected_m).abs() < 1e-5, "{solid:?} {along}: {farthest_m}, {expected_m}");
            }
            prop_assert!(checked > 15, "{checked} directions");
        }
    }

    #[test]
    fn what_is_flat_or_stands_upright_keeps_its_samples() {
        let sample = Vector3::new(0.1, -0.1, 0.0);
        let tilted = Vector3::new(0.6, -0.8, 0.0);
        assert_eq!(Solid::Box { size_m: [0.2; 3] }.support_of(sample, &tilted), sample);
        let cylinder = Solid::Cylinder { radius_m: 0.1, height_m: 0.2 };
        assert_eq!(cylinder.support_of(sample, &-Vector3::y()), sample);
        let within = Vector3::new(0.05, -0.1, 0.0);
        assert_eq!(cylinder.support_of(within, &tilted), within);
    }

    #[test]
    fn a_capsule_stands_on_the_lowest_point_of_its_end() {
        let capsule = Solid::Capsule { radius_m: 0.1, length_m: 0.2 };
        let support = capsule.support_of(Vector3::new(0.06, -0.18, 0.0), &-Vector3::y());
        assert!((support - Vector3::new(0.0, -0.2, 0.0)).norm() < 1e-9, "{support}");
    }
}
