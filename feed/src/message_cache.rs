//! Makes messages out of pictures and worlds, each once, however many pages get it.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use bytes::Bytes;
use coordinator::live::WorldState;
use tokio::sync::OnceCell;

use crate::message;
use crate::pictures::{FramePictures, JPEG_QUALITY, PictureKind, PictureRequest, Pictures};
use crate::tier::Tier;

/// Messages remembered: every tier of the last frames. What a page asks for that came later than the others is
/// made for it alone.
const MAX_RECENT: usize = 24;

/// What a message shows of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Look {
    /// All cameras: silhouettes or not, colours of a tier.
    FrameSet { silhouettes: bool, tier: Tier },
    /// Whole images of all cameras, both sides divided by 2 to the power of this.
    Thumbnails { scale_log2: u8 },
    /// The whole image of one camera, made smaller in the same way.
    Image { camera: u16, scale_log2: u8 },
}

/// A message about a frame.
#[derive(Clone, Debug)]
pub(crate) struct Made {
    pub seq: u32,
    /// Whether it shows any colours.
    pub has_colour: bool,
    pub bytes: Bytes,
}

type Cell = Arc<OnceCell<Result<Made, String>>>;
type Key = (u64, Look);
type WorldMessages = Option<(Arc<WorldState>, [Option<Bytes>; 2])>;

pub(crate) struct MessageCache {
    pictures: Arc<dyn Pictures>,
    fps: f64,
    next_seq: AtomicU32,
    recent: Mutex<VecDeque<(Key, Cell)>>,
    /// The newest world, and its messages without and with touches.
    world: Mutex<WorldMessages>,
}

impl MessageCache {
    pub fn new(pictures: Arc<dyn Pictures>, fps: f64) -> MessageCache {
        MessageCache {
            pictures,
            fps,
            next_seq: AtomicU32::new(1),
            recent: Mutex::default(),
            world: Mutex::default(),
        }
    }

    /// A message about a frame. Whoever asks first has it made; the others wait for the same.
    pub async fn look(&self, frame: u64, look: Look) -> Result<Made, String> {
        let cell = self.cell((frame, look));
        cell.get_or_init(|| self.make(Some(frame), look)).await.clone()
    }

    /// A message about the newest frame there is.
    pub async fn look_at_newest(&self, look: Look) -> Result<Made, String> {
        self.make(None, look).await
    }

    fn cell(&self, key: Key) -> Cell {
        let mut recent = self.recent.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, cell)) = recent.iter().find(|(of, _)| *of == key) {
            return Arc::clone(cell);
        }
        if recent.len() == MAX_RECENT {
            recent.pop_front();
        }
        let cell = Cell::default();
        recent.push_back((key, Arc::clone(&cell)));
        cell
    }

    async fn make(&self, frame: Option<u64>, look: Look) -> Result<Made, String> {
        let (kind, scale_log2, cameras) = match look {
            Look::FrameSet { tier: Tier::Off, .. } => (PictureKind::Silhouettes, 0, vec![]),
            Look::FrameSet { tier, .. } => (PictureKind::Crops, tier.scale_log2(), vec![]),
            Look::Thumbnails { scale_log2 } => (PictureKind::Whole, scale_log2, vec![]),
            Look::Image { camera, scale_log2 } => (PictureKind::Whole, scale_log2, vec![camera]),
        };
        let mut pictures = match (frame, look) {
            // A page that wants neither still hears of every frame.
            (Some(frame), Look::FrameSet { silhouettes: false, tier: Tier::Off }) => {
                FramePictures { frame, captured_unix_s: 0.0, cameras: vec![] }
            }
            _ => {
                let request = PictureRequest { frame, kind, scale_log2, jpeg_quality: JPEG_QUALITY, cameras };
                self.pictures.fetch(request).await?
            }
        };
        if matches!(look, Look::FrameSet { silhouettes: false, .. }) {
            pictures.cameras.iter_mut().for_each(|camera| camera.runs = Bytes::new());
        }
        let seq = self.seq();
        let bytes = match look {
            Look::FrameSet { .. } => message::frame_set(seq, self.fps, &pictures),
            Look::Thumbnails { .. } => message::images(seq, self.fps, true, &pictures),
            Look::Image { .. } => message::images(seq, self.fps, false, &pictures),
        };
        let has_colour = pictures.cameras.iter().any(|camera| !camera.jpeg.is_empty());
        Ok(Made { seq, has_colour, bytes })
    }

    /// The message about a world.
    pub fn world(&self, world: &Arc<WorldState>, with_touches: bool) -> Bytes {
        let mut kept = self.world.lock().unwrap_or_else(PoisonError::into_inner);
        if !kept.as_ref().is_some_and(|(of, _)| Arc::ptr_eq(of, world)) {
            *kept = Some((Arc::clone(world), [None, None]));
        }
        let make = || message::world(self.seq(), world, with_touches);
        match kept.as_mut() {
            Some((_, messages)) => messages[usize::from(with_touches)].get_or_insert_with(make).clone(),
            None => make(),
        }
    }

    fn seq(&self) -> u32 {
        self.next_seq.fetch_add(1, Ordering::Relaxed)
    }
}
