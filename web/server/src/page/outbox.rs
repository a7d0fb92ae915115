//! Messages that wait to be sent to one page: at most one of each kind, the newest, so that a slow page costs
//! nothing and gets nothing old.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use bytes::Bytes;
use parking_lot::{Mutex, MutexGuard};
use tokio::sync::Notify;

/// Answers that wait at most; a page that asks for more without reading is dropped.
const MAX_TEXTS: usize = 256;
/// Pings on their way that are remembered: two frame sets, and one a second for longer than a page is waited for.
const MAX_PINGS: usize = 16;

/// The next thing to send.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Item {
    Text(String),
    Binary(Bytes),
    /// Messages about one frame, and the ping behind them.
    Frame(Vec<Bytes>),
    Ping,
    /// The last message.
    Bye(String),
}

#[derive(Default)]
struct Slots {
    texts: VecDeque<String>,
    status: Option<String>,
    world: Option<Bytes>,
    frame: Option<Vec<Bytes>>,
    ping: bool,
    bye: Option<String>,
    is_busy: bool,
    pings: VecDeque<Ping>,
    next_ping: u32,
}

/// A ping on its way.
#[derive(Clone, Copy, Debug)]
struct Ping {
    number: u32,
    /// When what goes before it began to be sent.
    began: Instant,
    /// When the kernel had taken all of it.
    handed: Option<Instant>,
    is_behind_frame: bool,
}

/// What the answer to a ping shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Arrival {
    pub took: Duration,
    pub is_of_frame: bool,
}

#[derive(Default)]
pub(crate) struct Outbox {
    slots: Mutex<Slots>,
    filled: Notify,
    drained: Notify,
}

impl Outbox {
    /// A text that must not be lost; false if too many wait.
    pub fn text(&self, text: String) -> bool {
        let mut slots = self.slots();
        if slots.texts.len() >= MAX_TEXTS {
            return false;
        }
        slots.texts.push_back(text);
        drop(slots);
        self.filled.notify_one();
        true
    }

    pub fn status(&self, text: String) {
        self.slots().status = Some(text);
        self.filled.notify_one();
    }

    pub fn world(&self, bytes: Bytes) {
        self.slots().world = Some(bytes);
        self.filled.notify_one();
    }

    pub fn frame(&self, messages: Vec<Bytes>) {
        self.slots().frame = Some(messages);
        self.filled.notify_one();
    }

    pub fn ping(&self) {
        self.slots().ping = true;
        self.filled.notify_one();
    }

    /// Sends only what is being sent now, the newest world, and this: a page shows how a run ended.
    pub fn bye(&self, why: String, newest: Option<Bytes>) {
        let mut slots = self.slots();
        let world = newest.or(slots.world.take());
        *slots = Slots { is_busy: slots.is_busy, world, bye: Some(why), ..Slots::default() };
        drop(slots);
        self.filled.notify_one();
    }

    /// Whether a frame would be sent at once.
    pub fn is_clear(&self) -> bool {
        let slots = self.slots();
        !slots.is_busy && slots.frame.is_none()
    }

    /// Whether something is being sent, or waits.
    pub fn is_busy(&self) -> bool {
        self.slots().is_busy
    }

    /// Waits for the next thing to send.
    pub async fn next(&self) -> Item {
        loop {
            let filled = self.filled.notified();
            if let Some(item) = self.take() {
                return item;
            }
            self.drained.notify_one();
            filled.await;
        }
    }

    /// Waits until all has been sent, once more.
    pub async fn drained(&self) {
        self.drained.notified().await;
    }

    fn take(&self) -> Option<Item> {
        let mut slots = self.slots();
        let item = if slots.bye.is_some() {
            let world = slots.world.take().map(Item::Binary);
            world.or_else(|| slots.bye.take().map(Item::Bye))
        } else if let Some(text) = slots.texts.pop_front().or_else(|| slots.status.take()) {
            Some(Item::Text(text))
        } else if let Some(world) = slots.world.take() {
            Some(Item::Binary(world))
        } else if let Some(frame) = slots.frame.take() {
            Some(Item::Frame(frame))
        } else if std::mem::take(&mut slots.ping) {
            Some(Item::Ping)
        } else {
            None
        };
        slots.is_busy = item.is_some();
        item
    }

    /// The number of the ping that goes behind what begins to be sent now.
    pub fn begin_ping(&self, is_behind_frame: bool) -> u32 {
        let mut slots = self.slots();
        let number = slots.next_ping;
        slots.next_ping = number.wrapping_add(1);
        if slots.pings.len() == MAX_PINGS {
            slots.pings.pop_back();
        }
        slots.pings.push_back(Ping { number, began: Instant::now(), handed: None, is_behind_frame });
        number
    }

    /// The number of a ping to go behind what begins to be sent now, if no other is on its way: so it always shows
    /// how long what was sent takes to arrive.
    pub fn begin_ping_alone(&self) -> Option<u32> {
        let is_alone = self.slots().pings.is_empty();
        is_alone.then(|| self.begin_ping(false))
    }

    /// How long the oldest of what has not arrived yet has been on its way.
    pub fn on_its_way(&self) -> Option<Duration> {
        self.slots().pings.front().map(|ping| ping.began.elapsed())
    }

    /// The kernel has taken a ping and all before it.
    pub fn ping_handed(&self, number: u32) {
        let mut slots = self.slots();
        if let Some(ping) = slots.pings.iter_mut().find(|ping| ping.number == number) {
            ping.handed = Some(Instant::now());
        }
    }

    /// A ping was answered, and with it those before.
    pub fn pong(&self, number: u32) -> Option<Arrival> {
        let mut slots = self.slots();
        let place = slots.pings.iter().position(|ping| ping.number == number)?;
        let ping = slots.pings.drain(..=place).next_back()?;
        Some(Arrival { took: ping.began.elapsed(), is_of_frame: ping.is_behind_frame })
    }

    /// How long the oldest frame has been on its way.
    pub fn frame_waits(&self) -> Option<Duration> {
        let slots = self.slots();
        slots.pings.iter().find(|ping| ping.is_behind_frame).map(|ping| ping.began.elapsed())
    }

    /// How long the oldest ping that the kernel has taken has not been answered.
    pub fn silence(&self) -> Option<Duration> {
        let slots = self.slots();
        slots.pings.iter().find_map(|ping| ping.handed).map(|handed| handed.elapsed())
    }

    fn slots(&self) -> MutexGuard<'_, Slots> {
        self.slots.lock()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn the_newest_of_a_kind_is_sent_and_texts_all_of_them() {
        let outbox = Outbox::default();
        for round in 0..3u8 {
            outbox.world(Bytes::from(vec![round]));
            outbox.frame(vec![Bytes::from(vec![10 + round])]);
            outbox.status(format!("status {round}"));
            assert!(outbox.text(format!("text {round}")));
        }
        let mut sent = Vec::new();
        for _ in 0..6 {
            sent.push(outbox.next().await);
        }
        let text = |text: &str| Item::Text(text.into());
        let frame = Item::Frame(vec![Bytes::from(vec![12])]);
        let world = Item::Binary(Bytes::from(vec![2]));
        assert_eq!(sent, [text("text 0"), text("text 1"), text("text 2"), text("status 2"), world, frame]);
        assert!(outbox.take().is_none() && outbox.is_clear());
    }

    #[tokio::test]
    async fn the_newest_world_and_the_last_message_are_sent_and_nothing_else() {
        for (newest, sent) in [(None, 1), (Some(Bytes::from_static(&[2])), 2)] {
            let outbox = Outbox::default();
            outbox.world(Bytes::from_static(&[1]));
            outbox.frame(vec![Bytes::from_static(&[3])]);
            outbox.status("a status".into());
            outbox.bye("enough".into(), newest);
            assert_eq!(outbox.next().await, Item::Binary(Bytes::from(vec![sent])));
            assert_eq!(outbox.next().await, Item::Bye("enough".into()));
            assert!(outbox.take().is_none());
        }
    }

    #[test]
    fn unread_answers_are_bounded() {
        let outbox = Outbox::default();
        assert!((0..MAX_TEXTS).all(|_| outbox.text("done".into())));
        assert!(!outbox.text("one too many".into()));
    }

    #[test]
    fn a_ping_answers_for_those_before_it() {
        let outbox = Outbox::default();
        assert_eq!(outbox.on_its_way(), None);
        let frame = outbox.begin_ping(true);
        let own = outbox.begin_ping(false);
        assert!(outbox.on_its_way().is_some() && outbox.begin_ping_alone().is_none());
        assert!(outbox.frame_waits().is_some() && outbox.silence().is_none(), "not handed over yet");
        outbox.ping_handed(frame);
        assert!(outbox.silence().is_some());
        assert_eq!(outbox.pong(own).map(|arrival| arrival.is_of_frame), Some(false));
        assert!(outbox.frame_waits().is_none() && outbox.silence().is_none());
        assert_eq!(outbox.pong(frame), None, "an answer twice");
        assert!(outbox.begin_ping_alone().is_some());
    }
}
