//! Compares a replay with what was recorded, step by step.

use std::collections::VecDeque;
use std::sync::Arc;

use coordinator::hooks::{EndRecord, FrameRecord, Recorder, StepRecord};
use parking_lot::{Mutex, MutexGuard};
use thiserror::Error;

/// Steps that wait to be compared: more than a coordinator ever takes ahead.
const MAX_EXPECTED: usize = 64;

/// The first step at which a replay is another run.
#[derive(Clone, Debug, PartialEq, Error)]
#[error("step {step} ({film_s:.3} s) differs: digest {found}, recorded {recorded}")]
pub struct Difference {
    /// The step, counted from 1 over all worlds.
    pub step: u64,
    /// Film time at its end, seconds.
    pub film_s: f64,
    /// The digest of the replay.
    pub found: String,
    /// The recorded one.
    pub recorded: String,
}

/// Compares the steps that come out of a schedule: hand [`StepCheck::recorder`] to the coordinator that follows it.
#[derive(Clone, Debug, Default)]
pub struct StepCheck(Arc<Mutex<State>>);

#[derive(Debug, Default)]
struct State {
    expected: VecDeque<Expected>,
    /// Since the run last began: steps that were handed out, and steps that were made.
    handed_out: u64,
    made: u64,
    /// The most of both.
    most_handed_out: u64,
    steps: u64,
    given: u64,
    difference: Option<Difference>,
    problem: Option<String>,
}

/// The recorded outcome of a step.
#[derive(Debug)]
pub(super) struct Expected {
    pub step: u64,
    pub film_s: f64,
    pub digest: String,
}

impl StepCheck {
    fn state(&self) -> MutexGuard<'_, State> {
        self.0.lock()
    }

    /// What a step that was handed out must come to, and whether it was given its answers.
    pub(super) fn expect(&self, expected: Expected, is_given: bool) {
        let mut state = self.state();
        state.handed_out += 1;
        if state.handed_out > state.most_handed_out {
            state.most_handed_out = state.handed_out;
            state.given += u64::from(is_given);
        }
        if state.expected.len() == MAX_EXPECTED {
            state.expected.pop_front();
        }
        state.expected.push_back(expected);
    }

    /// The run begins again, and is compared again.
    pub(super) fn begin_again(&self) {
        let mut state = self.state();
        state.expected.clear();
        (state.handed_out, state.made) = (0, 0);
    }

    /// The file could not be read any farther.
    pub(super) fn fail(&self, problem: String) {
        self.state().problem = Some(problem);
    }

    /// The recorder that compares the replay.
    pub fn recorder(&self) -> Box<dyn Recorder> {
        Box::new(self.clone())
    }

    /// How many steps were made again, each counted once.
    pub fn steps(&self) -> u64 {
        self.state().steps
    }

    /// How many of them took the recorded answers instead of asking.
    pub fn given(&self) -> u64 {
        self.state().given
    }

    /// The first step that differs, if one does.
    pub fn difference(&self) -> Option<Difference> {
        self.state().difference.clone()
    }

    /// Why the file could not be read to its end, if so.
    pub fn problem(&self) -> Option<String> {
        self.state().problem.clone()
    }
}

impl Recorder for StepCheck {
    fn frame(&mut self, _record: FrameRecord<'_>) {}

    fn step(&mut self, record: &StepRecord<'_>) {
        let mut state = self.state();
        let Some(expected) = state.expected.pop_front() else { return };
        state.made += 1;
        state.steps = state.steps.max(state.made);
        if state.difference.is_some() {
            return;
        }
        let found = record.world.digest().to_string();
        let is_same = found == expected.digest
            && record.step == expected.step
            && record.film_s.to_bits() == expected.film_s.to_bits();
        if !is_same {
            let (step, film_s) = (state.made, expected.film_s);
            state.difference = Some(Difference { step, film_s, found, recorded: expected.digest });
        }
    }

    fn end(&mut self, _record: &EndRecord<'_>) {}
}
