//! For how long a step waits for its frame: in lock-step every step, live the first.

use std::task::Poll;
use std::time::Duration;

use film_time::FilmState;
use thiserror::Error;

use super::{Missing, Roster, RosterNode};

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
        /// Number of the frame.
        frame: u64,
    },
}

/// One line of all that are missing.
pub(crate) fn joined(missing: &[Missing]) -> String {
    missing.iter().map(ToString::to_string).collect::<Vec<_>>().join("; ")
}

/// Waits for frames, step after step. Times are seconds by [`film_time::monotonic_s`].
#[derive(Clone, Copy, Debug, Default)]
pub struct FrameWait {
    missing_since_s: Option<f64>,
}

impl FrameWait {
    /// Ready once the step that wants a frame and began to wait at `began_s` may be made: every node has a frame
    /// that new, or film has ended, or a node has been away for so long that steps go on without a hull.
    pub fn poll(
        &mut self,
        roster: &Roster,
        wanted: u64,
        began_s: f64,
        now_s: f64,
    ) -> Poll<Result<(), WaitError>> {
        match roster.film(wanted) {
            FilmState::Failed(why) => return Poll::Ready(Err(WaitError::FilmFailed(why))),
            FilmState::Ended => return Poll::Ready(Ok(())),
            FilmState::Running => {}
        }
        if roster.newest_common(u64::MAX).is_some_and(|newest| newest >= wanted) {
            return Poll::Ready(Ok(()));
        }
        let missing: Vec<Missing> = roster.present().filter_map(RosterNode::missing).collect();
        if missing.is_empty() {
            self.missing_since_s = None;
        } else {
            let gone_s = now_s - *self.missing_since_s.get_or_insert(now_s);
            if gone_s > LOCK_STEP_TIMEOUT.as_secs_f64() {
                return Poll::Ready(Err(WaitError::Missing(missing)));
            }
            if gone_s > RETURN_TIMEOUT.as_secs_f64() {
                return Poll::Ready(Ok(()));
            }
        }
        late(wanted, began_s, now_s)
    }
}

impl Roster {
    /// Live: whether a run that has seen no frame yet makes its first step, which wants a frame at a film time
    /// (seconds): every node has that frame or one before, of `least` cameras together, or none will come, or it was waited
    /// for long enough.
    pub fn may_begin(&self, wanted: u64, film_s: f64, patience: Duration, least: usize) -> bool {
        // A node that has failed is left out, if the others have enough cameras.
        let films = |node: &&RosterNode| node.is_up() && !matches!(node.film.state, FilmState::Failed(_));
        let cameras: usize = self.nodes.iter().filter(films).map(|node| node.cameras.len()).sum();
        let is_over = match self.film(wanted) {
            FilmState::Running => false,
            FilmState::Failed(_) if cameras >= least.max(1) => false,
            FilmState::Failed(_) | FilmState::Ended => true,
        };
        let is_over = is_over || film_s > patience.as_secs_f64();
        let has_enough = |frame| {
            let reports = self.reports(frame).unwrap_or_default();
            let cameras: usize = reports.iter().map(|report| report.cameras.len()).sum();
            // A frame of which no cameras are reported tells nothing.
            cameras == 0 || cameras >= least
        };
        is_over || self.newest_common(wanted).is_some_and(has_enough)
    }

    /// The places of the cameras of which any frame has come, by the newest report of each node.
    pub fn filming(&self) -> Vec<u16> {
        let reports = self.nodes.iter().filter_map(RosterNode::newest);
        reports.flat_map(|report| &report.cameras).map(|camera| camera.rig_index).collect()
    }

    /// Ready once the very frame that a recording names is there.
    pub fn poll_recorded(&self, frame: u64, began_s: f64, now_s: f64) -> Poll<Result<(), WaitError>> {
        if self.newest_common(frame) == Some(frame) {
            return Poll::Ready(Ok(()));
        }
        match self.film(frame) {
            FilmState::Failed(why) => Poll::Ready(Err(WaitError::FilmFailed(why))),
            FilmState::Running | FilmState::Ended => late(frame, began_s, now_s),
        }
    }
}

fn late(frame: u64, began_s: f64, now_s: f64) -> Poll<Result<(), WaitError>> {
    let is_late = now_s - began_s > LOCK_STEP_TIMEOUT.as_secs_f64();
    if is_late { Poll::Ready(Err(WaitError::Late { frame })) } else { Poll::Pending }
}
