//! What the paper's response needs of a pass: samples inside the hull with their ways out, and what moves a body out.

use crate::question::Edge;

/// What was found for one sample inside the hull.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InsideSample {
    /// The sample's index in its body.
    pub sample: u32,
    /// How many cameras say inside.
    pub inside_count: u32,
    /// The nearest edge; `None` if no camera has one (all its candidates are ignored).
    pub edge: Option<Edge>,
    /// The distance to the exit along the edge's normal, metres.
    pub exit_m: Option<f32>,
}

impl InsideSample {
    /// The sample's response `w`, metres, world; `None` without an exit.
    pub fn response_m(&self) -> Option<[f64; 3]> {
        response_m(self.edge, self.exit_m)
    }
}

/// The response of a sample with that edge and exit.
pub(super) fn response_m(edge: Option<Edge>, exit_m: Option<f32>) -> Option<[f64; 3]> {
    let (edge, exit_m) = (edge?, exit_m?);
    Some(edge.normal_world.map(|n| f64::from(n) * f64::from(exit_m)))
}

/// Why a body has no response.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NoResponse {
    /// The body is clear of the hull.
    Clear,
    /// No sample found its way out along its normal.
    NoDirection,
    /// A sample has no exit along the body's direction within the search depth.
    NoExit,
}

/// What was found for one body.
#[derive(Clone, Debug, PartialEq)]
pub struct PaperResult {
    /// Its samples inside the hull, ascending.
    pub inside: Vec<InsideSample>,
    /// The vector that moves it out, metres, world, or why there is none.
    pub response_m: Result<[f64; 3], NoResponse>,
    /// How many of the samples inside are still inside after the response.
    pub left_inside: usize,
}

impl PaperResult {
    /// Whether no sample is inside the hull.
    pub fn is_clear(&self) -> bool {
        self.inside.is_empty() && self.response_m.is_err()
    }
}

impl Default for PaperResult {
    /// A body that is clear of the hull.
    fn default() -> PaperResult {
        PaperResult { inside: Vec::new(), response_m: Err(NoResponse::Clear), left_inside: 0 }
    }
}
