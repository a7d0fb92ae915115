//! What one page has, wants and may get: which frame next, at which tier, and whether it still reads.

use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use coordinator::live::{Follower, Watching};
use futures::future::BoxFuture;

use crate::connection::Taken;
use crate::hello::{self, FeedStatus};
use crate::hub::{Look, Made};
use crate::incoming::{self, Incoming, Want};
use crate::orders::Orders;
use crate::outbox::Outbox;
use crate::server::Shared;
use crate::socket::{PATIENCE, STATUS_EVERY};
use crate::tier::{Link, Tier};

/// Frame sets that a page has not shown yet: one on its way while one is drawn.
const CREDIT: usize = 2;
/// Width of a thumbnail, pixels, where the image is not too large for that.
const THUMBNAIL_PIXELS: u32 = 160;
/// The most that pictures are made smaller: by 2 to the power of this.
const MAX_SCALE_LOG2: u8 = 3;
/// A page that comes while all stands still asks again after so long, until it has colours.
const ASK_AGAIN: Duration = Duration::from_millis(300);
/// Asks in vain at most.
const MAX_ASKS: u32 = 5;

/// Why a page's connection ends.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Verdict {
    /// It went.
    Gone,
    /// It reads no more.
    Stuck,
    /// It is told why.
    Bye(String),
}

type Delivery = BoxFuture<'static, Result<Vec<Made>, String>>;

pub(crate) struct Page {
    shared: Arc<Shared>,
    follower: Follower,
    outbox: Arc<Outbox>,
    is_controller: bool,
    taken: Taken,
    want: Want,
    link: Link,
    orders: Orders,
    /// The frame set that is being made.
    making: Option<Delivery>,
    /// Frame sets that were sent and not shown.
    unshown: Vec<u32>,
    /// The last frame that was asked for, and when.
    asked: Option<(u64, Instant)>,
    /// When the newest frame is to be asked for, if it is too early now.
    frame_due: Option<Instant>,
    has_colour: bool,
    asks_in_vain: u32,
    state_sent: Instant,
    is_state_new: bool,
    thumbnails_sent: Option<Instant>,
    sent: u64,
    dropped: u64,
    /// The least that a ping of its own took.
    base: Duration,
    /// Bytes taken when the link was last looked at, and when they last grew or nothing waited.
    seen_bytes: u64,
    moved: Instant,
    _watching: Watching,
}

impl Page {
    pub fn new(shared: Arc<Shared>, outbox: Arc<Outbox>, is_controller: bool, taken: Taken) -> Page {
        let mut follower = shared.follower.clone();
        // What is there already is new to this page.
        follower.world.mark_changed();
        follower.scene.mark_changed();
        let watching = follower.watch();
        let orders = Orders::new(follower.clone(), is_controller);
        let now = Instant::now();
        let want = Want { fps: shared.facts.fps, ..Want::default() };
        Page {
            link: Link::new(want.colour),
            shared,
            follower,
            outbox,
            is_controller,
            seen_bytes: taken.bytes(),
            taken,
            want,
            orders,
            making: None,
            unshown: Vec::new(),
            asked: None,
            frame_due: None,
            has_colour: false,
            asks_in_vain: 0,
            state_sent: now,
            is_state_new: false,
            thumbnails_sent: None,
            sent: 0,
            dropped: 0,
            base: PATIENCE,
            moved: now,
            _watching: watching,
        }
    }

    /// The first words.
    pub fn begin(&mut self) {
        let hello = {
            let Shared { facts, volume, session, .. } = &*self.shared;
            hello::hello(facts, volume, session, self.is_controller)
        };
        self.outbox.text(hello);
    }

    /// Waits for news: of the run, of a command, of a frame set, of the end.
    pub async fn changed(&mut self) -> Option<Verdict> {
        let Page { follower, orders, making, shared, outbox, .. } = self;
        let mut ending = shared.ending.clone();
        tokio::select! {
            Ok(()) = follower.scene.changed() => {
                let scene = follower.scene.borrow_and_update().clone();
                scene.and_then(|scene| self.tell(hello::scene(&scene)))
            }
            Ok(()) = follower.world.changed() => {
                follower.world.mark_unchanged();
                self.is_state_new = true;
                None
            }
            answer = orders.answered() => self.tell(answer),
            made = wait_for(making) => {
                self.making = None;
                self.deliver(made);
                None
            }
            // There is room for a frame now.
            () = outbox.drained() => None,
            _ = ending.wait_for(|ended| *ended) => Some(Verdict::Bye("the run has ended".into())),
        }
    }

    /// The page has gone.
    pub fn end(self) {
        self.orders.end();
    }

    /// A text that must arrive.
    fn tell(&self, text: String) -> Option<Verdict> {
        (!self.outbox.text(text)).then_some(Verdict::Stuck)
    }

    /// A message of the page.
    pub fn read(&mut self, text: &str) -> Option<Verdict> {
        match incoming::parse(text, &self.want) {
            Ok(Incoming::Want(want)) => self.change(want),
            Ok(Incoming::Shown(seq)) => {
                self.unshown.retain(|unshown| *unshown != seq);
                None
            }
            Ok(Incoming::Command(request)) => {
                let refusal = self.orders.take(request);
                refusal.and_then(|refusal| self.tell(refusal))
            }
            Err(why) => Some(Verdict::Bye(why)),
        }
    }

    fn change(&mut self, want: Want) -> Option<Verdict> {
        if let Some(name) = &want.image_of
            && self.shared.facts.rig.index_of(name).is_none()
        {
            return Some(Verdict::Bye(format!(
                "want.image_of is {name:?}, expected a camera's name or null"
            )));
        }
        self.link.ask(want.colour);
        if want != self.want {
            // What it has is not what it wants: the same frame once more.
            self.asked = None;
            self.asks_in_vain = 0;
        }
        self.want = want;
        None
    }

    /// When the next world goes out, if there is a new one.
    pub fn state_due(&self) -> Option<Instant> {
        let due = self.is_state_new && self.want.state_hz > 0.0;
        due.then(|| self.state_sent + Duration::from_secs_f64(1.0 / self.want.state_hz))
    }

    /// When the newest frame is to be asked for, if that was too early.
    pub fn frame_due(&self) -> Option<Instant> {
        self.frame_due
    }

    /// Sends the newest world.
    pub fn send_state(&mut self) -> Option<Verdict> {
        let now = Instant::now();
        let interval = Duration::from_secs_f64(1.0 / self.want.state_hz.max(0.1));
        // Kept in step, so that 60 of 120 a second are every second one.
        self.state_sent = (self.state_sent + interval).max(now - interval);
        self.is_state_new = false;
        let world = self.follower.world.borrow().clone();
        if let Some(world) = world {
            self.outbox.world(self.shared.hub.world(&world, self.want.touches));
        }
        None
    }

    /// Asks for the newest frame, if the page may have it now.
    pub fn pull_frame(&mut self) {
        self.frame_due = None;
        if self.making.is_some() || self.want.fps <= 0.0 {
            return;
        }
        if self.unshown.len() >= CREDIT || !self.outbox.is_clear() {
            return;
        }
        let Some((frame, is_paused)) = self.newest_frame() else { return };
        let interval = self.interval();
        let now = Instant::now();
        match self.asked {
            Some((asked, at)) if asked == frame => {
                // All stands still, and what was kept of the frame is not what is wanted: what there is now.
                let lacks = self.sent == 0 || (self.link.tier() != Tier::Off && !self.has_colour);
                let may = is_paused && lacks && self.shared.facts.has_colour && self.asks_in_vain < MAX_ASKS;
                if !may || now.duration_since(at) < ASK_AGAIN {
                    return;
                }
                self.asks_in_vain += 1;
                self.making = Some(self.newest());
            }
            Some((_, at)) if now.duration_since(at) + self.slack() < interval => {
                self.frame_due = Some(at + interval - self.slack());
                return;
            }
            _ => self.making = Some(self.delivery(frame)),
        }
        self.count_dropped(frame);
        self.asked = Some((frame, now));
    }

    fn newest_frame(&self) -> Option<(u64, bool)> {
        let world = self.follower.world.borrow();
        world.as_ref().and_then(|world| world.frame.map(|frame| (frame, world.paused)))
    }

    /// Between wanted frame sets.
    fn interval(&self) -> Duration {
        Duration::from_secs_f64(1.0 / self.want.fps.min(self.shared.facts.fps).max(0.01))
    }

    /// Frames do not come on the clock's tick: half a film frame early is in time.
    fn slack(&self) -> Duration {
        Duration::from_secs_f64(0.5 / self.shared.facts.fps.max(0.01))
    }

    fn count_dropped(&mut self, frame: u64) {
        if let Some((asked, _)) = self.asked {
            let wanted = (self.shared.facts.fps / self.want.fps.min(self.shared.facts.fps)).round().max(1.0);
            let passed = frame.saturating_sub(asked) as f64 / wanted;
            self.dropped += (passed.round() as u64).saturating_sub(1);
        }
    }

    fn look(&self) -> Look {
        Look::FrameSet { silhouettes: self.want.silhouettes, tier: self.link.tier() }
    }

    /// A frame set, with the images that are wanted too.
    fn delivery(&mut self, frame: u64) -> Delivery {
        let mut looks = vec![self.look()];
        let image_of = self.want.image_of.as_ref().and_then(|name| self.shared.facts.rig.index_of(name));
        if let Some(camera) = image_of {
            looks.push(Look::Image { camera: camera as u16, tier: self.link.tier() });
        }
        let now = Instant::now();
        let due = |sent: Instant| now.duration_since(sent).as_secs_f64() * self.want.thumbnails_hz >= 1.0;
        if self.want.thumbnails_hz > 0.0 && self.thumbnails_sent.is_none_or(due) {
            self.thumbnails_sent = Some(now);
            looks.push(Look::Thumbnails { scale_log2: self.thumbnail_scale() });
        }
        let shared = Arc::clone(&self.shared);
        Box::pin(async move {
            let made = looks.into_iter().map(|look| shared.hub.look(frame, look));
            let mut made = futures::future::join_all(made).await.into_iter();
            let first = made.next().unwrap_or_else(|| Err("nothing was asked for".into()))?;
            // Images that there are not are no reason to keep the rest back.
            Ok(std::iter::once(first).chain(made.flatten()).collect())
        })
    }

    fn newest(&self) -> Delivery {
        let (shared, look) = (Arc::clone(&self.shared), self.look());
        Box::pin(async move { shared.hub.look_at_newest(look).await.map(|made| vec![made]) })
    }

    fn thumbnail_scale(&self) -> u8 {
        let widest = self.shared.facts.rig.cameras().iter().map(hull::Camera::width).max().unwrap_or(1);
        (0..MAX_SCALE_LOG2).find(|scale| widest >> scale <= THUMBNAIL_PIXELS).unwrap_or(MAX_SCALE_LOG2)
    }

    fn deliver(&mut self, made: Result<Vec<Made>, String>) {
        match made {
            Ok(made) => {
                let Some(first) = made.first() else { return };
                self.has_colour = first.has_colour;
                self.unshown.push(first.seq);
                self.sent += 1;
                self.outbox.frame(made.into_iter().map(|made| made.bytes).collect());
            }
            Err(why) => tracing::debug!("no pictures: {why}"),
        }
    }

    /// A ping was answered.
    pub fn pong(&mut self, number: &[u8]) -> Option<Verdict> {
        let number = number.try_into().map(u32::from_le_bytes).ok()?;
        let arrival = self.outbox.pong(number)?;
        if arrival.is_of_frame {
            self.link.arrived(Instant::now(), arrival.took);
        }
        self.base = self.base.min(arrival.took);
        None
    }

    /// Asks whether the page is there.
    pub fn ping(&mut self) -> Option<Verdict> {
        self.outbox.ping();
        // Routes change: what was the least long ago counts less and less.
        self.base = self.base.mul_f64(1.02).min(PATIENCE);
        None
    }

    /// Judges the link, tells the status, and gives up a page that reads no more.
    pub fn look_at_link(&mut self) -> Option<Verdict> {
        let now = Instant::now();
        let bytes = self.taken.bytes();
        let grown = bytes - self.seen_bytes;
        if grown > 0 || !self.outbox.is_busy() {
            self.moved = now;
        }
        self.seen_bytes = bytes;
        let is_silent = self.outbox.silence().is_some_and(|silence| silence > PATIENCE);
        if is_silent || now.duration_since(self.moved) > PATIENCE {
            return Some(Verdict::Stuck);
        }
        self.link.judge(now, self.outbox.frame_waits(), self.base, self.interval());
        let feed = FeedStatus {
            bytes_per_s: grown as f64 / STATUS_EVERY.as_secs_f64(),
            sent: self.sent,
            dropped: self.dropped,
            tier: self.link.tier().name(),
            pages: self.shared.pages.load(Ordering::Relaxed),
        };
        let is_paused = self.follower.world.borrow().as_ref().is_some_and(|world| world.paused);
        let status = self.follower.status.borrow().clone();
        self.outbox.status(hello::status(status.as_deref(), is_paused, &feed));
        None
    }
}

/// Waits for a frame set that is being made; for ever if there is none.
async fn wait_for(making: &mut Option<Delivery>) -> Result<Vec<Made>, String> {
    match making {
        Some(making) => making.await,
        None => std::future::pending().await,
    }
}
