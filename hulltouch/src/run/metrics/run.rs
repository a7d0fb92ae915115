//! What a run tells of itself.

use std::borrow::Cow;
use std::fmt;
use std::sync::Arc;
use std::time::Duration;

use coordinator::live::CameraStatus;
use coordinator::metrics::{MetricsSender, NodeMetrics, RunMetrics};
use coordinator::roster::HullUnavailable;
use coordinator::{RunCounts, Stage};
use film_time::fresh_s;
use hull::question::QuestionKind;
use node_client::Dial;
use telemetry::{Labels, Sheet, Telemetry};
use tokio::sync::watch;

use super::{buckets, flag, node_label, one, unix_s};
use crate::run::run_setup::Setup;

/// A loop that has not turned for so long never will: in lock-step it waits for a frame, or a round, for half of that.
const STUCK: Duration = Duration::from_secs(60);
/// And does not do its work after this: it reports four times a second.
const SILENT: Duration = Duration::from_secs(3);

/// A run, as its loop hands out what it counts.
pub struct RunTelemetry {
    metrics: watch::Receiver<Option<Arc<RunMetrics>>>,
    /// What the run's set-up says of it.
    file: setup::ClusterFile,
    dial: Arc<dyn Dial>,
    /// Whether frames come at the pace of film.
    is_paced: bool,
}

/// Where a run's loop hands out what it counts, and what tells of it.
pub fn metrics(setup: &Setup, is_paced: bool) -> (MetricsSender, RunTelemetry) {
    let (sender, metrics) = watch::channel(None);
    let (file, dial) = (setup.file.clone(), Arc::clone(&setup.dial));
    (sender, RunTelemetry { metrics, file, dial, is_paced })
}

impl RunTelemetry {
    fn newest(&self) -> Option<Arc<RunMetrics>> {
        self.metrics.borrow().clone()
    }

    fn node(&self, node: &NodeMetrics) -> String {
        let cameras: Vec<usize> = node.cameras.iter().map(|&place| place.into()).collect();
        node_label(&self.file, &cameras)
    }

    /// The labels of each camera, in rig order.
    fn cameras(&self, run: &RunMetrics) -> Vec<Labels> {
        let label = |(place, camera): (usize, &CameraStatus)| {
            let has = |node: &&NodeMetrics| run.nodes.len() == 1 || node.cameras.contains(&(place as u16));
            let node = run.nodes.iter().find(has).map(|node| self.node(node)).unwrap_or_default();
            vec![("node", node), ("camera", camera.name.clone())]
        };
        run.cameras.iter().enumerate().map(label).collect()
    }
}

impl Telemetry for RunTelemetry {
    fn metrics(&self, sheet: &mut Sheet<'_>) -> fmt::Result {
        let ends = self.dial.certificate_ends().map(|ends| (Labels::new(), unix_s(ends)));
        sheet.gauge(
            "coordinator_certificate_end_seconds",
            "When the certificate ends, Unix seconds.",
            ends,
        )?;
        let Some(run) = self.newest() else { return Ok(()) };
        hull(sheet, &run)?;
        cameras(sheet, &run, &self.cameras(&run))?;
        let nodes: Vec<Labels> = run.nodes.iter().map(|node| vec![("node", self.node(node))]).collect();
        self::nodes(sheet, &run.nodes, &nodes)?;
        counts(sheet, &run.counts)?;
        misses(sheet, &run.counts)?;
        times(sheet, &run)?;
        let queues = || run.queues.iter().map(|queue| (vec![("queue", queue.name.to_owned())], queue));
        let lengths = queues().map(|(labels, queue)| (labels, queue.length as f64));
        sheet.gauge("coordinator_queue_length", "What waits for the loop.", lengths)?;
        let capacities = queues().map(|(labels, queue)| (labels, queue.capacity as f64));
        sheet.gauge("coordinator_queue_capacity", "How much may wait for the loop.", capacities)
    }

    fn stuck(&self) -> Option<String> {
        let silence = self.newest()?.at.elapsed();
        (silence > STUCK).then(|| format!("the run has not turned for {} s", silence.as_secs()))
    }

    fn lacks(&self) -> Option<String> {
        let Some(run) = self.newest() else { return Some("the run has not begun".into()) };
        let silence = run.at.elapsed();
        if silence > SILENT {
            return Some(format!("the run has not turned for {} s", silence.as_secs()));
        }
        let cameras = run.cameras.iter().zip(self.cameras(&run));
        let fresh_s = if self.is_paced { fresh_s(self.file.fps) } else { f64::INFINITY };
        let problem = |(camera, _): (&CameraStatus, Labels)| {
            let why: Cow<'_, str> = match (&camera.problem, camera.newest_frame) {
                (Some(problem), _) => return Some(problem.clone()),
                (None, None) => "has not filmed yet".into(),
                (None, Some(_)) if camera.left_out => "is left out".into(),
                (None, Some(_)) if camera.age_ms / 1e3 > fresh_s => {
                    format!("films nothing: its newest frame is {:.1} s old", camera.age_ms / 1e3).into()
                }
                (None, Some(_)) => return None,
            };
            Some(format!("camera {:?} {why}", camera.name))
        };
        cameras.into_iter().find_map(problem).or_else(|| match (run.hull_frame, &run.hull_unavailable) {
            (Some(_), _) => None,
            (None, Some(why)) => Some(format!("no hull is in use: {why}")),
            (None, None) => Some("no hull is in use: the run has just begun".into()),
        })
    }
}

fn hull(sheet: &mut Sheet<'_>, run: &RunMetrics) -> fmt::Result {
    sheet.gauge(
        "coordinator_hull_in_use",
        "Whether bodies collide with the hull.",
        one(flag(run.hull_frame.is_some())),
    )?;
    let Some(progress) = &run.progress else { return Ok(()) };
    sheet.gauge("coordinator_film_seconds", "Film time of the newest step.", one(progress.film_s))?;
    let latency_s = progress.latency_ms / 1e3;
    sheet.gauge(
        "coordinator_latency_seconds",
        "How long after its film time a step is made.",
        one(latency_s),
    )?;
    sheet.gauge("coordinator_samples", "Samples of all moving bodies.", one(progress.samples as f64))?;
    let contacts = one(progress.contacts as f64);
    sheet.gauge("coordinator_touching_bodies", "Bodies that touch the hull now.", contacts)
}

fn cameras(sheet: &mut Sheet<'_>, run: &RunMetrics, labels: &[Labels]) -> fmt::Result {
    let since_ms = run.at.elapsed().as_secs_f64() * 1e3;
    let all = || run.cameras.iter().zip(labels.iter().cloned());
    let filming = || all().filter(|(camera, _)| camera.newest_frame.is_some());
    let left_out = all().map(|(camera, labels)| (labels, flag(camera.left_out || camera.problem.is_some())));
    sheet.gauge("coordinator_camera_left_out", "Whether steps go on without the camera.", left_out)?;
    let ages = filming().map(|(camera, labels)| (labels, (camera.age_ms + since_ms) / 1e3));
    sheet.gauge("coordinator_frame_age_seconds", "How long ago the newest frame was captured.", ages)?;
    let foreground = filming().map(|(camera, labels)| (labels, camera.foreground));
    sheet.gauge(
        "coordinator_foreground_ratio",
        "Share of foreground pixels of the newest frame.",
        foreground,
    )?;
    let sync = filming().map(|(camera, labels)| (labels, camera.sync_ms / 1e3));
    let help = "How far captures lie from the median of all cameras'.";
    sheet.gauge("coordinator_sync_error_seconds", help, sync)?;
    let bounds = filming().map(|(camera, labels)| (labels, camera.clock_bound_ms / 1e3));
    sheet.gauge("coordinator_sync_bound_seconds", "How far that may be off.", bounds)?;
    let late = filming().filter_map(|(camera, labels)| Some((labels, camera.late_ms? / 1e3)));
    let help = "How long after their film time nearly all frames are known.";
    sheet.gauge("coordinator_camera_late_seconds", help, late)
}

fn nodes(sheet: &mut Sheet<'_>, nodes: &[NodeMetrics], labels: &[Labels]) -> fmt::Result {
    let all = || nodes.iter().zip(labels.iter().cloned());
    let clocks = || all().filter_map(|(node, labels)| Some((node.clock?, labels)));
    let up = all().map(|(node, labels)| (labels, flag(node.is_up)));
    sheet.gauge("coordinator_node_up", "Whether the node is connected.", up)?;
    let reconnects = all().map(|(node, labels)| (labels, node.connections.saturating_sub(1) as f64));
    sheet.counter("coordinator_node_reconnects", "How often the node was lost and came back.", reconnects)?;
    let offsets = clocks().map(|(clock, labels)| (labels, clock.film_s - clock.node_s));
    let help = "The coordinator's monotonic clock less the node's; what changes of it is drift.";
    sheet.gauge("coordinator_clock_offset_seconds", help, offsets)?;
    let bounds = clocks().map(|(clock, labels)| (labels, clock.bound_s));
    sheet.gauge("coordinator_clock_bound_seconds", "How far that may be off.", bounds)?;
    let trips = all().filter_map(|(node, labels)| Some((labels, node.trip_s?)));
    sheet.gauge("coordinator_node_trip_seconds", "What a short question to the node takes.", trips)?;
    let open = all().map(|(node, labels)| (labels, node.open_questions as f64));
    sheet.gauge("coordinator_open_questions", "Questions that the node has not answered.", open)
}

fn counts(sheet: &mut Sheet<'_>, counts: &RunCounts) -> fmt::Result {
    for (name, help, value) in [
        ("coordinator_steps", "Steps made.", counts.steps),
        ("coordinator_frames", "Frames used.", counts.frames),
        (
            "coordinator_frames_missed",
            "Frames passed over between two that were used.",
            counts.frames_passed_over,
        ),
        ("coordinator_passes", "Passes that asked something.", counts.passes.asked),
        ("coordinator_gathered_passes", "Passes over silhouettes that were fetched.", counts.passes.gathered),
        ("coordinator_round_trips", "Questions of passes, one after the other.", counts.passes.round_trips),
        ("coordinator_inside_samples", "Samples inside the hull, summed over steps.", counts.inside_samples),
        ("coordinator_contacts", "Bodies that touch the hull, summed over steps.", counts.contacts),
        ("coordinator_faults", "Responses or bodies that were not finite.", counts.faults),
    ] {
        sheet.counter(name, help, one(value as f64))?;
    }
    sheet.counter("coordinator_slipped_seconds", "Film time given up.", one(counts.slipped_s))?;
    let kinds = QuestionKind::ALL.into_iter().zip(counts.passes.points);
    let points = kinds.map(|(kind, points)| (vec![("kind", kind.word().to_owned())], points as f64));
    sheet.counter("coordinator_points", "Points that passes asked about.", points)?;
    let bytes = [
        ("to_nodes", counts.bytes.to_nodes),
        ("from_nodes", counts.bytes.from_nodes),
        ("silhouettes", counts.bytes.silhouettes),
    ];
    let bytes = bytes.map(|(kind, bytes)| (vec![("kind", kind.to_owned())], bytes as f64));
    let help = "Bytes at the sockets of nodes; silhouettes are part of what comes from nodes.";
    sheet.counter("coordinator_traffic_bytes", help, bytes)
}

/// Steps that saw less than they should.
fn misses(sheet: &mut Sheet<'_>, counts: &RunCounts) -> fmt::Result {
    let blind = HullUnavailable::CAUSES.into_iter().zip(counts.misses.blind_by_cause);
    let others = [("frame_late", counts.misses.late_steps), ("camera_left_out", counts.misses.reduced_steps)];
    let causes = others.into_iter().chain(blind);
    let causes = causes.map(|(cause, steps)| (vec![("cause", cause.to_owned())], steps as f64));
    let help =
        "Steps with an older frame than theirs, without some camera, or for other causes without a hull.";
    sheet.counter("coordinator_misses", help, causes)
}

fn times(sheet: &mut Sheet<'_>, run: &RunMetrics) -> fmt::Result {
    let times = &run.times;
    let stages = Stage::ALL.into_iter().zip(&times.stages);
    let stages = stages.map(|(stage, took)| (vec![("stage", stage.name().to_owned())], buckets(took)));
    sheet.histogram("coordinator_stage_seconds", "What the stages of steps took.", stages)?;
    for (name, help, histogram) in [
        ("coordinator_step_seconds", "What steps took, with their passes.", &times.step),
        ("coordinator_pass_seconds", "What passes took that asked something.", &times.pass),
        (
            "coordinator_response_age_seconds",
            "From capture to the step that film moved a body in.",
            &times.response_age,
        ),
        ("coordinator_hull_age_seconds", "How old film was at each step with a hull.", &times.hull_age),
    ] {
        sheet.histogram(name, help, [(Labels::new(), buckets(histogram))])?;
    }
    Ok(())
}
