//! Simulated time: a process in which nothing happens but in the order that its simulation says.

use std::sync::OnceLock;

static CLOCK: OnceLock<fn() -> f64> = OnceLock::new();

/// From now on [`monotonic_s`](crate::monotonic_s) and [`unix_now_s`](crate::unix_now_s) follow this clock, and no work is
/// given to other threads. The first call decides.
pub fn simulate(clock: fn() -> f64) {
    // A second one changes nothing.
    let _ = CLOCK.set(clock);
}

/// The clock of the simulation, if this is one.
pub(crate) fn simulated_clock() -> Option<fn() -> f64> {
    CLOCK.get().copied()
}

/// Whether time is simulated: then nothing that is sent may depend on the wall clock.
pub fn is_simulated() -> bool {
    simulated_clock().is_some()
}

/// Does work that takes long on a thread of its own; in a simulation at once. `None` if it panicked, or the runtime ends.
pub async fn apart<T: Send + 'static>(work: impl FnOnce() -> T + Send + 'static) -> Option<T> {
    match simulated_clock() {
        Some(_) => Some(work()),
        None => tokio::task::spawn_blocking(work).await.ok(),
    }
}
