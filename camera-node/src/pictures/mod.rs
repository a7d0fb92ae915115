//! Pictures for people to look at: silhouettes and colours of a frame, made on a thread of their own and only
//! on request.
//!
//! Film keeps the colours of new frames while they are requested ([`ColourRing`]); a [`PictureEncoder`] crops,
//! fills and compresses them, each picture once however often it is requested.

mod colour_ring;
mod encode;

use std::collections::VecDeque;
use std::panic::AssertUnwindSafe;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};

use bytes::Bytes;
use proto::convert::{SilhouetteEncoding, silhouette_data};
use proto::{CameraPicture, Picture, PictureKind, PictureRequest};
use thiserror::Error;

use crate::frames::{Frame, FrameError, FrameRing};

pub use colour_ring::ColourRing;
use encode::EncodedImage;

/// Requests that wait at most: every tier of two frames, and thumbnails.
const MAX_WAITING: usize = 16;
/// Pictures remembered: three tiers of two frames of ten cameras.
const MAX_KEPT: usize = 64;
/// Bytes of remembered pictures: eight images of 8K.
const MAX_KEPT_BYTES: usize = 32 << 20;
/// Pictures yield to film and probes where cores are short.
const NICE: i32 = 5;

/// Why there are no pictures.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum PictureError {
    /// The frame is not there.
    #[error(transparent)]
    Frame(#[from] FrameError),
    /// A camera that the node has not, or one twice.
    #[error("cameras {found:?} of a picture, expected some of {expected:?}, each once")]
    Cameras {
        /// Places in the rig.
        found: Vec<u16>,
        /// Those of the node.
        expected: Vec<u16>,
    },
    /// Too many requests wait.
    #[error("{MAX_WAITING} requests for pictures wait, expected fewer")]
    Busy,
}

/// Makes pictures of the frames of a ring.
pub struct PictureEncoder {
    ring: Arc<FrameRing>,
    colours: Arc<ColourRing>,
    /// The place in the rig of each camera of the ring.
    rig_indices: Vec<u16>,
    jobs: SyncSender<Job>,
}

/// A camera's place in the ring, and in the rig.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Place {
    index: usize,
    rig_index: u16,
}

struct Job {
    frame: Arc<Frame>,
    cameras: Vec<Place>,
    request: PictureRequest,
    deliver: Box<dyn FnMut(Picture) + Send>,
}

impl PictureEncoder {
    /// A thread that makes pictures until this is dropped.
    pub fn new(
        ring: Arc<FrameRing>,
        colours: Arc<ColourRing>,
        rig_indices: Vec<u16>,
    ) -> std::io::Result<PictureEncoder> {
        let (jobs, queue) = sync_channel(MAX_WAITING);
        let shared = Arc::clone(&colours);
        std::thread::Builder::new().name("pictures".into()).spawn(move || {
            // On Linux this is about this thread alone; where it is refused, pictures are as important as the rest.
            let _ = rustix::process::setpriority_process(None, NICE);
            work(&shared, &queue);
        })?;
        Ok(PictureEncoder { ring, colours, rig_indices, jobs })
    }

    /// Has the pictures of a frame made and handed over, one camera after the other, on the encoder's thread:
    /// `deliver` must not wait. It is dropped after the last. A request for colours has film keep those of the
    /// frames to come.
    pub fn request(
        &self,
        request: PictureRequest,
        deliver: impl FnMut(Picture) + Send + 'static,
    ) -> Result<(), PictureError> {
        let cameras = self.places(&request.cameras)?;
        for &camera in &cameras {
            match request.kind {
                PictureKind::Silhouettes => {}
                PictureKind::Crops => self.colours.request(camera.index, false),
                PictureKind::Whole => self.colours.request(camera.index, true),
            }
        }
        let frame = match request.frame {
            Some(number) => self.ring.get(number)?,
            None => self.ring.newest()?,
        };
        let job = Job { frame, cameras, request, deliver: Box::new(deliver) };
        self.jobs.try_send(job).map_err(|error| match error {
            TrySendError::Full(_) | TrySendError::Disconnected(_) => PictureError::Busy,
        })
    }

    /// The places in the ring of cameras; all of them if none is named.
    fn places(&self, cameras: &[u16]) -> Result<Vec<Place>, PictureError> {
        let cameras = if cameras.is_empty() { &self.rig_indices } else { cameras };
        let is_twice = |at: usize| cameras[..at].contains(&cameras[at]);
        let place = |&rig_index: &u16| {
            let index = self.rig_indices.iter().position(|&index| index == rig_index)?;
            Some(Place { index, rig_index })
        };
        // More than there are cannot all be different: the rest is not looked at.
        let few = &cameras[..cameras.len().min(self.rig_indices.len() + 1)];
        let places: Option<Vec<Place>> = few.iter().map(place).collect();
        let places = places.filter(|_| !(0..few.len()).any(is_twice));
        places
            .ok_or_else(|| PictureError::Cameras { found: few.to_vec(), expected: self.rig_indices.clone() })
    }
}

/// Makes pictures in the order of their requests.
fn work(colours: &ColourRing, queue: &Receiver<Job>) {
    let mut kept = Kept::default();
    while let Ok(mut job) = queue.recv() {
        for &camera in &job.cameras {
            let key = Key::new(&job, camera);
            let picture = kept.get(&key).or_else(|| {
                // A panic leaves the colours whole.
                let made = AssertUnwindSafe(|| picture(colours, &job.frame, camera, &job.request));
                let made = std::panic::catch_unwind(made);
                let made = made
                    .inspect_err(|_| {
                        tracing::error!("encoding a picture of camera {} panicked", camera.rig_index);
                    })
                    .ok()??;
                kept.keep(key, made.clone());
                Some(made)
            });
            if let Some(picture) = picture {
                (job.deliver)(picture);
            }
        }
    }
}

/// A camera's picture; `None` of a frame that went on without it.
fn picture(colours: &ColourRing, frame: &Frame, camera: Place, request: &PictureRequest) -> Option<Picture> {
    let part = frame.cameras.iter().find(|part| part.rig_index == camera.rig_index)?;
    let &PictureRequest { kind, scale_log2, jpeg_quality, .. } = request;
    let colour = match kind {
        PictureKind::Silhouettes => None,
        PictureKind::Crops | PictureKind::Whole => colours.get(camera.index, frame.number),
    };
    let encoded = colour.and_then(|colour| match kind {
        PictureKind::Whole => encode::whole(&colour, scale_log2.into(), jpeg_quality),
        _ => encode::crop(&colour, &part.silhouette, scale_log2.into(), jpeg_quality),
    });
    let EncodedImage { crop, jpeg } = encoded.unwrap_or_default();
    let runs = match kind {
        PictureKind::Whole => Bytes::new(),
        _ => silhouette_data(&part.silhouette, SilhouetteEncoding::Runs),
    };
    // Sides of images have 15 bits.
    let crop = crop.map(|side| side as u16);
    let camera = CameraPicture { rig_index: part.rig_index, runs, scale_log2, crop, jpeg: jpeg.into() };
    Some(Picture { frame: frame.number, captured_unix_s: frame.captured_unix_s, camera })
}

/// What a picture was made from, and how.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Key {
    frame: u64,
    /// Tells runs apart: each numbers its frames again.
    captured_bits: u64,
    camera: Place,
    kind: PictureKind,
    scale_log2: u8,
    jpeg_quality: u8,
}

impl Key {
    fn new(job: &Job, camera: Place) -> Key {
        let &PictureRequest { kind, scale_log2, jpeg_quality, .. } = &job.request;
        let captured_bits = job.frame.captured_unix_s.to_bits();
        Key { frame: job.frame.number, captured_bits, camera, kind, scale_log2, jpeg_quality }
    }
}

/// The last pictures.
#[derive(Default)]
struct Kept {
    pictures: VecDeque<(Key, Picture)>,
    bytes: usize,
}

impl Kept {
    fn get(&self, key: &Key) -> Option<Picture> {
        self.pictures.iter().find(|(of, _)| of == key).map(|(_, picture)| picture.clone())
    }

    fn keep(&mut self, key: Key, picture: Picture) {
        let size = |picture: &Picture| picture.camera.runs.len() + picture.camera.jpeg.len();
        self.bytes += size(&picture);
        self.pictures.push_back((key, picture));
        while self.pictures.len() > MAX_KEPT || (self.bytes > MAX_KEPT_BYTES && self.pictures.len() > 1) {
            let Some((_, oldest)) = self.pictures.pop_front() else { return };
            self.bytes -= size(&oldest);
        }
    }
}

#[cfg(test)]
mod tests;
