//! Lock-step: for how long a step waits for its frame.

use std::task::Poll;
use std::time::{Duration, Instant};

use proto::FilmState;
use thiserror::Error;

use super::{Missing, Roster};

/// The longest that a node may take over a frame before the run is given up.
pub(crate) const LOCK_STEP_TIMEOUT: Duration = Duration::from_secs(30);
/// For how long a node that is gone is waited for before steps go on without a hull.
const RETURN_TIMEOUT: Duration = Duration::from_secs(2);

/// Why a lock-step run is given up.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum WaitError {
    /// Film failed for good.
    #[error("{0}")]
    FilmFailed(String),
    /// Nodes stayed away.
    #[error("{}", joined(.0))]
    Missing(Vec<Missing>),
    /// The frame did not come.
    #[error("frame {frame} did not come within {} s", LOCK_STEP_TIMEOUT.as_secs())]
    Late {
        /// Which frame.
        frame: u64,
    },
}

/// One line of all that are missing.
pub(crate) fn joined(missing: &[Missing]) -> String {
    missing.iter().map(ToString::to_string).collect::<Vec<_>>().join("; ")
}

/// Waits for frames, step after step.
#[derive(Clone, Copy, Debug, Default)]
pub struct FrameWait {
    missing_since: Option<Instant>,
}

impl FrameWait {
    /// Ready once the step that wants a frame and began to wait at `began` may be made: every node has a frame
    /// that new, or film has ended, or a node has been away for so long that steps go on without a hull.
    pub fn poll(
        &mut self,
        roster: &Roster,
        wanted: u64,
        began: Instant,
        now: Instant,
    ) -> Poll<Result<(), WaitError>> {
        match roster.film(wanted) {
            FilmState::Failed(why) => return Poll::Ready(Err(WaitError::FilmFailed(why))),
            FilmState::Ended => return Poll::Ready(Ok(())),
            FilmState::Running => {}
        }
        if roster.newest_common(u64::MAX).is_some_and(|newest| newest >= wanted) {
            return Poll::Ready(Ok(()));
        }
        let missing: Vec<Missing> = roster.missing().collect();
        if missing.is_empty() {
            self.missing_since = None;
        } else {
            let gone = now - *self.missing_since.get_or_insert(now);
            if gone > LOCK_STEP_TIMEOUT {
                return Poll::Ready(Err(WaitError::Missing(missing)));
            }
            if gone > RETURN_TIMEOUT {
                return Poll::Ready(Ok(()));
            }
        }
        late(wanted, began, now)
    }
}

impl Roster {
    /// Ready once the very frame that a recording names is there.
    pub fn poll_recorded(&self, frame: u64, began: Instant, now: Instant) -> Poll<Result<(), WaitError>> {
        if self.newest_common(frame) == Some(frame) {
            return Poll::Ready(Ok(()));
        }
        match self.film(frame) {
            FilmState::Failed(why) => Poll::Ready(Err(WaitError::FilmFailed(why))),
            FilmState::Running | FilmState::Ended => late(frame, began, now),
        }
    }
}

fn late(frame: u64, began: Instant, now: Instant) -> Poll<Result<(), WaitError>> {
    if now - began > LOCK_STEP_TIMEOUT { Poll::Ready(Err(WaitError::Late { frame })) } else { Poll::Pending }
}
