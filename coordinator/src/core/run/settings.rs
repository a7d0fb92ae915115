//! How a run goes.

use std::time::Duration;

use hull::ProbeSettings;

use crate::core::query::AskEvery;

/// How a run goes.
#[derive(Clone, Debug)]
pub struct RunSettings {
    /// The hull rule and the probes' settings.
    pub probes: ProbeSettings,
    /// Frames of the cluster per second.
    pub fps: f64,
    /// Live: wall time from capture to the step that sees it, seconds; `None`: no more than frames need to be known
    /// everywhere, as it is measured.
    pub latency_s: Option<f64>,
    /// How long the last frame of film that ends is held, seconds.
    pub hold_s: f64,
    /// The run ends after so much film, seconds; `None`: when film does, or never.
    pub seconds: Option<f64>,
    /// Every frame, as fast as it can be made, instead of in real time.
    pub lock_step: bool,
    /// How often the hull is asked.
    pub ask_every: AskEvery,
    /// See [`HullQuery::set_bodies`](crate::query::HullQuery::set_bodies), metres.
    pub reuse_within_m: f64,
    /// How it goes on without a camera.
    pub going_on: GoingOn,
    /// How long to wait for nodes at the beginning, and live from then on for their first frame.
    pub connect_timeout: Duration,
}

/// How a run goes on without a camera, and when it does not.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GoingOn {
    /// A missing camera is left out while at least so many remain; below it there is no hull.
    pub min_cameras: usize,
    /// For a second after a camera has gone or come back, the hull moves bodies no faster, m/s.
    pub push_m_s: f64,
}

impl Default for GoingOn {
    fn default() -> GoingOn {
        GoingOn { min_cameras: 3, push_m_s: 1.5 }
    }
}
