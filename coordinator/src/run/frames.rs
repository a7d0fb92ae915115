//! The frame in use, frames that steps wait for, and what happens when one comes into use.

use std::task::Poll;
use std::time::Duration;

use tokio::time::Instant;

use super::now;
use super::{Coordinator, FRAMES_AHEAD, RunError, Watcher};
use crate::core::clock::frame_at;
use crate::figures::Stage;
use crate::hooks::FrameRecord;
use crate::roster::{FrameWait, HullUnavailable, LOCK_STEP_TIMEOUT};

/// How often a waiting step looks at the clock.
const LOOK_EVERY: Duration = Duration::from_millis(100);

/// The first step does not wait for longer to know how late frames are, seconds of film.
const MEASURE_S: f64 = 1.0;

/// A live run begins without what films nothing for so long after another camera has begun, seconds of film.
const BEGIN_WITHOUT_S: f64 = 1.5;

/// Which part of film a step is in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum FilmPhase {
    /// Frames come.
    Runs,
    /// The last one is held.
    Held,
    /// The frame was asked for by its number, whatever the time.
    Given,
}

/// How many changes of cameras may be logged. Times are those of the world, seconds.
#[derive(Debug, Default)]
pub(super) struct LogBudget {
    /// How many were, less one a second since.
    spent: f64,
    at_s: f64,
}

impl LogBudget {
    /// So many at once, and then one a second.
    const MOST: f64 = 10.0;

    /// Whether one more may be.
    pub fn spend(&mut self, now_s: f64) -> bool {
        self.spent = (self.spent - (now_s - self.at_s).max(0.0)).max(0.0);
        self.at_s = now_s;
        let may = self.spent + 1.0 <= LogBudget::MOST;
        self.spent += f64::from(u8::from(may));
        may
    }
}

/// The frame that steps see.
#[derive(Default)]
pub(super) struct FilmInUse {
    /// The newest that was taken into use.
    pub frame: Option<u64>,
    /// Why the last step had no hull, if it had none.
    pub unavailable: Option<HullUnavailable>,
    /// Frames that were not wanted: film went by while no steps were wanted.
    pub frames_passed: u64,
    /// The same when the frame was taken into use.
    passed_before: u64,
    /// The cameras that the last step asked, by their places in the rig, ascending.
    pub cameras: Vec<u16>,
    /// A camera has gone or come back: until then the hull pushes gently, film time in seconds.
    pub gentle_until_s: f64,
    /// The cameras that the log's lines add up to.
    pub logged_cameras: Vec<u16>,
    pub log_budget: LogBudget,
    wait: FrameWait,
    /// The film time at which the first frame of any camera was found, seconds.
    began_s: Option<f64>,
}

impl FilmInUse {
    /// The frame that the last step saw, if it had a hull.
    pub fn hull_frame(&self) -> Option<u64> {
        self.frame.filter(|_| self.unavailable.is_none())
    }
}

impl Coordinator {
    /// Live: whether the world stands still because there has been no hull yet that bodies could lie on.
    pub(super) fn awaits_first_frame(&mut self) -> bool {
        if self.settings.lock_step || self.film.frame.is_some() {
            return false;
        }
        self.transport.drain();
        let film_s = self.clock.slipped_film_s(self.film_s(), now());
        let wanted = frame_at(film_s, self.settings.fps);
        self.begin_without_silent(wanted, film_s);
        let (patience, least) = (self.settings.connect_timeout, self.least_cameras());
        let may_begin = self.transport.roster().may_begin(wanted, film_s, patience, least)
            && (self.clock.latency.is_known() || film_s > MEASURE_S);
        if may_begin {
            // What nodes still keep of film is made good; else the first step itself sees the frame of now.
            let has_film = self.transport.roster().newest_common(wanted).is_some();
            self.clock.begin(self.film_s(), has_film, now());
        }
        !may_begin
    }

    /// Leaves out nodes that film nothing a while after others have begun: a camera that never films must not hold up
    /// the run. They are back with their first frame.
    fn begin_without_silent(&mut self, wanted: u64, film_s: f64) {
        if self.transport.roster().newest().is_none() {
            return;
        }
        let began_s = *self.film.began_s.get_or_insert(film_s);
        if film_s > began_s + BEGIN_WITHOUT_S && self.transport.roster().newest_common(wanted).is_none() {
            self.go_on_without(wanted);
        }
    }

    /// How many cameras a hull is made of at least.
    pub(super) fn least_cameras(&self) -> usize {
        self.settings.going_on.min_cameras.min(self.query.observers().len())
    }

    /// Why the first step is not made yet.
    fn why_not_begun(&self, film_s: f64) -> Option<HullUnavailable> {
        let why = self.hull_frame(film_s, FilmPhase::Runs).err()?;
        let filming = self.transport.roster().filming();
        if why != HullUnavailable::NoFrame || filming.is_empty() {
            return Some(why);
        }
        let others =
            self.query.observers().iter().filter(|observer| !filming.contains(&observer.rig_index()));
        let missing: Vec<String> = others.map(|observer| format!("{:?}", observer.camera().name())).collect();
        let (found, expected) = (filming.len(), self.least_cameras());
        let is_few = found < expected && !missing.is_empty();
        Some(if is_few { HullUnavailable::NotBegun { found, expected, missing } } else { why })
    }

    /// Waits for the first frame, not for long; false if the run's time is over.
    pub(super) async fn await_first_frame(&mut self, watcher: &mut dyn Watcher) -> bool {
        self.transport.next_within(LOOK_EVERY).await;
        let film_s = self.clock.now_s(self.film_s(), now());
        let frames = frame_at(film_s, self.settings.fps) + 1;
        self.figures.frames_expected = frames.saturating_sub(self.film.frames_passed);
        if let Some(why) = self.why_not_begun(film_s) {
            self.note_no_hull(why);
        }
        self.report(watcher, None);
        !self.is_over(film_s)
    }

    /// Lock-step: waits until every node has a frame that new, or film has ended.
    pub(super) async fn await_frame(&mut self, wanted: u64) -> Result<(), RunError> {
        let began = Instant::now();
        loop {
            self.transport.drain();
            let roster = self.transport.roster();
            self.transport.credit(roster.credit(wanted, FRAMES_AHEAD));
            if let Poll::Ready(waited) =
                self.film.wait.poll(roster, wanted, began.into_std(), Instant::now().into_std())
            {
                return Ok(waited?);
            }
            self.transport.next_within(LOOK_EVERY).await;
        }
    }

    /// Takes into use the very frame that a schedule names; waits for it if the hull is to be asked.
    pub(super) async fn seek(&mut self, frame: u64, asks_hull: bool) -> Result<(), RunError> {
        self.transport.credit(frame);
        self.transport.drain();
        let began = Instant::now();
        if asks_hull {
            self.await_recorded(frame, began).await?;
        }
        if self.film.frame == Some(frame) { Ok(()) } else { self.use_frame(frame).await }
    }

    async fn await_recorded(&mut self, frame: u64, began: Instant) -> Result<(), RunError> {
        loop {
            let polled =
                self.transport.roster().poll_recorded(frame, began.into_std(), Instant::now().into_std());
            if let Poll::Ready(waited) = polled {
                return Ok(waited?);
            }
            self.transport.next_within(LOOK_EVERY).await;
        }
    }

    /// Asks those who compute now.
    pub(super) fn regroup(&mut self) {
        self.query.ask_groups(self.transport.group_count());
        self.query.speculate(self.transport.asks_nodes());
        self.query.leave_out(|group| self.transport.is_left_out(group));
    }

    /// Takes a frame into use.
    pub(super) async fn use_frame(&mut self, frame: u64) -> Result<(), RunError> {
        let passed = self.film.frames_passed;
        if let Some(before) = self.film.frame.replace(frame) {
            let unwanted = passed.saturating_sub(self.film.passed_before);
            self.figures.counts.frames_passed_over +=
                frame.saturating_sub(before + 1).saturating_sub(unwanted);
        }
        self.film.passed_before = passed;
        self.transport.use_frame(frame);
        if self.transport.choose_placement() {
            self.regroup();
        }
        self.figures.counts.frames += 1;
        let reports = self.transport.roster().reports(frame).unwrap_or_default();
        let cameras = reports.iter().flat_map(|report| &report.cameras);
        if let Some(slowest_ms) = cameras.map(|camera| camera.segment_ms).reduce(f64::max) {
            self.figures.add_stage(Stage::Segment, slowest_ms);
        }
        let Some(recorder) = &mut self.log.recorder else { return Ok(()) };
        recorder.frame(FrameRecord {
            frame,
            reports: &reports,
            silhouettes: self.transport.silhouettes(frame),
        });
        let deadline = Instant::now() + LOCK_STEP_TIMEOUT;
        while self.settings.lock_step && !recorder.is_ready() {
            if Instant::now() > deadline {
                return Err(RunError::Unrecorded { frame });
            }
            tokio::time::sleep(Duration::from_millis(1)).await;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn changes_now_and_then_are_logged_and_a_flood_of_them_once_a_second() {
        let mut budget = LogBudget::default();
        assert!((0..100).all(|change| budget.spend(f64::from(change))));
        let logged = (0..6000).filter(|&change| budget.spend(100.0 + f64::from(change) / 60.0)).count();
        assert!((100..=112).contains(&logged), "{logged} lines in 100 s");
    }
}
