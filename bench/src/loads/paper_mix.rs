//! The paper's own load (§5, §6.1): boxes of 250 to 500 samples in a heap about a person, most samples
//! clear of the hull, some boxes deep in it.

use std::sync::Arc;

use hull::body::{Pose, Shape};
use hull::question::Points;
use setup::cli::{Failure, Outcome};
use sim::Solid;
use sim::samples::{DEFAULT_COVERING_RADIUS_M, shape};

use super::Studio;
use crate::random::Random;

/// Cameras of the paper's studio.
pub const CAMERAS: usize = 7;
/// Their images.
pub const SIZE: (u32, u32) = (640, 480);
/// Boxes of the heap.
const BOXES: usize = 40;
/// Edges of the boxes, metres: at the usual covering radius they carry the paper's 250 to 500 samples.
const EDGES_M: [f64; 3] = [0.25, 0.275, 0.3];
/// How far beyond the person's box the centres of the boxes lie, metres.
const MARGIN_M: f64 = 0.4;

impl Studio {
    /// Boxes at random places and turns.
    pub fn heap(&self, random: &mut Random) -> Outcome<Vec<Points>> {
        let cube = |edge_m: f64| {
            let solid = Solid::Box { size_m: [edge_m; 3] };
            shape(&solid, DEFAULT_COVERING_RADIUS_M).map(Arc::new).map_err(Failure::run)
        };
        let shapes: Vec<Arc<Shape>> = EDGES_M.iter().map(|&edge_m| cube(edge_m)).collect::<Outcome<_>>()?;
        let centres = self.in_box(random, BOXES, MARGIN_M);
        let place = |(index, centre): (usize, [f64; 3])| {
            let turn: [f64; 4] = std::array::from_fn(|_| random.share() - 0.5);
            let length = turn.iter().map(|part| part * part).sum::<f64>().sqrt();
            let pose = Pose::new(centre, turn.map(|part| part / length)).map_err(Failure::run)?;
            Ok(Points::Body { shape: Arc::clone(&shapes[index % shapes.len()]), pose })
        };
        centres.into_iter().enumerate().map(place).collect()
    }
}
