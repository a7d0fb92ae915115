//! Film time: seconds since a run began, of which all machines of a room have the same. How a node's clock follows it
//! ([`ClockLine`]), how film is paced ([`Pace`]) and reported ([`FilmEvent`]), where it is cut into frames ([`Cut`]), and
//! a process whose time is simulated ([`simulate`]).

mod clock;
mod cut;
mod film;
mod simulation;

pub use clock::{ClockLine, monotonic_s};
pub use cut::Cut;
pub use film::{
    BACKGROUND_S, BackgroundFilm, CameraPace, CameraReport, FilmEvent, FilmState, FrameReport, Pace,
    RunStart, Stamps, fresh_s, ring_frames, unix_now_s,
};
pub use simulation::{apart, is_simulated, simulate};
