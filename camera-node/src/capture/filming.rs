//! What a service needs of its film.

use film_time::{BackgroundFilm, ClockLine, RunStart};

use super::CaptureError;
use super::background::{BackgroundError, Learning};

/// Film of a node's cameras: it begins and ends as it is told, and offers its frames to a ring.
pub trait Filming: Send + Sync + 'static {
    /// Begins a run. The run that is on already changes nothing; another one starts film again. Blocks while
    /// sources open and an earlier run stops. Refused if a source cannot be opened; but live ones of a run
    /// that is not in lock-step, which the system may only lack something for, are opened until they film.
    fn start(&self, start: RunStart) -> Result<(), CaptureError>;

    /// Ends the run and closes the cameras, if that is still wanted when no run can begin meanwhile; whether one was on.
    /// Blocks until its threads have ended.
    fn stop_if(&self, is_wanted: &dyn Fn() -> bool) -> bool;

    /// Lets a lock-step run go on up to this frame.
    fn credit(&self, up_to_frame: u64);

    /// Tells a run its film time by the node's clock; another run's changes nothing. False if its film is too far ahead of that:
    /// the coordinator's computer stood still, and film must start again ([`Filming::start_again`]).
    fn keep_time(&self, run: u64, line: ClockLine) -> bool;

    /// Starts film of the same run again, at an earlier film time, if it still is too far ahead. Blocks as [`Filming::start`]
    /// does.
    fn start_again(&self, run: u64, line: ClockLine) -> Result<(), CaptureError>;

    /// Tells where a run's film is cut into frames, in periods from their numbers.
    fn cut_at(&self, run: u64, phase: f64);

    /// Has every camera learn its background again from frames of the film; until it has, the old one stays in
    /// use. Refused if a camera has none to learn.
    fn take_background(&self, film: BackgroundFilm) -> Result<Learning, BackgroundError>;

    /// Whether [`Filming::take_background`] would be refused, and why.
    fn check_background(&self, film: BackgroundFilm) -> Result<(), BackgroundError>;

    /// Has every camera whose background has that id use the one before again; one that is learning it stops.
    fn restore_background(&self, id: u64);
}
