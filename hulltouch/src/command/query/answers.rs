//! The answers' JSON form.

use hull::Rig;
use hull::pass::{InsideSample, PaperResult};
use serde::Serialize;

use super::points::PointsFile;

/// All answers. Numbers are printed so that they read back as the same bits.
#[derive(Debug, Serialize)]
pub struct Answers<'a> {
    /// In the order of the file.
    points: Vec<PointAnswer<'a>>,
    /// In order of first appearance.
    bodies: Vec<BodyAnswer<'a>>,
}

/// What is said of one point.
#[derive(Clone, Debug, Serialize)]
#[serde(untagged)]
enum PointAnswer<'a> {
    Outside {
        inside: bool,
    },
    /// All but `inside` are null if no camera has a background pixel to be nearest.
    Inside {
        inside: bool,
        camera: Option<&'a str>,
        /// Column and row.
        pixel: Option<[i32; 2]>,
        /// From the point to the surface, metres.
        distance: Option<f64>,
        /// Of unit length, world.
        normal: Option<[f64; 3]>,
        /// Metres, world; null without an exit within the search depth.
        response: Option<[f64; 3]>,
    },
}

/// What is said of one body.
#[derive(Debug, Serialize)]
struct BodyAnswer<'a> {
    body: &'a str,
    /// How many of its points are inside.
    inside: usize,
    /// Metres, world; null where there is none.
    response: Option<[f64; 3]>,
}

impl Answers<'_> {
    /// How many bodies have names.
    pub fn body_count(&self) -> usize {
        self.bodies.len()
    }
}

/// The answers from the pass's results, one a group of the file.
pub fn answers<'a>(rig: &'a Rig, file: &'a PointsFile, results: &[PaperResult]) -> Answers<'a> {
    let mut points = vec![PointAnswer::Outside { inside: false }; file.points_m.len()];
    let mut bodies = Vec::new();
    for ((name, indices), result) in file.groups.iter().zip(results) {
        for found in &result.inside {
            points[indices[found.sample as usize]] = inside(rig, found);
        }
        if let Some(body) = name {
            let inside = result.inside.len();
            bodies.push(BodyAnswer { body, inside, response: result.response_m.ok() });
        }
    }
    Answers { points, bodies }
}

fn inside<'a>(rig: &'a Rig, found: &InsideSample) -> PointAnswer<'a> {
    let edge = found.edge;
    PointAnswer::Inside {
        inside: true,
        camera: edge.map(|edge| rig.cameras()[usize::from(edge.camera)].name()),
        pixel: edge.map(|edge| [edge.pixel.column, edge.pixel.row]),
        distance: edge.map(|edge| f64::from(edge.distance_m)),
        normal: edge.map(|edge| edge.normal_world.map(f64::from)),
        response: found.response_m(),
    }
}
