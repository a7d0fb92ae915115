//! Whether there is a hull for a step.

use film_time::FilmState;
use thiserror::Error;

use super::{Missing, Roster, RosterNode};

/// Live film that is older than this has stopped, seconds; a run that has no frame after this has a fault.
const STALE_S: f64 = 1.0;

/// Why a step has no hull: collisions are disabled.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum HullUnavailable {
    /// A node is not there.
    #[error(transparent)]
    Missing(#[from] Missing),
    /// Without the nodes that are not there, too few cameras are left.
    #[error("{shortage}: {missing}")]
    TooFewLeft {
        /// How many cameras are left, and needed.
        shortage: Shortage,
        /// The first node that is not there.
        missing: Missing,
    },
    /// Film failed for good.
    #[error("film failed: {0}")]
    FilmFailed(String),
    /// The run has just begun.
    #[error("the first frame has not come yet")]
    NotYet,
    /// Film should long have begun.
    #[error("no frame has come yet")]
    NoFrame,
    /// Live film has stopped.
    #[error("film has stopped at frame {frame}, {age_s:.1} s ago")]
    Stopped {
        /// The newest frame of all cameras.
        frame: u64,
        /// How long ago that should have been followed by another, seconds.
        age_s: f64,
    },
    /// The reports of the frame are lost: a node has come back since.
    #[error("frame {frame} was reported before a node came back")]
    Forgotten {
        /// The frame in use.
        frame: u64,
    },
    /// The recorded run had none at this step.
    #[error("there was no hull when this was recorded")]
    Recorded,
    /// Too few cameras film.
    #[error(transparent)]
    TooFew(#[from] Shortage),
    /// Too few cameras have begun to film.
    #[error("{shortage}: no frame has come from {}", missing.join(", "))]
    NotBegun {
        /// How many cameras have begun, and are needed.
        shortage: Shortage,
        /// The names of the others.
        missing: Vec<String>,
    },
    /// The nodes did not answer all questions.
    #[error("{0}")]
    Unanswered(String),
}

/// Fewer cameras than a hull is made of.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[error("{found} of {all} cameras, {needed} needed")]
pub struct Shortage {
    /// Number of cameras that film.
    pub found: usize,
    /// Number of cameras in the rig.
    pub all: usize,
    /// How many a hull needs: `min_cameras`, or all where these are fewer.
    pub needed: usize,
}

impl HullUnavailable {
    /// What metrics call each cause.
    pub const CAUSES: [&str; 9] = [
        "node_missing",
        "film_failed",
        "not_yet",
        "no_frame",
        "film_stopped",
        "frame_forgotten",
        "recorded",
        "too_few_cameras",
        "unanswered",
    ];

    /// Its place in [`HullUnavailable::CAUSES`].
    pub fn cause(&self) -> usize {
        match self {
            HullUnavailable::Missing(_) | HullUnavailable::TooFewLeft { .. } => 0,
            HullUnavailable::FilmFailed(_) => 1,
            HullUnavailable::NotYet => 2,
            HullUnavailable::NoFrame => 3,
            HullUnavailable::Stopped { .. } => 4,
            HullUnavailable::Forgotten { .. } => 5,
            HullUnavailable::Recorded => 6,
            HullUnavailable::TooFew(_) | HullUnavailable::NotBegun { .. } => 7,
            HullUnavailable::Unanswered(_) => 8,
        }
    }

    /// False for what every run begins with.
    pub fn is_fault(&self) -> bool {
        *self != HullUnavailable::NotYet
    }
}

/// What a step knows of film.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StepFilm {
    /// Film time of the step's end, seconds.
    pub film_s: f64,
    /// Frames per second.
    pub fps: f64,
    /// The frame in use, if any.
    pub frame: Option<u64>,
    /// Whether frames are due at a wall time and one that is old is a fault: not in lock-step, nor while the
    /// last frame is held.
    pub is_paced: bool,
}

impl Roster {
    /// The frame whose hull a step sees, or why there is none.
    pub fn hull_frame(&self, step: StepFilm) -> Result<u64, HullUnavailable> {
        if let Some(missing) = self.present().find_map(RosterNode::missing) {
            return Err(match self.shortage() {
                Some(shortage) => HullUnavailable::TooFewLeft { shortage, missing },
                None => missing.into(),
            });
        }
        if let FilmState::Failed(why) = self.film(0) {
            return Err(HullUnavailable::FilmFailed(why));
        }
        let StepFilm { film_s, fps, frame, is_paced } = step;
        let Some(frame) = frame else {
            let is_late = film_s > STALE_S;
            return Err(if is_late { HullUnavailable::NoFrame } else { HullUnavailable::NotYet });
        };
        let age_s = film_s - frame as f64 / fps;
        if is_paced && age_s > STALE_S {
            return Err(HullUnavailable::Stopped { frame, age_s });
        }
        Ok(frame)
    }
}
