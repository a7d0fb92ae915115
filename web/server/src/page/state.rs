//! The state of one page: what it wants, what it may get, and whether it still reads.

use std::sync::Arc;
use std::time::{Duration, Instant};

use bytes::Bytes;
use coordinator::live::{Client, ClientKind, Follower, Watching};

use super::frames::{PageFrames, WorldFrame};
use super::incoming::{self, Incoming, Want};
use super::link::Link;
use super::outbox::Outbox;
use super::{STATUS_EVERY, WRITE_TIMEOUT};
use crate::fields::wrong;
use crate::http::BytesSent;
use crate::orders::Orders;
use crate::shared::Shared;
use crate::text::{self, FeedStatus};

/// A link on which a frame set takes no longer than this, beyond what any message takes, carries the next one
/// meanwhile.
const QUICK: Duration = Duration::from_millis(100);
/// While something has been on its way for longer than this, beyond what any message takes, nothing follows but
/// what must not be lost.
const LATE: Duration = Duration::from_millis(250);

/// Why a page's connection ends.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Ending {
    /// The page disconnected.
    Disconnected,
    /// It no longer reads.
    Stalled,
    /// The server closes it and gives the reason.
    Bye(String),
}

pub(crate) struct Page {
    shared: Arc<Shared>,
    follower: Follower,
    outbox: Arc<Outbox>,
    is_controller: bool,
    bytes_sent: BytesSent,
    want: Want,
    link: Link,
    orders: Orders,
    frames: PageFrames,
    state_sent: Instant,
    is_state_new: bool,
    /// The least that a ping of its own took.
    base: Duration,
    /// Whether the last frame set arrived soon enough for the next to follow it on its way.
    is_quick: bool,
    /// Bytes taken when the link was last looked at, and when they last grew or nothing waited.
    last_bytes: u64,
    progress_at: Instant,
    _watching: Watching,
}

impl Page {
    pub fn new(shared: Arc<Shared>, outbox: Arc<Outbox>, is_controller: bool, bytes_sent: BytesSent) -> Page {
        let mut follower = shared.follower.for_client(Client::new(ClientKind::Page));
        // What was published before is new to this page.
        follower.world.mark_changed();
        follower.scene.mark_changed();
        let watching = follower.watch();
        let refusal = (!is_controller).then_some("open the page with its token");
        let orders = Orders::new(follower.clone(), refusal);
        let now = Instant::now();
        let want = Want { fps: shared.info.fps, ..Want::default() };
        Page {
            link: Link::new(want.colour),
            frames: PageFrames::new(Arc::clone(&shared)),
            shared,
            follower,
            outbox,
            is_controller,
            last_bytes: bytes_sent.bytes(),
            bytes_sent,
            want,
            orders,
            state_sent: now,
            is_state_new: false,
            base: WRITE_TIMEOUT,
            is_quick: false,
            progress_at: now,
            _watching: watching,
        }
    }

    /// Sends the first message.
    pub fn begin(&mut self) {
        let hello = {
            let Shared { info, volume, session, .. } = &*self.shared;
            text::hello(info, volume, session, self.is_controller)
        };
        self.outbox.text(hello);
    }

    /// Waits for a change of the run, an answer to a command, a frame set or the end.
    pub async fn changed(&mut self) -> Option<Ending> {
        let Page { follower, orders, frames, shared, outbox, .. } = self;
        let mut ending = shared.ending.clone();
        tokio::select! {
            Ok(()) = follower.scene.changed() => {
                let scene = follower.scene.borrow_and_update().clone()?;
                self.send(text::scene(&scene))
            }
            Ok(()) = follower.world.changed() => {
                follower.world.mark_unchanged();
                self.is_state_new = true;
                None
            }
            answer = orders.answered() => self.send(answer),
            made = frames.made() => {
                match made {
                    Ok(messages) => outbox.frame(messages),
                    Err(why) => tracing::debug!("no pictures: {why}"),
                }
                None
            }
            // There is room for a frame now.
            () = outbox.drained() => None,
            _ = ending.wait_for(|ended| *ended) => Some(Ending::Bye(shared.info.end().into())),
        }
    }

    /// The newest world, if the page wants worlds and may not have been sent it.
    pub fn newest_world(&self) -> Option<Bytes> {
        // A run that is over is no longer watched: then the world may be sent twice.
        let is_new = self.is_state_new || self.follower.world.has_changed().unwrap_or(true);
        let is_wanted = is_new && self.want.state_hz > 0.0;
        let world = self.follower.world.borrow().clone().filter(|_| is_wanted)?;
        Some(self.shared.messages.world(&world, self.want.world))
    }

    /// The page has disconnected.
    pub fn end(self) {
        self.orders.end();
    }

    /// Sends a text that must not be lost.
    fn send(&self, text: String) -> Option<Ending> {
        (!self.outbox.text(text)).then_some(Ending::Stalled)
    }

    /// A message of the page.
    pub fn read(&mut self, text: &str) -> Option<Ending> {
        match incoming::parse(text, &self.want) {
            Ok(Incoming::Want(want)) => self.change(want),
            Ok(Incoming::Shown(seq)) => {
                self.frames.shown(seq);
                None
            }
            Ok(Incoming::Command(request)) => {
                let refusal = self.orders.order(request);
                refusal.and_then(|refusal| self.send(refusal))
            }
            Err(why) => Some(Ending::Bye(why.to_string())),
        }
    }

    fn change(&mut self, want: Want) -> Option<Ending> {
        if let Some(name) = &want.image_of
            && self.shared.info.rig.index_of(name).is_none()
        {
            let wrong = wrong("want.image_of", &name.as_str().into(), "a camera's name or null");
            return Some(Ending::Bye(wrong.to_string()));
        }
        self.link.ask(want.colour);
        if want != self.want {
            self.frames.again();
        }
        // A world that stands still is not made again.
        self.is_state_new |= want.world != self.want.world;
        self.want = want;
        None
    }

    /// When the next world goes out, if there is a new one.
    pub fn state_due(&self) -> Option<Instant> {
        let due = self.is_state_new && self.want.state_hz > 0.0 && !self.is_late();
        due.then(|| self.state_sent + Duration::from_secs_f64(1.0 / self.want.state_hz))
    }

    /// When the newest frame is to be asked for, if that was too early.
    pub fn frame_due(&self) -> Option<Instant> {
        self.frames.due()
    }

    /// Whether what was sent is on its way for so long that more would only queue.
    fn is_late(&self) -> bool {
        self.outbox.on_its_way().is_some_and(|on_its_way| on_its_way > self.base + LATE)
    }

    /// Sends the newest world.
    pub fn send_state(&mut self) -> Option<Ending> {
        let now = Instant::now();
        let interval = Duration::from_secs_f64(1.0 / self.want.state_hz.max(0.1));
        // Kept in step, so that 60 of 120 a second are every second one.
        self.state_sent = (self.state_sent + interval).max(now - interval);
        self.is_state_new = false;
        let world = self.follower.world.borrow().clone();
        if let Some(world) = world {
            self.outbox.world(self.shared.messages.world(&world, self.want.world));
        }
        None
    }

    /// Asks for the newest frame, if the page may have it now.
    pub fn pull_frame(&mut self) {
        let newest = {
            let world = self.follower.world.borrow();
            world.as_ref().and_then(|world| Some(WorldFrame { frame: world.frame?, is_paused: world.paused }))
        };
        // On a slow link a second frame set would only queue behind the first.
        let has_room = self.is_quick || self.outbox.frame_waits().is_none();
        let is_clear = self.outbox.is_clear() && has_room && !self.is_late();
        self.frames.pull(newest, &self.want, self.link.tier(), is_clear);
    }

    /// A ping was answered.
    pub fn pong(&mut self, number: &[u8]) -> Option<Ending> {
        let number = number.try_into().map(u32::from_le_bytes).ok()?;
        let arrival = self.outbox.pong(number)?;
        if arrival.is_of_frame {
            self.is_quick = arrival.took < self.base + QUICK;
            self.link.arrived(Instant::now(), arrival.took);
        }
        self.base = self.base.min(arrival.took);
        None
    }

    /// Checks that the page is alive.
    pub fn ping(&mut self) -> Option<Ending> {
        self.outbox.ping();
        // Routes change: what was the least long ago counts less and less.
        self.base = self.base.mul_f64(1.02).min(WRITE_TIMEOUT);
        None
    }

    /// Judges the link, sends the status, and gives up a page that no longer reads.
    pub fn look_at_link(&mut self) -> Option<Ending> {
        let now = Instant::now();
        let bytes = self.bytes_sent.bytes();
        let grown = bytes - self.last_bytes;
        if grown > 0 || !self.outbox.is_busy() {
            self.progress_at = now;
        }
        self.last_bytes = bytes;
        let is_silent = self.outbox.silence().is_some_and(|silence| silence > WRITE_TIMEOUT);
        if is_silent || now.duration_since(self.progress_at) > WRITE_TIMEOUT {
            return Some(Ending::Stalled);
        }
        self.link.judge(now, self.outbox.frame_waits(), self.base, self.frames.interval(&self.want));
        let (sent, dropped) = self.frames.counts();
        let feed = FeedStatus {
            bytes_per_s: grown as f64 / STATUS_EVERY.as_secs_f64(),
            sent,
            dropped,
            tier: self.link.tier().name(),
            pages: self.shared.pages.taken(),
        };
        let is_paused = self.follower.world.borrow().as_ref().is_some_and(|world| world.paused);
        let status = self.follower.status.borrow().clone();
        self.outbox.status(text::status(status.as_deref(), is_paused, &feed));
        None
    }
}
