//! Which frame sets one page gets, and when: no more than it shows, the newest, and the images beside them.

use std::sync::Arc;
use std::time::{Duration, Instant};

use bytes::Bytes;
use futures::future::BoxFuture;

use super::incoming::Want;
use crate::message_cache::{Look, Made};
use crate::shared::Shared;
use crate::tier::Tier;

/// Frame sets that a page has not shown yet: one on its way while one is drawn.
const CREDIT: usize = 2;
/// Width of a thumbnail, pixels, where the image is not too large for that.
const THUMBNAIL_PIXELS: u32 = 160;
/// Width of the image behind a camera's own view, pixels, where the image is not too large for that: more than
/// a page shows, and no megapixels to be made and sent thirty times a second.
const IMAGE_PIXELS: u32 = 1280;
/// The most that pictures are made smaller: by 2 to the power of this.
const MAX_SCALE_LOG2: u8 = 3;
/// A page that comes while all stands still asks again after so long, until it has colours.
const ASK_AGAIN: Duration = Duration::from_millis(300);
/// Asks in vain at most.
const MAX_ASKS: u32 = 5;

type Delivery = BoxFuture<'static, Result<Delivered, String>>;

/// Messages that are made.
struct Delivered {
    set: Option<Made>,
    images: Vec<Made>,
}

/// The newest frame of the run.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Newest {
    pub frame: u64,
    /// Whether the world stands still: then no other frame comes.
    pub is_paused: bool,
}

pub(crate) struct PageFrames {
    shared: Arc<Shared>,
    /// The frame set that is being made.
    making: Option<Delivery>,
    /// Frame sets that were sent and not shown.
    unshown: Vec<u32>,
    /// The last frame that was asked for, and when.
    asked: Option<(u64, Instant)>,
    /// The last frame that was asked for while frames came.
    counted: Option<u64>,
    /// When the newest frame is to be asked for, if it is too early now.
    due: Option<Instant>,
    has_colour: bool,
    asks_in_vain: u32,
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
            has_colour: false,
            asks_in_vain: 0,
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

    /// What it has is not what it wants: the same frame once more.
    pub fn again(&mut self) {
        self.asked = None;
        self.asks_in_vain = 0;
    }

    /// When the newest frame is to be asked for, if that was too early.
    pub fn due(&self) -> Option<Instant> {
        self.due
    }

    /// The next frame set's messages, when they are made; for ever if none are being made.
    pub async fn made(&mut self) -> Result<Vec<Bytes>, String> {
        let made = match &mut self.making {
            Some(making) => making.await,
            None => std::future::pending().await,
        };
        self.making = None;
        let Delivered { set, images } = made?;
        if let Some(set) = &set {
            self.has_colour = set.has_colour;
            self.unshown.push(set.seq);
            self.sent += 1;
        }
        Ok(set.into_iter().chain(images).map(|made| made.bytes).collect())
    }

    /// Asks for the newest frame, if the page may have it now. `is_clear`: nothing else waits to be sent.
    pub fn pull(&mut self, newest: Option<Newest>, want: &Want, tier: Tier, is_clear: bool) {
        self.due = None;
        if self.making.is_some() || want.fps <= 0.0 || self.unshown.len() >= CREDIT || !is_clear {
            return;
        }
        let Some(Newest { frame, is_paused }) = newest else {
            self.counted = None;
            return;
        };
        // What is there already, kept of the frame or not.
        let lacks = self.sent == 0 || (tier != Tier::Off && !self.has_colour);
        let interval = self.interval(want);
        let now = Instant::now();
        match self.asked {
            Some((asked, at)) if asked == frame => {
                // All stands still, and what was kept of the frame is not what is wanted: what there is now.
                let may = is_paused && lacks && self.shared.facts.has_colour && self.asks_in_vain < MAX_ASKS;
                if !may || now.duration_since(at) < ASK_AGAIN {
                    return;
                }
                self.asks_in_vain += 1;
            }
            Some((_, at)) if now.duration_since(at) + self.slack() < interval => {
                self.due = Some(at + interval - self.slack());
                return;
            }
            _ => {}
        }
        self.making = Some(self.delivery(frame, want, tier, (is_paused && lacks, is_paused)));
        self.count_dropped(frame, is_paused, want);
        self.asked = Some((frame, now));
    }

    /// Between wanted frame sets.
    pub fn interval(&self, want: &Want) -> Duration {
        Duration::from_secs_f64(1.0 / want.fps.min(self.shared.facts.fps).max(0.01))
    }

    /// Frames do not come on the clock's tick: half a film frame early is in time.
    fn slack(&self) -> Duration {
        Duration::from_secs_f64(0.5 / self.shared.facts.fps.max(0.01))
    }

    /// Film that goes by in a pause is not missed.
    fn count_dropped(&mut self, frame: u64, is_paused: bool, want: &Want) {
        if let Some(counted) = self.counted {
            let wanted = (self.shared.facts.fps / want.fps.min(self.shared.facts.fps)).round().max(1.0);
            let passed = frame.saturating_sub(counted) as f64 / wanted;
            self.dropped += (passed.round() as u64).saturating_sub(1);
        }
        self.counted = (!is_paused).then_some(frame);
    }

    /// A frame set, with the images that are wanted too. Of a frame that is gone by now, the newest film may be
    /// shown instead: for the set, and for the images.
    fn delivery(&mut self, frame: u64, want: &Want, tier: Tier, or_newest: (bool, bool)) -> Delivery {
        let set = Look::FrameSet { silhouettes: want.silhouettes, tier };
        let mut images = Vec::new();
        let image_of = want.image_of.as_ref().and_then(|name| self.shared.facts.rig.index_of(name));
        if let Some(camera) = image_of {
            let width = self.shared.facts.rig.cameras()[camera].width();
            let scale_log2 = scale_to(IMAGE_PIXELS, width).max(tier.scale_log2());
            images.push(Look::Image { camera: camera as u16, scale_log2 });
        }
        let now = Instant::now();
        let due = |sent: Instant| now.duration_since(sent).as_secs_f64() * want.thumbnails_hz >= 1.0;
        if want.thumbnails_hz > 0.0 && self.thumbnails_sent.is_none_or(due) {
            self.thumbnails_sent = Some(now);
            images.push(Look::Thumbnails { scale_log2: self.thumbnail_scale() });
        }
        let shared = Arc::clone(&self.shared);
        Box::pin(async move {
            let made = |look, or_newest| {
                let cache = &shared.messages;
                async move {
                    match cache.look(frame, look).await {
                        Err(_) if or_newest => cache.look_at_newest(look).await,
                        made => made,
                    }
                }
            };
            let images = images.into_iter().map(|look| made(look, or_newest.1));
            let images = futures::future::join_all(images);
            let (set, images) = futures::future::join(made(set, or_newest.0), images).await;
            // What there is not is no reason to keep the rest back.
            let images: Vec<Made> = images.into_iter().flatten().collect();
            match set {
                Err(why) if images.is_empty() => Err(why),
                set => Ok(Delivered { set: set.ok(), images }),
            }
        })
    }

    fn thumbnail_scale(&self) -> u8 {
        let widest = self.shared.facts.rig.cameras().iter().map(hull::Camera::width).max().unwrap_or(1);
        scale_to(THUMBNAIL_PIXELS, widest)
    }
}

/// How much smaller an image becomes so that it is not wider than this, both in pixels.
fn scale_to(most: u32, width: u32) -> u8 {
    (0..MAX_SCALE_LOG2).find(|scale| width >> scale <= most).unwrap_or(MAX_SCALE_LOG2)
}
