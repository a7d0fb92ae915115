//! The tier of a page's colours: what it asks for, or less where its link does not carry that.
//!
//! Behind every frame set goes a ping, which a browser answers as soon as it has received what came before,
//! however slowly it draws. So the time to the answer is the link's. A link is too slow if a frame set takes
//! longer to arrive than the next one takes to come.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use crate::tier::Tier;

/// A link that is too slow for so long gets a smaller tier.
const SLOW: Duration = Duration::from_secs(3);
/// Frame sets that are on their way for so long, one after the other, are too large: there is less at once. A single
/// one may have met a busy machine.
const TOO_LATE: Duration = Duration::from_millis(500);
const LATE_IN_A_ROW: usize = 2;
/// A link with room for so long gets a larger tier.
const RAISE_AFTER: Duration = Duration::from_secs(10);
/// A link that could not take more waits twice as long each time, up to so long.
const MAX_RAISE_AFTER: Duration = Duration::from_secs(160);
/// With room: a frame set arrives so many times faster than the next one comes; the next tier is about so many
/// times as large.
const ROOM_FACTOR: u32 = 3;
/// Arrivals looked at: those of so long.
const WINDOW: Duration = Duration::from_secs(3);
/// Arrivals kept at most: a hundred frames a second of them.
const MAX_KEPT: usize = 300;

/// One page's link.
#[derive(Debug)]
pub(crate) struct Link {
    asked: Tier,
    tier: Tier,
    /// When frame sets arrived, and how long they took.
    arrivals: VecDeque<(Instant, Duration)>,
    slow_since: Option<Instant>,
    room_since: Option<Instant>,
    raised_at: Option<Instant>,
    raise_after: Duration,
}

impl Link {
    pub fn new(asked: Tier) -> Link {
        Link {
            asked,
            tier: asked,
            arrivals: VecDeque::new(),
            slow_since: None,
            room_since: None,
            raised_at: None,
            raise_after: RAISE_AFTER,
        }
    }

    /// The tier now.
    pub fn tier(&self) -> Tier {
        self.tier
    }

    /// The page asks for another tier; what was learnt of the link starts over.
    pub fn ask(&mut self, asked: Tier) {
        if asked != self.asked {
            *self = Link::new(asked);
        }
    }

    /// A ping was answered: all that was sent before it took so long to arrive.
    pub fn arrived(&mut self, now: Instant, took: Duration) {
        if self.arrivals.len() == MAX_KEPT {
            self.arrivals.pop_front();
        }
        self.arrivals.push_back((now, took));
    }

    /// Looks at the last seconds. `waiting`: how long the oldest frame set has been on its way; `base`: the least
    /// that a ping of its own takes; `interval`: between wanted frame sets.
    pub fn judge(&mut self, now: Instant, waiting: Option<Duration>, base: Duration, interval: Duration) {
        while self.arrivals.front().is_some_and(|(at, _)| now.duration_since(*at) > WINDOW) {
            self.arrivals.pop_front();
        }
        let all = || self.arrivals.iter().map(|(_, took)| *took).chain(waiting);
        let count = all().count() as u32;
        let mean = all().sum::<Duration>().checked_div(count).map(|mean| mean.saturating_sub(base));
        let note = |since: &mut Option<Instant>, is: bool| {
            *since = if is { since.or(Some(now)) } else { None };
            since.map_or(Duration::ZERO, |since| now.duration_since(since))
        };
        let slow = note(&mut self.slow_since, mean.is_some_and(|mean| mean > interval));
        let room = note(&mut self.room_since, mean.is_some_and(|mean| mean * ROOM_FACTOR < interval));
        let late = |took: &Duration| took.saturating_sub(base) > TOO_LATE;
        let in_a_row = self.arrivals.iter().rev().take_while(|(_, took)| late(took)).count();
        let is_late = in_a_row >= LATE_IN_A_ROW;
        if (slow >= SLOW || is_late) && self.tier != Tier::Off {
            let was_raised = self.raised_at.is_some_and(|at| now.duration_since(at) < RAISE_AFTER);
            self.raise_after =
                if was_raised { (2 * self.raise_after).min(MAX_RAISE_AFTER) } else { self.raise_after };
            self.change(self.tier.less());
        } else if room >= self.raise_after && self.tier > self.asked {
            self.raised_at = Some(now);
            self.change(self.tier.more());
        }
    }

    fn change(&mut self, tier: Tier) {
        self.tier = tier;
        self.arrivals.clear();
        self.slow_since = None;
        self.room_since = None;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const INTERVAL: Duration = Duration::from_millis(33);
    const BASE: Duration = Duration::from_millis(40);

    /// A link on which a frame set of a tier takes some time; returns the tier after each second.
    fn play(link: &mut Link, from: Instant, seconds: u64, took: impl Fn(Tier) -> Duration) -> Vec<Tier> {
        let quarter = |quarter: u64| {
            let now = from + Duration::from_millis(250 * quarter);
            link.arrived(now, BASE + took(link.tier()));
            link.judge(now, None, BASE, INTERVAL);
            link.tier()
        };
        (0..4 * seconds).map(quarter).collect::<Vec<_>>().into_iter().skip(3).step_by(4).collect()
    }

    #[test]
    fn a_slow_link_gets_less_until_it_fits() {
        let mut link = Link::new(Tier::Full);
        let took = |tier| Duration::from_millis(if tier == Tier::Full { 90 } else { 20 });
        let tiers = play(&mut link, Instant::now(), 30, took);
        assert_eq!(tiers[1], Tier::Full, "not at once");
        assert_eq!(tiers[5..], vec![Tier::Half; 25], "20 ms fit, with no room for more");
    }

    #[test]
    fn frame_sets_that_come_much_too_late_are_the_last_of_their_size() {
        let mut link = Link::new(Tier::Full);
        let began = Instant::now();
        let late = BASE + Duration::from_millis(700);
        for (took, expected) in [
            (late, Tier::Full),
            (BASE, Tier::Full),
            (late, Tier::Full),
            (late, Tier::Half),
            (late, Tier::Half),
        ] {
            link.arrived(began, took);
            link.judge(began, None, BASE, INTERVAL);
            assert_eq!(link.tier(), expected);
        }
    }

    #[test]
    fn a_hopeless_link_gets_silhouettes_only_and_a_healed_one_everything() {
        let mut link = Link::new(Tier::Full);
        let began = Instant::now();
        assert_eq!(play(&mut link, began, 20, |_| Duration::from_millis(500)).last(), Some(&Tier::Off));
        let healed = play(&mut link, began + Duration::from_secs(20), 60, |_| Duration::from_millis(2));
        assert_eq!(healed.last(), Some(&Tier::Full));
        assert!(healed[5] == Tier::Off, "it must be at ease for ten seconds first");
    }

    #[test]
    fn a_link_that_cannot_take_more_is_tried_less_and_less() {
        let mut link = Link::new(Tier::Full);
        let took = |tier| Duration::from_millis(if tier == Tier::Full { 90 } else { 5 });
        let tiers = play(&mut link, Instant::now(), 400, took);
        let tries = tiers.windows(2).filter(|pair| pair[0] == Tier::Half && pair[1] == Tier::Full).count();
        assert!((2..=6).contains(&tries), "{tries} tries in 400 s");
    }

    #[test]
    fn what_the_page_asks_for_is_the_most_it_gets() {
        let mut link = Link::new(Tier::Quarter);
        let tiers = play(&mut link, Instant::now(), 60, |_| Duration::from_millis(1));
        assert_eq!(tiers.last(), Some(&Tier::Quarter));
        link.ask(Tier::Half);
        assert_eq!(link.tier(), Tier::Half, "what it asks for again it gets at once");
    }

    #[test]
    fn a_frame_set_that_never_arrives_counts() {
        let mut link = Link::new(Tier::Full);
        let began = Instant::now();
        for quarter in 0..16 {
            let waiting = Duration::from_millis(250 * quarter);
            link.judge(began + waiting, Some(waiting), BASE, INTERVAL);
        }
        assert_eq!(link.tier(), Tier::Half);
    }
}
