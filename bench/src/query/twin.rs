//! The slow twin on some of the planes of a contact pass.

use hull::oracle::brute;
use hull::pass::{BodyResult, SamplePlane};
use hull::question::{Edge, Points};
use nalgebra::{Point3, Vector3};

use crate::loads::Studio;
use crate::passes::{ContactBody, Passes, world_points};

/// Pixels that the twin looks at, one point after the other.
const PIXELS: usize = 1 << 28;
/// The exits of the twin are not used: its rays make one step.
const MARCH_M: f64 = 10.0;
/// Distances differ by no more, metres, and so do normals: they travel in single precision.
const SAME: f64 = 2e-6;
/// Around bodies planes are asked for within a reach of 0.14 m. Of a plane farther than this, metres, ours may be of
/// another camera than the twin's, but no farther away.
const AROUND_M: f64 = 0.12;

/// Compares some of the planes that a pass found for these bodies with the twin's; returns how many, and the first that
/// differs.
pub fn check_planes(studio: &Studio, bodies: &[ContactBody], asked: &Passes) -> (usize, Option<String>) {
    let (width, height) = (studio.dense[0].camera.width() as usize, studio.dense[0].camera.height() as usize);
    let most = (PIXELS / (studio.dense.len() * width * height)).max(1);
    let of_body = |points: &Points, found: &[SamplePlane]| -> Vec<(Point3<f64>, Edge)> {
        let places = world_points(points);
        found.iter().filter_map(|of| Some((places[of.sample as usize], of.plane?))).collect()
    };
    let (mut inside, mut around) = (Vec::new(), Vec::new());
    for (body, result) in bodies.iter().zip(asked.pass.results().iter().filter_map(BodyResult::planes)) {
        inside.extend(of_body(&body.probes, &result.samples));
        around.extend(body.around.iter().flat_map(|points| of_body(points, &result.around)));
    }
    let some = |found: Vec<(Point3<f64>, Edge)>| {
        let step = (found.len() / most).max(1);
        found.into_iter().step_by(step).take(most)
    };
    let chosen: Vec<_> = some(inside).chain(some(around)).collect();
    let wrong = chosen.iter().find(|(point, edge)| !is_twins(studio, point, edge));
    let failed =
        wrong.map(|(point, edge)| format!("the slow twin finds another plane than {edge:?} near {point}"));
    (chosen.len(), failed)
}

/// True if the twin finds the same plane, or in another camera one as near.
fn is_twins(studio: &Studio, point: &Point3<f64>, edge: &Edge) -> bool {
    let found_m = f64::from(edge.distance_m);
    let outside = brute::plane_from_outside(&studio.dense, &studio.settings, point);
    if let Some(far) = outside.as_ref().filter(|far| far.distance_m < -AROUND_M) {
        return found_m >= far.distance_m - SAME;
    }
    let twin = outside.or_else(|| brute::point(&studio.dense, &studio.settings, point, MARCH_M)?.edge);
    let Some(mut twin) = twin else { return false };
    if (twin.distance_m - found_m).abs() > SAME {
        return false;
    }
    if (twin.camera, twin.pixel) != (usize::from(edge.camera), edge.pixel) {
        return true;
    }
    let view = &studio.dense[twin.camera];
    if found_m > 0.0 {
        let normal = view
            .camera
            .pixel(point)
            .and_then(|start| brute::plane_normal(view, &studio.settings, start, twin.pixel));
        let Some(normal) = normal else { return false };
        twin.normal_world = normal;
    }
    (twin.normal_world - Vector3::from(edge.normal_world.map(f64::from))).norm() < SAME
}
