//! Messages about frames and worlds, each made once for all pages, and the pictures of the frame at which a paused
//! world stands.

use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Duration;

use bytes::Bytes;
use coordinator::live::WorldState;
use parking_lot::Mutex;
use tokio::sync::OnceCell;

use crate::message::{self, WorldParts};
use crate::pictures::{JPEG_QUALITY, Pictures, PicturesError};
use crate::tier::Tier;
use proto::{FramePictures, PictureKind, PictureRequest};

/// Messages kept: every tier of the last frames. A page that asks for an older one has it made again.
const MAX_RECENT: usize = 24;
/// How often the pictures of a paused world's frame are asked for, until all cameras have answered.
const FREEZE_ATTEMPTS: usize = 3;
/// Between two of them: a node that was too slow is not asked for 2 s.
const FREEZE_PAUSE: Duration = Duration::from_millis(2200);

/// What a message shows of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Content {
    /// All cameras: silhouettes or not, colours of a tier.
    FrameSet { silhouettes: bool, tier: Tier },
    /// Whole images of all cameras, both sides divided by 2 to the power of this.
    Thumbnails { scale_log2: u8 },
    /// The whole image of one camera, made smaller in the same way.
    Image { camera: u16, scale_log2: u8 },
}

/// A message about a frame.
#[derive(Clone, Debug)]
pub(crate) struct FrameMessage {
    pub seq: u32,
    /// Whether it shows any colours.
    pub has_colour: bool,
    pub bytes: Bytes,
}

type Cell = Arc<OnceCell<FrameMessage>>;
type Key = (u64, Content);
/// A world and its message with each choice of parts.
type WorldMessages = Option<(Arc<WorldState>, Vec<(WorldParts, Bytes)>)>;

pub(crate) struct MessageCache {
    pictures: Arc<dyn Pictures>,
    fps: f64,
    /// Cameras of the rig.
    cameras: usize,
    next_seq: AtomicU32,
    recent: Mutex<VecDeque<(Key, Cell)>>,
    kept: Mutex<Kept>,
    /// The newest world, and its messages.
    world: Mutex<WorldMessages>,
}

/// Pictures that outlive the nodes' own.
#[derive(Default)]
struct Kept {
    /// The frame of a paused world.
    frozen: Option<u64>,
    /// The pictures of that frame; while the world runs, the last of all cameras that a page got.
    pictures: Option<FramePictures>,
}

impl MessageCache {
    pub fn new(pictures: Arc<dyn Pictures>, fps: f64, cameras: usize) -> MessageCache {
        MessageCache {
            pictures,
            fps,
            cameras,
            next_seq: AtomicU32::new(1),
            recent: Mutex::default(),
            kept: Mutex::default(),
            world: Mutex::default(),
        }
    }

    /// A message about a frame, made for the first page that asks and shared by the others.
    pub async fn message(&self, frame: u64, content: Content) -> Result<FrameMessage, PicturesError> {
        let cell = self.cell((frame, content));
        // Errors are not kept: the next request tries again.
        cell.get_or_try_init(|| self.make(Some(frame), content)).await.cloned()
    }

    /// A message about the newest frame there is.
    pub async fn newest(&self, content: Content) -> Result<FrameMessage, PicturesError> {
        self.make(None, content).await
    }

    fn cell(&self, key: Key) -> Cell {
        let mut recent = self.recent.lock();
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

    async fn make(&self, frame: Option<u64>, content: Content) -> Result<FrameMessage, PicturesError> {
        let pictures = match (frame, content) {
            // A page that wants neither still gets every frame's number.
            (Some(frame), Content::FrameSet { silhouettes: false, tier: Tier::Off }) => {
                FramePictures { frame, captured_unix_s: 0.0, cameras: vec![] }
            }
            (Some(frame), Content::FrameSet { silhouettes, tier }) => match self.frozen(frame) {
                Some(frozen) => stripped(frozen, silhouettes, tier),
                None => {
                    let fetched = self.fetch(Some(frame), content).await?;
                    self.keep(&fetched);
                    stripped(fetched, silhouettes, tier)
                }
            },
            _ => self.fetch(frame, content).await?,
        };
        let seq = self.seq();
        let bytes = match content {
            Content::FrameSet { .. } => message::frame_set(seq, self.fps, &pictures),
            Content::Thumbnails { .. } => message::images(seq, self.fps, true, &pictures),
            Content::Image { .. } => message::images(seq, self.fps, false, &pictures),
        };
        let has_colour = pictures.cameras.iter().any(|camera| !camera.jpeg.is_empty());
        Ok(FrameMessage { seq, has_colour, bytes })
    }

    async fn fetch(&self, frame: Option<u64>, content: Content) -> Result<FramePictures, PicturesError> {
        let (kind, scale_log2, cameras) = match content {
            Content::FrameSet { tier: Tier::Off, .. } => (PictureKind::Silhouettes, 0, vec![]),
            Content::FrameSet { tier, .. } => (PictureKind::Crops, tier.scale_log2(), vec![]),
            Content::Thumbnails { scale_log2 } => (PictureKind::Whole, scale_log2, vec![]),
            Content::Image { camera, scale_log2 } => (PictureKind::Whole, scale_log2, vec![camera]),
        };
        let request = PictureRequest { frame, kind, scale_log2, jpeg_quality: JPEG_QUALITY, cameras };
        Ok(self.pictures.fetch(request).await?)
    }

    /// The world stands at this frame: keeps its pictures for pages that join before it goes on.
    pub async fn freeze(&self, frame: u64) {
        if self.kept.lock().frozen.replace(frame) == Some(frame) {
            return;
        }
        for _ in 0..FREEZE_ATTEMPTS {
            if self.kept.lock().frozen != Some(frame) {
                return;
            }
            let content = Content::FrameSet { silhouettes: true, tier: Tier::Full };
            let is_whole = match self.fetch(Some(frame), content).await {
                Ok(fetched) => self.keep(&fetched),
                Err(_) => false,
            };
            if is_whole || self.kept.lock().frozen != Some(frame) {
                break;
            }
            tokio::time::sleep(FREEZE_PAUSE).await;
        }
        // What was made before may lack cameras or colours.
        self.recent
            .lock()
            .retain(|((of, content), _)| *of != frame || !matches!(content, Content::FrameSet { .. }));
    }

    /// The world goes on.
    pub fn thaw(&self) {
        self.kept.lock().frozen = None;
    }

    /// The kept pictures of a frame at which the world stands.
    fn frozen(&self, frame: u64) -> Option<FramePictures> {
        let kept = self.kept.lock();
        let is_frozen = kept.frozen == Some(frame);
        kept.pictures.clone().filter(|pictures| is_frozen && pictures.frame == frame)
    }

    /// Keeps pictures if they are of all cameras, or of the frozen frame, with no fewer cameras or colours than those
    /// before; whether they are of all cameras.
    fn keep(&self, pictures: &FramePictures) -> bool {
        let count = |pictures: &FramePictures| {
            pictures.cameras.iter().filter(|camera| !camera.runs.is_empty()).count()
        };
        let colour_bytes =
            |pictures: &FramePictures| pictures.cameras.iter().map(|camera| camera.jpeg.len()).sum::<usize>();
        let is_whole = count(pictures) == self.cameras;
        let mut kept = self.kept.lock();
        let improves = match (&kept.pictures, kept.frozen) {
            (Some(old), _) if old.frame == pictures.frame => {
                (count(pictures), colour_bytes(pictures)) >= (count(old), colour_bytes(old))
            }
            (_, Some(frozen)) => frozen == pictures.frame,
            _ => is_whole,
        };
        if improves {
            kept.pictures = Some(pictures.clone());
        }
        is_whole
    }

    /// The message about a world.
    pub fn world(&self, world: &Arc<WorldState>, parts: WorldParts) -> Bytes {
        let mut kept = self.world.lock();
        if !kept.as_ref().is_some_and(|(of, _)| Arc::ptr_eq(of, world)) {
            *kept = None;
        }
        let (_, messages) = kept.get_or_insert_with(|| (Arc::clone(world), Vec::new()));
        if let Some((_, bytes)) = messages.iter().find(|(of, _)| *of == parts) {
            return bytes.clone();
        }
        let bytes = message::world(self.seq(), world, parts);
        messages.push((parts, bytes.clone()));
        bytes
    }

    fn seq(&self) -> u32 {
        self.next_seq.fetch_add(1, Ordering::Relaxed)
    }
}

/// Pictures without what a page does not want.
fn stripped(mut pictures: FramePictures, silhouettes: bool, tier: Tier) -> FramePictures {
    for camera in &mut pictures.cameras {
        if !silhouettes {
            camera.runs = Bytes::new();
        }
        if tier == Tier::Off {
            camera.jpeg = Bytes::new();
            (camera.crop, camera.scale_log2) = ([0; 4], 0);
        }
    }
    pictures
}
