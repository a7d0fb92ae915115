//! Which way a solid's surface faces at its samples: on edges and at corners every face counts.

use crate::solid::Solid;
use hull::Shape;
use hull::body::BodyError;
use hull::faces::FaceNormals;
use nalgebra::Vector3;

/// A sample that is no farther than this from a face lies on it, metres: samples are rounded to `f32`.
const ON_FACE_M: f64 = 1e-5;
/// Faces whose normals agree so well are one: the triangles of a flat side.
const SAME_FACE: f64 = 0.999;

/// The outward unit normals of all faces on which each sample of a solid's shape lies.
pub fn face_normals(solid: &Solid, shape: &Shape) -> FaceNormals {
    let mut faces = FaceNormals::default();
    for sample in shape.samples_body() {
        let at = Vector3::from(sample.map(f64::from));
        let mut normals_body = Vec::new();
        add_faces(solid, at, &mut normals_body);
        let is_known = !normals_body.is_empty();
        if !is_known {
            // Rounding only: away from the middle.
            normals_body.push(at.try_normalize(0.0).unwrap_or_default());
        }
        match normals_body[..] {
            [normal] if is_known && is_flat(solid, &normal) => faces.push_flat(normal),
            _ => faces.push(normals_body),
        }
    }
    faces
}

/// Whether the face of a solid that looks there is flat: the sides of what is round are not.
fn is_flat(solid: &Solid, normal: &Vector3<f64>) -> bool {
    match solid {
        Solid::Box { .. } | Solid::Hull(_) => true,
        Solid::Cylinder { .. } | Solid::Cone { .. } => normal.x == 0.0 && normal.z == 0.0,
        Solid::Ball { .. } | Solid::Capsule { .. } => false,
    }
}

/// The samples of a shape, and after them each of them again so far out along the sum of its faces' normals, metres.
pub fn with_offset_samples(faces: &FaceNormals, shape: &Shape, out_m: f64) -> Result<Shape, BodyError> {
    let samples = shape.samples_body();
    let offset = samples.iter().enumerate().map(|(index, sample)| {
        let out = faces.at(index).iter().sum::<Vector3<f64>>() * out_m;
        std::array::from_fn(|axis| (f64::from(sample[axis]) + out[axis]) as f32)
    });
    Shape::new(samples.iter().copied().chain(offset).collect())
}

/// Adds the normals of the faces on which a point of the surface lies.
fn add_faces(solid: &Solid, p: Vector3<f64>, normals: &mut Vec<Vector3<f64>>) {
    let level = Vector3::new(p.x, 0.0, p.z);
    let caps = |height_m: f64| [(0.5 * height_m, Vector3::y()), (0.5 * height_m, -Vector3::y())];
    let mut add_if = |is_on: bool, normal: Vector3<f64>| {
        if is_on && let Some(normal) = normal.try_normalize(1e-9) {
            normals.push(normal);
        }
    };
    match solid {
        Solid::Box { size_m } => {
            for axis in 0..3 {
                let is_on = p[axis].abs() >= 0.5 * size_m[axis] - ON_FACE_M;
                add_if(is_on, Vector3::ith(axis, p[axis].signum()));
            }
        }
        Solid::Ball { .. } => add_if(true, p),
        Solid::Capsule { length_m, .. } => {
            let y = p.y.clamp(-0.5 * length_m, 0.5 * length_m);
            add_if(true, p - Vector3::new(0.0, y, 0.0));
        }
        Solid::Cylinder { radius_m, height_m } => {
            add_if(level.norm() >= radius_m - ON_FACE_M, level);
            for (reach_m, normal) in caps(*height_m) {
                add_if(p.dot(&normal) >= reach_m - ON_FACE_M, normal);
            }
        }
        Solid::Cone { radius_m, height_m } => {
            let is_on_side = level.norm() >= radius_m * (0.5 - p.y / height_m) - ON_FACE_M;
            let side = level.try_normalize(1e-9).unwrap_or_default() * *height_m + Vector3::y() * *radius_m;
            add_if(is_on_side, side);
            add_if(p.y <= -0.5 * height_m + ON_FACE_M, -Vector3::y());
        }
        Solid::Hull(hull) => {
            let first = normals.len();
            for [a, b, c] in hull.triangle_corners_m() {
                let Some(normal) = (b - a).cross(&(c - a)).try_normalize(1e-12) else { continue };
                let is_new = || normals[first..].iter().all(|other| other.dot(&normal) < SAME_FACE);
                if normal.dot(&(p - a)).abs() <= ON_FACE_M && is_new() {
                    normals.push(normal);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples::shape;
    use crate::solid::ConvexHull;
    use std::sync::Arc;

    fn solids() -> Vec<Solid> {
        let corners = [
            [0.1, 0.0, 0.0],
            [-0.1, 0.0, 0.0],
            [0.0, 0.1, 0.0],
            [0.0, -0.1, 0.0],
            [0.0, 0.0, 0.1],
            [0.0, 0.0, -0.1],
        ];
        vec![
            Solid::Box { size_m: [0.2, 0.3, 0.1] },
            Solid::Ball { radius_m: 0.1 },
            Solid::Capsule { radius_m: 0.05, length_m: 0.2 },
            Solid::Cylinder { radius_m: 0.1, height_m: 0.2 },
            Solid::Cone { radius_m: 0.1, height_m: 0.2 },
            Solid::Hull(Arc::new(ConvexHull::new(&corners).expect("an octahedron"))),
        ]
    }

    #[test]
    fn normals_are_those_of_planes_that_hold_the_solid() {
        for solid in solids() {
            let shape = shape(&solid, 0.03).expect("few samples");
            let normals = face_normals(&solid, &shape);
            for (index, sample) in shape.samples_body().iter().enumerate() {
                let sample = Vector3::from(sample.map(f64::from));
                assert!(!normals.at(index).is_empty());
                for normal in normals.at(index) {
                    assert!((normal.norm() - 1.0).abs() < 1e-9);
                    let gap_m = solid.reach_m(*normal) - normal.dot(&sample);
                    assert!(gap_m.abs() < 1e-4, "{solid:?}: {sample} is {gap_m} m behind its face {normal}");
                }
            }
        }
    }

    #[test]
    fn faces_of_what_is_round_are_flat_at_their_ends_alone() {
        for solid in solids() {
            let is_round = matches!(solid, Solid::Ball { .. } | Solid::Capsule { .. });
            assert_eq!(is_flat(&solid, &Vector3::y()), !is_round, "{solid:?}");
            let is_polyhedron = matches!(solid, Solid::Box { .. } | Solid::Hull(_));
            assert_eq!(is_flat(&solid, &Vector3::x()), is_polyhedron, "{solid:?}");
        }
    }

    #[test]
    fn corners_of_a_box_have_three_faces_and_offset_samples_stand_off_all_of_them() {
        let solid = Solid::Box { size_m: [0.2; 3] };
        let shape = shape(&solid, 0.05).expect("few samples");
        let normals = face_normals(&solid, &shape);
        let corner = shape.samples_body().iter().position(|sample| *sample == [0.1; 3]).expect("a corner");
        assert_eq!(normals.at(corner).len(), 3);
        let count = shape.samples_body().len();
        let with = with_offset_samples(&normals, &shape, 0.01).expect("twice as many");
        assert_eq!(with.samples_body().len(), 2 * count);
        assert_eq!(with.samples_body()[count + corner], [0.11; 3]);
    }
}
