//! Rate-limited log for lines that thousands of untrusted peers may cause: one a second, and how many were left out.

use std::fmt::Display;
use std::time::Duration;

use parking_lot::Mutex;
use tokio::time::Instant;

const EVERY: Duration = Duration::from_secs(1);

/// A log of one line a second at most.
#[derive(Debug, Default)]
pub struct RateLimitedLog(Mutex<Option<(Instant, u64)>>);

impl RateLimitedLog {
    /// Warns of what became of something, and why.
    pub fn warn(&self, what: &dyn Display, why: &dyn Display) {
        if let Some(unsaid) = self.may_say(Instant::now()) {
            tracing::warn!("{}", line(what, why, unsaid));
        }
    }

    /// How many were left out before, if this one may be said.
    fn may_say(&self, now: Instant) -> Option<u64> {
        let mut last = self.0.lock();
        match &mut *last {
            Some((at, unsaid)) if now.saturating_duration_since(*at) < EVERY => {
                *unsaid += 1;
                None
            }
            said => {
                let unsaid = said.map_or(0, |(_, unsaid)| unsaid);
                *said = Some((now, 0));
                Some(unsaid)
            }
        }
    }
}

fn line(what: &dyn Display, why: &dyn Display, unsaid: u64) -> String {
    let more = if unsaid > 0 { format!(" (and {unsaid} more since the line before)") } else { String::new() };
    format!("{what}: {why}{more}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_a_second_is_said_and_the_others_are_counted() {
        let (log, began) = (RateLimitedLog::default(), Instant::now());
        let said: Vec<_> =
            (0..25).map(|tenth| log.may_say(began + Duration::from_millis(100 * tenth))).collect();
        let said: Vec<u64> = said.into_iter().flatten().collect();
        assert_eq!(said, [0, 9, 9]);
        assert_eq!(line(&"a call was refused", &"no", 0), "a call was refused: no");
        assert_eq!(
            line(&"a call was refused", &"no", 9),
            "a call was refused: no (and 9 more since the line before)"
        );
    }
}
