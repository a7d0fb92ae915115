//! Film time without wall clocks: the coordinator's clock, and how a node's own follows it.

use std::sync::LazyLock;
use std::time::Instant;

use crate::simulation::simulated_clock;

/// Seconds of this process's clock, which runs on whatever happens to the wall clock.
pub fn monotonic_s() -> f64 {
    static BEGAN: LazyLock<Instant> = LazyLock::new(Instant::now);
    simulated_clock().map_or_else(|| BEGAN.elapsed().as_secs_f64(), |clock| clock())
}

/// Film time by a node's clock.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClockLine {
    /// A reading of the node's [`monotonic_s`].
    pub node_s: f64,
    /// Film time then, seconds.
    pub film_s: f64,
    /// Seconds of film a second of the node's clock.
    pub rate: f64,
    /// How far film time may be off, seconds.
    pub bound_s: f64,
}

impl ClockLine {
    /// Film time in the coordinator's own process, where it is zero at a reading of its clock.
    pub fn of_this_process(zero_s: f64) -> ClockLine {
        ClockLine { node_s: zero_s, film_s: 0.0, rate: 1.0, bound_s: 0.0 }
    }

    /// Film time at a reading of the node's clock, seconds.
    pub fn film_s_at(&self, node_s: f64) -> f64 {
        self.film_s + (node_s - self.node_s) * self.rate
    }
}
