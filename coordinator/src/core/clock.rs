//! Film time: which frame a step sees, how many steps share it, and when a live step is due. It is this process's own
//! clock, whatever happens to the wall clock.

use film_time::{FrameReport, Pace};

use super::latency::FilmLatency;

/// Live steps never lag by more than this behind film, seconds.
const MAX_LAG_S: f64 = 0.15;
/// And may lag by this, however little film nodes keep, seconds.
pub(crate) const LEAST_LAG_S: f64 = 0.02;

/// A step is due that is due within this, seconds: sums of times are no more exact, and no timer is finer.
const DUE_WITHIN_S: f64 = 1e-9;

/// Film times a billionth of a frame before a frame count as that frame's: sums of steps fall short.
const FRAME_SLACK: f64 = 1e-9;

/// The frame that a step ending at `film_s` (seconds) must see.
pub(crate) fn frame_at(film_s: f64, fps: f64) -> u64 {
    (film_s * fps + FRAME_SLACK).floor() as u64
}

/// How many steps of `dt_s` after the one that ends at `film_s` must see the same frame, at most `most`.
/// Film time alone decides: a frame that comes late leaves the one before in use for longer.
pub(crate) fn steps_that_share(film_s: f64, dt_s: f64, fps: f64, most: usize) -> usize {
    let frame = frame_at(film_s, fps);
    (1..=most).take_while(|&later| frame_at(film_s + later as f64 * dt_s, fps) == frame).count()
}

/// What clocks say at one moment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Now {
    /// By [`film_time::monotonic_s`].
    pub monotonic_s: f64,
    /// By [`film_time::unix_now_s`].
    pub unix_s: f64,
}

/// Film time against the clock.
pub(crate) struct Clock {
    pub pace: Pace,
    pub latency: FilmLatency,
    /// What nodes keep of film, seconds.
    kept_s: f64,
    /// It has begun and was not in time yet: it may lag by what nodes keep.
    catches_up: bool,
    /// Film time that was given up because steps took too long.
    pub slipped_s: f64,
    /// Film time that went by without steps on purpose: pauses, and the worlds before this one; less the time that
    /// this one had before this run.
    pub passed_s: f64,
    /// A run that follows a schedule has its film times from there, so that its pauses shift them all.
    pub shifted_s: f64,
    /// Seconds of film in a second: not 1 only in a replay.
    pub speed: f64,
}

impl Clock {
    /// A clock of nodes that keep so much film, seconds.
    pub fn new(pace: Pace, latency: FilmLatency, kept_s: f64) -> Clock {
        let (slipped_s, passed_s, shifted_s) = (0.0, 0.0, 0.0);
        Clock { pace, latency, kept_s, catches_up: false, slipped_s, passed_s, shifted_s, speed: 1.0 }
    }

    /// The first step is about to be made: if there is film, what nodes still keep of it is made good.
    pub fn begin(&mut self, film_s: f64, has_film: bool, now: Now) {
        self.latency.begin(self.film_now_s(now));
        self.catches_up = has_film;
        self.slip(film_s, now);
    }

    /// By how much film time is ahead of a world's own.
    pub fn offset_s(&self) -> f64 {
        self.slipped_s + self.passed_s
    }

    /// How long ago the step of a film time was due; negative before.
    fn lag_s(&self, film_s: f64, now: Now) -> f64 {
        self.film_now_s(now) - (film_s / self.speed + self.latency.now_s() + self.shifted_s)
    }

    /// How long ago a frame was captured, seconds. In lock-step film has no time: by the wall clock of where that was.
    pub fn age_s(&self, report: &FrameReport, now: Now) -> f64 {
        if self.pace.lock_step {
            now.unix_s - report.captured_unix_s
        } else {
            self.film_now_s(now) - report.capture_time_s
        }
    }

    /// In how many seconds the step of a film time is due, if that is still to come.
    pub fn left_s(&mut self, film_s: f64, now: Now) -> Option<f64> {
        let left_s = -self.lag_s(film_s, now);
        let is_early = left_s > DUE_WITHIN_S;
        self.catches_up &= !is_early;
        is_early.then_some(left_s)
    }

    /// Film time, seconds.
    pub fn film_now_s(&self, now: Now) -> f64 {
        now.monotonic_s - self.pace.zero_s
    }

    /// The film time that is now due, if it is later than this.
    pub fn now_s(&self, film_s: f64, now: Now) -> f64 {
        film_s + self.lag_s(film_s, now).max(0.0)
    }

    /// The film time of a step, later by what steps can no longer make good.
    pub fn slipped_film_s(&self, film_s: f64, now: Now) -> f64 {
        let now_s = self.now_s(film_s, now);
        if now_s - film_s > self.most_lag_s() { now_s } else { film_s }
    }

    /// Steps that lag by more give up film: what is older than nodes keep is not there when they ask for it.
    fn most_lag_s(&self) -> f64 {
        let kept_s = self.kept_s - self.latency.now_s();
        if self.catches_up { kept_s } else { kept_s.clamp(LEAST_LAG_S, MAX_LAG_S) }
    }

    /// Gives up film time that steps can no longer make good.
    pub fn slip(&mut self, film_s: f64, now: Now) {
        let lag_s = self.slipped_film_s(film_s, now) - film_s;
        if lag_s > 0.0 {
            tracing::warn!("steps lag {lag_s:.2} s behind film, which goes on without them");
            self.slipped_s += lag_s;
        }
    }

    /// Lets the film go by that came since a step was due: the step was not wanted.
    pub fn pass(&mut self, film_s: f64, now: Now) {
        self.passed_s += self.lag_s(film_s, now).max(0.0);
    }

    /// The same where film times are given: they are due later from now on.
    pub fn shift(&mut self, film_s: f64, now: Now) {
        self.shifted_s += self.lag_s(film_s, now).max(0.0);
    }

    /// Where film times are given: this one is due now, and the others before and after it.
    pub fn play_from(&mut self, film_s: f64, now: Now) {
        self.shifted_s += self.lag_s(film_s, now);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DT_S: f64 = 1.0 / 120.0;

    /// For each of the first steps, how many that follow share its frame.
    fn shared(fps: f64, steps: u64) -> Vec<usize> {
        (1..=steps).map(|step| steps_that_share(step as f64 * DT_S, DT_S, fps, 7)).collect()
    }

    #[test]
    fn frames_last_as_many_steps_as_film_time_says() {
        // Step k sees frame floor(k · fps / 120); step 1 comes after what would be step 0.
        assert_eq!(shared(30.0, 11), [2, 1, 0, 3, 2, 1, 0, 3, 2, 1, 0]);
        assert_eq!(shared(60.0, 5), [0, 1, 0, 1, 0]);
        assert_eq!(shared(50.0, 12), [1, 0, 1, 0, 2, 1, 0, 1, 0, 1, 0, 2]);
        assert_eq!(shared(25.0, 10), [3, 2, 1, 0, 4, 3, 2, 1, 0, 4]);
        assert_eq!(shared(120.0, 3), [0, 0, 0]);
        assert_eq!(shared(240.0, 3), [0, 0, 0]);
    }

    #[test]
    fn steps_never_lag_so_far_that_nodes_no_longer_have_their_frames() {
        let most_lag_s = |latency_s: f64| {
            let latency = FilmLatency::new(Some(latency_s), (1, 1), 0.68);
            Clock::new(Pace::live(1, 0.0), latency, 0.7).most_lag_s()
        };
        assert_eq!([0.1, 0.68].map(most_lag_s), [MAX_LAG_S, LEAST_LAG_S]);
    }

    #[test]
    fn what_is_shared_is_what_the_steps_see() {
        for fps in [1.0, 7.5, 23.976, 25.0, 30.0, 50.0, 59.94, 60.0, 119.88, 120.0, 200.0] {
            for step in 1..=1200u64 {
                let film_s = step as f64 * DT_S;
                let count = steps_that_share(film_s, DT_S, fps, 7) as u64;
                let frame = |later: u64| frame_at((step + later) as f64 * DT_S, fps);
                assert!((0..=count).all(|later| frame(later) == frame(0)), "step {step} at {fps}");
                assert!(count == 7 || frame(count + 1) > frame(0), "step {step} at {fps}");
            }
        }
    }
}
