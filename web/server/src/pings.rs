//! How often a peer may ping: each ping is answered, and an answer that is not read waits in memory.

use std::time::{Duration, Instant};

/// Browsers send none, and programs one in some seconds.
const MOST_A_SECOND: u32 = 16;

/// The pings of one peer.
#[derive(Debug, Default)]
pub(crate) struct Pings {
    since: Option<Instant>,
    count: u32,
}

impl Pings {
    /// Why a peer is dropped that pings now, if it pings too often.
    pub fn note(&mut self, now: Instant) -> Option<String> {
        let since = *self.since.get_or_insert(now);
        if now - since > Duration::from_secs(1) {
            (self.since, self.count) = (Some(now), 0);
        }
        self.count += 1;
        (self.count > MOST_A_SECOND)
            .then(|| format!("over {MOST_A_SECOND} pings in a second, expected one in some seconds"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn seldom_pings_are_answered_and_a_flood_is_not() {
        let (mut pings, began) = (Pings::default(), Instant::now());
        let after = |ms| began + Duration::from_millis(ms);
        assert!((0..100).all(|ping| pings.note(after(100 * ping)).is_none()));
        let flood: Vec<bool> = (0..20).map(|_| pings.note(after(20_000)).is_some()).collect();
        assert_eq!(flood.iter().position(|&dropped| dropped), Some(MOST_A_SECOND as usize));
    }
}
