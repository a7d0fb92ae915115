//! What a run has counted so far, for monitoring. The loop publishes it four times a second if a viewer asked for
//! it ([`Coordinator::with_metrics`](crate::Coordinator::with_metrics)); a reader never holds it up.

use std::sync::Arc;
use std::time::Instant;

use film_time::ClockLine;
use telemetry::Histogram;
use tokio::sync::watch;

use crate::figures::{Progress, RunCounts, Stage};
use crate::live::CameraStatus;

/// Where the newest is handed out.
pub type MetricsSender = watch::Sender<Option<Arc<RunMetrics>>>;

/// A run as it stands.
#[derive(Clone, Debug)]
pub struct RunMetrics {
    /// When it stood so.
    pub at: Instant,
    /// The frame of the newest step, if it had a hull.
    pub hull_frame: Option<u64>,
    /// Why the newest step had no hull, if it had none.
    pub hull_unavailable: Option<String>,
    /// As on the console; nothing before the loop has turned: then nodes are waited for.
    pub progress: Option<Progress>,
    /// Each camera, in rig order.
    pub cameras: Vec<CameraStatus>,
    /// Each node, in the order of the cluster file.
    pub nodes: Vec<NodeMetrics>,
    /// What was counted since the run began.
    pub counts: RunCounts,
    /// How long things took since the run began.
    pub times: RunTimes,
    /// What waits now.
    pub queues: Vec<Queue>,
}

/// A node as its coordinator sees it.
#[derive(Clone, Debug, PartialEq)]
pub struct NodeMetrics {
    /// The places of its cameras in the rig.
    pub cameras: Vec<u16>,
    /// Whether it is connected.
    pub is_up: bool,
    /// Whether steps go on without it.
    pub is_left_out: bool,
    /// How often it was connected.
    pub connections: u64,
    /// The coordinator's monotonic clock by the node's, once that was read.
    pub clock: Option<ClockLine>,
    /// What a short question to it usually takes, seconds; nothing of cameras of this process.
    pub trip_s: Option<f64>,
    /// Questions that it has not answered.
    pub open_questions: usize,
}

/// How long things took.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RunTimes {
    /// Each of [`Stage::ALL`].
    pub stages: [Histogram; Stage::ALL.len()],
    /// A step with its pass.
    pub step: Histogram,
    /// A pass that asked something.
    pub pass: Histogram,
    /// From capture to the end of a step that the film caused something in.
    pub response_age: Histogram,
    /// The same of all steps with a hull.
    pub hull_age: Histogram,
}

/// Something that is bounded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Queue {
    /// What waits there.
    pub name: &'static str,
    /// Number of entries that wait.
    pub length: usize,
    /// The most entries that may wait.
    pub capacity: usize,
}
