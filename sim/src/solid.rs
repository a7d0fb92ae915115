//! The geometry of a body: what the solver collides, the samples cover and a renderer draws.

use nalgebra::Vector3;
use rapier3d::parry::transformation::try_convex_hull;
use rapier3d::prelude::Vector;
use std::sync::Arc;
use thiserror::Error;

/// No dimension of a solid is smaller, metres: the solver's tolerances are millimetres.
pub const MIN_EXTENT_M: f64 = 0.01;
/// No dimension of a solid is larger, metres: keeps the number of samples in bounds.
pub const MAX_EXTENT_M: f64 = 5.0;
/// The most points a convex hull may be given.
pub const MAX_HULL_POINTS: usize = 256;

/// A convex solid in its body frame, metres. The axis of a capsule, cylinder or cone is body Y; the
/// origin is half-way up, and for [`Solid::Hull`] where its points have it.
#[derive(Clone, Debug, PartialEq)]
pub enum Solid {
    /// A box.
    Box {
        /// Edge lengths along body x, y, z.
        size_m: [f64; 3],
    },
    /// A ball.
    Ball {
        /// Its radius.
        radius_m: f64,
    },
    /// A cylinder with a half ball on either end.
    Capsule {
        /// Radius of cylinder and balls.
        radius_m: f64,
        /// From ball centre to ball centre.
        length_m: f64,
    },
    /// A cylinder.
    Cylinder {
        /// Its radius.
        radius_m: f64,
        /// From disc to disc.
        height_m: f64,
    },
    /// A cone; its tip is at +Y.
    Cone {
        /// Radius of the base.
        radius_m: f64,
        /// From base to tip.
        height_m: f64,
    },
    /// The convex hull of points.
    Hull(Arc<ConvexHull>),
}

/// A convex polyhedron as triangles.
#[derive(Clone, Debug, PartialEq)]
pub struct ConvexHull {
    points_m: Vec<[f64; 3]>,
    corners_m: Vec<[f64; 3]>,
    triangles: Vec<[usize; 3]>,
}

/// Why points have no convex hull that could be a body.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
pub enum HullError {
    /// Too few points, or too many.
    #[error("{found} points, expected 4 to {MAX_HULL_POINTS}")]
    PointCount {
        /// Number of points.
        found: usize,
    },
    /// A coordinate that is none, or too far out.
    #[error("a coordinate of {found}, expected metres within ±{MAX_EXTENT_M}")]
    Coordinate {
        /// The number.
        found: f64,
    },
    /// The points lie in a plane, or nearly.
    #[error(
        "points at most {found_m:.4} m apart in one direction, expected {MIN_EXTENT_M} m or more in every one"
    )]
    Flat {
        /// The least extent that was found.
        found_m: f64,
    },
}

impl ConvexHull {
    /// The hull of at least four points that do not lie in a plane, body frame, metres.
    pub fn new(points_m: &[[f64; 3]]) -> Result<ConvexHull, HullError> {
        if points_m.len() < 4 || points_m.len() > MAX_HULL_POINTS {
            return Err(HullError::PointCount { found: points_m.len() });
        }
        if let Some(&found) = points_m.iter().flatten().find(|c| !(-MAX_EXTENT_M..=MAX_EXTENT_M).contains(*c))
        {
            return Err(HullError::Coordinate { found });
        }
        // Faces of less than a square micrometre tell no extent.
        let found_m = least_side_m(points_m);
        if found_m < MIN_EXTENT_M {
            return Err(HullError::Flat { found_m });
        }
        let points: Vec<Vector> = points_m.iter().map(|p| Vector::from_array(p.map(|c| c as f32))).collect();
        let (corners, triangles) = try_convex_hull(&points).map_err(|_| HullError::Flat { found_m: 0.0 })?;
        let hull = ConvexHull {
            points_m: points_m.to_vec(),
            corners_m: corners.iter().map(|c| c.to_array().map(f64::from)).collect(),
            triangles: triangles.iter().map(|t| t.map(|index| index as usize)).collect(),
        };
        let found_m = hull.least_extent_m();
        if found_m < MIN_EXTENT_M {
            return Err(HullError::Flat { found_m });
        }
        Ok(hull)
    }

    /// The points it was made of: made of them again it is the same, bit for bit.
    pub fn points_m(&self) -> &[[f64; 3]] {
        &self.points_m
    }

    /// The corners, body frame, metres.
    pub fn corners_m(&self) -> &[[f64; 3]] {
        &self.corners_m
    }

    /// Corner indices of every triangle, counter-clockwise from outside.
    pub fn triangles(&self) -> &[[usize; 3]] {
        &self.triangles
    }

    /// The corners of every triangle, body frame, metres.
    pub fn triangle_corners_m(&self) -> impl Iterator<Item = [Vector3<f64>; 3]> + '_ {
        self.triangles.iter().map(|t| t.map(|index| Vector3::from(self.corners_m[index])))
    }

    /// The least extent across any face.
    fn least_extent_m(&self) -> f64 {
        let across = |[a, b, c]: [Vector3<f64>; 3]| {
            let normal = (b - a).cross(&(c - a)).try_normalize(1e-12)?;
            Some(self.corners_m.iter().map(|p| normal.dot(&(a - Vector3::from(*p)))).fold(0.0, f64::max))
        };
        self.triangle_corners_m().filter_map(across).reduce(f64::min).unwrap_or_default()
    }
}

/// The shortest side of the box around points, metres.
fn least_side_m(points_m: &[[f64; 3]]) -> f64 {
    let side_m = |axis: usize| {
        let along = || points_m.iter().map(|point| point[axis]);
        along().fold(f64::NEG_INFINITY, f64::max) - along().fold(f64::INFINITY, f64::min)
    };
    (0..3).map(side_m).fold(f64::INFINITY, f64::min)
}

impl Solid {
    /// How far the solid reaches from its origin along a unit vector of the body frame, metres.
    pub fn reach_m(&self, direction_body: Vector3<f64>) -> f64 {
        let d = direction_body;
        let level = (d.x * d.x + d.z * d.z).sqrt();
        match self {
            Solid::Box { size_m: [x, y, z] } => 0.5 * (x * d.x.abs() + y * d.y.abs() + z * d.z.abs()),
            Solid::Ball { radius_m } => *radius_m,
            Solid::Capsule { radius_m, length_m } => 0.5 * length_m * d.y.abs() + radius_m,
            Solid::Cylinder { radius_m, height_m } => 0.5 * height_m * d.y.abs() + radius_m * level,
            Solid::Cone { radius_m, height_m } => {
                (0.5 * height_m * d.y).max(radius_m * level - 0.5 * height_m * d.y)
            }
            Solid::Hull(hull) => {
                let along = hull.corners_m.iter().map(|corner| d.dot(&Vector3::from(*corner)));
                along.fold(f64::NEG_INFINITY, f64::max)
            }
        }
    }

    /// No point of the solid is farther than this from its origin, metres.
    pub fn radius_m(&self) -> f64 {
        match self {
            Solid::Box { size_m } => 0.5 * Vector3::from(*size_m).norm(),
            Solid::Ball { radius_m } => *radius_m,
            Solid::Capsule { radius_m, length_m } => 0.5 * length_m + radius_m,
            Solid::Cylinder { radius_m, height_m } | Solid::Cone { radius_m, height_m } => {
                (0.25 * height_m * height_m + radius_m * radius_m).sqrt()
            }
            Solid::Hull(hull) => {
                hull.corners_m.iter().map(|corner| Vector3::from(*corner).norm()).fold(0.0, f64::max)
            }
        }
    }

    /// What a scene file calls this kind of solid.
    pub fn kind(&self) -> &'static str {
        match self {
            Solid::Box { .. } => "box",
            Solid::Ball { .. } => "ball",
            Solid::Capsule { .. } => "capsule",
            Solid::Cylinder { .. } => "cylinder",
            Solid::Cone { .. } => "cone",
            Solid::Hull(_) => "hull",
        }
    }

    /// Whether the solid is round somewhere, so that it rolls.
    pub(crate) fn rolls(&self) -> bool {
        self.has_axis() || matches!(self, Solid::Ball { .. })
    }

    /// Whether body Y is the solid's own axis, which stands upright unless the scene turns it.
    pub(crate) fn has_axis(&self) -> bool {
        matches!(self, Solid::Capsule { .. } | Solid::Cylinder { .. } | Solid::Cone { .. })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cube_corners() -> Vec<[f64; 3]> {
        (0..8).map(|i| [i & 1, i >> 1 & 1, i >> 2].map(|bit| 0.2 * f64::from(bit) - 0.1)).collect()
    }

    #[test]
    fn a_hull_leaves_inner_points_out_and_faces_outwards() {
        let mut points = cube_corners();
        points.push([0.0, 0.01, 0.02]);
        let hull = ConvexHull::new(&points).expect("a cube");
        assert_eq!((hull.corners_m().len(), hull.triangles().len()), (8, 12));
        for [a, b, c] in hull.triangle_corners_m() {
            assert!((b - a).cross(&(c - a)).dot(&a) > 0.0);
        }
    }

    #[test]
    fn flat_or_wild_points_make_no_hull() {
        let flat: Vec<_> = cube_corners().into_iter().map(|[x, y, z]| [x, 0.01 * y, z]).collect();
        assert!(matches!(ConvexHull::new(&flat), Err(HullError::Flat { .. })));
        assert!(matches!(ConvexHull::new(&[[0.0; 3]; 8]), Err(HullError::Flat { .. })));
        for size in [1e-3, 1e-6, 1e-9, 1e-30] {
            let tiny: Vec<_> = cube_corners().into_iter().map(|corner| corner.map(|m| m * size)).collect();
            assert!(matches!(ConvexHull::new(&tiny), Err(HullError::Flat { .. })), "{size}");
        }
        assert!(matches!(ConvexHull::new(&flat[..3]), Err(HullError::PointCount { found: 3 })));
        let mut wild = cube_corners();
        wild[3][1] = f64::NAN;
        assert!(matches!(ConvexHull::new(&wild), Err(HullError::Coordinate { .. })));
    }

    #[test]
    fn reach_is_that_of_the_geometry() {
        let diagonal = Vector3::new(1.0, 1.0, 0.0).normalize();
        let half = 0.5f64.sqrt();
        let hull = Solid::Hull(Arc::new(ConvexHull::new(&cube_corners()).expect("a cube")));
        for (solid, expected) in [
            (Solid::Box { size_m: [0.2; 3] }, 0.2 * half),
            (hull, 0.2 * half),
            (Solid::Ball { radius_m: 0.1 }, 0.1),
            (Solid::Capsule { radius_m: 0.1, length_m: 0.2 }, 0.1 + 0.1 * half),
            (Solid::Cylinder { radius_m: 0.1, height_m: 0.2 }, 0.2 * half),
            (Solid::Cone { radius_m: 0.1, height_m: 0.2 }, 0.1 * half),
        ] {
            assert!((solid.reach_m(diagonal) - expected).abs() < 1e-7, "{solid:?}");
            assert!(solid.radius_m() + 1e-12 >= solid.reach_m(-diagonal), "{solid:?}");
        }
    }
}
