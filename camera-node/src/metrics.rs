//! What a node counts of itself, for monitoring: each meter stands where its figures arise, and is read at each
//! scrape.

use std::sync::atomic::{AtomicU64, Ordering};

use film_time::monotonic_s;
use hull::question::QuestionKind;
use parking_lot::Mutex;
use proto::convert::RefusalReason;
use telemetry::Histogram;

/// Film of all cameras of a node.
#[derive(Debug)]
pub struct FilmMeter {
    cameras: Vec<Mutex<CameraFigures>>,
    clock_bound_s: Mutex<Option<f64>>,
}

/// What one camera has filmed since the process began.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CameraFigures {
    /// Its name.
    pub name: String,
    /// Frames that became silhouettes.
    pub frames: u64,
    /// Numbers between two of them: frames that the source lacked, or gave too late.
    pub missed: u64,
    /// How often its source failed, and had to be opened again.
    pub failures: u64,
    /// Share of foreground pixels of its newest frame.
    pub foreground: f64,
    /// From capture to silhouette.
    pub segment: Histogram,
    /// When its newest frame was captured, by this process's monotonic clock, seconds.
    pub captured_s: Option<f64>,
}

impl CameraFigures {
    /// How old its newest frame is, seconds.
    pub fn age_s(&self) -> Option<f64> {
        self.captured_s.map(|captured_s| (monotonic_s() - captured_s).max(0.0))
    }
}

/// A frame that became a silhouette.
#[derive(Clone, Copy, Debug)]
pub(crate) struct FilmedFrame {
    /// Frames missed just before it.
    pub missed: u64,
    /// Share of foreground pixels.
    pub foreground: f64,
    /// From capture to silhouette, seconds.
    pub segment_s: f64,
    /// How old it is now, seconds.
    pub age_s: f64,
}

impl FilmMeter {
    /// Nothing yet, of cameras with these names.
    pub(crate) fn new(names: impl Iterator<Item = String>) -> FilmMeter {
        let camera = |name| Mutex::new(CameraFigures { name, ..CameraFigures::default() });
        FilmMeter { cameras: names.map(camera).collect(), clock_bound_s: Mutex::default() }
    }

    pub(crate) fn filmed(&self, camera: usize, frame: FilmedFrame) {
        let mut figures = self.cameras[camera].lock();
        figures.frames += 1;
        figures.missed += frame.missed;
        figures.foreground = frame.foreground;
        figures.segment.add(frame.segment_s);
        figures.captured_s = Some(monotonic_s() - frame.age_s);
    }

    pub(crate) fn failed(&self, camera: usize) {
        self.cameras[camera].lock().failures += 1;
    }

    pub(crate) fn clock(&self, bound_s: f64) {
        *self.clock_bound_s.lock() = Some(bound_s);
    }

    /// Each camera, in the node's order.
    pub fn cameras(&self) -> Vec<CameraFigures> {
        self.cameras.iter().map(|camera| camera.lock().clone()).collect()
    }

    /// How far film time may be off here, seconds, once a coordinator has told it.
    pub fn clock_bound_s(&self) -> Option<f64> {
        *self.clock_bound_s.lock()
    }
}

/// Questions and what became of them.
#[derive(Debug, Default)]
pub struct AnswerMeter(Mutex<AnswerFigures>);

/// What a node has answered since the process began.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct AnswerFigures {
    /// By kind, in the order of [`QuestionKind::ALL`].
    pub answered: [KindFigures; QuestionKind::ALL.len()],
    /// Questions that were refused, in the order of [`RefusalReason::ALL`].
    pub refused: [u64; RefusalReason::ALL.len()],
}

/// Answers to questions of one kind.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct KindFigures {
    /// Points that were asked about.
    pub points: u64,
    /// What computing an answer took.
    pub took: Histogram,
}

impl AnswerMeter {
    pub(crate) fn answered(&self, kind: QuestionKind, points: usize, seconds: f64) {
        let mut figures = self.0.lock();
        let of_kind = &mut figures.answered[kind as usize];
        of_kind.points += points as u64;
        of_kind.took.add(seconds);
    }

    pub(crate) fn refused(&self, reason: RefusalReason) {
        self.0.lock().refused[reason as usize] += 1;
    }

    /// The figures since the process began.
    pub fn read(&self) -> AnswerFigures {
        self.0.lock().clone()
    }
}

/// Bytes and connections of a node's port.
#[derive(Debug, Default)]
pub struct TrafficMeter {
    received: AtomicU64,
    sent: AtomicU64,
    opened: AtomicU64,
    closed: AtomicU64,
}

/// What has crossed a node's port since the process began: of the protocol, without what encryption adds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TrafficFigures {
    /// Bytes read.
    pub received: u64,
    /// Bytes written.
    pub sent: u64,
    /// Connections that were let in.
    pub opened: u64,
    /// Connections that are open.
    pub open: u64,
}

impl TrafficMeter {
    pub(crate) fn received(&self, bytes: usize) {
        self.received.fetch_add(bytes as u64, Ordering::Relaxed);
    }

    pub(crate) fn sent(&self, bytes: usize) {
        self.sent.fetch_add(bytes as u64, Ordering::Relaxed);
    }

    pub(crate) fn opened(&self) {
        self.opened.fetch_add(1, Ordering::Relaxed);
    }

    pub(crate) fn closed(&self) {
        self.closed.fetch_add(1, Ordering::Relaxed);
    }

    /// The figures since the process began.
    pub fn read(&self) -> TrafficFigures {
        let closed = self.closed.load(Ordering::Relaxed);
        let opened = self.opened.load(Ordering::Relaxed);
        TrafficFigures {
            received: self.received.load(Ordering::Relaxed),
            sent: self.sent.load(Ordering::Relaxed),
            opened,
            open: opened.saturating_sub(closed),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_camera_that_films_has_an_age_and_what_it_missed() {
        let meter = FilmMeter::new(["left", "right"].map(String::from).into_iter());
        let frame = FilmedFrame { missed: 0, foreground: 0.5, segment_s: 0.003, age_s: 0.25 };
        meter.filmed(1, frame);
        meter.filmed(1, FilmedFrame { missed: 2, foreground: 0.25, ..frame });
        meter.failed(1);
        let [left, right] = &meter.cameras()[..] else { panic!("two cameras") };
        assert_eq!((&left.name[..], left.frames, left.age_s()), ("left", 0, None));
        assert_eq!((right.frames, right.missed, right.failures, right.foreground), (2, 2, 1, 0.25));
        assert!(right.age_s().is_some_and(|age_s| (0.25..5.0).contains(&age_s)));
        assert!((right.segment.sum_s() - 0.006).abs() < 1e-12);
    }

    #[test]
    fn every_kind_and_reason_has_its_place() {
        let meter = AnswerMeter::default();
        for (place, kind) in QuestionKind::ALL.into_iter().enumerate() {
            meter.answered(kind, place + 1, 0.001);
            assert_eq!(meter.read().answered[place].points, place as u64 + 1, "{kind:?}");
        }
        for (place, reason) in RefusalReason::ALL.into_iter().enumerate() {
            meter.refused(reason);
            assert_eq!(meter.read().refused[place], 1, "{reason:?}");
        }
    }
}
