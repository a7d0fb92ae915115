//! How a camera films, from the frames that it has delivered: for those who look, never for an answer. No clock: times
//! are arguments.

use std::collections::VecDeque;

use proto::{CameraStatus, CameraTrouble, NewestFrame, TroubleKind};

use super::frame::{CameraFrame, Stamp};

/// Frames per second are measured over so long, and over so many frames of slow film.
const MEASURED_S: f64 = 1.0;
const LEAST_FRAMES: usize = 4;
/// What is older no longer counts.
const WINDOW_S: f64 = 5.0;
const MOST_FRAMES: usize = 256;
/// A camera that has given nothing for so many periods gives no frames at present.
const SILENT_PERIODS: f64 = 4.0;

/// A frame that came.
#[derive(Clone, Copy, Debug)]
struct Came {
    number: u64,
    capture_time_s: f64,
    at_s: f64,
}

/// How one camera films in the run that is on.
#[derive(Clone, Debug, Default)]
pub(super) struct CameraHealth {
    frames: u64,
    /// The newest frame, its age that at which it came.
    newest: Option<NewestFrame>,
    recent: VecDeque<Came>,
    /// What was last wrong, and when.
    trouble: Option<(TroubleKind, String, f64)>,
}

impl CameraHealth {
    /// A frame has come.
    pub fn note(&mut self, stamp: Stamp, part: &CameraFrame, at_s: f64) {
        self.frames += 1;
        let pixels = f64::from(part.silhouette.width()) * f64::from(part.silhouette.height());
        self.newest = Some(NewestFrame {
            frame: stamp.number,
            age_s: part.late_s,
            foreground: part.silhouette.area() as f64 / pixels.max(1.0),
            stamps: part.stamps,
            pace: part.pace,
        });
        self.recent.push_back(Came { number: stamp.number, capture_time_s: stamp.capture_time_s, at_s });
        let is_old = |first: &Came| at_s - first.at_s > WINDOW_S;
        while self.recent.len() > MOST_FRAMES || self.recent.front().is_some_and(is_old) {
            self.recent.pop_front();
        }
    }

    /// Its film has failed.
    pub fn fail(&mut self, kind: TroubleKind, why: &str, at_s: f64) {
        self.trouble = Some((kind, why.to_owned(), at_s));
    }

    /// What is known of the camera at this place in the rig.
    pub fn status(&self, rig_index: u16, now_s: f64) -> CameraStatus {
        let (since_s, period_s) = match (self.recent.back(), self.period_s()) {
            (Some(last), period_s) => ((now_s - last.at_s).max(0.0), period_s),
            (None, _) => (0.0, None),
        };
        let is_silent = |period_s: f64| since_s > (SILENT_PERIODS * period_s).max(MEASURED_S);
        let period_s = period_s.filter(|period_s| !is_silent(*period_s));
        let newest = self.newest.map(|newest| {
            let came_s = self.recent.back().map_or(now_s, |last| last.at_s);
            NewestFrame { age_s: (newest.age_s + now_s - came_s).max(0.0), ..newest }
        });
        let trouble = self.trouble.as_ref().map(|(kind, message, at_s)| CameraTrouble {
            kind: *kind,
            message: message.clone(),
            age_s: (now_s - at_s).max(0.0),
        });
        CameraStatus {
            rig_index,
            frames: self.frames,
            newest,
            frames_per_s: period_s.map_or(0.0, |period_s| 1.0 / period_s),
            jitter_s: self.jitter_s(),
            trouble,
        }
    }

    /// Between the frames of about the last second, as they came.
    fn period_s(&self) -> Option<f64> {
        let last = self.recent.back()?;
        let counts =
            |(behind, came): &(usize, &Came)| last.at_s - came.at_s <= MEASURED_S || *behind <= LEAST_FRAMES;
        let (behind, first) = self.recent.iter().rev().enumerate().take_while(counts).last()?;
        let took_s = last.at_s - first.at_s;
        (behind > 0 && took_s > 0.0).then(|| took_s / behind as f64)
    }

    /// The standard deviation of capture times from the steady pace that fits all recent frames best.
    fn jitter_s(&self) -> f64 {
        let Some(first) = self.recent.front().filter(|_| self.recent.len() >= 2 * LEAST_FRAMES) else {
            return 0.0;
        };
        let point = |came: &Came| {
            let periods = came.number.saturating_sub(first.number) as f64;
            (periods, came.capture_time_s - first.capture_time_s)
        };
        let points = || self.recent.iter().map(point);
        let frames = self.recent.len() as f64;
        let mean = points().fold((0.0, 0.0), |sum, at| (sum.0 + at.0 / frames, sum.1 + at.1 / frames));
        let about = || points().map(|at| (at.0 - mean.0, at.1 - mean.1));
        let (spread, slope) = about().fold((0.0, 0.0), |sum, at| (sum.0 + at.0 * at.0, sum.1 + at.0 * at.1));
        let period_s = if spread > 0.0 { slope / spread } else { 0.0 };
        let squares = about().map(|at| at.1 - at.0 * period_s).map(|off_s| off_s * off_s);
        (squares.sum::<f64>() / frames).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use hull::{Observer, ProbeSettings, Silhouette};

    use super::*;

    /// Frames of these numbers, captured and come at these times, each an eighth foreground.
    fn filmed(frames: impl IntoIterator<Item = (u64, f64, f64)>) -> CameraHealth {
        let camera = crate::source::tests::camera(8, 4);
        let observer = Arc::new(Observer::new(camera, 0, ProbeSettings::default(), None));
        let mut mask = vec![0; 32];
        mask[..4].fill(1);
        let mut health = CameraHealth::default();
        for (number, capture_time_s, at_s) in frames {
            let silhouette = Silhouette::from_mask(8, 4, &mask).expect("a mask");
            let part = CameraFrame { late_s: 0.05, ..CameraFrame::new(&observer, silhouette, 0.5) };
            let stamp = Stamp { number, capture_time_s, captured_unix_s: 0.0 };
            health.note(stamp, &part, at_s);
        }
        health
    }

    fn steady(fps: f64, frames: u64) -> impl Iterator<Item = (u64, f64, f64)> {
        (0..frames).map(move |number| (number, number as f64 / fps, 10.0 + number as f64 / fps))
    }

    #[test]
    fn steady_film_has_its_rate_its_age_and_no_jitter() {
        for (fps, frames) in [(30.0, 200), (1000.0, 5000), (2.0, 7)] {
            let health = filmed(steady(fps, frames));
            let last_s = 10.0 + (frames - 1) as f64 / fps;
            let status = health.status(3, last_s + 0.01);
            assert!((status.frames_per_s / fps - 1.0).abs() < 1e-6, "{status:?}");
            assert!(status.jitter_s < 1e-6, "{status:?}");
            let newest = status.newest.expect("one");
            assert!((newest.age_s - 0.06).abs() < 1e-9, "{newest:?}");
            assert!((newest.foreground - 0.125).abs() < 1e-12);
            assert_eq!((status.rig_index, status.frames, newest.frame), (3, frames, frames - 1));
        }
    }

    #[test]
    fn film_that_stops_or_changes_its_rate_is_seen_within_a_second() {
        let health = filmed(steady(30.0, 60));
        assert!(health.status(0, 12.9).frames_per_s > 29.0);
        let silent = health.status(0, 13.1);
        assert_eq!(silent.frames_per_s, 0.0);
        assert!(silent.newest.expect("one").age_s > 1.0);
        let slower = (60..80)
            .map(|number| (number, 2.0 + (number - 60) as f64 / 10.0, 12.0 + (number - 60) as f64 / 10.0));
        let health = filmed(steady(30.0, 60).chain(slower));
        assert!((health.status(0, 13.95).frames_per_s - 10.0).abs() < 1e-6);
        let none = CameraHealth::default().status(0, 5.0);
        assert_eq!((none.frames, none.newest, none.frames_per_s), (0, None, 0.0));
    }

    #[test]
    fn unsteady_stamps_are_jitter_and_missed_frames_are_not() {
        let wobble = |number: u64| if number.is_multiple_of(2) { 0.004 } else { -0.004 };
        let unsteady = filmed(steady(20.0, 80).map(|(number, s, at_s)| (number, s + wobble(number), at_s)));
        let jitter_s = unsteady.status(0, 14.0).jitter_s;
        assert!((jitter_s - 0.004).abs() < 2e-4, "{jitter_s}");
        let missed = filmed(steady(20.0, 80).filter(|(number, ..)| number % 7 != 3));
        assert!(missed.status(0, 14.0).jitter_s < 1e-6);
    }

    #[test]
    fn the_last_trouble_is_remembered_with_its_age() {
        let mut health = filmed(steady(30.0, 3));
        health.fail(TroubleKind::Rate, "films 15 frames/s", 11.0);
        let trouble = health.status(0, 14.0).trouble.expect("one");
        let CameraTrouble { kind, message, age_s } = trouble;
        assert_eq!((kind, &message[..], age_s), (TroubleKind::Rate, "films 15 frames/s", 3.0));
    }
}
