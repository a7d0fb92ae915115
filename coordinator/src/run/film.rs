//! Frames that steps wait for, and what happens when one comes into use.

use std::time::{Duration, Instant};

use super::{Coordinator, FRAMES_AHEAD, LOCK_STEP_PATIENCE, RETURN_PATIENCE, RunError};
use crate::facts::FilmState;
use crate::record::FrameRecord;

/// How film stands for a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Film {
    /// Frames come.
    Runs,
    /// The last one is held.
    Ended,
    /// The frame was asked for by its number, whatever the time.
    Given,
}

impl Coordinator {
    /// Lock-step: waits until every node has a frame that new, or film has ended.
    pub(super) async fn await_frame(&mut self, wanted: u64) -> Result<(), RunError> {
        self.transport.credit(wanted + FRAMES_AHEAD);
        let deadline = Instant::now() + LOCK_STEP_PATIENCE;
        loop {
            match self.transport.film(wanted) {
                FilmState::Failed(why) => return Err(RunError::Film(why)),
                FilmState::Ended => return Ok(()),
                FilmState::Running => {}
            }
            let newest = self.transport.newest_common(u64::MAX);
            if newest.is_some_and(|newest| newest >= wanted) {
                return Ok(());
            }
            let missing = self.transport.missing();
            if missing.is_empty() {
                self.missing_since = None;
            } else {
                // A node may come back; a dead one makes no hull, and no reason to wait for ever.
                let gone = self.missing_since.get_or_insert_with(Instant::now).elapsed();
                if gone > LOCK_STEP_PATIENCE {
                    return Err(RunError::Nodes(missing.join("; ")));
                }
                if gone > RETURN_PATIENCE {
                    return Ok(());
                }
            }
            if Instant::now() > deadline {
                return Err(late(wanted));
            }
            self.transport.told(Duration::from_millis(100)).await;
        }
    }

    /// Waits for the very frame that a schedule names.
    pub(super) async fn await_recorded(&mut self, frame: u64) -> Result<(), RunError> {
        self.transport.credit(frame + FRAMES_AHEAD);
        let deadline = Instant::now() + LOCK_STEP_PATIENCE;
        while self.transport.newest_common(frame) != Some(frame) {
            if let FilmState::Failed(why) = self.transport.film(frame) {
                return Err(RunError::Film(why));
            }
            if Instant::now() > deadline {
                return Err(late(frame));
            }
            self.transport.told(Duration::from_millis(100)).await;
        }
        Ok(())
    }

    /// Takes a frame into use.
    pub(super) async fn use_frame(&mut self, frame: Option<u64>) -> Result<(), RunError> {
        self.frame = frame;
        self.figures.frames += 1;
        let facts = frame.and_then(|frame| self.transport.facts(frame)).unwrap_or_default();
        let cameras = facts.iter().flat_map(|facts| &facts.cameras);
        if let Some(slowest_ms) = cameras.map(|camera| camera.segment_ms).reduce(f64::max) {
            self.figures.add_stage("segment", slowest_ms);
        }
        let (Some(frame), Some(recorder)) = (frame, &mut self.recorder) else { return Ok(()) };
        recorder.frame(FrameRecord { frame, facts: &facts, silhouettes: self.transport.fetching(frame) });
        let deadline = Instant::now() + LOCK_STEP_PATIENCE;
        while self.settings.lock_step && !recorder.is_ready() {
            if Instant::now() > deadline {
                return Err(RunError::Film(format!("frame {frame} could not be kept")));
            }
            tokio::time::sleep(Duration::from_millis(1)).await;
        }
        Ok(())
    }
}

fn late(frame: u64) -> RunError {
    RunError::Film(format!("frame {frame} did not come within {} s", LOCK_STEP_PATIENCE.as_secs()))
}
