//! Film: a thread a camera that takes frames when they are due, segments them and offers them to the
//! ring. In real time a frame that comes too late is passed over; in lock-step every frame is made, as
//! far ahead as credits allow. In real time a live camera whose source fails is away until it can be opened again,
//! and the others go on.

mod background;
mod camera;
mod capture_loop;
mod film;
mod film_clock;
mod filming;
mod gate;
mod mask_watch;
mod retry;
mod segmenter;

pub use background::{BackgroundError, Learning};
pub use film::Film;
pub use film_clock::FilmClock;
pub use filming::Filming;
pub use segmenter::CutoutError;

use proto::TroubleKind;
use thiserror::Error;

use crate::source::SourceError;

/// Why a camera's film cannot begin, or ends early.
#[derive(Debug, Error)]
pub enum CaptureError {
    /// The source.
    #[error("camera {camera:?}: {error}")]
    Source {
        /// Name of the camera.
        camera: String,
        /// What happened.
        error: SourceError,
    },
    /// A live camera's source gives no more frames.
    #[error("camera {camera:?}: its film has ended, expected film without end")]
    Ended {
        /// Name of the camera.
        camera: String,
    },
    /// The background clip.
    #[error("camera {camera:?}: background: {error}")]
    Background {
        /// Name of the camera.
        camera: String,
        /// What happened.
        error: CutoutError,
    },
    /// The segmentation, or its settings.
    #[error("camera {camera:?}: segmentation: {error}")]
    Segmentation {
        /// Name of the camera.
        camera: String,
        /// What happened.
        error: CutoutError,
    },
    /// A bug.
    #[error("the thread of a camera's film panicked")]
    Panicked,
}

impl CaptureError {
    /// What kind of thing is wrong, for who looks.
    fn kind(&self) -> TroubleKind {
        match self {
            CaptureError::Source { error, .. } => error.kind(),
            _ => TroubleKind::Source,
        }
    }

    /// Whether a source that could not be opened may open later by itself.
    fn may_pass(&self) -> bool {
        matches!(self, CaptureError::Source { error, .. } if error.may_pass())
    }
}
