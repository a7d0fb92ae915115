//! Film time in a node: it follows what the coordinator tells of it without ever being set.

use film_time::{ClockLine, monotonic_s};
use parking_lot::{Mutex, MutexGuard};

/// What film time is off is made good at this rate: slowly enough that no frame is counted twice.
const SLEW: f64 = 0.01;

/// Film time that is off by more is not slewed, seconds: nodes keep half a second of film.
const MOST_OFF_S: f64 = 0.5;

/// Film time, shared by the film threads of one run.
pub struct FilmClock(Mutex<State>);

struct State {
    line: ClockLine,
    /// By how much film time was ahead of the line when it was told, and when that was by the node's clock, seconds.
    ahead_s: f64,
    told_s: f64,
}

impl State {
    fn film_s_at(&self, node_s: f64) -> f64 {
        let made_good_s = SLEW * (node_s - self.told_s).max(0.0);
        let ahead_s = (self.ahead_s.abs() - made_good_s).max(0.0).copysign(self.ahead_s);
        self.line.film_s_at(node_s) + ahead_s
    }

    fn follow(&mut self, line: ClockLine, node_s: f64) {
        let ahead_s = self.film_s_at(node_s) - line.film_s_at(node_s);
        // This computer's clock stood still: numbers of frames only jump ahead.
        let ahead_s = if ahead_s < -MOST_OFF_S - line.bound_s { 0.0 } else { ahead_s };
        *self = State { line, ahead_s, told_s: node_s };
    }
}

impl FilmClock {
    /// Film time as it is told when a run begins.
    pub fn new(line: ClockLine) -> FilmClock {
        FilmClock(Mutex::new(State { line, ahead_s: 0.0, told_s: line.node_s }))
    }

    /// Film time, seconds.
    pub fn now_s(&self) -> f64 {
        self.lock().film_s_at(monotonic_s())
    }

    /// From now on goes towards another line; false if film time is too far ahead of it for that.
    pub fn follow(&self, line: ClockLine) -> bool {
        let (mut state, node_s) = (self.lock(), monotonic_s());
        let is_near = state.film_s_at(node_s) - line.film_s_at(node_s) <= MOST_OFF_S + line.bound_s;
        if is_near {
            state.follow(line, node_s);
        }
        is_near
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.0.lock()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(node_s: f64, film_s: f64) -> ClockLine {
        ClockLine { node_s, film_s, rate: 1.0, bound_s: 0.0 }
    }

    #[test]
    fn film_time_is_slewed_and_never_set() {
        for off_s in [0.03, -0.03] {
            let mut state = State { line: line(0.0, 0.0), ahead_s: 0.0, told_s: 0.0 };
            state.follow(line(10.0, 10.0 + off_s), 10.0);
            let mut before_s = state.film_s_at(10.0);
            assert!((before_s - 10.0).abs() < 1e-12, "it goes on from where it is");
            for step in 1..=4000 {
                let film_s = state.film_s_at(10.0 + f64::from(step) * 0.001);
                assert!(
                    (film_s - before_s - 0.001).abs() < 1.001e-5,
                    "never faster or slower by more than a hundredth"
                );
                before_s = film_s;
            }
            assert!((before_s - (14.0 + off_s)).abs() < 1e-9, "and ends where it was told");
        }
    }

    #[test]
    fn film_time_of_a_clock_that_stood_still_jumps_ahead() {
        let mut state = State { line: line(0.0, 0.0), ahead_s: 0.0, told_s: 0.0 };
        state.follow(line(10.0, 15.0), 10.0);
        assert!((state.film_s_at(10.0) - 15.0).abs() < 1e-12);
        state.follow(line(20.0, 20.0), 20.0);
        assert!(state.film_s_at(20.0) > 24.9, "it never goes back");
    }

    #[test]
    fn a_correction_under_way_is_taken_over_by_the_next() {
        let mut state = State { line: line(0.0, 0.0), ahead_s: 0.0, told_s: 0.0 };
        state.follow(line(1.0, 1.01), 1.0);
        let before_s = state.film_s_at(1.5);
        state.follow(line(1.5, 1.4), 1.5);
        assert!((state.film_s_at(1.5) - before_s).abs() < 1e-12);
        assert!((state.film_s_at(20.0) - 19.9).abs() < 1e-9);
    }
}
