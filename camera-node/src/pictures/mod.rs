//! Pictures for people to look at: silhouettes and colours of a frame, made on a thread of their own and only
//! while somebody asks.
//!
//! Film keeps the colours of new frames while they are wanted ([`Colours`]); a [`Darkroom`] crops, fills and
//! compresses them, each picture once however often it is asked for.

mod colour_ring;
mod encode;

use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};

use bytes::Bytes;
use proto::convert::{SilhouetteEncoding, silhouette_data};
use thiserror::Error;

use crate::frames::{Frame, FrameError, FrameRing};

pub use colour_ring::{Colours, MARGIN_PIXELS};
use encode::Developed;

/// Orders that wait at most: every tier of two frames, and thumbnails.
const MAX_WAITING: usize = 16;
/// Pictures remembered: three tiers of two frames of ten cameras.
const MAX_KEPT: usize = 64;
/// Bytes of remembered pictures: eight images of 8K.
const MAX_KEPT_BYTES: usize = 32 << 20;
/// Pictures are made smaller by at most 2 to the power of this.
pub const MAX_SCALE_LOG2: u8 = 3;
/// Pictures yield to film and probes where cores are short.
const NICE: i32 = 5;

/// What is asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PictureKind {
    /// Silhouettes alone.
    Silhouettes,
    /// Silhouettes and the colours around them.
    Crops,
    /// Whole images without silhouettes.
    Whole,
}

/// A question about one frame.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PictureOrder {
    /// Which frame; `None`: the newest.
    pub frame: Option<u64>,
    /// What of it.
    pub kind: PictureKind,
    /// Both sides of the JPEG are divided by 2 to the power of this, 0 to [`MAX_SCALE_LOG2`].
    pub scale_log2: u8,
    /// 1 to 100.
    pub jpeg_quality: u8,
    /// Places in the rig; empty: all cameras.
    pub cameras: Vec<u16>,
}

/// One camera's picture.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    /// The camera's place in the rig.
    pub rig_index: u16,
    /// Which frame it is of.
    pub frame: u64,
    /// When that was captured by the wall clock, unix seconds.
    pub captured_unix_s: f64,
    /// The silhouette of the whole image: the wire's RUNS. Empty of whole images.
    pub runs: Bytes,
    /// Left, top, width and height of what the JPEG shows, in the camera's own pixels.
    pub crop: [u32; 4],
    /// Both sides of the JPEG are divided by 2 to the power of this.
    pub scale_log2: u8,
    /// The colours; empty if there are none.
    pub jpeg: Bytes,
}

/// Why there are no pictures.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum PictureError {
    /// The frame is not there.
    #[error(transparent)]
    Frame(#[from] FrameError),
    /// The order makes no sense.
    #[error("{field} is {found}, expected {expected}")]
    Order {
        /// Which field.
        field: &'static str,
        /// Its value.
        found: u32,
        /// What would be right.
        expected: String,
    },
    /// Too many orders wait.
    #[error("{MAX_WAITING} orders for pictures wait, expected fewer")]
    Busy,
}

/// Makes pictures of the frames of a ring.
pub struct Darkroom {
    ring: Arc<FrameRing>,
    /// The place in the rig of each camera of the ring.
    rig_indices: Vec<u16>,
    jobs: SyncSender<Job>,
}

struct Job {
    frame: Arc<Frame>,
    cameras: Vec<usize>,
    order: PictureOrder,
    deliver: Box<dyn FnMut(Picture) + Send>,
}

impl Darkroom {
    /// A thread that makes pictures until this is dropped.
    pub fn new(ring: Arc<FrameRing>, rig_indices: Vec<u16>) -> std::io::Result<Darkroom> {
        let (jobs, queue) = sync_channel(MAX_WAITING);
        let shared = Arc::clone(&ring);
        std::thread::Builder::new().name("pictures".into()).spawn(move || {
            // On Linux this is about this thread alone; where it is refused, pictures are as important as the rest.
            let _ = rustix::process::setpriority_process(None, NICE);
            work(&shared, &queue);
        })?;
        Ok(Darkroom { ring, rig_indices, jobs })
    }

    /// Has the pictures of a frame made and handed over, one camera after the other, on the darkroom's thread:
    /// `deliver` must not wait. It is dropped after the last. Asking for colours has film keep those of the
    /// frames to come.
    pub fn order(
        &self,
        order: PictureOrder,
        deliver: impl FnMut(Picture) + Send + 'static,
    ) -> Result<(), PictureError> {
        let cameras = self.checked(&order)?;
        for &camera in &cameras {
            match order.kind {
                PictureKind::Silhouettes => {}
                PictureKind::Crops => self.ring.colours().ask(camera, false),
                PictureKind::Whole => self.ring.colours().ask(camera, true),
            }
        }
        let frame = match order.frame {
            Some(number) => self.ring.get(number)?,
            None => self.ring.newest().ok_or(FrameError::NotYet { asked: u64::MAX, newest: None })?,
        };
        let job = Job { frame, cameras, order, deliver: Box::new(deliver) };
        self.jobs.try_send(job).map_err(|error| match error {
            TrySendError::Full(_) | TrySendError::Disconnected(_) => PictureError::Busy,
        })
    }

    /// The cameras of an order that makes sense, as places in the ring.
    fn checked(&self, order: &PictureOrder) -> Result<Vec<usize>, PictureError> {
        let wrong = |field, found: u32, expected: String| PictureError::Order { field, found, expected };
        if order.scale_log2 > MAX_SCALE_LOG2 {
            let expected = format!("0 to {MAX_SCALE_LOG2}");
            return Err(wrong("scale_log2", order.scale_log2.into(), expected));
        }
        if order.kind != PictureKind::Silhouettes && !(1..=100).contains(&order.jpeg_quality) {
            return Err(wrong("jpeg_quality", order.jpeg_quality.into(), "1 to 100".into()));
        }
        if order.cameras.is_empty() {
            return Ok((0..self.rig_indices.len()).collect());
        }
        if order.cameras.len() > self.rig_indices.len() {
            let expected = format!("at most {}", self.rig_indices.len());
            return Err(wrong("number of cameras", order.cameras.len() as u32, expected));
        }
        let place = |camera: &u16| {
            let place = self.rig_indices.iter().position(|index| index == camera);
            place.ok_or_else(|| wrong("camera", (*camera).into(), format!("one of {:?}", self.rig_indices)))
        };
        order.cameras.iter().map(place).collect()
    }
}

/// Makes pictures in the order they were asked for.
fn work(ring: &FrameRing, queue: &Receiver<Job>) {
    let mut kept = Kept::default();
    while let Ok(mut job) = queue.recv() {
        for &camera in &job.cameras {
            let key = Key::new(&job, camera);
            let made = kept.get(&key).or_else(|| {
                let made = std::panic::catch_unwind(|| make(ring, &job.frame, camera, &job.order));
                match made {
                    Ok(picture) => {
                        kept.keep(key, picture.clone());
                        Some(picture)
                    }
                    Err(_) => {
                        tracing::error!("a picture of camera {camera} made the darkroom panic");
                        None
                    }
                }
            });
            if let Some(picture) = made {
                (job.deliver)(picture);
            }
        }
    }
}

fn make(ring: &FrameRing, frame: &Frame, camera: usize, order: &PictureOrder) -> Picture {
    let part = &frame.cameras[camera];
    let colour = match order.kind {
        PictureKind::Silhouettes => None,
        PictureKind::Crops | PictureKind::Whole => ring.colours().get(camera, frame.number),
    };
    let (scale, quality) = (u32::from(order.scale_log2), order.jpeg_quality);
    let developed = colour.and_then(|colour| match order.kind {
        PictureKind::Whole => encode::whole(&colour, scale, quality),
        _ => encode::crop(&colour, &part.silhouette, scale, quality),
    });
    let Developed { crop, jpeg } = developed.unwrap_or_default();
    let runs = match order.kind {
        PictureKind::Whole => Bytes::new(),
        _ => silhouette_data(&part.silhouette, SilhouetteEncoding::Runs),
    };
    Picture {
        rig_index: part.rig_index,
        frame: frame.number,
        captured_unix_s: frame.captured_unix_s,
        runs,
        crop,
        scale_log2: order.scale_log2,
        jpeg: jpeg.into(),
    }
}

/// What a picture was made from, and how.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Key {
    frame: u64,
    /// Tells runs apart: each numbers its frames anew.
    captured_bits: u64,
    camera: usize,
    kind: PictureKind,
    scale_log2: u8,
    jpeg_quality: u8,
}

impl Key {
    fn new(job: &Job, camera: usize) -> Key {
        let &PictureOrder { kind, scale_log2, jpeg_quality, .. } = &job.order;
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
        let size = |picture: &Picture| picture.runs.len() + picture.jpeg.len();
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
