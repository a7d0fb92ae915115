//! Whether a loop still turns.

use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// Beats of a loop. Until the first one it is not said to be silent.
#[derive(Debug)]
pub struct Heartbeat {
    made: Instant,
    /// Milliseconds since then, and one; 0 before the first beat.
    last_ms: AtomicU64,
}

impl Default for Heartbeat {
    fn default() -> Heartbeat {
        Heartbeat { made: Instant::now(), last_ms: AtomicU64::new(0) }
    }
}

impl Heartbeat {
    /// The loop turns.
    pub fn beat(&self) {
        self.last_ms.store(self.now_ms(), Ordering::Relaxed);
    }

    /// For how long it has not turned.
    pub fn silence(&self) -> Duration {
        match self.last_ms.load(Ordering::Relaxed) {
            0 => Duration::ZERO,
            last_ms => Duration::from_millis(self.now_ms().saturating_sub(last_ms)),
        }
    }

    fn now_ms(&self) -> u64 {
        self.made.elapsed().as_millis() as u64 + 1
    }
}
