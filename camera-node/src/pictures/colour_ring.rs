//! The colours of recent frames, kept only while a viewer requests them.

use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use hull::Silhouette;
use hull::silhouette::PixelRect;
use parking_lot::{Mutex, MutexGuard};
use segment::{CROP_GRID, Format};

use crate::frames::RING_FRAMES;
use crate::source::Image;

/// A request keeps colours coming for so long.
const REQUEST_LASTS: Duration = Duration::from_secs(5);
/// Colours are kept of the foreground's box grown by so much.
const MARGIN_PIXELS: u32 = 16;
/// Bytes of colours kept of one camera: the ring's eight frames of whole HD images, fewer of larger ones, and
/// one in any case.
const MAX_BYTES: usize = 56 << 20;

/// A part of a camera's frame, in the camera's own layout.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Colour {
    pub format: Format,
    /// Where the part begins, pixels.
    pub left: u32,
    pub top: u32,
    /// Whether it is the whole image.
    pub is_whole: bool,
    pub bytes: Vec<u8>,
}

/// Colours by camera and frame; shared by film and the encoder of pictures.
pub struct ColourRing {
    /// What times count from.
    began: Instant,
    cameras: Vec<CameraColours>,
}

#[derive(Default)]
struct CameraColours {
    /// Until when crops, or whole images, are wanted: milliseconds after the beginning.
    crops_until_ms: AtomicU64,
    whole_until_ms: AtomicU64,
    kept: Mutex<VecDeque<(u64, Arc<Colour>)>>,
}

impl CameraColours {
    fn kept(&self) -> MutexGuard<'_, VecDeque<(u64, Arc<Colour>)>> {
        self.kept.lock()
    }
}

impl ColourRing {
    /// Of so many cameras.
    pub fn new(camera_count: usize) -> ColourRing {
        let cameras = (0..camera_count).map(|_| CameraColours::default()).collect();
        ColourRing { began: Instant::now(), cameras }
    }

    /// Has film keep a camera's colours for the next seconds: of whole images, or around the foreground.
    pub fn request(&self, camera: usize, whole: bool) {
        let camera = &self.cameras[camera];
        let until = if whole { &camera.whole_until_ms } else { &camera.crops_until_ms };
        until.store(self.now_ms() + REQUEST_LASTS.as_millis() as u64, Ordering::Relaxed);
    }

    /// Keeps what is requested of a frame, nothing otherwise.
    pub fn keep(&self, camera: usize, number: u64, image: &Image, silhouette: &Silhouette) {
        let camera = &self.cameras[camera];
        let now_ms = self.now_ms();
        let whole = camera.whole_until_ms.load(Ordering::Relaxed) > now_ms;
        let crops = camera.crops_until_ms.load(Ordering::Relaxed) > now_ms;
        if !whole && !crops {
            camera.kept().clear();
            return;
        }
        // Masks have no colours.
        let Ok(format) = image.format() else { return };
        let part = if whole {
            Some([0, 0, image.width, image.height])
        } else {
            silhouette.bounds().map(|bounds| around(bounds, (image.width, image.height)))
        };
        let Some(part) = part else { return };
        let mut bytes = Vec::new();
        let format = format.crop(&image.data, part, &mut bytes);
        let colour = Colour { format, left: part[0], top: part[1], is_whole: whole, bytes };
        let mut kept = camera.kept();
        kept.push_back((number, Arc::new(colour)));
        let mut total: usize = kept.iter().map(|(_, colour)| colour.bytes.len()).sum();
        while kept.len() > RING_FRAMES || (total > MAX_BYTES && kept.len() > 1) {
            let Some((_, oldest)) = kept.pop_front() else { return };
            total -= oldest.bytes.len();
        }
    }

    pub(super) fn get(&self, camera: usize, number: u64) -> Option<Arc<Colour>> {
        let kept = self.cameras[camera].kept();
        kept.iter().find(|(of, _)| *of == number).map(|(_, colour)| Arc::clone(colour))
    }

    /// Bytes kept now, of all cameras.
    #[cfg(test)]
    pub(super) fn bytes(&self) -> usize {
        let bytes = |camera: &CameraColours| -> usize {
            camera.kept().iter().map(|(_, colour)| colour.bytes.len()).sum()
        };
        self.cameras.iter().map(bytes).sum()
    }

    /// Forgets all colours: a new run begins.
    pub fn clear(&self) {
        self.cameras.iter().for_each(|camera| camera.kept().clear());
    }

    fn now_ms(&self) -> u64 {
        self.began.elapsed().as_millis() as u64
    }
}

/// The box grown by the margin: left, top, width, height.
fn around(bounds: PixelRect, (width, height): (u32, u32)) -> [u32; 4] {
    let begin = |side: u32| side.saturating_sub(MARGIN_PIXELS) / CROP_GRID * CROP_GRID;
    let (left, top) = (begin(bounds.left), begin(bounds.top));
    let end = |side: u32, most: u32| side.saturating_add(MARGIN_PIXELS).min(most);
    [left, top, end(bounds.right, width) - left, end(bounds.bottom, height) - top]
}
