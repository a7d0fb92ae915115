//! What a run measured.

use hull::collision::BodyCollision;
use hull::pass::Round;
use hull::question::QuestionKind;
use serde::Serialize;
use telemetry::Histogram;

use crate::roster::HullUnavailable;

/// Figures kept at most: beyond, every second one is dropped, and of what comes only so many are taken.
const MAX_KEPT: usize = 1 << 16;

/// Figures in milliseconds, kept for percentiles; of a very long run an even selection.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Percentiles {
    values_ms: Vec<f64>,
    count: usize,
    max_ms: Option<f64>,
    /// Every 2ⁿ-th figure is kept.
    halvings: u32,
    /// All of them.
    histogram: Histogram,
}

impl Percentiles {
    /// Adds a figure.
    pub fn add(&mut self, value_ms: f64) {
        self.max_ms = Some(self.max_ms.map_or(value_ms, |max_ms| max_ms.max(value_ms)));
        if self.count.is_multiple_of(1 << self.halvings) {
            self.values_ms.push(value_ms);
        }
        self.count += 1;
        self.histogram.add(value_ms / 1e3);
        if self.values_ms.len() >= MAX_KEPT {
            let mut kept = 0..self.values_ms.len();
            self.values_ms.retain(|_| kept.next().is_some_and(|index| index % 2 == 0));
            self.halvings += 1;
        }
    }

    /// How often which figures came.
    pub fn histogram(&self) -> &Histogram {
        &self.histogram
    }

    /// How many figures there are.
    pub fn count(&self) -> usize {
        self.count
    }

    /// The figure that a share (0 to 1) of all do not exceed; `None` without any.
    pub fn at(&self, share: f64) -> Option<f64> {
        let mut sorted = self.values_ms.clone();
        sorted.sort_by(f64::total_cmp);
        let last = sorted.len().checked_sub(1)?;
        Some(sorted[(share * last as f64).round() as usize])
    }

    /// The median.
    pub fn p50(&self) -> Option<f64> {
        self.at(0.5)
    }

    /// The figure of the slowest hundredth.
    pub fn p99(&self) -> Option<f64> {
        self.at(0.99)
    }

    /// The largest figure.
    pub fn max(&self) -> Option<f64> {
        self.max_ms
    }
}

/// A stage of a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// The slowest camera's image becomes a silhouette.
    Segment,
    /// Bodies are moved ahead to the next film frame.
    Foresee,
    /// Bodies beyond the hull's bounds are left out.
    Cull,
    /// Nodes say which samples are inside.
    Classes,
    /// Nodes say how far edges are.
    Edges,
    /// Nodes say where samples leave the hull.
    Exits,
    /// The same for a whole body.
    BodyExits,
    /// Nodes say whether a way out is one.
    Check,
    /// Planes become contacts.
    Contacts,
    /// The solver's step.
    Physics,
}

impl Stage {
    /// All, in the order they happen.
    pub const ALL: [Stage; 10] = [
        Stage::Segment,
        Stage::Foresee,
        Stage::Cull,
        Stage::Classes,
        Stage::Edges,
        Stage::Exits,
        Stage::BodyExits,
        Stage::Check,
        Stage::Contacts,
        Stage::Physics,
    ];

    /// As in figures, metrics and spans.
    pub fn name(self) -> &'static str {
        match self {
            Stage::Segment => "segment",
            Stage::Foresee => "foresee",
            Stage::Cull => "cull",
            Stage::Classes => "classes",
            Stage::Edges => "edges",
            Stage::Exits => "exits",
            Stage::BodyExits => "body_exits",
            Stage::Check => "check",
            Stage::Contacts => "contacts",
            Stage::Physics => "physics",
        }
    }
}

impl From<Round> for Stage {
    fn from(round: Round) -> Stage {
        match round {
            Round::Classes => Stage::Classes,
            Round::Edges => Stage::Edges,
            Round::Exits => Stage::Exits,
            Round::BodyExits => Stage::BodyExits,
            Round::Check | Round::Done => Stage::Check,
        }
    }
}

/// What a run has counted: only grows.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RunCounts {
    /// Steps made.
    pub steps: u64,
    /// Distinct frames used.
    pub frames: u64,
    /// Frames passed over between two that were used. Those that are missing before the first or after the last are not
    /// among them: a frame may still come, and a count only grows. [`Figures::frames_missed`] includes them.
    pub frames_passed_over: u64,
    /// Passes, and what they asked.
    pub passes: PassCounts,
    /// Samples inside the hull, summed over steps.
    pub inside_samples: u64,
    /// Bodies with samples inside the hull, summed over steps.
    pub contacts: u64,
    /// Steps that lacked film or cameras.
    pub misses: MissedSteps,
    /// Responses or bodies that were not finite.
    pub faults: u64,
    /// Film time given up because the first frame was late or steps took longer than real time, seconds.
    pub slipped_s: f64,
    /// Bytes at the sockets of nodes.
    pub bytes: NodeBytes,
}

/// Passes of a run, and what they asked.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PassCounts {
    /// Passes that asked something.
    pub asked: u64,
    /// Of these, those that were answered here, of silhouettes that were fetched.
    pub gathered: u64,
    /// Questions of these passes that the cameras answered, one after the other.
    pub round_trips: u64,
    /// Points that passes asked about, by kind, in the order of [`QuestionKind::ALL`].
    pub points: [u64; QuestionKind::ALL.len()],
}

/// Steps of a run that lacked film or cameras.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MissedSteps {
    /// Steps that used an older frame than theirs because theirs was late.
    pub late_steps: u64,
    /// Steps that went on without a camera that was not there.
    pub reduced_steps: u64,
    /// Steps without a hull because a node was not there or refused, by cause, in the order of
    /// [`HullUnavailable::CAUSES`].
    pub blind_by_cause: [u64; HullUnavailable::CAUSES.len()],
}

/// Bytes at the sockets of nodes.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct NodeBytes {
    /// Bytes written to nodes.
    pub to_nodes: u64,
    /// Bytes read from nodes.
    pub from_nodes: u64,
    /// Of these, silhouettes fetched to answer probes.
    pub silhouettes: u64,
}

impl MissedSteps {
    /// Steps without a hull.
    pub fn blind_steps(&self) -> u64 {
        self.blind_by_cause.iter().sum()
    }
}

/// Everything a run measured.
#[derive(Clone, Debug, Default)]
pub struct Figures {
    /// Wall time from the first step to the last, seconds.
    pub wall_s: f64,
    /// What was counted.
    pub counts: RunCounts,
    /// Frames that the film of the run held.
    pub frames_expected: u64,
    /// Samples of all moving bodies.
    pub samples: usize,
    /// Of the inside samples, those that no response freed.
    pub left_samples: u64,
    /// How often answers about bodies were used, and used again.
    pub answers: AnswerCounts,
    /// How long what took, and how old film was.
    pub times: Timings,
    /// How deep the deepest sample of a touching body is in the hull before a step, along its normal.
    pub depth_mm: Percentiles,
    /// Why film failed, if it did.
    pub film_failure: Option<String>,
}

/// How often answers about bodies were used.
#[derive(Clone, Debug, Default)]
pub struct AnswerCounts {
    /// Poses that were asked about.
    pub poses_asked: u64,
    /// Steps with a hull that asked nothing: all answers were known, or no body was near the hull.
    pub steps_without_question: u64,
    /// Answers used, summed over bodies and steps; bodies beyond the hull's bounds need none.
    pub used: u64,
    /// Of these, those that an earlier step asked for.
    pub reused: u64,
}

impl AnswerCounts {
    /// The share of the answers used that were asked at an earlier step.
    pub fn reused_share(&self) -> f64 {
        self.reused as f64 / self.used.max(1) as f64
    }
}

/// How long what took, and how old film was.
#[derive(Clone, Debug, Default)]
pub struct Timings {
    /// What passes took that asked something.
    pub pass: Histogram,
    /// A step with its pass.
    pub step_ms: Percentiles,
    /// Each of [`Stage::ALL`].
    pub stage_ms: [Percentiles; Stage::ALL.len()],
    /// How old the film was that bodies collided with, from its capture to the end of each step.
    pub hull_age: Histogram,
    /// Capture of the film to the response it caused.
    pub response_age_ms: Percentiles,
}

impl Figures {
    /// Takes in what a step uses of the hull's answers.
    pub(crate) fn add_collisions(&mut self, collisions: &[BodyCollision]) {
        for collision in collisions {
            let inside = collision.inside().count();
            self.counts.inside_samples += inside as u64;
            self.counts.contacts += u64::from(inside > 0);
            if let Some(depth_m) = collision.deepest_m() {
                self.depth_mm.add(f64::from(depth_m) * 1e3);
            }
            self.left_samples += collision.left_inside() as u64;
        }
    }

    pub(crate) fn add_stage(&mut self, stage: Stage, value_ms: f64) {
        self.times.stage_ms[stage as usize].add(value_ms);
    }

    /// Frames that the film of the run held and no step used: [`Figures::frames_expected`] less [`RunCounts::frames`].
    /// The page and the JSON of a run show it. It can shrink: a late frame is missed until a step uses it.
    /// [`RunCounts::frames_passed_over`], which metrics show, only grows: it leaves out frames before the first that was
    /// used and after the newest.
    pub fn frames_missed(&self) -> u64 {
        self.frames_expected.saturating_sub(self.counts.frames)
    }

    /// The share of inside samples that a response did not free.
    pub fn left_inside(&self) -> f64 {
        self.left_samples as f64 / self.counts.inside_samples.max(1) as f64
    }
}

/// How a run stands, for a live line.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Progress {
    /// Film time, seconds.
    pub film_s: f64,
    /// The frame in use, if any.
    pub frame: Option<u64>,
    /// Steps a second of wall time since the last report.
    pub steps_per_s: f64,
    /// Passes that asked something, a second of wall time since the last report.
    pub passes_per_s: f64,
    /// The median step since the last report, milliseconds.
    pub p50_ms: f64,
    /// The slowest hundredth since the last report, milliseconds.
    pub p99_ms: f64,
    /// Samples of all moving bodies.
    pub samples: usize,
    /// Bodies that touch the hull now.
    pub contacts: usize,
    /// How old the film was that bodies collided with, from its capture to the end of the step: the median since the
    /// last report, milliseconds; `None` if no step had a hull.
    pub hull_age_ms: Option<f64>,
    /// How long after its film time a step is made, milliseconds: live.
    pub latency_ms: f64,
    /// Bytes at the sockets a second since the last report.
    pub bytes_per_s: f64,
    /// Why there is no hull now, if so.
    #[serde(skip)]
    pub hull_unavailable: Option<String>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_are_those_of_the_sorted_figures() {
        let mut figures = Percentiles::default();
        assert_eq!(figures.p50(), None);
        for value in [5.0, 1.0, 4.0, 2.0, 3.0] {
            figures.add(value);
        }
        assert_eq!((figures.p50(), figures.max(), figures.at(0.0)), (Some(3.0), Some(5.0), Some(1.0)));
    }

    #[test]
    fn a_very_long_run_keeps_an_even_selection() {
        let mut figures = Percentiles::default();
        let all = 5 * MAX_KEPT;
        (0..all).for_each(|value| figures.add(value as f64));
        assert!(figures.values_ms.len() < MAX_KEPT && figures.count() == all);
        assert_eq!(figures.max(), Some((all - 1) as f64));
        let middle = figures.p50().expect("figures") / all as f64;
        assert!((middle - 0.5).abs() < 0.01, "{middle}");
    }
}
