//! A recorder that keeps a run in a file.

use std::path::Path;
use std::sync::Arc;

use coordinator::hooks::{EndRecord, FrameRecord, Recorder, StepRecord};
use parking_lot::Mutex;
use proto::recording::{End, Figures, Response, Step};
use sim::ResponseMode;
use world_encodings::recording::vector;

use crate::channels::Channel;
use crate::convert::{self, RunHeader, command_to_message, contacts_to_bytes};
use crate::fetch::{ColourSource, Fetcher, Fetches};
use crate::times::Times;
use crate::writer::{Entry, FileWriter, Overwrites, Sink, WriteError};

/// Film time between poses, seconds.
const BODIES_EVERY_S: f64 = 1.0 / 60.0;
/// Film time between figures, seconds.
const FIGURES_EVERY_S: f64 = 0.25;
/// Film times are sums of steps: what is due is due a moment early.
const SLACK_S: f64 = 1e-9;

/// What was recorded.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Recorded {
    /// Physics steps.
    pub steps: u64,
    /// Frames whose silhouettes are in the file.
    pub frames: u64,
    /// Frames that steps used and that could not be fetched. A replay takes the recorded answers for them.
    pub frames_lost: u64,
}

/// Keeps a run in a file: the loop's end.
#[derive(Debug)]
pub struct RunRecorder {
    times: Times,
    sink: Sink,
    fetcher: Fetcher,
    bodies_due_s: f64,
    figures_due_s: f64,
    recent: Recent,
    last: Arc<Mutex<End>>,
}

/// The other end: completes the file once the run is over. A run that fails, or a file that is dropped, leaves
/// what was recorded, and nothing if there was no step.
#[derive(Debug)]
pub struct RecordingFile {
    times: Times,
    writer: Option<FileWriter>,
    fetches: Option<Fetches>,
    last: Arc<Mutex<End>>,
}

/// What was measured since the last figures.
#[derive(Debug, Default)]
struct Recent {
    steps_ms: Vec<f64>,
    blind_steps: u32,
}

/// Creates a file for a run. The header is on the disk when this returns. Colours are kept if there is a source.
pub fn record(
    path: &Path,
    overwrites: Overwrites,
    header: &RunHeader,
    colours: Option<ColourSource>,
) -> Result<(RunRecorder, RecordingFile), WriteError> {
    let times = Times { began_unix_s: header.began_unix_s, fps: header.fps };
    let log_ns = times.log_ns(0.0);
    let first = Entry::new(Channel::Header, log_ns, &header.to_message());
    let writer = FileWriter::create(path, overwrites, header.lock_step, &header.names(), first)?;
    let sink = writer.sink().clone();
    let (fetcher, fetches) = Fetcher::begin(sink.clone(), times, colours);
    let last = Arc::new(Mutex::new(End::default()));
    let recorder = RunRecorder {
        times,
        sink,
        fetcher,
        bodies_due_s: 0.0,
        figures_due_s: FIGURES_EVERY_S,
        recent: Recent::default(),
        last: Arc::clone(&last),
    };
    Ok((recorder, RecordingFile { times, writer: Some(writer), fetches: Some(fetches), last }))
}

impl Recorder for RunRecorder {
    fn frame(&mut self, record: FrameRecord<'_>) {
        self.fetcher.fetch(record);
    }

    fn step(&mut self, record: &StepRecord<'_>) {
        let log_ns = self.times.log_ns(record.film_s);
        let step = step_message(record);
        let mut entries = Vec::new();
        if self.is_first() || !record.commands.is_empty() {
            let scene = convert::scene(record.generation, record.world);
            entries.push(Entry::new(Channel::Scene, log_ns, &scene));
        }
        entries.push(Entry::new(Channel::Step, log_ns, &step));
        if record.film_s + SLACK_S >= self.bodies_due_s {
            self.bodies_due_s = (self.bodies_due_s + BODIES_EVERY_S).max(record.film_s);
            entries.push(Entry::new(Channel::Bodies, log_ns, &convert::bodies(record)));
            entries.extend(
                convert::touches(record).map(|touches| Entry::new(Channel::Touches, log_ns, &touches)),
            );
            entries.extend(
                convert::patches(record).map(|patches| Entry::new(Channel::Patches, log_ns, &patches)),
            );
        }
        self.recent.steps_ms.push(record.step_ms);
        self.recent.blind_steps += u32::from(record.frame.is_none());
        if record.film_s + SLACK_S >= self.figures_due_s {
            self.figures_due_s = record.film_s + FIGURES_EVERY_S;
            let figures = std::mem::take(&mut self.recent).figures(record);
            entries.push(Entry::new(Channel::Figures, log_ns, &figures));
        }
        self.sink.put(entries);
        let mut last = self.last.lock();
        last.steps += 1;
        last.film_s = record.film_s;
        last.digest = step.digest;
    }

    fn end(&mut self, _record: &EndRecord<'_>) {
        self.fetcher.close();
    }

    fn is_ready(&self) -> bool {
        self.sink.keeps_up() && self.fetcher.keeps_up()
    }
}

impl RunRecorder {
    fn is_first(&self) -> bool {
        self.last.lock().steps == 0
    }
}

impl RecordingFile {
    /// Waits for frames on their way and completes the file. The runtime of the nodes' connections must run
    /// meanwhile. Fails if the file has.
    pub fn finish(mut self) -> Result<Recorded, WriteError> {
        let (frames, frames_lost) = self.fetches.take().map_or((0, 0), Fetches::finish);
        let Some(writer) = self.writer.take() else { return Ok(Recorded::default()) };
        let last = self.last.lock().clone();
        if last.steps == 0 {
            writer.abandon();
            return Ok(Recorded::default());
        }
        let end = End { frames, frames_lost, ..last };
        writer.sink().put(vec![Entry::new(Channel::End, self.times.log_ns(end.film_s), &end)]);
        writer.finish()?;
        Ok(Recorded { steps: end.steps, frames, frames_lost })
    }
}

impl Drop for RecordingFile {
    fn drop(&mut self) {
        let is_empty = self.last.lock().steps == 0;
        if let Some(writer) = self.writer.take().filter(|_| is_empty) {
            writer.abandon();
        }
    }
}

fn step_message(record: &StepRecord<'_>) -> Step {
    let by_contacts = record.world.settings().response == ResponseMode::Contacts;
    let response = |response: &sim::BodyResponse| Response {
        response_m: response.response_m.map(vector),
        inside_samples: response.inside_samples as u32,
        contacts: contacts_to_bytes(if by_contacts { &response.contacts } else { &[] }),
        spin_rad_s: Some(response.spin_rad_s)
            .filter(|spin| *spin != [0.0; 3])
            .map(|spin| vector(spin.map(f64::from))),
    };
    Step {
        generation: record.generation,
        step: record.step,
        film_s: record.film_s,
        slipped_s: record.slipped_s,
        frame: record.frame,
        commands: record.commands.iter().map(command_to_message).collect(),
        responses: record.responses.iter().map(response).collect(),
        digest: record.world.digest().to_string(),
        step_ms: record.step_ms,
    }
}

impl Recent {
    fn figures(mut self, record: &StepRecord<'_>) -> Figures {
        self.steps_ms.sort_by(f64::total_cmp);
        let last = self.steps_ms.len().saturating_sub(1);
        let at = |share: f64| self.steps_ms.get((share * last as f64).round() as usize).copied();
        Figures {
            film_s: record.film_s,
            steps: self.steps_ms.len() as u32,
            blind_steps: self.blind_steps,
            step_p50_ms: at(0.5).unwrap_or_default(),
            step_p99_ms: at(0.99).unwrap_or_default(),
            contacts: record.responses.iter().filter(|response| response.touches()).count() as u32,
            inside_samples: record.responses.iter().map(|response| response.inside_samples as u32).sum(),
        }
    }
}
