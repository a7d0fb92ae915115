//! Which poses the hull must be asked about, and which answers of the frame still hold.
//!
//! Several physics steps see one film frame, and a frozen frame answers a pose the same way whenever it
//! is asked. So the answers of the frame in use are kept, each with its body and pose. A step takes those
//! that hold for the poses its bodies have and asks the rest; nothing is kept from frame to frame. Bodies
//! that lie beyond the hull's bounds are clear without a question.
//!
//! The world's own prediction is exact for as long as the hull touches no body. Then the poses of all steps
//! that share the frame go into one question, and the others ask nothing. Once a body is touched, what
//! was foreseen is wrong for the bodies that are pushed, and the next step must ask again anyway. So touches are
//! expected where they were: at a new frame, if the frame before began or ended with one (a person moves
//! into bodies); at its later steps, if the later step before had one (bodies rest on a person). A step
//! that expects touches asks about present poses alone. That is a matter of cost and never of answers.
//!
//! An answer holds for a pose of the same bits: then a run is the same, bit for bit, as one that asks at
//! every step. With `reuse_within_m` above zero, a body also counts as clear where each of its samples is
//! known to have been outside no farther away than this. An answer makes known the samples that were
//! outside at the pose that was asked; and, of those that were not, that they are outside once the body
//! has moved by its response, if all of them are. Between two poses each sample moves by an affine
//! function of its place in the body, whose length is convex, so that none moves farther than the farthest
//! corner of the box around all samples. So no sample deeper than `reuse_within_m` in the hull is ever
//! missed, and what is missed is found at the next frame at the latest.

use std::collections::VecDeque;
use std::sync::Arc;

use hull::pass::{BodyResult, PaperResult, Reaches};
use hull::surface::PoseToAsk;
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
pub enum AskEvery {
    /// Once a film frame where no body is touched, for all steps that share it.
    #[default]
    Frame,
    /// At every step, about every body: what the other is measured against.
    Step,
}

/// A pose of a moving body to ask the hull about.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct PoseQuery {
    /// The body's place among the moving ones.
    pub body: usize,
    /// World from body, and how.
    pub asked: PoseToAsk,
}

/// The answers that one step takes.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct StepAnswers {
    /// One a moving body.
    pub results: Vec<BodyResult>,
    /// How many of them the hull gave; the other bodies are beyond its bounds.
    pub asked: usize,
    /// How many of those were asked at an earlier step.
    pub reused: usize,
}

/// The hull's answers about the moving bodies at one film frame.
#[derive(Clone, Debug)]
pub(crate) struct Answers {
    ask_every: AskEvery,
    reuse_within_m: f64,
    frame: Option<u64>,
    step: u64,
    bodies: Vec<BodyAnswers>,
    /// The step is the first that sees the frame.
    is_first: bool,
    touched: RecentTouches,
}

/// Whether the hull touched a body.
#[derive(Clone, Copy, Debug, Default)]
struct RecentTouches {
    /// At the last first step of a frame.
    first: bool,
    /// At the last step that was not the first of a frame.
    later: bool,
}

#[derive(Clone, Debug)]
struct BodyAnswers {
    shape: Arc<Shape>,
    /// What this step asks of the body; `None` before the first.
    present: Option<PoseToAsk>,
    /// Whether it may meet the hull there.
    is_near: bool,
    known: VecDeque<KnownAnswer>,
    reaches: Reaches,
}

#[derive(Clone, Debug)]
struct KnownAnswer {
    asked: PoseToAsk,
    result: BodyResult,
    step: u64,
}

impl Answers {
    /// No answers yet about bodies of these shapes.
    pub fn new(
        shapes: impl Iterator<Item = Arc<Shape>>,
        ask_every: AskEvery,
        reuse_within_m: f64,
    ) -> Answers {
        let body = |shape| BodyAnswers {
            shape,
            present: None,
            is_near: false,
            known: VecDeque::new(),
            reaches: Reaches::default(),
        };
        let (bodies, touched) = (shapes.map(body).collect(), RecentTouches::default());
        Answers { ask_every, reuse_within_m, frame: None, step: 0, bodies, is_first: true, touched }
    }

    /// Begins a step that sees `frame`, with the bodies at these poses: answers of other frames are
    /// dropped. `may_meet` is false for what cannot be inside the hull of that frame.
    pub fn begin_step(
        &mut self,
        frame: u64,
        present: impl Iterator<Item = PoseToAsk>,
        may_meet: impl Fn(&Shape, &Pose) -> bool,
    ) {
        self.step += 1;
        self.is_first = self.frame != Some(frame);
        self.frame = Some(frame);
        for (body, asked) in self.bodies.iter_mut().zip(present) {
            body.present = Some(asked);
            body.is_near = may_meet(&body.shape, &asked.pose);
            if self.is_first || self.ask_every == AskEvery::Step {
                body.known.clear();
            }
        }
    }

    /// Whether the hull must be asked about a present pose.
    pub fn lacks_any(&self) -> bool {
        self.bodies.iter().any(|body| body.is_near && self.present(body).is_none())
    }

    /// Whether poses of later steps are worth asking about: see the top of this file.
    pub fn may_foresee(&self) -> bool {
        let expects_touch = self.touched.later || self.is_first && self.touched.first;
        self.ask_every == AskEvery::Frame && !expects_touch
    }

    /// What to ask: the bodies' present poses and those `ahead` (a list a later step), as far as they may
    /// meet the hull and no answer is known that holds.
    pub fn questions(&self, ahead: &[Vec<Pose>], may_meet: impl Fn(&Shape, &Pose) -> bool) -> Vec<PoseQuery> {
        let near = self.bodies.iter().enumerate().filter(|(_, body)| body.is_near);
        let lacking = near.filter(|(_, body)| self.present(body).is_none());
        let present =
            lacking.filter_map(|(index, body)| Some(PoseQuery { body: index, asked: body.present? }));
        let mut asked: Vec<PoseQuery> = present.collect();
        let mut planned: Vec<Vec<Pose>> = vec![Vec::new(); self.bodies.len()];
        asked.iter().for_each(|asked| planned[asked.body].push(asked.asked.pose));
        let mut samples_ahead = 0;
        for poses in ahead {
            for (index, (body, &pose)) in self.bodies.iter().zip(poses).enumerate() {
                let holds =
                    |planned: &Pose| same_bits(planned, &pose) || self.is_within(body, planned, &pose);
                let is_planned =
                    self.known(body, &PoseToAsk::plain(pose)).is_some() || planned[index].iter().any(holds);
                if is_planned || !may_meet(&body.shape, &pose) {
                    continue;
                }
                samples_ahead += body.shape.samples_body().len();
                if samples_ahead > MAX_SAMPLES_AHEAD {
                    return asked;
                }
                planned[index].push(pose);
                asked.push(PoseQuery { body: index, asked: PoseToAsk::plain(pose) });
            }
        }
        asked
    }

    /// Whether what is around a body is unknown in this frame, and the question is about where it is now.
    pub fn knows_nothing_around(&self, query: &PoseQuery) -> bool {
        let body = &self.bodies[query.body];
        let is_present = body.present.is_some_and(|asked| is_same(&asked, &query.asked));
        let has_around = |known: &KnownAnswer| known.result.planes().is_some_and(|of| !of.around.is_empty());
        is_present && !body.known.iter().any(has_around)
    }

    /// How far a body's edges are worth searching at first.
    pub fn reaches(&self, body: usize) -> &Reaches {
        &self.bodies[body].reaches
    }

    /// Takes the answers to what was asked, in the same order.
    pub fn add(&mut self, asked: &[PoseQuery], results: &[BodyResult]) {
        for (asked, result) in asked.iter().zip(results) {
            let known = &mut self.bodies[asked.body].known;
            if known.len() == MAX_KNOWN {
                known.pop_front();
            }
            known.push_back(KnownAnswer { asked: asked.asked, result: result.clone(), step: self.step });
        }
    }

    /// The answers of this step, `clear` for bodies that are clear of the hull; `None` while one is missing.
    pub fn take(&mut self, clear: &BodyResult) -> Option<StepAnswers> {
        let mut taken = StepAnswers::default();
        for body in &self.bodies {
            let known = if body.is_near { Some(self.present(body)?) } else { None };
            taken.asked += usize::from(known.is_some());
            taken.reused += usize::from(known.is_some_and(|known| known.step < self.step));
            let own = known.filter(|known| body.present.is_some_and(|asked| is_same(&known.asked, &asked)));
            taken.results.push(own.map_or(clear, |known| &known.result).clone());
        }
        let touched = taken.results.iter().any(|result| !result.is_clear());
        *(if self.is_first { &mut self.touched.first } else { &mut self.touched.later }) = touched;
        for (body, result) in self.bodies.iter_mut().zip(&taken.results) {
            body.reaches.note(result);
        }
        Some(taken)
    }

    /// The answer for a body's present pose, if one is known that holds.
    fn present<'a>(&self, body: &'a BodyAnswers) -> Option<&'a KnownAnswer> {
        self.known(body, body.present.as_ref()?)
    }

    /// The answer to what is asked, if one is known that holds: one for this very pose comes first.
    fn known<'a>(&self, body: &'a BodyAnswers, asked: &PoseToAsk) -> Option<&'a KnownAnswer> {
        let same = body.known.iter().find(|known| is_same(&known.asked, asked));
        same.or_else(|| body.known.iter().find(|known| self.clears(body, known, &asked.pose)))
    }

    /// Whether by an answer the body counts as clear at another pose.
    fn clears(&self, body: &BodyAnswers, known: &KnownAnswer, pose: &Pose) -> bool {
        let freed = match &known.result {
            result if result.is_clear() => Some(known.asked.pose),
            BodyResult::Paper(PaperResult { response_m: Ok(response_m), left_inside: 0, .. }) => {
                Some(known.asked.pose.moved(*response_m))
            }
            _ => None,
        };
        let is_near = |from: &Pose| self.is_within(body, from, pose);
        freed.is_some_and(|freed| is_near(&freed) && is_near(&known.asked.pose))
    }

    /// Whether no sample moves farther between the poses than what is reused allows.
    fn is_within(&self, body: &BodyAnswers, from: &Pose, to: &Pose) -> bool {
        self.reuse_within_m > 0.0 && body.shape.moved_at_most_m(from, to) <= self.reuse_within_m
    }
}

fn is_same(a: &PoseToAsk, b: &PoseToAsk) -> bool {
    same_bits(&a.pose, &b.pose) && a.back_m == b.back_m
}

fn same_bits(a: &Pose, b: &Pose) -> bool {
    let bits = |pose: &Pose| (pose.position_m().map(f64::to_bits), pose.rotation_xyzw().map(f64::to_bits));
    bits(a) == bits(b)
}

#[cfg(test)]
mod tests;
