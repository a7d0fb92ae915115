//! Silhouettes and colours chunk by chunk, as they are in the file.

use std::collections::{HashMap, VecDeque};
use std::fs::File;
use std::sync::Arc;

use parking_lot::Mutex;
use proto::recording as messages;

use super::{Index, NO_CHUNK, ReadError, decode};
use crate::channels::Channel;
use crate::fetch::ColourCrop;

/// Chunks kept unpacked: a frame may lie over two, and the next begins where it ends.
const KEPT_CHUNKS: usize = 2;

/// One camera's part of a frame, as it is in the file.
#[derive(Clone, Debug, PartialEq)]
pub struct RecordedPicture {
    /// The camera's place in the rig.
    pub camera: u16,
    /// Its silhouette: for each row the number of runs, for each run the gap before it (less one after the first)
    /// and its length less one, LEB128. Not checked.
    pub runs: Vec<u8>,
    /// When it was captured, unix seconds by its node's clock.
    pub captured_unix_s: f64,
    /// Its colours, if they were recorded.
    pub colour: Option<ColourCrop>,
}

/// Silhouettes and colours of a recording, to be shown.
#[derive(Debug)]
pub struct RecordedPictures(Mutex<Unpacker>);

/// Reads chunks and keeps the last ones.
#[derive(Debug)]
pub(super) struct Unpacker {
    index: Arc<Index>,
    file: File,
    with_colours: bool,
    kept: VecDeque<(u32, Unpacked)>,
}

/// The silhouettes and colours of a chunk, by camera and frame.
#[derive(Debug, Default)]
struct Unpacked {
    silhouettes: HashMap<(usize, u64), messages::Silhouette>,
    colours: HashMap<(usize, u64), messages::Colour>,
}

impl RecordedPictures {
    pub(super) fn begin(index: Arc<Index>) -> Result<RecordedPictures, ReadError> {
        Ok(RecordedPictures(Mutex::new(Unpacker::begin(index, true)?)))
    }

    /// Every camera's part of a frame, of those that it has, in rig order; `None` if the recording has it not.
    pub fn frame(&self, frame: u64) -> Result<Option<Vec<RecordedPicture>>, ReadError> {
        // What a panic elsewhere left is whole: chunks are added last.
        let mut unpacker = self.0.lock();
        let index = Arc::clone(&unpacker.index);
        let Some(chunks) = index.frames.get(&frame) else { return Ok(None) };
        let colours = index.colours.get(&frame);
        let is_there = |(_, chunk): &(usize, &u32)| **chunk != NO_CHUNK;
        let picture = |(camera, &chunk): (usize, &u32)| {
            let messages::Silhouette { runs, captured_unix_s, .. } =
                unpacker.silhouette(chunk, camera, frame)?.clone();
            let with_colour =
                colours.and_then(|chunks| chunks.get(camera)).filter(|chunk| **chunk != NO_CHUNK);
            let colour = with_colour.map(|&chunk| unpacker.colour(chunk, camera, frame)).transpose()?;
            Ok(RecordedPicture { camera: camera as u16, runs, captured_unix_s, colour })
        };
        chunks.iter().enumerate().filter(is_there).map(picture).collect::<Result<_, _>>().map(Some)
    }
}

impl Unpacker {
    pub fn begin(index: Arc<Index>, with_colours: bool) -> Result<Unpacker, ReadError> {
        let file = index.open()?;
        Ok(Unpacker { index, file, with_colours, kept: VecDeque::new() })
    }

    /// A camera's silhouette of a frame, from the chunk that has it.
    pub fn silhouette(
        &mut self,
        chunk: u32,
        camera: usize,
        frame: u64,
    ) -> Result<&messages::Silhouette, ReadError> {
        let place = self.place(chunk)?;
        let found = self.kept[place].1.silhouettes.get(&(camera, frame));
        found.ok_or_else(|| self.index.lacks(frame, camera))
    }

    fn colour(&mut self, chunk: u32, camera: usize, frame: u64) -> Result<ColourCrop, ReadError> {
        let place = self.place(chunk)?;
        let found = self.kept[place].1.colours.get(&(camera, frame));
        let found = found.ok_or_else(|| self.index.lacks(frame, camera))?;
        Ok(ColourCrop {
            camera: camera as u16,
            crop: [found.left, found.top, found.width, found.height],
            scale_log2: found.scale_log2,
            jpeg: found.jpeg.clone(),
        })
    }

    /// Where a chunk is among those that are kept, read if need be.
    fn place(&mut self, chunk: u32) -> Result<usize, ReadError> {
        if let Some(at) = self.kept.iter().position(|(kept, _)| *kept == chunk) {
            return Ok(at);
        }
        let mut unpacked = Unpacked::default();
        for (channel, data) in self.index.messages(&mut self.file, chunk)? {
            let refused = |problem| self.index.refused(problem);
            match channel {
                Channel::Silhouette(camera) => {
                    let found: messages::Silhouette = decode(&data).map_err(refused)?;
                    unpacked.silhouettes.insert((camera, found.frame), found);
                }
                Channel::Colour(camera) if self.with_colours => {
                    let found: messages::Colour = decode(&data).map_err(refused)?;
                    unpacked.colours.insert((camera, found.frame), found);
                }
                _ => {}
            }
        }
        if self.kept.len() == KEPT_CHUNKS {
            self.kept.pop_front();
        }
        self.kept.push_back((chunk, unpacked));
        Ok(self.kept.len() - 1)
    }
}
