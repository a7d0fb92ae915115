//! The paper's response (§4 and §5): exits of samples along their normals, then of bodies along their samples' mean.

mod body_exits;
mod exits;
mod result;

pub use result::{InsideSample, NoResponse, PaperResult};

use super::PassBody;
use super::found::FoundSample;
use body_exits::Along;

/// What the rounds of the paper's response know of the bodies of a pass.
#[derive(Clone, Debug, Default)]
pub(super) struct Paper {
    /// One for each body; there may be buffers of more.
    bodies: Vec<PaperBody>,
}

#[derive(Clone, Debug)]
struct PaperBody {
    /// Of each sample inside the exit along its edge's normal, metres.
    exits_m: Vec<Option<f32>>,
    direction: Option<[f32; 3]>,
    longest_m: f32,
    has_exits: bool,
    /// What the response leaves inside has been counted.
    is_checked: bool,
    /// Of each sample inside.
    along: Vec<Along>,
    response_m: Result<[f64; 3], NoResponse>,
    left_inside: usize,
}

impl Default for PaperBody {
    fn default() -> PaperBody {
        PaperBody {
            exits_m: Vec::new(),
            direction: None,
            longest_m: 0.0,
            has_exits: true,
            is_checked: false,
            along: Vec::new(),
            response_m: Err(NoResponse::Clear),
            left_inside: 0,
        }
    }
}

impl PaperBody {
    /// The buffers, for another body.
    fn restart(&mut self) {
        let PaperBody { mut exits_m, mut along, .. } = std::mem::take(self);
        exits_m.clear();
        along.clear();
        *self = PaperBody { exits_m, along, ..PaperBody::default() };
    }
}

impl Paper {
    /// Begins a pass over so many bodies.
    pub fn restart(&mut self, count: usize) {
        if self.bodies.len() < count {
            self.bodies.resize_with(count, PaperBody::default);
        }
        self.bodies[..count].iter_mut().for_each(PaperBody::restart);
    }

    /// The classes are known: no sample inside has an exit yet.
    pub fn begin(&mut self, bodies: &[PassBody]) {
        for (paper, body) in self.bodies.iter_mut().zip(bodies) {
            paper.exits_m.clear();
            paper.exits_m.resize(body.found.len(), None);
        }
    }

    /// Writes what was found for a body.
    pub fn conclude(&self, index: usize, found: &[FoundSample], result: &mut PaperResult) {
        let PaperBody { exits_m, response_m, left_inside, .. } = &self.bodies[index];
        result.inside.clear();
        let inside = |(found, &exit_m): (&FoundSample, &Option<f32>)| InsideSample {
            sample: found.sample,
            inside_count: found.inside_count,
            edge: found.edge,
            exit_m,
        };
        result.inside.extend(found.iter().zip(exits_m).map(inside));
        (result.response_m, result.left_inside) = (*response_m, *left_inside);
    }
}
