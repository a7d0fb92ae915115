//! Whether the work of a process gets on: what a watchdog wants to know of it.

use std::fmt;
use std::sync::{Arc, Weak};
use std::time::{Duration, Instant};

use parking_lot::Mutex;

/// The work that a process must get on with, piece by piece.
#[derive(Clone, Debug, Default)]
pub struct Pulse(Arc<Mutex<Vec<Weak<Beat>>>>);

/// One piece of that work: mostly what one thread does. It is watched as long as it lives.
#[derive(Debug)]
pub struct Beat {
    name: String,
    /// When it last got on; none while it waits for others.
    at: Mutex<Option<Instant>>,
}

/// Work that does not get on.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Stuck {
    /// The name of the work, for the log.
    pub name: String,
    /// For how long.
    pub since: Duration,
}

impl Pulse {
    /// More work, by its name. It waits at first.
    pub fn beat(&self, name: impl Into<String>) -> Arc<Beat> {
        let beat = Arc::new(Beat { name: name.into(), at: Mutex::default() });
        let mut beats = self.0.lock();
        beats.retain(|beat| beat.strong_count() > 0);
        beats.push(Arc::downgrade(&beat));
        beat
    }

    /// What has been at one thing for longer than `limit`, if anything; of several the longest.
    pub fn stuck(&self, limit: Duration) -> Option<Stuck> {
        let beats: Vec<Arc<Beat>> = self.0.lock().iter().filter_map(Weak::upgrade).collect();
        let since = |beat: &Arc<Beat>| Some((beat.at.lock().as_ref()?.elapsed(), beat.name.clone()));
        let (since, name) = beats.iter().filter_map(since).max()?;
        (since > limit).then_some(Stuck { name, since })
    }
}

impl Beat {
    /// It gets on: it begins something, or shows that it is still at it.
    pub fn works(&self) {
        *self.at.lock() = Some(Instant::now());
    }

    /// It waits for others, who may take as long as they like.
    pub fn waits(&self) {
        *self.at.lock() = None;
    }
}

impl fmt::Display for Stuck {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} has not got on for {:.1} s", self.name, self.since.as_secs_f64())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn work_that_does_not_get_on_is_named_and_work_that_waits_is_not() {
        let pulse = Pulse::default();
        let [first, second] = ["first", "second"].map(|name| pulse.beat(name));
        assert_eq!(pulse.stuck(Duration::ZERO), None, "nothing has begun");
        first.works();
        std::thread::sleep(Duration::from_millis(2));
        second.works();
        assert_eq!(pulse.stuck(Duration::from_secs(60)), None);
        let stuck = |pulse: &Pulse| pulse.stuck(Duration::ZERO).map(|stuck| stuck.name);
        assert_eq!(stuck(&pulse).as_deref(), Some("first"), "for longer than the other");
        first.waits();
        assert_eq!(stuck(&pulse).as_deref(), Some("second"));
        drop(second);
        assert_eq!(stuck(&pulse), None, "what is over is not watched");
    }
}
