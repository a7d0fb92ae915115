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
use proto::MAX_SCALE_LOG2;
use proto::codec::{Entries, check_entries};
use proto::recording as messages;
use world_encodings::recording::ConvertError;

use crate::channels::Channel;
use crate::convert::{RunHeader, SEGMENT_MS, UNIX_S, within};
use chunk::{Chunks, Place, Record};

/// Film of longer runs, and frames beyond these, are no run's.
const FILM_S: std::ops::RangeInclusive<f64> = 0.0..=1e9;
const MAX_FRAME: u64 = 1 << 40;
/// Cameras of a rig.
const MAX_CAMERAS: usize = 1024;
/// Answers and commands of a step.
const MAX_ENTRIES: usize = 1 << 16;
/// What the index of a file may take, in numbers of four bytes, each frame counted with [`FRAME_SIZE`] more and each chunk
/// with [`PLACE_SIZE`]: a day of eight cameras, two hours of 256, half of it in files without chunks. A hostile file could
/// name a frame in every few bytes.
const MAX_INDEX: usize = 1 << 27;
const FRAME_SIZE: usize = 16;
const PLACE_SIZE: usize = 4;

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
        let file = open_file(path).map_err(refused)?;
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

    /// Film time of the last step, seconds.
    pub fn length_s(&self) -> f64 {
        self.last.film_s
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
    /// Topics by number.
    topics: HashMap<u16, String>,
    /// Channels by topic, once the header has named the cameras.
    by_topic: HashMap<String, Channel>,
    /// What the index has taken of [`MAX_INDEX`].
    index_size: usize,
}

impl Scan {
    fn add(&mut self, place: Place, found: Vec<Record>) -> Result<(), ReadProblem> {
        let chunk = self.index.chunks.len() as u32;
        self.index.chunks.push(place);
        self.index_size += PLACE_SIZE;
        for found in found {
            match found {
                Record::Channel(id, topic) => {
                    if let Some(&channel) = self.by_topic.get(&topic) {
                        self.index.channels.insert(id, channel);
                    }
                    self.topics.insert(id, topic);
                }
                Record::Message(header, data) => {
                    let topic = self.topics.get(&header.channel_id).map(String::as_str);
                    match self.index.channels.get(&header.channel_id) {
                        Some(&channel) => self.message(chunk, channel, &data)?,
                        None if topic == Some("/header") => {
                            let message = decode::<messages::Header>(&data)?;
                            self.name_channels(RunHeader::from_message(&message)?);
                        }
                        None => {}
                    }
                }
            }
        }
        if self.index_size > MAX_INDEX {
            return Err(ReadProblem::TooManyFrames(self.index.frames.len().max(self.index.colours.len())));
        }
        Ok(())
    }

    /// Finds the channels of the topics that are known; those that follow are found as they come.
    fn name_channels(&mut self, header: RunHeader) {
        let names = header.names();
        self.by_topic = Channel::all(names.len()).map(|channel| (channel.topic(&names), channel)).collect();
        let known = |(&id, topic): (&u16, &String)| self.by_topic.get(topic).map(|&channel| (id, channel));
        self.index.channels.extend(self.topics.iter().filter_map(known));
        self.header = Some(header);
    }

    fn message(&mut self, chunk: u32, channel: Channel, data: &[u8]) -> Result<(), ReadProblem> {
        match channel {
            Channel::Step => {
                let step = decode::<messages::Step>(data)?;
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
                let found: messages::Silhouette = decode(data)?;
                self.check_silhouette(&found)?;
                let messages::Silhouette { frame, cameras, .. } = found;
                self.index_size += note(&mut self.index.frames, frame, camera, chunk);
                if cameras > 0 {
                    self.index.reduced.insert(frame, cameras as usize);
                }
            }
            Channel::Colour(camera) => {
                let found: messages::Colour = decode(data)?;
                self.check_colour(&found, camera)?;
                self.index_size += note(&mut self.index.colours, found.frame, camera, chunk);
            }
            Channel::End => self.is_complete = true,
            _ => {}
        }
        Ok(())
    }

    fn check_silhouette(&self, found: &messages::Silhouette) -> Result<(), ReadProblem> {
        if found.frame > MAX_FRAME {
            return Err(ReadProblem::FrameNumber(found.frame));
        }
        within("Silhouette", "captured_unix_s", found.captured_unix_s, UNIX_S)?;
        within("Silhouette", "segment_ms", found.segment_ms, SEGMENT_MS)?;
        Ok(())
    }

    fn check_colour(&self, found: &messages::Colour, camera: usize) -> Result<(), ReadProblem> {
        if found.frame > MAX_FRAME {
            return Err(ReadProblem::FrameNumber(found.frame));
        }
        let camera = self.header.as_ref().and_then(|header| header.rig.cameras().get(camera));
        let (across, down) = camera.map_or((0, 0), |camera| (camera.width(), camera.height()));
        let ends_at = (found.left.saturating_add(found.width), found.top.saturating_add(found.height));
        if ends_at.0 > across || ends_at.1 > down {
            let problem =
                format_args!("ends at {} x {}, expected within {across} x {down}", ends_at.0, ends_at.1);
            return Err(ConvertError::new("Colour", problem).into());
        }
        if found.scale_log2 > MAX_SCALE_LOG2.into() {
            let problem =
                format_args!("scale_log2 is {}, expected at most {MAX_SCALE_LOG2}", found.scale_log2);
            return Err(ConvertError::new("Colour", problem).into());
        }
        Ok(())
    }
}

/// Notes where a frame's part is; how much larger the index has become.
fn note(frames: &mut BTreeMap<u64, Vec<u32>>, frame: u64, camera: usize, chunk: u32) -> usize {
    let is_new = !frames.contains_key(&frame);
    let cameras = frames.entry(frame).or_default();
    let before = cameras.len();
    if before <= camera {
        cameras.resize(camera + 1, NO_CHUNK);
    }
    cameras[camera] = chunk;
    cameras.len() - before + if is_new { FRAME_SIZE } else { 0 }
}

/// Opens a file. A pipe is refused: to open one waits for a writer, and a recording is read in any order.
fn open_file(path: &Path) -> Result<File, ReadProblem> {
    if !std::fs::metadata(path)?.is_file() {
        return Err(ReadProblem::NoFile);
    }
    Ok(File::open(path)?)
}

impl Index {
    fn open(&self) -> Result<File, ReadError> {
        open_file(&self.path).map_err(|problem| self.refused(problem))
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

/// A message of a recording, whose entries are counted before it is decoded: an empty one takes two bytes in the file and a
/// hundred in memory.
trait Recorded: Message + Default {
    const NAME: &'static str;
    const ENTRIES: &'static [Entries] = &[];
}

impl Recorded for messages::Header {
    const NAME: &'static str = "Header";
    const ENTRIES: &'static [Entries] = &[Entries::new("Header.ignored_runs", &[5], MAX_CAMERAS)];
}

impl Recorded for messages::Step {
    const NAME: &'static str = "Step";
    const ENTRIES: &'static [Entries] = &[
        Entries::new("Step.commands", &[6], MAX_ENTRIES),
        Entries::new("Polyhedron.corners_m", &[6, 6, 2, 6, 1], MAX_ENTRIES),
        Entries::new("Polyhedron.triangles", &[6, 6, 2, 6, 2], MAX_ENTRIES).packed(),
        Entries::new("Polyhedron.points_m", &[6, 6, 2, 6, 3], MAX_ENTRIES),
        Entries::new("Step.responses", &[7], MAX_ENTRIES),
    ];
}

impl Recorded for messages::Silhouette {
    const NAME: &'static str = "Silhouette";
}

impl Recorded for messages::Colour {
    const NAME: &'static str = "Colour";
}

fn decode<M: Recorded>(data: &[u8]) -> Result<M, ReadProblem> {
    check_entries(M::ENTRIES, data)?;
    M::decode(data).map_err(|error| ReadProblem::Decode { message: M::NAME, error })
}
