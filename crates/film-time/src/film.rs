//! What a node reports of its film, and how film is paced.

use std::ops::RangeInclusive;
use std::time::{SystemTime, UNIX_EPOCH};

use hull::silhouette::PixelRect;

use crate::clock::{ClockLine, monotonic_s};
use crate::simulation::simulated_clock;

/// The least and the most film that a background is learnt from, seconds: shorter learns noise, longer keeps
/// the room waiting.
pub const BACKGROUND_S: RangeInclusive<f64> = 0.2..=30.0;

/// Which film a background is to be learnt from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BackgroundFilm {
    /// By which the background can be undone; no two have the same.
    pub id: u64,
    /// The first frame.
    pub first_frame: u64,
    /// Number of frames.
    pub frames: u64,
    /// Also if the room does not look empty by the background in use: after the light has changed, or furniture.
    pub allow_foreground: bool,
}

/// How many frames a node keeps: half a second of film, whatever a coordinator lags behind; a few of slow film, and no
/// more of fast film than answers need.
pub fn ring_frames(fps: f64) -> usize {
    (0.5 * fps).ceil().clamp(8.0, 64.0) as usize
}

/// How old the newest frame of a camera that films may be, seconds: five periods, and a second at least.
pub fn fresh_s(fps: f64) -> f64 {
    (5.0 / fps).max(1.0)
}

/// A run: when film time is zero by the coordinator's clock, and how film is paced.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pace {
    /// Names the run.
    pub run: u64,
    /// A reading of the coordinator's [`monotonic_s`].
    pub zero_s: f64,
    /// The same moment by its wall clock, unix seconds: for logs and recordings alone.
    pub epoch_unix_s: f64,
    /// Every frame, as credits allow, instead of in real time.
    pub lock_step: bool,
}

impl Pace {
    /// A run whose frames come as credits allow, from now on.
    pub fn lock_step(run: u64) -> Pace {
        Pace { lock_step: true, ..Pace::live(run, 0.0) }
    }

    /// A run in real time that begins after so many seconds.
    pub fn live(run: u64, lead_s: f64) -> Pace {
        Pace { run, zero_s: monotonic_s() + lead_s, epoch_unix_s: unix_now_s() + lead_s, lock_step: false }
    }

    /// Film time now, seconds; negative before the run begins.
    pub fn film_now_s(&self) -> f64 {
        monotonic_s() - self.zero_s
    }
}

/// A run as a node is told of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RunStart {
    /// Names the run.
    pub run: u64,
    /// Film time by the node's clock.
    pub clock: ClockLine,
    /// Unix seconds at film time zero by the coordinator's wall clock: for logs and recordings alone.
    pub epoch_unix_s: f64,
    /// Every frame, as credits allow, instead of in real time.
    pub lock_step: bool,
}

impl RunStart {
    /// A run as a node is told of whose clock film time is known.
    pub fn of(pace: Pace, clock: ClockLine) -> RunStart {
        let Pace { run, zero_s: _, epoch_unix_s, lock_step } = pace;
        RunStart { run, clock, epoch_unix_s, lock_step }
    }

    /// The same for cameras of the coordinator's own process.
    pub fn of_this_process(pace: Pace) -> RunStart {
        RunStart::of(pace, ClockLine::of_this_process(pace.zero_s))
    }
}

/// The state of a node's film.
#[derive(Clone, Debug, PartialEq, Eq, Default)]
pub enum FilmState {
    /// It runs, or has not begun.
    #[default]
    Running,
    /// All its frames have been reported.
    Ended,
    /// It failed for good, and why.
    Failed(String),
}

/// By what a camera's source knows which frame is which.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Stamps {
    /// The frame's place in a film.
    #[default]
    Index,
    /// A hardware trigger's count.
    Counter,
    /// The time that camera or driver says.
    Capture,
    /// When frames arrive.
    Arrival,
}

impl Stamps {
    /// The word of cluster files and status.
    pub fn word(self) -> &'static str {
        match self {
            Stamps::Index => "index",
            Stamps::Counter => "counter",
            Stamps::Capture => "capture",
            Stamps::Arrival => "arrival",
        }
    }
}

/// How a live camera films.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraPace {
    /// Where its captures lie between frames of film, periods: 0 to 1.
    pub phase: f64,
    /// Frames per second.
    pub frames_per_s: f64,
}

/// One camera's part of a frame, without its pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraReport {
    /// Place in the rig.
    pub rig_index: u16,
    /// Least rectangle of what the camera does not reject; `None` if it rejects all it sees.
    pub admitted: Option<PixelRect>,
    /// Foreground pixels.
    pub area: u64,
    /// Size of the compact silhouette, bytes.
    pub silhouette_bytes: u32,
    /// From capture to silhouette, milliseconds.
    pub segment_ms: f64,
    /// Live: from the film time of the frame's number to when its silhouette was there, seconds.
    pub late_s: f64,
    /// By what its source knows which frame is which.
    pub stamps: Stamps,
    /// Of live cameras, once it is known.
    pub pace: Option<CameraPace>,
}

/// One frame of one node, without its pixels.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameReport {
    /// Its number in the cluster's count.
    pub frame: u64,
    /// Film time since the epoch, seconds.
    pub capture_time_s: f64,
    /// When it was captured by the wall clock, unix seconds.
    pub captured_unix_s: f64,
    /// Its cameras.
    pub cameras: Vec<CameraReport>,
    /// Frames passed over just before it.
    pub skipped: u64,
}

/// What a node reports of its film.
#[derive(Clone, Debug, PartialEq)]
pub enum FilmEvent {
    /// A frame is there.
    Frame(FrameReport),
    /// All frames have been reported.
    Ended,
    /// Film has failed for good, and why.
    Failed(String),
}

/// The wall clock, unix seconds.
pub fn unix_now_s() -> f64 {
    if let Some(clock) = simulated_clock() {
        return clock();
    }
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0.0, |since| since.as_secs_f64())
}
