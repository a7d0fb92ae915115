//! Which frame sets one page gets, and when: no more than it shows, the newest, and the images beside them.

use std::sync::Arc;
use std::time::{Duration, Instant};

use bytes::Bytes;
use futures::future::{self, BoxFuture};
use proto::MAX_SCALE_LOG2;

use super::incoming::Want;
use crate::message_cache::{Content, FrameMessage};
use crate::pictures::PicturesError;
use crate::shared::Shared;
use crate::tier::Tier;

/// Frame sets that a page has not shown yet: one on its way while one is drawn.
const CREDIT: usize = 2;
/// Width of a thumbnail, pixels, where the image is not too large for that.
const THUMBNAIL_PIXELS: u32 = 160;
/// Width of the image behind a camera's own view, pixels, where the image is not too large for that: more than
/// a page shows, and no megapixels to be made and sent thirty times a second.
const IMAGE_PIXELS: u32 = 1280;
/// While the world is paused, what could not be had is asked for again after so long: nodes begin to keep colours
/// when they are first asked for them.
const RETRY_EVERY: Duration = Duration::from_millis(300);
const MAX_RETRIES: u32 = 5;

/// The messages of one frame: the frame set, and the images that are wanted beside it.
struct Messages {
    set: Option<FrameMessage>,
    images: Vec<FrameMessage>,
    lacks: Lacks,
}

/// What was wanted of a frame and could not be had.
#[derive(Clone, Copy, Debug, Default)]
struct Lacks {
    set: bool,
    image: bool,
}

/// The frame that the world's last step saw.
#[derive(Clone, Copy, Debug)]
pub(crate) struct WorldFrame {
    pub frame: u64,
    /// Whether the world is paused: then no other frame comes.
    pub is_paused: bool,
}

pub(crate) struct PageFrames {
    shared: Arc<Shared>,
    /// The messages that are being made.
    making: Option<BoxFuture<'static, Result<Messages, PicturesError>>>,
    /// Frame sets that were sent and not shown.
    unshown: Vec<u32>,
    /// The last frame that was asked for, and when.
    asked: Option<(u64, Instant)>,
    /// The last frame that was asked for while frames came.
    counted: Option<u64>,
    /// When the newest frame is to be asked for, if it is too early now.
    due: Option<Instant>,
    /// What the page lacks of the last frame, and how often that was asked for again.
    lacks: Lacks,
    retries: u32,
    thumbnails_sent: Option<Instant>,
    sent: u64,
    dropped: u64,
}

impl PageFrames {
    pub fn new(shared: Arc<Shared>) -> PageFrames {
        PageFrames {
            shared,
            making: None,
            unshown: Vec::new(),
            asked: None,
            counted: None,
            due: None,
            lacks: Lacks::default(),
            retries: 0,
            thumbnails_sent: None,
            sent: 0,
            dropped: 0,
        }
    }

    /// Frame sets that were sent, and frames that were wanted and left out.
    pub fn counts(&self) -> (u64, u64) {
        (self.sent, self.dropped)
    }

    /// The page has shown a frame set.
    pub fn shown(&mut self, seq: u32) {
        self.unshown.retain(|unshown| *unshown != seq);
    }

    /// The page wants something else: the same frame once more.
    pub fn again(&mut self) {
        self.asked = None;
        self.retries = 0;
    }

    /// When the newest frame is to be asked for, if that was too early.
    pub fn due(&self) -> Option<Instant> {
        self.due
    }

    /// The next messages, when they are made; pending for ever if none are being made.
    pub async fn made(&mut self) -> Result<Vec<Bytes>, PicturesError> {
        let made = match &mut self.making {
            Some(making) => making.await,
            None => future::pending().await,
        };
        self.making = None;
        self.lacks = made.as_ref().map_or(Lacks { set: true, image: true }, |made| made.lacks);
        let Messages { set, images, .. } = made?;
        if let Some(set) = &set {
            self.unshown.push(set.seq);
            self.sent += 1;
        }
        Ok(set.into_iter().chain(images).map(|made| made.bytes).collect())
    }

    /// Asks for the newest frame, if the page may have it now. `is_clear`: nothing else waits to be sent.
    pub fn pull(&mut self, newest: Option<WorldFrame>, want: &Want, tier: Tier, is_clear: bool) {
        self.due = None;
        if self.making.is_some() || want.fps <= 0.0 || self.unshown.len() >= CREDIT || !is_clear {
            return;
        }
        let Some(WorldFrame { frame, is_paused }) = newest else {
            self.counted = None;
            return;
        };
        let now = Instant::now();
        let is_same = self.asked.is_some_and(|(asked, _)| asked == frame);
        let lacks_some = self.lacks.set || self.lacks.image;
        if is_same && !(is_paused && lacks_some && self.retries < MAX_RETRIES) {
            return;
        }
        let wait = if is_same { RETRY_EVERY } else { self.interval(want).saturating_sub(self.slack()) };
        if let Some(due) = self.asked.map(|(_, at)| at + wait).filter(|due| now < *due) {
            self.due = Some(due);
            return;
        }
        let with_set = !is_same || self.lacks.set;
        self.retries = if is_same { self.retries + 1 } else { 0 };
        let set = with_set.then_some(Content::FrameSet { silhouettes: want.silhouettes, tier });
        let images = self.images(want, tier, is_same);
        self.making = Some(self.messages(WorldFrame { frame, is_paused }, set, images));
        self.count_dropped(frame, is_paused, want);
        self.asked = Some((frame, now));
    }

    /// Between wanted frame sets.
    pub fn interval(&self, want: &Want) -> Duration {
        Duration::from_secs_f64(1.0 / want.fps.min(self.shared.info.fps).max(0.01))
    }

    /// Frames do not come on the clock's tick: half a film frame early is in time.
    fn slack(&self) -> Duration {
        Duration::from_secs_f64(0.5 / self.shared.info.fps.max(0.01))
    }

    /// Film that goes by in a pause is not missed.
    fn count_dropped(&mut self, frame: u64, is_paused: bool, want: &Want) {
        if let Some(counted) = self.counted {
            let wanted = (self.shared.info.fps / want.fps.min(self.shared.info.fps)).round().max(1.0);
            let passed = frame.saturating_sub(counted) as f64;
            // Where a recording was sought, no frame between was wanted.
            let is_sought = self.shared.info.is_replay && passed > self.shared.info.fps;
            if !is_sought {
                self.dropped += ((passed / wanted).round() as u64).saturating_sub(1);
            }
        }
        self.counted = (!is_paused).then_some(frame);
    }

    /// The messages of a frame. A paused world's image of a camera, which its node may have dropped by now, is of the
    /// newest film instead; its frame set never is: it would show the person of another moment.
    fn messages(
        &self,
        WorldFrame { frame, is_paused }: WorldFrame,
        set: Option<Content>,
        images: Vec<Content>,
    ) -> BoxFuture<'static, Result<Messages, PicturesError>> {
        let shared = Arc::clone(&self.shared);
        Box::pin(async move {
            let cache = &shared.messages;
            let image = |content| async move {
                let of_frame = cache.message(frame, content).await;
                if !is_paused || of_frame.as_ref().is_ok_and(|message| message.has_colour) {
                    return of_frame;
                }
                cache.newest(content).await
            };
            let images = future::join_all(images.into_iter().map(image));
            let set = async {
                match set {
                    Some(set) => cache.message(frame, set).await.map(Some),
                    None => Ok(None),
                }
            };
            let (set, images) = future::join(set, images).await;
            let has_colour =
                |image: &Result<FrameMessage, _>| image.as_ref().is_ok_and(|image| image.has_colour);
            let image = shared.info.has_colour && !images.iter().all(has_colour);
            let lacks = Lacks { set: set.is_err(), image };
            let images: Vec<FrameMessage> = images.into_iter().flatten().collect();
            match set {
                Err(why) if images.is_empty() => Err(why),
                set => Ok(Messages { set: set.ok().flatten(), images, lacks }),
            }
        })
    }

    /// The images that are wanted now.
    fn images(&mut self, want: &Want, tier: Tier, is_retry: bool) -> Vec<Content> {
        let cameras = self.shared.info.rig.cameras();
        let mut images = Vec::new();
        let image_of = want.image_of.as_ref().and_then(|name| self.shared.info.rig.index_of(name));
        if let Some(camera) = image_of {
            let scale_log2 = scale_to(IMAGE_PIXELS, cameras[camera].width()).max(tier.scale_log2());
            images.push(Content::Image { camera: camera as u16, scale_log2 });
        }
        let now = Instant::now();
        let is_due = |sent: Instant| now.duration_since(sent).as_secs_f64() * want.thumbnails_hz >= 1.0;
        if want.thumbnails_hz > 0.0 && (is_retry || self.thumbnails_sent.is_none_or(is_due)) {
            self.thumbnails_sent = Some(now);
            let widest = cameras.iter().map(hull::Camera::width).max().unwrap_or(1);
            images.push(Content::Thumbnails { scale_log2: scale_to(THUMBNAIL_PIXELS, widest) });
        }
        images
    }
}

/// How much smaller an image becomes so that it is not wider than this, both in pixels.
fn scale_to(most: u32, width: u32) -> u8 {
    (0..MAX_SCALE_LOG2).find(|scale| width >> scale <= most).unwrap_or(MAX_SCALE_LOG2)
}
