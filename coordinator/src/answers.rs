//! Which poses the hull must be asked about, and which answers of the frame still hold.
//!
//! Several physics steps see one film frame, and a frozen frame answers a pose the same way whenever it
//! is asked. So the answers of the frame in use are kept, each with its body and pose. A step takes those
//! that hold for the poses its bodies have and asks the rest; nothing is kept from frame to frame. While
//! the hull touches nobody, the world's own prediction is exact, and the poses of all steps that share the
//! frame go into one question. Once it touches somebody, that prediction is worth nothing for whoever is
//! pushed, and a question a step is needed anyway: then only present poses are asked.
//!
//! An answer holds for a pose of the same bits: then a run is the same, bit for bit, as one that asks at
//! every step. With `reuse_within_m` above zero, the answer "clear" holds also where no sample can be
//! farther than this from where it was when it was asked. The bound: between two poses each sample moves
//! by an affine function of its place in the body, whose length is convex, so that none moves farther
//! than the farthest corner of the box around all samples. A sample that is inside now was, not farther
//! away than this, outside: no sample deeper than `reuse_within_m` in the hull is ever missed.

use std::collections::VecDeque;
use std::sync::Arc;

use hull::pass::{BodyResult, FIRST_REACH};
use hull::reach::Reach;
use hull::{Pose, Shape};

/// Answers kept a body: more than one question asks, so that none is dropped unused; where one frame is
/// held for long, the oldest go.
const MAX_KNOWN: usize = 16;
/// Poses foreseen in one question: all steps of a frame down to 15 frames/s.
pub(crate) const MAX_STEPS_AHEAD: usize = 7;
/// Samples of foreseen poses in one question, a fifth of what a question may hold: a step never waits for
/// more than a few times its own answers.
const MAX_SAMPLES_AHEAD: usize = 200_000;

/// How often the hull is asked.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Asks {
    /// Once a film frame where nobody is touched, for all steps that share it.
    #[default]
    EachFrame,
    /// At every step, about every body: what the other is measured against.
    EachStep,
}

/// A pose of a moving body to ask the hull about.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Asked {
    /// The body's place among the moving ones.
    pub body: usize,
    /// World from body.
    pub pose: Pose,
    /// How far its edges are worth searching at first.
    pub reach: Reach,
}

/// The answers that one step takes.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct StepAnswers {
    /// One a moving body.
    pub results: Vec<BodyResult>,
    /// How many of them were asked at an earlier step.
    pub reused: usize,
}

/// The hull's answers about the moving bodies at one film frame.
#[derive(Clone, Debug)]
pub(crate) struct Answers {
    asks: Asks,
    reuse_within_m: f64,
    frame: Option<u64>,
    bodies: Vec<BodyAnswers>,
    /// Some body was touched at the last step.
    touched: bool,
    step: u64,
}

#[derive(Clone, Debug)]
struct BodyAnswers {
    shape: Arc<Shape>,
    known: VecDeque<Known>,
    reach: Reach,
}

#[derive(Clone, Debug)]
struct Known {
    pose: Pose,
    result: BodyResult,
    step: u64,
}

impl Answers {
    /// No answers yet about bodies of these shapes.
    pub fn new(shapes: impl Iterator<Item = Arc<Shape>>, asks: Asks, reuse_within_m: f64) -> Answers {
        let body = |shape| BodyAnswers { shape, known: VecDeque::new(), reach: FIRST_REACH };
        let bodies = shapes.map(body).collect();
        Answers { asks, reuse_within_m, frame: None, bodies, touched: false, step: 0 }
    }

    /// Begins a step that sees `frame`: answers of other frames are dropped.
    pub fn begin_step(&mut self, frame: u64) {
        self.step += 1;
        if self.frame != Some(frame) || self.asks == Asks::EachStep {
            self.bodies.iter_mut().for_each(|body| body.known.clear());
        }
        self.frame = Some(frame);
    }

    /// The bodies without an answer for their poses.
    pub fn missing(&self, poses: &[Pose]) -> impl Iterator<Item = usize> {
        let bodies = self.bodies.iter().zip(poses).enumerate();
        bodies.filter(|(_, (body, pose))| self.known(body, pose).is_none()).map(|(index, _)| index)
    }

    /// Whether poses of later steps are worth asking about: see the top of this file.
    pub fn may_foresee(&self) -> bool {
        self.asks == Asks::EachFrame && !self.touched
    }

    /// What to ask: the bodies' `present` poses and those `ahead` (a list a later step), as far as no
    /// answer is known that holds.
    pub fn questions(&self, present: &[Pose], ahead: &[Vec<Pose>]) -> Vec<Asked> {
        let mut asked: Vec<Asked> = Vec::new();
        let mut planned: Vec<Vec<Pose>> = vec![Vec::new(); self.bodies.len()];
        let mut samples_ahead = 0;
        for (later, poses) in std::iter::once(present).chain(ahead.iter().map(Vec::as_slice)).enumerate() {
            for (index, (body, &pose)) in self.bodies.iter().zip(poses).enumerate() {
                let holds = |planned: &Pose| self.clear_holds(body, planned, &pose);
                if self.known(body, &pose).is_some() || planned[index].iter().any(holds) {
                    continue;
                }
                samples_ahead += if later > 0 { body.shape.samples_body().len() } else { 0 };
                if samples_ahead > MAX_SAMPLES_AHEAD {
                    return asked;
                }
                planned[index].push(pose);
                asked.push(Asked { body: index, pose, reach: body.reach });
            }
        }
        asked
    }

    /// Takes the answers to what was asked, in the same order.
    pub fn add(&mut self, asked: &[Asked], results: &[BodyResult]) {
        for (asked, result) in asked.iter().zip(results) {
            let known = &mut self.bodies[asked.body].known;
            if known.len() == MAX_KNOWN {
                known.pop_front();
            }
            known.push_back(Known { pose: asked.pose, result: result.clone(), step: self.step });
        }
    }

    /// The answers of this step; `None` while one is missing.
    pub fn take(&mut self, poses: &[Pose]) -> Option<StepAnswers> {
        let bodies = self.bodies.iter().zip(poses);
        let known: Vec<&Known> = bodies.map(|(body, pose)| self.known(body, pose)).collect::<Option<_>>()?;
        let reused = known.iter().filter(|known| known.step < self.step).count();
        let results: Vec<BodyResult> = known.into_iter().map(|known| known.result.clone()).collect();
        self.touched = results.iter().any(|result| !is_clear(result));
        for (body, result) in self.bodies.iter_mut().zip(&results) {
            body.reach = result.reach();
        }
        Some(StepAnswers { results, reused })
    }

    /// The answer for a pose, if one is known that holds: one for this very pose comes first.
    fn known<'a>(&self, body: &'a BodyAnswers, pose: &Pose) -> Option<&'a Known> {
        let same = body.known.iter().find(|known| same_bits(&known.pose, pose));
        same.or_else(|| {
            let mut known = body.known.iter();
            known.find(|known| is_clear(&known.result) && self.clear_holds(body, &known.pose, pose))
        })
    }

    /// Whether the answer "clear" at one pose holds for another.
    fn clear_holds(&self, body: &BodyAnswers, asked: &Pose, pose: &Pose) -> bool {
        same_bits(asked, pose)
            || (self.reuse_within_m > 0.0 && moved_at_most_m(&body.shape, asked, pose) <= self.reuse_within_m)
    }
}

/// Whether no sample is inside the hull.
fn is_clear(result: &BodyResult) -> bool {
    result.touches.is_empty() && result.response_m.is_err()
}

fn same_bits(a: &Pose, b: &Pose) -> bool {
    let bits = |pose: &Pose| (pose.position_m().map(f64::to_bits), pose.rotation_xyzw().map(f64::to_bits));
    bits(a) == bits(b)
}

/// No sample of the shape is farther than this from where it is at the other pose, metres.
fn moved_at_most_m(shape: &Shape, from: &Pose, to: &Pose) -> f64 {
    let (low, high) = shape.bounds_body();
    let turned = to.rotation() - from.rotation();
    let moved: nalgebra::Vector3<f64> =
        nalgebra::Vector3::from(to.position_m()) - nalgebra::Vector3::from(from.position_m());
    let corner = |index: usize| -> nalgebra::Vector3<f64> {
        nalgebra::Vector3::from_fn(|axis, _| if index >> axis & 1 == 0 { low[axis] } else { high[axis] })
    };
    (0..8).map(|index| (turned * corner(index) + moved).norm()).fold(0.0, f64::max)
}

#[cfg(test)]
mod tests;
