//! What a coordinator knows of a frame without its pixels.

use hull::silhouette::PixelRect;

/// When a run began and how it is paced.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pace {
    /// Unix seconds at which film time is zero.
    pub epoch_unix_s: f64,
    /// Every frame, as credits allow, instead of in real time.
    pub lock_step: bool,
}

/// One camera's part of a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraFacts {
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
}

/// One frame of one node.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameFacts {
    /// Its number in the cluster's count.
    pub frame: u64,
    /// Film time since the epoch, seconds.
    pub capture_time_s: f64,
    /// When it was captured by the wall clock, unix seconds.
    pub captured_unix_s: f64,
    /// Its cameras.
    pub cameras: Vec<CameraFacts>,
    /// Frames passed over just before it.
    pub skipped: u64,
}

/// How a node's film stands.
#[derive(Clone, Debug, PartialEq, Eq, Default)]
pub enum FilmState {
    /// It runs, or has not begun.
    #[default]
    Running,
    /// Every frame there is has come.
    Ended,
    /// It failed, and why.
    Failed(String),
}
