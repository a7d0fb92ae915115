//! Which number of the cluster's count a live camera's frame has, by what its source knows. No clock: times are
//! arguments.
//!
//! Frames come at a steady pace and only ever late: what comes earliest tells when all were captured. Once counting, a
//! camera counts on until it is most of a period off, so that one whose captures lie at the turn of the count does not
//! repeat one number and miss the next.

use std::collections::VecDeque;

use film_time::{CameraPace, Stamps};
use proto::TroubleKind;
use thiserror::Error;

/// So far off, periods, a number no longer follows from the one before.
const TURN: f64 = 0.75;
/// So far off, periods, a counter is not the one that it was.
const COUNTER_TURN: f64 = 0.5;
/// For so many frames in a row, and no burst, before that is believed.
const SURE_FRAMES: usize = 5;
/// What is so old no longer counts, seconds, unless there are but a few frames.
const WINDOW_S: f64 = 4.0;
const LEAST_FRAMES: usize = 24;
const MOST_FRAMES: usize = 4096;
/// Phase and rate are told after so much film, seconds.
const FIT_S: f64 = 1.0;
const RATED_S: f64 = 2.0;
/// How far a camera's rate may be off, a share.
const MOST_OFF: f64 = 0.01;
/// Times that a camera says never jump by more, seconds; its clock may be set a little.
const MOST_JUMP_S: f64 = 1.0;
/// A counter that is off by more, periods, numbers no frame before it is anchored again.
const MAD_PERIODS: f64 = 2.0;

/// Why a frame has no number, and none that follows will.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum NumberFault {
    /// Another rate than the cluster's.
    #[error("films {found:.2} frames/s, expected {expected} as fps of the cluster file")]
    Rate {
        /// Frames per second.
        found: f64,
        /// Of the cluster.
        expected: f64,
    },
    /// A time or count is not later than the one before.
    #[error("said {found} after {before} of the frame before, expected more")]
    Backwards {
        /// What it said.
        found: f64,
        /// What it had said.
        before: f64,
    },
    /// A time is long after its frame came.
    #[error("said {found_ms} ms, a jump of {by_s:.1} s past when the frame came")]
    Jump {
        /// What it said.
        found_ms: f64,
        /// By how much it is off.
        by_s: f64,
    },
}

impl NumberFault {
    /// For who looks.
    pub fn kind(&self) -> TroubleKind {
        match self {
            NumberFault::Rate { .. } => TroubleKind::Rate,
            NumberFault::Backwards { .. } | NumberFault::Jump { .. } => TroubleKind::Stamps,
        }
    }
}

/// Number and capture time of a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Numbered {
    /// Its number; there is none before film begins.
    pub number: Option<u64>,
    /// Seconds of film.
    pub capture_time_s: f64,
    /// A counter was off, and counts from somewhere else from now on: by so many frames.
    pub anchored_again: Option<i64>,
}

/// A frame that came.
#[derive(Clone, Copy)]
struct Point {
    /// Its place among those that came, or its count.
    unit: i64,
    /// The camera's own time: what it says, or what its count makes at the cluster's pace.
    own_s: f64,
    arrival_s: f64,
}

/// The numbers of one live camera.
pub struct LiveNumbers {
    stamps: Stamps,
    fps: f64,
    latency_s: f64,
    points: VecDeque<Point>,
    frames: i64,
    /// Frames that the camera itself missed.
    missed: i64,
    /// Seconds a frame, as measured.
    period_s: f64,
    next_rating: i64,
    /// What was said of the first frame, and of the one before.
    first_said: Option<f64>,
    said: Option<f64>,
    /// From the count of the frames to numbers.
    base: Option<i64>,
    before: Option<i64>,
    /// Numbers follow each other from a phase and a pace that are known.
    is_settled: bool,
    off: Off,
    phase: f64,
}

/// Frames in a row that are off, and by how many periods the least.
#[derive(Default)]
struct Off {
    frames: usize,
    least: f64,
}

impl Off {
    /// Notes a frame; by how much all of enough frames were off, once they were.
    fn note(&mut self, periods: f64, is_off: bool) -> Option<f64> {
        if !is_off || self.frames > 0 && periods.signum() != self.least.signum() {
            *self = Off::default();
        }
        if !is_off {
            return None;
        }
        self.least = if self.frames == 0 || periods.abs() < self.least.abs() { periods } else { self.least };
        self.frames += 1;
        (self.frames >= SURE_FRAMES).then(|| std::mem::take(self).least)
    }
}

impl LiveNumbers {
    /// Nothing has come. `latency_s`: from capture to arrival, at best.
    pub fn new(stamps: Stamps, fps: f64, latency_s: f64) -> LiveNumbers {
        LiveNumbers {
            stamps,
            fps,
            latency_s,
            points: VecDeque::new(),
            frames: 0,
            missed: 0,
            period_s: 1.0 / fps,
            next_rating: 0,
            first_said: None,
            said: None,
            base: None,
            before: None,
            is_settled: false,
            off: Off::default(),
            phase: 0.0,
        }
    }

    /// Numbers the next frame, which came at `arrival_s` of film time, and of which the source said a time in
    /// milliseconds or a count, if it says such. `phase`: where the cluster cuts film into frames, once that is decided.
    pub fn push(
        &mut self,
        arrival_s: f64,
        said: Option<f64>,
        phase: Option<f64>,
    ) -> Result<Numbered, NumberFault> {
        self.check_order(said)?;
        let unit = match (self.stamps, said) {
            (Stamps::Counter, Some(count)) => (count - *self.first_said.get_or_insert(count)) as i64,
            _ => self.frames + self.missed,
        };
        self.note(Point { unit, own_s: self.own_s(unit, said), arrival_s }, said)?;
        self.frames += 1;
        self.rate()?;
        let point = *self.points.back().unwrap_or(&Point { unit, own_s: 0.0, arrival_s });
        let capture_time_s = point.own_s + self.offset_s() - self.latency_s;
        let ticks = capture_time_s * self.fps;
        self.phase = ticks.rem_euclid(1.0);
        let settles = !self.is_settled && phase.is_some() && self.spans(FIT_S);
        self.is_settled |= settles;
        if settles {
            (self.base, self.before) = (None, None);
        }
        let (number, anchored_again) = self.follow(point.unit, ticks - phase.unwrap_or_default());
        self.before = number.or(self.before);
        let number = number.and_then(|number| u64::try_from(number).ok());
        Ok(Numbered { number, capture_time_s, anchored_again })
    }

    /// Phase and rate, once they are known.
    pub fn pace(&self) -> Option<CameraPace> {
        self.spans(FIT_S).then(|| CameraPace { phase: self.phase, frames_per_s: 1.0 / self.period_s })
    }

    /// Whether the frames that count cover so much time, and are not just a few.
    fn spans(&self, seconds: f64) -> bool {
        let (Some(first), Some(last)) = (self.points.front(), self.points.back()) else { return false };
        self.points.len() >= LEAST_FRAMES / 2 && last.arrival_s - first.arrival_s >= seconds
    }

    fn own_s(&self, unit: i64, said: Option<f64>) -> f64 {
        match (self.stamps, said) {
            (Stamps::Capture, Some(said_ms)) => said_ms * 1e-3,
            _ => unit as f64 * self.period_s,
        }
    }

    fn check_order(&mut self, said: Option<f64>) -> Result<(), NumberFault> {
        let Some(found) = said else { return Ok(()) };
        match self.said.replace(found) {
            Some(before) if found <= before => Err(NumberFault::Backwards { found, before }),
            _ => Ok(()),
        }
    }

    /// Takes a frame in, and finds out whether the camera missed some before it.
    fn note(&mut self, mut point: Point, said: Option<f64>) -> Result<(), NumberFault> {
        if let Some(last) = self.points.back().copied() {
            let late_s = point.arrival_s - point.own_s - self.offset_s();
            match self.stamps {
                // Nothing comes before it is captured.
                Stamps::Capture if late_s < -MOST_JUMP_S => {
                    return Err(NumberFault::Jump { found_ms: said.unwrap_or_default(), by_s: -late_s });
                }
                Stamps::Arrival => {
                    let late = late_s / self.period_s;
                    let is_burst = point.arrival_s - last.arrival_s < 0.5 * self.period_s;
                    if let Some(late) = self.off.note(late, late >= TURN && !is_burst) {
                        let missed = late.round().max(1.0) as i64;
                        self.missed += missed;
                        point.unit += missed;
                        point.own_s = self.own_s(point.unit, None);
                    }
                }
                Stamps::Index | Stamps::Counter | Stamps::Capture => {}
            }
        }
        self.points.push_back(point);
        let is_old = |first: &Point, count: usize| {
            count > MOST_FRAMES || count > LEAST_FRAMES && point.arrival_s - first.arrival_s > WINDOW_S
        };
        while self.points.front().is_some_and(|first| is_old(first, self.points.len())) {
            self.points.pop_front();
        }
        Ok(())
    }

    /// From the camera's own time to film time of the earliest arrival, seconds.
    fn offset_s(&self) -> f64 {
        let offsets = self.points.iter().map(|point| point.arrival_s - point.own_s);
        offsets.fold(f64::INFINITY, f64::min)
    }

    /// Measures the pace again, now and then: a median over spans of several frames, each counting as long as it takes,
    /// so that neither frames that are missed nor those that come in a burst change it.
    fn rate(&mut self) -> Result<(), NumberFault> {
        if self.frames < self.next_rating || !self.spans(RATED_S) {
            return Ok(());
        }
        let step = (self.points.len() / 6).max(2);
        self.next_rating = self.frames + (step / 2) as i64;
        let time = |point: &Point| if self.stamps == Stamps::Capture { point.own_s } else { point.arrival_s };
        let span = |at: usize| {
            let (from, to) = (&self.points[at], &self.points[at + step]);
            let count = if self.stamps == Stamps::Counter { to.unit - from.unit } else { step as i64 };
            let span_s = time(to) - time(from);
            (span_s / count.max(1) as f64, span_s)
        };
        let mut spans: Vec<(f64, f64)> = (0..self.points.len() - step).map(span).collect();
        spans.sort_by(|a, b| a.0.total_cmp(&b.0));
        let half_s = 0.5 * spans.iter().map(|(_, span_s)| span_s).sum::<f64>();
        let mut so_far_s = 0.0;
        let median = spans.iter().find(|(_, span_s)| {
            so_far_s += span_s;
            so_far_s >= half_s
        });
        let Some(&(period_s, _)) = median else { return Ok(()) };
        let found = 1.0 / period_s;
        let is_near = (found / self.fps - 1.0).abs() <= MOST_OFF;
        if !is_near {
            return Err(NumberFault::Rate { found, expected: self.fps });
        }
        self.period_s = period_s;
        if self.stamps != Stamps::Capture {
            self.points.iter_mut().for_each(|point| point.own_s = point.unit as f64 * period_s);
        }
        Ok(())
    }

    /// The number of a frame that time alone would put at `ticks`; and by how much a counter was off.
    fn follow(&mut self, unit: i64, ticks: f64) -> (Option<i64>, Option<i64>) {
        let nearest = (ticks + 0.5).floor() as i64;
        let expected = match self.stamps {
            Stamps::Capture => self.before.map(|before| before.saturating_add(1)),
            _ => self.base.map(|base| base.saturating_add(unit)),
        };
        let Some(expected) = expected else {
            self.base = Some(nearest.saturating_sub(unit));
            return (Some(nearest), None);
        };
        let off = ticks - expected as f64;
        if self.stamps == Stamps::Counter {
            let most = if self.is_settled { COUNTER_TURN } else { TURN };
            if self.off.note(off, off.abs() >= most).is_none() {
                return ((off.abs() < MAD_PERIODS).then_some(expected), None);
            }
        } else if off.abs() < TURN {
            return (Some(expected), None);
        }
        self.base = Some(nearest.saturating_sub(unit));
        let by = (self.stamps == Stamps::Counter && nearest != expected).then_some(nearest - expected);
        (Some(nearest), by)
    }
}

#[cfg(test)]
mod tests;
