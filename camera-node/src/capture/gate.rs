//! What stops the threads of a run, and how far they may go ahead.

use std::time::Duration;

use parking_lot::{Condvar, Mutex, MutexGuard};

use super::film_clock::FilmClock;

/// The longest sleep, seconds: film time may be set again meanwhile.
const MAX_SLEEP_S: f64 = 0.1;

/// Shared by the film threads of one run.
#[derive(Default)]
pub(super) struct Gate {
    state: Mutex<State>,
    changed: Condvar,
}

#[derive(Default)]
struct State {
    stopped: bool,
    up_to_frame: u64,
}

impl Gate {
    /// Lets lock-step film go on up to this frame.
    pub fn credit(&self, up_to_frame: u64) {
        let mut state = self.lock();
        state.up_to_frame = state.up_to_frame.max(up_to_frame);
        self.changed.notify_all();
    }

    /// Ends the run.
    pub fn stop(&self) {
        self.lock().stopped = true;
        self.changed.notify_all();
    }

    pub fn is_stopped(&self) -> bool {
        self.lock().stopped
    }

    /// Waits for the credit of a frame; false if the run stops.
    pub fn wait_for(&self, frame: u64) -> bool {
        let must_wait = |state: &mut State| !state.stopped && frame > state.up_to_frame;
        let mut state = self.lock();
        self.changed.wait_while(&mut state, must_wait);
        !state.stopped
    }

    /// Sleeps until a film time, seconds; false if the run stops.
    pub fn sleep_until(&self, film_s: f64, clock: &FilmClock) -> bool {
        loop {
            let left_s = film_s - clock.now_s();
            let mut state = self.lock();
            if state.stopped {
                return false;
            }
            if left_s <= 0.0 {
                return true;
            }
            let sleep = Duration::from_secs_f64(left_s.min(MAX_SLEEP_S));
            self.changed.wait_while_for(&mut state, |state| !state.stopped, sleep);
        }
    }

    /// Sleeps so long; false if the run stops.
    pub fn sleep(&self, pause: Duration) -> bool {
        let mut state = self.lock();
        self.changed.wait_while_for(&mut state, |state| !state.stopped, pause);
        !state.stopped
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock()
    }
}

#[cfg(test)]
mod tests {
    use film_time::ClockLine;

    use super::*;

    #[test]
    fn a_stop_wakes_every_wait_however_far_its_moment() {
        let (gate, clock) = (Gate::default(), FilmClock::new(ClockLine::of_this_process(0.0)));
        std::thread::scope(|scope| {
            let waits = [f64::MAX, 1e300, f64::INFINITY, f64::NAN].map(|film_s| {
                let (gate, clock) = (&gate, &clock);
                scope.spawn(move || gate.sleep_until(film_s, clock))
            });
            let credit = scope.spawn(|| gate.wait_for(u64::MAX));
            let pause = scope.spawn(|| gate.sleep(Duration::MAX));
            gate.stop();
            for wait in waits.into_iter().chain([credit, pause]) {
                assert!(!wait.join().expect("no panic"));
            }
        });
        assert!(!Gate::default().is_stopped() && Gate::default().sleep_until(-1e300, &clock));
    }
}
