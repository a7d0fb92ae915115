//! OpenCV and NumPy on the very same masks and points, and whether they agree.

use std::cell::RefCell;
use std::path::PathBuf;

use hull::Camera;
use hull::coordinates::Coordinates;
use hull::oracle::DenseView;
use hull::pass::{AROUND_REACH, BodyPlanes, BodyResult, PaperResult, SamplePlane};
use hull::question::{Edge, Points};
use nalgebra::{Point3, Vector3};
use serde::Serialize;
use serde_json::{Value, json};
use setup::cli::{Failure, Outcome};

use super::lanes::{Lane, REPETITION_S};
use crate::loads::{BODY_POINTS, Studio};
use crate::passes::{ContactBody, world_points};
use crate::peers::Peer;

/// The load of contact passes.
pub const TOUCHING: &str = "touching";
/// The points around its bodies.
const AROUND: &str = "touching_around";

/// The program.
pub const SCRIPT: &str = include_str!("../../peers/query.py");
/// A point that projects this near to a pixel's edge may be rounded either way, pixels.
const TIE_PIXELS: f64 = 0.01;
/// Responses agree within a pixel's width at this distance from the cameras, metres,
const PIXEL_AT_M: f64 = stage::RIG_RADIUS_M;
/// and this share of the response's length.
const SAME_SHARE: f64 = 0.1;
/// The transform's nearest pixel is nearly the nearest: its distance may be off by a pixel and this share,
/// and then it may be another pixel with another normal.
const TRANSFORM_SHARE: f64 = 0.03;
/// The least share of points whose responses agree,
const LEAST_AGREEING: f64 = 0.95;
/// and of those that agree or were given another edge as near.
const LEAST_EXPLAINED: f64 = 0.99;
/// Planes agree within a pixel's width and this angle's cosine: 5 degrees.
const SAME_PLANE: f64 = 0.996;
/// The least share of planes that agree, and of those with an edge as near. Their discs reach across thin limbs, ours do
/// not; and around bodies the farthest plane of all cameras wins, so that an error of any camera's transform shows.
const LEAST_PLANES: [f64; 2] = [0.85, 0.9];
/// Numbers of a plane: its normal, the depth of the point below it, how far its edge is.
const PLANE_NUMBERS: usize = 5;

/// How far the two agree.
#[derive(Clone, Debug, Serialize)]
pub struct Agreement {
    /// Of the cameras' images.
    pub size: String,
    /// Name of the load: the points that were asked about.
    pub load: String,
    /// Points compared.
    pub points: usize,
    /// The share of them that agree, 0 to 1.
    pub agreeing: f64,
    /// The rest as far as it is explained: points within rounding of a pixel's edge, or given another edge
    /// that is as near as the transform can tell.
    pub ties: usize,
    /// What was found and expected, if too few agree.
    pub failed: Option<String>,
}

/// OpenCV and NumPy in a process of their own.
pub struct Opponent {
    /// The process; its greeting names its versions.
    pub peer: Peer,
}

impl Opponent {
    /// Hands over the cameras and masks of a studio; points of another are forgotten.
    pub fn show(&mut self, studio: &Studio) -> Outcome {
        let camera = |(index, view): (usize, &DenseView)| {
            let path = self.peer.folder().join(format!("mask_{index}.u8"));
            write(&path, &view.mask)?;
            Ok(described(&view.camera, &path))
        };
        let cameras = studio.dense.iter().enumerate().map(camera).collect::<Outcome<Vec<Value>>>()?;
        self.peer.ask(&json!({
            "do": "frame",
            "cameras": cameras,
            "window_pixels": studio.window_pixels(),
            "max_depth_m": studio.settings.max_depth_m(),
            "around_m": AROUND_REACH.m(),
        }))?;
        Ok(())
    }

    /// Hands over points under a name; full passes take them in bodies of [`BODY_POINTS`].
    pub fn hand_over(&mut self, load: &str, points_world: &Coordinates) -> Outcome {
        self.hand_over_bodies(load, points_world, BODY_POINTS)
    }

    /// Hands over bodies that touch, all of which have as many points.
    pub fn hand_over_touching(&mut self, bodies: &[ContactBody]) -> Outcome {
        let mut hand_over = |load: &str, each: &mut dyn Iterator<Item = &Points>| {
            let all: Coordinates = each.flat_map(world_points).collect();
            self.hand_over_bodies(load, &all, all.len() / bodies.len().max(1))
        };
        hand_over(TOUCHING, &mut bodies.iter().map(|body| &body.probes))?;
        hand_over(AROUND, &mut bodies.iter().filter_map(|body| body.around.as_ref()))
    }

    fn hand_over_bodies(&mut self, load: &str, points_world: &Coordinates, body_points: usize) -> Outcome {
        let path = self.peer.folder().join(format!("{load}.f64"));
        let points = (0..points_world.len()).map(|at| <[f64; 3]>::from(points_world.point(at)));
        let bytes: Vec<u8> = points.flatten().flat_map(f64::to_le_bytes).collect();
        write(&path, &bytes)?;
        self.peer.ask(&json!({"do": "points", "load": load, "file": path, "body_points": body_points}))?;
        Ok(())
    }

    /// An engine of it on points that it has.
    pub fn lane<'a>(opponent: &'a RefCell<Opponent>, engine: &'static str, load: &'static str) -> Lane<'a> {
        Lane::new(engine, move || {
            let request = json!({"do": "measure", "engine": engine, "load": load, "seconds": REPETITION_S});
            let answer = opponent.borrow_mut().peer.ask(&request)?;
            answer["points_per_s"].as_f64().ok_or_else(|| strange("a rate", &answer))
        })
    }

    fn answers(&mut self, load: &str, each: usize) -> Outcome<Vec<f64>> {
        let path = self.peer.folder().join("answers.f64");
        let answer = self.peer.ask(&json!({"do": "answers", "load": load, "file": path}))?;
        let bytes = std::fs::read(&path).map_err(|error| Failure::run(error.to_string()))?;
        let numbers = bytes.chunks_exact(8).filter_map(|chunk| chunk.try_into().ok()).map(f64::from_le_bytes);
        let numbers: Vec<f64> = numbers.collect();
        if answer["points"].as_u64() != Some((numbers.len() / each) as u64) {
            return Err(strange("as many answers as it wrote", &answer));
        }
        Ok(numbers)
    }

    /// Compares the inside test: equal but for points on a pixel's edge.
    pub fn check_inside(
        &mut self,
        studio: &Studio,
        size: &str,
        points_world: &Coordinates,
        inside: &[bool],
    ) -> Outcome<Agreement> {
        let theirs = self.answers("inside", 1)?;
        let differing = || {
            let pairs = inside.iter().zip(&theirs).enumerate();
            let differing = pairs.filter(|(_, (ours, theirs))| **ours != (**theirs != 0.0));
            differing.map(|(at, _)| points_world.point(at))
        };
        let ties = differing().filter(|point| is_tie(&studio.dense, point)).count();
        let wrong = differing().count() - ties;
        let total = inside.len();
        let failed = (wrong > 0 || theirs.len() != total).then(|| {
            format!("{size}, inside: OpenCV says otherwise of {wrong} of {total} points, expected 0")
        });
        Ok(Agreement {
            size: size.to_owned(),
            load: "inside".to_owned(),
            points: total,
            agreeing: 1.0 - (ties + wrong) as f64 / total.max(1) as f64,
            ties,
            failed,
        })
    }

    /// Compares the responses of single points.
    pub fn check_responses(
        &mut self,
        studio: &Studio,
        size: &str,
        load: &str,
        ours: &[BodyResult],
    ) -> Outcome<Agreement> {
        let theirs = self.answers(load, 4)?;
        let pixel_m = PIXEL_AT_M / studio.dense[0].camera.intrinsics()[(0, 0)];
        let (mut points, mut agreeing, mut ties) = (0, 0, 0);
        for (body, result) in ours.iter().map(paper).enumerate() {
            for inside in &result.inside {
                let at = 4 * (body * BODY_POINTS + inside.sample as usize);
                let Some(their) = theirs.get(at..at + 4) else { continue };
                points += 1;
                let agrees = agree(inside.response_m(), &their[..3], pixel_m);
                agreeing += usize::from(agrees);
                ties +=
                    usize::from(!agrees && inside.edge.is_some_and(|edge| as_near(&edge, their[3], pixel_m)));
            }
        }
        Ok(agreement("responses", size, load, points, agreeing, ties))
    }

    /// Compares the planes near the samples, offset samples and points around of bodies that touch.
    pub fn check_planes(
        &mut self,
        studio: &Studio,
        size: &str,
        bodies: &[ContactBody],
        ours: &[BodyResult],
    ) -> Outcome<Agreement> {
        let theirs = self.answers(TOUCHING, PLANE_NUMBERS)?;
        let pixel_m = PIXEL_AT_M / studio.dense[0].camera.intrinsics()[(0, 0)];
        let probes: usize = bodies.iter().map(|body| body.probes.len()).sum();
        let (mut points, mut agreeing, mut ties) = (0, 0, 0);
        let mut compare = |places: &[Point3<f64>], found: &[SamplePlane], first: usize| {
            for of in found {
                let at = PLANE_NUMBERS * (first + of.sample as usize);
                let (Some(edge), Some(their)) = (of.plane, theirs.get(at..at + PLANE_NUMBERS)) else {
                    continue;
                };
                let centre = studio.dense[usize::from(edge.camera)].camera.centre_world();
                let normal = Vector3::from(edge.normal_world.map(f64::from));
                let depth_m = normal.dot(&(centre - places[of.sample as usize]));
                points += 1;
                let turned = normal.dot(&Vector3::new(their[0], their[1], their[2]));
                let agrees = turned >= SAME_PLANE && (depth_m - their[3]).abs() <= pixel_m;
                agreeing += usize::from(agrees);
                ties += usize::from(!agrees && as_near(&edge, their[4], pixel_m));
            }
        };
        let (mut probe, mut around) = (0, probes);
        for (body, result) in bodies.iter().zip(ours.iter().map(planes)) {
            compare(&world_points(&body.probes), &result.samples, probe);
            probe += body.probes.len();
            if let Some(points) = &body.around {
                compare(&world_points(points), &result.around, around);
                around += points.len();
            }
        }
        Ok(agreement("planes", size, TOUCHING, points, agreeing, ties))
    }
}

fn paper(result: &BodyResult) -> &PaperResult {
    result.paper().expect("the load asks for the paper's response")
}

fn planes(result: &BodyResult) -> &BodyPlanes {
    result.planes().expect("the load asks for contacts")
}

/// What was compared, and whether enough of it agrees.
fn agreement(what: &str, size: &str, load: &str, points: usize, agreeing: usize, ties: usize) -> Agreement {
    let share = |count: usize| count as f64 / points.max(1) as f64;
    let [least, explained] = if load == TOUCHING { LEAST_PLANES } else { [LEAST_AGREEING, LEAST_EXPLAINED] };
    let failed = (share(agreeing) < least || share(agreeing + ties) < explained).then(|| {
        format!(
            "{size}, {load}: {:.2} % of OpenCV's {what} agree and {:.2} % are of another edge as near, \
             expected {:.0} % and {:.0} % with both",
            100.0 * share(agreeing),
            100.0 * share(ties),
            100.0 * least,
            100.0 * explained
        )
    });
    Agreement {
        size: size.to_owned(),
        load: load.to_owned(),
        points,
        agreeing: share(agreeing),
        ties,
        failed,
    }
}

/// True if an edge at their distance may have won by the transform's error.
fn as_near(our: &Edge, their_m: f64, pixel_m: f64) -> bool {
    let our_m = f64::from(our.distance_m);
    (our_m - their_m).abs() <= pixel_m + TRANSFORM_SHARE * our_m
}

/// `their` is not a number where there is no response.
fn agree(our: Option<[f64; 3]>, their: &[f64], pixel_m: f64) -> bool {
    let Some(our) = our else { return their.iter().any(|part| part.is_nan()) };
    let squared = |parts: [f64; 3]| parts.iter().map(|part| part * part).sum::<f64>();
    let apart = squared(std::array::from_fn(|axis| our[axis] - their[axis])).sqrt();
    apart <= pixel_m + SAME_SHARE * squared(our).sqrt()
}

/// True if some camera sees the point within rounding of a pixel's edge.
fn is_tie(views: &[DenseView], point: &Point3<f64>) -> bool {
    let near_edge = |part: f64| (part - part.floor() - 0.5).abs() < TIE_PIXELS;
    views
        .iter()
        .any(|view| view.camera.project(point).is_some_and(|image| near_edge(image.x) || near_edge(image.y)))
}

fn described(camera: &Camera, mask: &std::path::Path) -> Value {
    let rows = |matrix: &nalgebra::Matrix3<f64>| matrix.transpose().as_slice().to_vec();
    json!({
        "width": camera.width(),
        "height": camera.height(),
        "matrix": rows(camera.intrinsics()),
        "rotation": rows(camera.rotation()),
        "translation": camera.translation_m().as_slice(),
        "mask": mask,
    })
}

fn write(path: &PathBuf, bytes: &[u8]) -> Outcome {
    std::fs::write(path, bytes).map_err(|error| Failure::unwritable(path, error))
}

fn strange(expected: &str, found: &Value) -> Failure {
    Failure::run(format_args!("the Python program: found {found}, expected {expected}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn responses_agree_within_a_pixel_and_silence_agrees_with_silence() {
        let agree = |our, their: [f64; 3]| agree(our, &their, 0.002);
        assert!(agree(Some([0.02, 0.0, 0.0]), [0.0205, 0.001, 0.0]));
        assert!(!agree(Some([0.02, 0.0, 0.0]), [0.0, 0.02, 0.0]));
        assert!(agree(None, [f64::NAN; 3]) && !agree(None, [0.1, 0.0, 0.0]));
        assert!(!agree(Some([0.02, 0.0, 0.0]), [f64::NAN; 3]));
    }

    #[test]
    fn a_comparison_that_fails_keeps_its_figures() {
        let enough = agreement("planes", "640x480", TOUCHING, 1000, 860, 50);
        assert_eq!((enough.agreeing, enough.failed), (0.86, None));
        let few = agreement("planes", "640x480", TOUCHING, 1000, 700, 50);
        assert_eq!((few.agreeing, few.ties), (0.7, 50));
        let expected = "640x480, touching: 70.00 % of OpenCV's planes agree and 5.00 % are of another edge as near, \
            expected 85 % and 90 % with both";
        assert_eq!(few.failed.as_deref(), Some(expected));
    }
}
