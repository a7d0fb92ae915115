//! The steps of a recording as a schedule for a coordinator.

use std::collections::VecDeque;
use std::fs::File;
use std::sync::{Arc, Mutex, PoisonError};

use coordinator::hooks::{Schedule, Scheduled, Sees};
use proto::convert::Precision;
use sim::BodyResponse;

use super::{Index, ReadError, decode};
use crate::channels::Channel;
use crate::convert::{RunHeader, command_from_message, finite};
use crate::messages::{Response, Step};

/// Steps that wait to be compared: more than a coordinator ever takes ahead.
const MAX_EXPECTED: usize = 64;

/// The steps of a recording, read chunk by chunk.
#[derive(Debug)]
pub struct RecordedSteps {
    index: Arc<Index>,
    file: File,
    next_chunk: usize,
    steps: VecDeque<Step>,
    is_rounded: bool,
    comparison: Arc<Comparison>,
}

/// What the steps that were handed out must come to, shared with the check.
#[derive(Debug, Default)]
pub(super) struct Comparison {
    inner: Mutex<Inner>,
}

#[derive(Debug, Default)]
struct Inner {
    expected: VecDeque<Expected>,
    given: u64,
    problem: Option<String>,
}

/// The recorded outcome of a step.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Expected {
    pub generation: u32,
    pub step: u64,
    pub film_s: f64,
    pub digest: String,
}

impl RecordedSteps {
    pub(super) fn begin(header: &RunHeader, index: Arc<Index>) -> Result<RecordedSteps, ReadError> {
        let file = index.open()?;
        let is_rounded = header.precision == Precision::Quantised;
        let (steps, comparison) = (VecDeque::new(), Arc::default());
        Ok(RecordedSteps { index, file, next_chunk: 0, steps, is_rounded, comparison })
    }

    pub(super) fn comparison(&self) -> Arc<Comparison> {
        Arc::clone(&self.comparison)
    }

    fn next_step(&mut self) -> Result<Option<Step>, ReadError> {
        while self.steps.is_empty() {
            let Some(&chunk) = self.index.with_steps.get(self.next_chunk) else { return Ok(None) };
            self.next_chunk += 1;
            let found = self.index.messages(&mut self.file, chunk)?;
            let steps = found.iter().filter(|(channel, _)| *channel == Channel::Step);
            let steps = steps.map(|(_, data)| decode("Step", data)).collect::<Result<_, _>>();
            self.steps = steps.map_err(|problem| self.index.refused(problem))?;
        }
        Ok(self.steps.pop_front())
    }

    fn scheduled(&self, step: Step) -> Result<Scheduled, ReadError> {
        let Step { film_s, frame, .. } = step;
        let commands = step.commands.into_iter().map(command_from_message).collect::<Result<_, _>>();
        let commands = commands.map_err(|error| self.index.refused(error))?;
        // Rounded answers cannot be found again; a frame that was lost cannot be asked.
        let is_lost = frame.is_some_and(|frame| !self.index.frames.contains_key(&frame));
        let sees = if self.is_rounded && frame.is_some() || is_lost {
            let responses = step.responses.iter().map(response).collect::<Result<_, _>>();
            let responses = responses.map_err(|error| self.index.refused(error))?;
            Sees::Given { film_s, frame: frame.filter(|_| !is_lost), responses }
        } else {
            Sees::Recorded { film_s, frame }
        };
        Ok(Scheduled { commands, sees })
    }
}

impl Schedule for RecordedSteps {
    fn next(&mut self) -> Option<Scheduled> {
        let found = self.next_step().and_then(|step| {
            let Some(step) = step else { return Ok(None) };
            let Step { generation, step: number, film_s, .. } = step;
            let expected = Expected { generation, step: number, film_s, digest: step.digest.clone() };
            Ok(Some((expected, self.scheduled(step)?)))
        });
        match found {
            Ok(Some((expected, scheduled))) => {
                self.comparison.expect(expected, matches!(scheduled.sees, Sees::Given { .. }));
                Some(scheduled)
            }
            Ok(None) => None,
            Err(error) => {
                self.comparison.fail(error.to_string());
                None
            }
        }
    }
}

impl Comparison {
    fn expect(&self, expected: Expected, is_given: bool) {
        let mut inner = self.inner.lock().unwrap_or_else(PoisonError::into_inner);
        inner.given += u64::from(is_given);
        if inner.expected.len() == MAX_EXPECTED {
            inner.expected.pop_front();
        }
        inner.expected.push_back(expected);
    }

    fn fail(&self, problem: String) {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner).problem = Some(problem);
    }

    /// The recorded outcome of the step that was just made.
    pub fn take(&self) -> Option<Expected> {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner).expected.pop_front()
    }

    /// How many steps were given their answers.
    pub fn given(&self) -> u64 {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner).given
    }

    /// Why reading ended early, if it did.
    pub fn problem(&self) -> Option<String> {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner).problem.clone()
    }
}

fn response(response: &Response) -> Result<BodyResponse, crate::ConvertError> {
    Ok(BodyResponse {
        response_m: response.response_m.as_ref().map(|found| finite("Response", found)).transpose()?,
        inside_samples: response.inside_samples as usize,
        ..BodyResponse::UNTOUCHED
    })
}
