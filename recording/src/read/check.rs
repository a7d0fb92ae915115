//! Compares a replay with what was recorded, step by step.

use std::sync::{Arc, Mutex, PoisonError};

use coordinator::hooks::{EndRecord, FrameRecord, Recorder, StepRecord};
use thiserror::Error;

use super::RecordedSteps;
use super::schedule::Comparison;

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

/// Compares steps: hand [`StepCheck::recorder`] to the coordinator that follows the schedule.
#[derive(Clone, Debug)]
pub struct StepCheck {
    comparison: Arc<Comparison>,
    state: Arc<Mutex<State>>,
}

#[derive(Debug, Default)]
struct State {
    steps: u64,
    difference: Option<Difference>,
}

impl StepCheck {
    /// A check of the steps that come out of a schedule.
    pub fn of(steps: &RecordedSteps) -> StepCheck {
        StepCheck { comparison: steps.comparison(), state: Arc::default() }
    }

    /// The recorder that compares the replay.
    pub fn recorder(&self) -> Box<dyn Recorder> {
        Box::new(self.clone())
    }

    /// How many steps were made again.
    pub fn steps(&self) -> u64 {
        self.state.lock().unwrap_or_else(PoisonError::into_inner).steps
    }

    /// How many of them took the recorded answers instead of asking.
    pub fn given(&self) -> u64 {
        self.comparison.given()
    }

    /// The first step that differs, if one does.
    pub fn difference(&self) -> Option<Difference> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner).difference.clone()
    }

    /// Why the file could not be read to its end, if so.
    pub fn problem(&self) -> Option<String> {
        self.comparison.problem()
    }
}

impl Recorder for StepCheck {
    fn frame(&mut self, _record: FrameRecord<'_>) {}

    fn step(&mut self, record: &StepRecord<'_>) {
        let Some(expected) = self.comparison.take() else { return };
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        state.steps += 1;
        if state.difference.is_some() {
            return;
        }
        let found = record.world.digest().to_string();
        let is_same = found == expected.digest
            && record.step == expected.step
            && record.film_s.to_bits() == expected.film_s.to_bits();
        if !is_same {
            let (step, film_s) = (state.steps, expected.film_s);
            state.difference = Some(Difference { step, film_s, found, recorded: expected.digest });
        }
    }

    fn end(&mut self, _record: &EndRecord<'_>) {}
}
