//! What a run has counted so far, for monitoring. The loop publishes it four times a second if a viewer asked for
//! it ([`Coordinator::with_metrics`](crate::Coordinator::with_metrics)); a reader never holds it up.

use std::sync::Arc;
use std::time::Instant;

use film_time::ClockLine;
use hull::question::QuestionKind;
use telemetry::Histogram;
use tokio::sync::watch;

use crate::figures::{Progress, Stage};
use crate::live::CameraStatus;
use crate::roster::HullUnavailable;

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

/// What only grows.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RunCounts {
    /// Steps made.
    pub steps: u64,
    /// Frames used.
    pub frames: u64,
    /// Frames passed over between two that were used.
    pub frames_missed: u64,
    /// Passes that asked something, and those of them that were answered here, of silhouettes that were fetched.
    pub passes: u64,
    /// The second of these.
    pub gathered_passes: u64,
    /// Questions of passes, one after the other.
    pub round_trips: u64,
    /// Points that passes asked about, by kind, in the order of [`QuestionKind::ALL`].
    pub points: [u64; QuestionKind::ALL.len()],
    /// Samples inside the hull, and bodies with some, summed over steps.
    pub inside_samples: u64,
    /// The second of these.
    pub contacts: u64,
    /// Steps that used an older frame than theirs.
    pub late_steps: u64,
    /// Steps that went on without some camera.
    pub reduced_steps: u64,
    /// Steps without a hull, by cause, in the order of [`HullUnavailable::CAUSES`].
    pub blind_steps: [u64; HullUnavailable::CAUSES.len()],
    /// Responses or bodies that were not finite.
    pub faults: u64,
    /// Film time given up, seconds.
    pub slipped_s: f64,
    /// Bytes written to nodes, read from them, and of these silhouettes fetched to answer probes.
    pub bytes_to_nodes: u64,
    /// The second of these.
    pub bytes_from_nodes: u64,
    /// The third.
    pub bytes_silhouettes: u64,
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
    /// How much of it.
    pub length: usize,
    /// How much may.
    pub capacity: usize,
}
