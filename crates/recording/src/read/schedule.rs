//! The steps of a recording as a schedule for a coordinator.

use std::collections::VecDeque;
use std::fs::File;
use std::sync::Arc;

use coordinator::hooks::{Schedule, Scheduled, Sees};
use proto::convert::Precision;
use proto::recording::{Response, Step};
use sim::{BodyResponse, ResponseMode};
use world_encodings::recording::{ConvertError, finite};

use super::check::{Expected, StepCheck};
use super::{Index, ReadError, decode};
use crate::channels::Channel;
use crate::convert::{RunHeader, command_from_message, contacts_from_bytes};

/// The steps of a recording, read chunk by chunk.
#[derive(Debug)]
pub struct RecordedSteps {
    index: Arc<Index>,
    file: File,
    next_chunk: usize,
    /// Steps of a chunk, decoded one after the other.
    steps: VecDeque<Vec<u8>>,
    is_rounded: bool,
    gaps: Gaps,
    check: StepCheck,
}

/// Under contacts planes move as they did since the frame before, and what is known of a surface goes on from frame to
/// frame: after a frame whose predecessor is not in the file, or a step without a hull, the same answers are not found.
#[derive(Clone, Copy, Debug)]
struct Gaps {
    matter: bool,
    /// Whether a step has had a hull.
    had_hull: bool,
    is_found: bool,
}

impl Gaps {
    /// Whether one was before this step, or is at its frame.
    fn note(&mut self, frame: Option<u64>, index: &Index) -> bool {
        let is_gap = match frame {
            Some(frame) => frame.checked_sub(1).is_some_and(|before| !index.frames.contains_key(&before)),
            // At the beginning nothing is lost yet.
            None => self.had_hull,
        };
        self.had_hull |= frame.is_some();
        self.is_found |= self.matter && is_gap;
        self.is_found
    }
}

impl RecordedSteps {
    pub(super) fn begin(header: &RunHeader, index: Arc<Index>) -> Result<RecordedSteps, ReadError> {
        let file = index.open()?;
        let is_rounded = header.precision == Precision::Quantised;
        let (steps, check) = (VecDeque::new(), StepCheck::default());
        let matter = header.world.response == ResponseMode::Contacts;
        let gaps = Gaps { matter, had_hull: false, is_found: false };
        Ok(RecordedSteps { index, file, next_chunk: 0, steps, is_rounded, gaps, check })
    }

    /// The check of what comes out.
    pub fn check(&self) -> StepCheck {
        self.check.clone()
    }

    fn next_step(&mut self) -> Result<Option<Step>, ReadError> {
        while self.steps.is_empty() {
            let Some(&chunk) = self.index.with_steps.get(self.next_chunk) else { return Ok(None) };
            self.next_chunk += 1;
            let found = self.index.messages(&mut self.file, chunk)?;
            let steps = found.into_iter().filter(|(channel, _)| *channel == Channel::Step);
            self.steps = steps.map(|(_, data)| data).collect();
        }
        let step = self.steps.pop_front().map(|data| decode(&data)).transpose();
        step.map_err(|problem| self.index.refused(problem))
    }

    fn scheduled(&mut self, step: Step) -> Result<Scheduled, ReadError> {
        let Step { film_s, frame, .. } = step;
        let commands = step.commands.into_iter().map(command_from_message).collect::<Result<_, _>>();
        let commands = commands.map_err(|error| self.index.refused(error))?;
        // Rounded answers cannot be found again; a frame that was lost cannot be asked.
        let is_lost = frame.is_some_and(|frame| !self.index.frames.contains_key(&frame));
        let is_given = self.gaps.note(frame, &self.index) || self.is_rounded;
        let sees = if is_given && frame.is_some() || is_lost {
            let responses = step.responses.iter().map(response).collect::<Result<_, _>>();
            let responses = responses.map_err(|error| self.index.refused(error))?;
            Sees::Given { film_s, frame: frame.filter(|_| !is_lost), responses }
        } else {
            Sees::Recorded { film_s, frame }
        };
        let expected = Expected { step: step.step, film_s, digest: step.digest };
        self.check.expect(expected, matches!(sees, Sees::Given { .. }));
        Ok(Scheduled { commands, sees })
    }
}

impl Schedule for RecordedSteps {
    fn next(&mut self) -> Option<Scheduled> {
        let found = self.next_step().and_then(|step| step.map(|step| self.scheduled(step)).transpose());
        found.unwrap_or_else(|error| {
            self.check.fail(error.to_string());
            None
        })
    }

    fn begin_again(&mut self) {
        self.next_chunk = 0;
        self.steps.clear();
        self.gaps = Gaps { had_hull: false, is_found: false, ..self.gaps };
        self.check.begin_again();
    }
}

fn response(response: &Response) -> Result<BodyResponse, ConvertError> {
    let spin = response.spin_rad_s.as_ref().map(|found| finite("Response", found)).transpose()?;
    Ok(BodyResponse {
        response_m: response.response_m.as_ref().map(|found| finite("Response", found)).transpose()?,
        inside_samples: response.inside_samples as usize,
        contacts: contacts_from_bytes(&response.contacts)?,
        spin_rad_s: spin.unwrap_or_default().map(|part| part as f32),
    })
}
