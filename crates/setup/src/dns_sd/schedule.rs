//! When a node announces itself on one network, and how many datagrams are read: decisions without sockets and clocks.

use std::time::{Duration, Instant};

/// A record is multicast once a second at most (RFC 6762, section 6): so many queries make no flood of answers.
const MIN_INTERVAL: Duration = Duration::from_secs(1);
/// Announcements that no query asked for, each after twice the time: the first may be lost.
const UNASKED: u32 = 3;

/// Datagrams that are read in an [`INTERVAL`], from all machines together; the system drops the others. Fifty nodes that
/// answer at once are fifty.
const MAX_READ: u32 = 400;
const INTERVAL: Duration = Duration::from_millis(100);

/// The announcements of a node on one network.
#[derive(Clone, Debug)]
pub(super) struct AnnouncementSchedule {
    due: Option<Instant>,
    last_sent: Option<Instant>,
    unasked: u32,
}

impl AnnouncementSchedule {
    /// Announces at once.
    pub(super) fn new(now: Instant) -> AnnouncementSchedule {
        AnnouncementSchedule { due: Some(now), last_sent: None, unasked: UNASKED }
    }

    /// A query asks for the announcement. It is answered after `delay`, different for each node, or a second after the
    /// last announcement; several queries get one answer.
    pub(super) fn ask(&mut self, delay: Duration, now: Instant) {
        let soon = self.last_sent.map_or(now, |last_sent| now.max(last_sent + MIN_INTERVAL)) + delay;
        self.due = Some(self.due.map_or(soon, |due| due.min(soon)));
    }

    /// When to announce next.
    pub(super) fn due(&self) -> Option<Instant> {
        self.due
    }

    /// Notes that an announcement was sent.
    pub(super) fn sent(&mut self, now: Instant) {
        self.last_sent = Some(now);
        self.unasked = self.unasked.saturating_sub(1);
        self.due = (self.unasked > 0).then(|| now + MIN_INTERVAL * 2_u32.pow(UNASKED - 1 - self.unasked));
    }
}

/// How many more datagrams may be read. It bounds the processor's time, however many are sent.
#[derive(Clone, Debug)]
pub(super) struct ReadBudget {
    left: u32,
    renewed: Instant,
}

impl ReadBudget {
    pub(super) fn new(now: Instant) -> ReadBudget {
        ReadBudget { left: MAX_READ, renewed: now }
    }

    /// Whether one more may be read.
    pub(super) fn may_read(&mut self, now: Instant) -> bool {
        if now >= self.renewed + INTERVAL {
            *self = ReadBudget::new(now);
        }
        self.left > 0
    }

    /// One was read.
    pub(super) fn spend(&mut self) {
        self.left = self.left.saturating_sub(1);
    }

    /// When reading may go on; `None`: now.
    pub(super) fn paused_until(&self, now: Instant) -> Option<Instant> {
        (self.left == 0).then_some(self.renewed + INTERVAL).filter(|until| now < *until)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// When announcements are sent within so many milliseconds, if queries come at these.
    fn sent_ms(queries_ms: &[u64], delay_ms: u64, until_ms: u64) -> Vec<u64> {
        let began = Instant::now();
        let mut schedule = AnnouncementSchedule::new(began);
        let mut sent = Vec::new();
        for ms in 0..until_ms {
            let now = began + Duration::from_millis(ms);
            if queries_ms.contains(&ms) {
                schedule.ask(Duration::from_millis(delay_ms), now);
            }
            if schedule.due().is_some_and(|due| due <= now) {
                schedule.sent(now);
                sent.push(ms);
            }
        }
        sent
    }

    #[test]
    fn a_node_announces_itself_three_times_unasked() {
        assert_eq!(sent_ms(&[], 50, 100_000), [0, 1000, 3000]);
    }

    #[test]
    fn a_query_is_answered_after_the_delay() {
        assert_eq!(sent_ms(&[20_000], 50, 30_000), [0, 1000, 3000, 20_050]);
    }

    #[test]
    fn a_flood_of_queries_is_answered_once_a_second() {
        let flood: Vec<u64> = (10_000..20_000).collect();
        let sent = sent_ms(&flood, 50, 30_000);
        assert!(sent.len() <= 15, "{sent:?}");
        assert!(sent.windows(2).all(|pair| pair[1] - pair[0] >= 1000), "{sent:?}");
    }

    #[test]
    fn a_flood_of_datagrams_is_read_in_part() {
        let began = Instant::now();
        let mut budget = ReadBudget::new(began);
        let mut read = 0;
        for us in (0..1_000_000).step_by(10) {
            let now = began + Duration::from_micros(us);
            if budget.may_read(now) {
                budget.spend();
                read += 1;
            }
        }
        assert_eq!(read, 4000);
        assert_eq!(
            budget.paused_until(began + Duration::from_millis(950)),
            Some(began + Duration::from_secs(1))
        );
    }
}
