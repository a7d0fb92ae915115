//! A step whose hull is asked about.

use hull::pass::BodyResult;
use hull::surface::FrameAge;

use super::step::Step;

/// A step whose hull is asked about.
#[derive(Debug)]
pub(super) struct OpenQuestion {
    pub step: Step,
    pub frame: u64,
    pub at: FrameAge,
    /// How many passes were asked before this step.
    pub passes_before: u64,
    /// How often it was asked again without nodes that did not answer.
    pub repeats: usize,
    /// What was found for the moving bodies, one each, if fast ones are asked about once more, back along their ways.
    pub found: Option<Vec<BodyResult>>,
    /// When the pass was asked, seconds; `None` if that asks nothing.
    pub asked_s: Option<f64>,
}

impl OpenQuestion {
    /// Nothing was asked yet.
    pub fn new(step: Step, frame: u64, at: FrameAge, passes_before: u64) -> OpenQuestion {
        OpenQuestion { step, frame, at, passes_before, repeats: 0, found: None, asked_s: None }
    }
}
