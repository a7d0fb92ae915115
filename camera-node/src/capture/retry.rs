//! When a live camera's source that has failed is opened again, and what of it is worth a line. No clock: times
//! are arguments.

use std::time::{Duration, Instant};

/// The shortest pause: a program that ends at once takes little of the machine.
const FIRST_PAUSE: Duration = Duration::from_millis(50);
/// The longest: a camera that is plugged in again films soon.
const LONGEST_PAUSE: Duration = Duration::from_secs(5);
/// A source that has given frames for so long runs well: its next failure is a new one.
const RAN_WELL: Duration = Duration::from_secs(5);
/// How many different reasons of one outage are told apart.
const MAX_REASONS: usize = 8;

/// What a film thread remembers of its source's failures.
pub(super) struct Retry {
    random: u64,
    /// What the next pause is at most.
    pause: Duration,
    /// Why it has failed since it last ran well, without what differs from time to time.
    reasons: Vec<String>,
    /// When the source that is open gave its first frame.
    films_since: Option<Instant>,
}

/// What to do about a failure.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Failure {
    /// How long to wait before the source is opened again.
    pub pause: Duration,
    /// Whether it has not failed for this reason since it last ran well.
    pub is_new: bool,
}

impl Retry {
    /// Nothing has failed. Different seeds keep cameras apart that are lost together, as those of one hub.
    pub fn new(seed: u64) -> Retry {
        Retry { random: seed, pause: 2 * FIRST_PAUSE, reasons: Vec::new(), films_since: None }
    }

    /// Notes that a frame has come; true if with it the source runs well again after it had failed.
    pub fn filmed(&mut self, now: Instant) -> bool {
        let since = *self.films_since.get_or_insert(now);
        if self.reasons.is_empty() || now.saturating_duration_since(since) < RAN_WELL {
            return false;
        }
        self.pause = 2 * FIRST_PAUSE;
        self.reasons.clear();
        true
    }

    /// Notes that the source has failed. Pauses double from one failure to the next, and are half of that to all
    /// of it by chance.
    pub fn failed(&mut self, reason: &str) -> Failure {
        self.films_since = None;
        let pause = self.pause.mul_f64(0.5 + 0.5 * self.random_share());
        self.pause = (2 * self.pause).min(LONGEST_PAUSE);
        let reason = lasting_part(reason);
        let is_new = !self.reasons.contains(&reason);
        if is_new {
            if self.reasons.len() == MAX_REASONS {
                self.reasons.remove(0);
            }
            self.reasons.push(reason);
        }
        Failure { pause, is_new }
    }

    /// From 0 up to 1 (splitmix64).
    fn random_share(&mut self) -> f64 {
        self.random = self.random.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut bits = self.random;
        bits = (bits ^ (bits >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        bits = (bits ^ (bits >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((bits ^ (bits >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }
}

/// A reason without numbers: counts of frames and the addresses in ffmpeg's lines are others each time.
fn lasting_part(reason: &str) -> String {
    reason.chars().filter(|letter| !letter.is_ascii_hexdigit()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pauses(retry: &mut Retry, count: usize) -> Vec<Duration> {
        (0..count).map(|_| retry.failed("no camera").pause).collect()
    }

    #[test]
    fn pauses_double_from_50_ms_to_5_s_and_differ_by_seed_alone() {
        let mut limits = vec![];
        for seed in 0..200 {
            let found = pauses(&mut Retry::new(seed), 12);
            for (index, pause) in found.iter().enumerate() {
                let most = LONGEST_PAUSE.min(FIRST_PAUSE * 2 * (1 << index));
                assert!((most / 2..=most).contains(pause), "{pause:?} after {index} others");
            }
            assert_eq!(found, pauses(&mut Retry::new(seed), 12));
            limits.push(found[11]);
        }
        limits.sort_unstable();
        limits.dedup();
        assert!(limits.len() > 190, "pauses of different cameras differ");
        let spread = limits[limits.len() - 1].saturating_sub(limits[0]);
        assert!(spread > Duration::from_secs(2), "they lie apart: {spread:?}");
    }

    #[test]
    fn pauses_start_over_once_a_source_has_run_well() {
        let (mut retry, began) = (Retry::new(1), Instant::now());
        pauses(&mut retry, 10);
        assert!(!retry.filmed(began));
        assert!(!retry.filmed(began + RAN_WELL / 2));
        assert!(retry.failed("no camera").pause > Duration::from_secs(2), "it ran too briefly");
        assert!(!retry.filmed(began + RAN_WELL), "time before a failure does not count");
        assert!(retry.filmed(began + 2 * RAN_WELL), "it runs well");
        assert!(!retry.filmed(began + 3 * RAN_WELL), "which is told once");
        assert!(retry.failed("no camera").pause <= 2 * FIRST_PAUSE);
    }

    #[test]
    fn a_reason_is_new_once_until_the_source_has_run_well() {
        let (mut retry, now) = (Retry::new(1), Instant::now());
        assert!(retry.failed("failed after 37 frames ([v4l2 @ 0x55ad3f]: busy)").is_new);
        assert!(!retry.failed("failed after 2 frames ([v4l2 @ 0x560e00]: busy)").is_new);
        assert!(retry.failed("no such device").is_new);
        assert!(!retry.failed("failed after 0 frames ([v4l2 @ 0x5]: busy)").is_new, "they may take turns");
        retry.filmed(now);
        retry.filmed(now + RAN_WELL);
        assert!(retry.failed("no such device").is_new);
        for length in 1..1000 {
            assert!(retry.failed(&"?".repeat(length)).is_new);
        }
        assert_eq!(retry.reasons.len(), MAX_REASONS);
    }
}
