//! Points on a body's surface, dense enough that nothing thicker than a gap slips between (paper §5).
//!
//! The paper asks that neighbouring samples lie close; here that is a guarantee: no point of the
//! surface is farther than the covering radius from a sample. Corners and edges carry samples, since
//! they touch first. Samples are in Morton order: neighbours in memory are neighbours in space.

mod cloud;
pub use cloud::cloud;
mod faces;
mod morton;
pub mod normals;
mod revolved;

use crate::solid::Solid;
use hull::Shape;
use hull::body::{BodyError, MAX_SAMPLES};
use revolved::ProfilePiece;

/// The default covering radius, metres: 250–500 samples on a box of 0.25–0.3 m.
pub const DEFAULT_COVERING_RADIUS_M: f64 = 0.025;

/// Samples are rounded to `f32`; a covering radius is held after that.
const ROUNDING_M: f64 = 1e-6;

/// The samples of a solid in its body frame, as the hull wants them. Fails where the covering radius
/// is so small that there would be more samples than a shape may have.
pub fn shape(solid: &Solid, covering_radius_m: f64) -> Result<Shape, BodyError> {
    let points_body = surface_points(solid, covering_radius_m - ROUNDING_M);
    if points_body.len() > MAX_SAMPLES {
        return Err(BodyError::SampleCount { found: points_body.len() });
    }
    let mut samples_body: Vec<[f32; 3]> = points_body.iter().map(|p| p.map(|c| c as f32)).collect();
    morton::sort(&mut samples_body);
    samples_body.dedup();
    Shape::new(samples_body)
}

/// Points of the surface, none of whose points is farther than `reach_m` from one of them.
fn surface_points(solid: &Solid, reach_m: f64) -> Vec<[f64; 3]> {
    use ProfilePiece::{Arc, Line};
    match solid {
        Solid::Box { size_m } => faces::box_lattice(*size_m, reach_m),
        Solid::Hull(hull) => faces::hull_points(hull, reach_m),
        &Solid::Ball { radius_m } => {
            let top = Arc { centre_y_m: 0.0, radius_m, upper: true };
            revolved::points(&[top, Arc { centre_y_m: 0.0, radius_m, upper: false }], reach_m)
        }
        &Solid::Capsule { radius_m, length_m } => {
            let y = 0.5 * length_m;
            let pieces = [
                Arc { centre_y_m: y, radius_m, upper: true },
                Line { from: [radius_m, y], to: [radius_m, -y] },
                Arc { centre_y_m: -y, radius_m, upper: false },
            ];
            revolved::points(&pieces, reach_m)
        }
        &Solid::Cylinder { radius_m, height_m } => {
            let y = 0.5 * height_m;
            let pieces = [
                Line { from: [0.0, y], to: [radius_m, y] },
                Line { from: [radius_m, y], to: [radius_m, -y] },
                Line { from: [radius_m, -y], to: [0.0, -y] },
            ];
            revolved::points(&pieces, reach_m)
        }
        &Solid::Cone { radius_m, height_m } => {
            let y = 0.5 * height_m;
            let pieces =
                [Line { from: [0.0, y], to: [radius_m, -y] }, Line { from: [radius_m, -y], to: [0.0, -y] }];
            revolved::points(&pieces, reach_m)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::seeded::Seeded;
    use crate::solid::ConvexHull;
    use nalgebra::Vector3;
    use proptest::prelude::*;
    use std::sync::Arc;

    /// A surface point: the point of the surface where a ray from the origin leaves, by bisection on
    /// "inside"; obviously right for every convex solid that holds its origin.
    fn surface_point(solid: &Solid, direction: Vector3<f64>) -> Vector3<f64> {
        let (mut near, mut far) = (0.0, 2.0 * solid.radius_m());
        for _ in 0..60 {
            let middle = 0.5 * (near + far);
            if holds(solid, direction * middle) { near = middle } else { far = middle }
        }
        direction * near
    }

    fn holds(solid: &Solid, p: Vector3<f64>) -> bool {
        let level = (p.x * p.x + p.z * p.z).sqrt();
        match solid {
            Solid::Box { size_m } => (0..3).all(|i| p[i].abs() <= 0.5 * size_m[i]),
            Solid::Ball { radius_m } => p.norm() <= *radius_m,
            Solid::Capsule { radius_m, length_m } => {
                let y = p.y.clamp(-0.5 * length_m, 0.5 * length_m);
                (p - Vector3::new(0.0, y, 0.0)).norm() <= *radius_m
            }
            Solid::Cylinder { radius_m, height_m } => level <= *radius_m && p.y.abs() <= 0.5 * height_m,
            Solid::Cone { radius_m, height_m } => {
                p.y >= -0.5 * height_m && level <= radius_m * (0.5 - p.y / height_m)
            }
            Solid::Hull(hull) => hull
                .triangle_corners_m()
                .all(|[a, b, c]| (b - a).cross(&(c - a)).normalize().dot(&(p - a)) <= 1e-9),
        }
    }

    fn solid_strategy() -> impl Strategy<Value = Solid> {
        let length = || 0.02..0.6f64;
        prop_oneof![
            [length(), length(), length()].prop_map(|size_m| Solid::Box { size_m }),
            length().prop_map(|radius_m| Solid::Ball { radius_m }),
            (length(), length()).prop_map(|(radius_m, length_m)| Solid::Capsule { radius_m, length_m }),
            (length(), length()).prop_map(|(radius_m, height_m)| Solid::Cylinder { radius_m, height_m }),
            (length(), length()).prop_map(|(radius_m, height_m)| Solid::Cone { radius_m, height_m }),
            (length(), any::<u64>()).prop_map(|(size_m, seed)| hull_around_origin(size_m, seed)),
        ]
    }

    /// The corners of an octahedron, so that the origin is inside, and a dozen points more.
    fn hull_around_origin(size_m: f64, seed: u64) -> Solid {
        let mut points_m = vec![];
        for axis in 0..3 {
            for sign in [-1.0, 1.0] {
                let mut corner = [0.0; 3];
                corner[axis] = 0.5 * sign * size_m;
                points_m.push(corner);
            }
        }
        let mut seeded = Seeded::new(seed, "hull");
        points_m.extend((0..12).map(|_| [(); 3].map(|()| 0.5 * size_m * seeded.signed())));
        Solid::Hull(Arc::new(ConvexHull::new(&points_m).expect("a body")))
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(60))]
        #[test]
        fn every_surface_point_has_a_sample_within_the_covering_radius(
            solid in solid_strategy(), radius_m in 0.012..0.06f64, seed in any::<u64>(),
        ) {
            let shape = shape(&solid, radius_m).expect("few samples");
            let samples: Vec<_> =
                shape.samples_body().iter().map(|s| Vector3::from(s.map(f64::from))).collect();
            let mut seeded = Seeded::new(seed, "directions");
            for _ in 0..200 {
                let direction = Vector3::from([(); 3].map(|()| seeded.signed()));
                prop_assume!(direction.norm() > 1e-3);
                let point = surface_point(&solid, direction.normalize());
                let nearest = samples.iter().map(|s| (s - point).norm()).fold(f64::INFINITY, f64::min);
                prop_assert!(nearest <= radius_m, "{solid:?}: {nearest} m from a sample at {point}");
            }
        }

        #[test]
        fn every_sample_lies_on_the_surface(solid in solid_strategy()) {
            let shape = shape(&solid, 0.03).expect("few samples");
            for sample in shape.samples_body() {
                let sample = Vector3::from(sample.map(f64::from));
                let gap = (surface_point(&solid, sample.normalize()) - sample).norm();
                prop_assert!(gap < 2e-6, "{solid:?}: {sample} is {gap} m off the surface");
            }
        }
    }

    #[test]
    fn a_box_of_the_demo_has_250_to_500_samples() {
        for edge_m in [0.25, 0.26, 0.28, 0.3] {
            let count = shape(&Solid::Box { size_m: [edge_m; 3] }, DEFAULT_COVERING_RADIUS_M)
                .expect("a box")
                .samples_body()
                .len();
            assert!((250..=500).contains(&count), "{count} samples on {edge_m} m");
        }
    }

    #[test]
    fn neighbours_in_memory_are_near_each_other() {
        let shape = shape(&Solid::Box { size_m: [0.3; 3] }, 0.025).expect("a box");
        let samples: Vec<_> = shape.samples_body().iter().map(|s| Vector3::from(s.map(f64::from))).collect();
        let mean = samples.windows(2).map(|w| (w[1] - w[0]).norm()).sum::<f64>() / samples.len() as f64;
        assert!(mean < 0.08, "mean step {mean} m");
    }

    #[test]
    fn the_same_solid_gives_the_same_samples() {
        let solid = hull_around_origin(0.3, 5);
        assert_eq!(shape(&solid, 0.025).expect("few").digest(), shape(&solid, 0.025).expect("few").digest());
    }

    #[test]
    fn more_samples_than_a_shape_may_have_are_refused() {
        let error = shape(&Solid::Box { size_m: [5.0; 3] }, 0.005).expect_err("too many");
        assert!(matches!(error, BodyError::SampleCount { .. }));
    }
}
