//! Reading a recording: once through to see what it holds, then step by step and frame by frame.

mod check;
mod chunk;
mod error;
mod frames;
mod schedule;
#[cfg(test)]
mod tests;
mod unpack;

pub use check::{Difference, StepCheck};
pub use error::{ReadError, ReadProblem};
pub use frames::RecordedFrames;
pub use schedule::RecordedSteps;
pub use unpack::{RecordedPicture, RecordedPictures};

use std::collections::{BTreeMap, HashMap};
use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use prost::Message;

use crate::channels::Channel;
use crate::convert::RunHeader;
use crate::messages;
use chunk::{Chunks, Place, Record};

/// Film of longer runs, and frames beyond these, are no run's.
const FILM_S: std::ops::RangeInclusive<f64> = 0.0..=1e9;
const MAX_FRAME: u64 = 1 << 40;

/// A recording that has been read through once.
#[derive(Debug)]
pub struct Recording {
    header: RunHeader,
    index: Arc<Index>,
    steps: u64,
    last: messages::Step,
    is_complete: bool,
    problem: Option<ReadProblem>,
}

/// Where things are in the file. A few bytes a frame and camera: an hour of eight cameras takes 10 MB.
#[derive(Debug, Default)]
struct Index {
    path: PathBuf,
    channels: HashMap<u16, Channel>,
    chunks: Vec<Place>,
    /// The chunks that hold steps, in order.
    with_steps: Vec<u32>,
    /// Of each frame that is whole, the chunk of each camera's silhouette; none of a camera that it went on without.
    frames: BTreeMap<u64, Vec<u32>>,
    /// How many cameras a frame has that went on without some.
    reduced: BTreeMap<u64, usize>,
    /// The same of colours, as far as there are any.
    colours: BTreeMap<u64, Vec<u32>>,
}

impl Recording {
    /// Reads a file through. One that was cut off ends with its last whole chunk.
    pub fn open(path: &Path) -> Result<Recording, ReadError> {
        let refused = |problem| ReadError { path: path.to_owned(), problem };
        let file = File::open(path).map_err(|error| refused(error.into()))?;
        let mut chunks = Chunks::begin(file).map_err(refused)?;
        let index = Index { path: path.to_owned(), ..Index::default() };
        let mut scan = Scan { index, ..Scan::default() };
        while let Some((place, found)) = chunks.next() {
            scan.add(place, found).map_err(refused)?;
        }
        let problem = chunks.problem.take();
        let (header, last) = match (scan.header, scan.last) {
            (None, _) => return Err(refused(ReadProblem::NoHeader(problem.map(Box::new)))),
            (_, None) => return Err(refused(ReadProblem::NoStep(problem.map(Box::new)))),
            (Some(header), Some(last)) => (header, last),
        };
        let Scan { mut index, steps, is_complete, .. } = scan;
        let cameras = header.rig.cameras().len();
        let Index { frames, reduced, .. } = &mut index;
        frames.retain(|frame, chunks| {
            chunks.resize(cameras.max(chunks.len()), NO_CHUNK);
            let found = chunks.iter().filter(|chunk| **chunk != NO_CHUNK).count();
            chunks.len() == cameras && found == reduced.get(frame).copied().unwrap_or(cameras)
        });
        Ok(Recording { header, index: Arc::new(index), steps, last, is_complete, problem })
    }

    /// All that the run needs besides its film.
    pub fn header(&self) -> &RunHeader {
        &self.header
    }

    /// How many steps there are.
    pub fn step_count(&self) -> u64 {
        self.steps
    }

    /// The digest of the last world's trajectory, as programs print it.
    pub fn digest(&self) -> &str {
        &self.last.digest
    }

    /// Why it holds less than the whole run, if so: one line.
    pub fn cut_off(&self) -> Option<String> {
        if self.is_complete && self.problem.is_none() {
            return None;
        }
        let why = self.problem.as_ref().map_or_else(|| "its run was cut off".into(), ToString::to_string);
        let (steps, film_s) = (self.steps, self.last.film_s);
        Some(format!("it is not complete ({why}): {steps} steps, {film_s:.2} s, are there"))
    }

    /// Its steps from the first.
    pub fn steps(&self) -> Result<RecordedSteps, ReadError> {
        RecordedSteps::begin(&self.header, Arc::clone(&self.index))
    }

    /// The pictures of its frames.
    pub fn pictures(&self) -> Result<RecordedPictures, ReadError> {
        RecordedPictures::begin(Arc::clone(&self.index))
    }

    /// The frames of which it has every camera's silhouette.
    pub fn frame_numbers(&self) -> impl Iterator<Item = u64> {
        self.index.frames.keys().copied()
    }

    /// Whether there are colours.
    pub fn has_colour(&self) -> bool {
        !self.index.colours.is_empty()
    }

    /// Its frames.
    pub fn frames(&self) -> Result<RecordedFrames, ReadError> {
        RecordedFrames::begin(&self.header, Arc::clone(&self.index))
    }
}

/// A camera whose silhouette of a frame has not been found.
const NO_CHUNK: u32 = u32::MAX;

/// What a file holds, as far as it has been read.
#[derive(Default)]
struct Scan {
    header: Option<RunHeader>,
    index: Index,
    steps: u64,
    last: Option<messages::Step>,
    is_complete: bool,
    /// Topics by number, until the header names the cameras.
    topics: HashMap<u16, String>,
}

impl Scan {
    fn add(&mut self, place: Place, found: Vec<Record>) -> Result<(), ReadProblem> {
        let chunk = self.index.chunks.len() as u32;
        self.index.chunks.push(place);
        for found in found {
            match found {
                Record::Channel(id, topic) => {
                    self.topics.insert(id, topic);
                    self.name_channels();
                }
                Record::Message(header, data) => {
                    let topic = self.topics.get(&header.channel_id).map(String::as_str);
                    match self.index.channels.get(&header.channel_id) {
                        Some(&channel) => self.message(chunk, channel, &data)?,
                        None if topic == Some("/header") => {
                            let message = decode::<messages::Header>("Header", &data)?;
                            self.header = Some(RunHeader::from_message(&message)?);
                            self.name_channels();
                        }
                        None => {}
                    }
                }
            }
        }
        Ok(())
    }

    /// Finds the channels of the topics that are known.
    fn name_channels(&mut self) {
        let Some(header) = &self.header else { return };
        let names = header.names();
        for channel in Channel::all(names.len()) {
            let topic = channel.topic(&names);
            let ids = self.topics.iter().filter(|(_, found)| **found == topic).map(|(&id, _)| id);
            self.index.channels.extend(ids.map(|id| (id, channel)));
        }
    }

    fn message(&mut self, chunk: u32, channel: Channel, data: &[u8]) -> Result<(), ReadProblem> {
        match channel {
            Channel::Step => {
                let step = decode::<messages::Step>("Step", data)?;
                if !FILM_S.contains(&step.film_s) {
                    return Err(ReadProblem::FilmTime(step.film_s));
                }
                if let Some(frame) = step.frame.filter(|frame| *frame > MAX_FRAME) {
                    return Err(ReadProblem::FrameNumber(frame));
                }
                if self.last.as_ref().is_some_and(|last| last.film_s >= step.film_s) {
                    return Err(ReadProblem::Order(step.film_s));
                }
                self.steps += 1;
                self.last = Some(step);
                if self.index.with_steps.last() != Some(&chunk) {
                    self.index.with_steps.push(chunk);
                }
            }
            Channel::Silhouette(camera) => {
                let messages::Silhouette { frame, cameras, .. } = decode("Silhouette", data)?;
                note(&mut self.index.frames, frame, camera, chunk);
                if cameras > 0 {
                    self.index.reduced.insert(frame, cameras as usize);
                }
            }
            Channel::Colour(camera) => {
                let frame = decode::<messages::Colour>("Colour", data)?.frame;
                note(&mut self.index.colours, frame, camera, chunk);
            }
            Channel::End => self.is_complete = true,
            _ => {}
        }
        Ok(())
    }
}

fn note(frames: &mut BTreeMap<u64, Vec<u32>>, frame: u64, camera: usize, chunk: u32) {
    let cameras = frames.entry(frame).or_default();
    if cameras.len() <= camera {
        cameras.resize(camera + 1, NO_CHUNK);
    }
    cameras[camera] = chunk;
}

impl Index {
    fn open(&self) -> Result<File, ReadError> {
        File::open(&self.path).map_err(|error| self.refused(error))
    }

    fn refused(&self, problem: impl Into<ReadProblem>) -> ReadError {
        ReadError { path: self.path.clone(), problem: problem.into() }
    }

    fn lacks(&self, frame: u64, camera: usize) -> ReadError {
        self.refused(ReadProblem::Moved { frame, camera })
    }

    /// The messages of a chunk with their channels.
    fn messages(&self, file: &mut File, chunk: u32) -> Result<Vec<(Channel, Vec<u8>)>, ReadError> {
        let found =
            chunk::read(file, self.chunks[chunk as usize]).map_err(|problem| self.refused(problem))?;
        let of_channel = |found| match found {
            Record::Message(header, data) => {
                self.channels.get(&header.channel_id).map(|&channel| (channel, data))
            }
            Record::Channel(..) => None,
        };
        Ok(found.into_iter().filter_map(of_channel).collect())
    }
}

fn decode<M: Message + Default>(message: &'static str, data: &[u8]) -> Result<M, ReadProblem> {
    M::decode(data).map_err(|error| ReadProblem::Decode { message, error })
}
