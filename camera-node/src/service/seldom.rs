//! Rate-limited log for lines that thousands of untrusted peers may cause: one a second, and how many were left out.

use std::fmt::Display;
use std::net::IpAddr;
use std::time::Duration;

use parking_lot::Mutex;
use tokio::time::Instant;

const EVERY: Duration = Duration::from_secs(1);

/// Says something, and not every time.
#[derive(Debug, Default)]
pub(super) struct Seldom(Mutex<Option<(Instant, u64)>>);

impl Seldom {
    /// Warns of what became of something, and why.
    pub fn warn(&self, what: &str, why: &dyn Display) {
        if let Some(unsaid) = self.may_say(Instant::now()) {
            let more = if unsaid > 0 { format!(", and {unsaid} more") } else { String::new() };
            tracing::warn!("{what}: {why}{more}");
        }
    }

    /// Warns of a connection from that machine that is refused; `None` is this one.
    pub fn refused(&self, from: Option<IpAddr>, why: &dyn Display) {
        let from = from.map_or_else(|| "this machine".to_owned(), |from| from.to_string());
        self.warn(&format!("a connection from {from} was refused"), why);
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_a_second_is_said_and_the_others_are_counted() {
        let (seldom, began) = (Seldom::default(), Instant::now());
        let said: Vec<_> =
            (0..25).map(|tenth| seldom.may_say(began + Duration::from_millis(100 * tenth))).collect();
        let said: Vec<u64> = said.into_iter().flatten().collect();
        assert_eq!(said, [0, 9, 9]);
    }
}
