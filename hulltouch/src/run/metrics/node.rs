//! What a node tells of itself.

use std::fmt;
use std::sync::OnceLock;
use std::time::Duration;

use camera_node::metrics::{CameraFigures, KindFigures};
use camera_node::service::NodeWatch;
use hull::question::QuestionKind;
use proto::convert::RefusalReason;
use telemetry::{Labels, Pulse, Sheet, Telemetry};

use super::{buckets, flag, one, unix_s};

/// The network's thread beats so often,
const BEAT: Duration = Duration::from_secs(1);
/// and is stuck after this: no message takes it so long.
const STUCK: Duration = Duration::from_secs(15);

/// A node: known once its backgrounds are learnt.
#[derive(Default)]
pub struct NodeTelemetry {
    node: OnceLock<NodeWatch>,
    network: Pulse,
}

impl NodeTelemetry {
    /// From now on tells of this node. Must be called within the node's runtime, which is what beats.
    pub fn watch(&self, node: NodeWatch) {
        // There is one node in a process.
        let _ = self.node.set(node);
        let beat = self.network.beat("the node's network");
        tokio::spawn(async move {
            loop {
                beat.works();
                tokio::time::sleep(BEAT).await;
            }
        });
    }
}

impl Telemetry for NodeTelemetry {
    fn metrics(&self, sheet: &mut Sheet<'_>) -> fmt::Result {
        let Some(node) = self.node.get() else { return Ok(()) };
        film(sheet, &node.cameras())?;
        answers(sheet, node)?;
        traffic(sheet, node)?;
        sheet.gauge("node_held", "Whether a coordinator leads the node.", one(flag(node.is_held())))?;
        let bound = node.clock_bound_s().map(|bound_s| (Labels::new(), bound_s));
        sheet.gauge(
            "node_clock_bound_seconds",
            "How far film time may be off, as the node was told.",
            bound,
        )?;
        let ends = node.certificate_ends().map(|ends| (Labels::new(), unix_s(ends)));
        sheet.gauge("node_certificate_end_seconds", "When the certificate ends, Unix seconds.", ends)
    }

    fn stuck(&self) -> Option<String> {
        let stuck = self.network.stuck(STUCK).or_else(|| self.node.get()?.pulse().stuck(STUCK));
        stuck.map(|stuck| stuck.to_string())
    }

    fn lacks(&self) -> Option<String> {
        match self.node.get() {
            Some(node) => node.lacks(),
            None => Some("backgrounds are being learnt".to_owned()),
        }
    }
}

fn film(sheet: &mut Sheet<'_>, cameras: &[CameraFigures]) -> fmt::Result {
    let of = |camera: &CameraFigures| vec![("camera", camera.name.clone())];
    let each =
        |value: fn(&CameraFigures) -> f64| cameras.iter().map(move |camera| (of(camera), value(camera)));
    let ages = cameras.iter().filter_map(|camera| Some((of(camera), camera.age_s()?)));
    sheet.gauge("node_frame_age_seconds", "How long ago the newest frame was captured.", ages)?;
    let foreground = each(|camera| camera.foreground);
    sheet.gauge("node_foreground_ratio", "Share of foreground pixels of the newest frame.", foreground)?;
    sheet.counter("node_frames", "Frames that became silhouettes.", each(|camera| camera.frames as f64))?;
    let missed = each(|camera| camera.missed as f64);
    sheet.counter("node_frames_missed", "Frames that a source lacked, or gave too late.", missed)?;
    let failures = each(|camera| camera.failures as f64);
    sheet.counter("node_source_failures", "How often a source failed, and was opened again.", failures)?;
    let segment = cameras.iter().map(|camera| (of(camera), buckets(&camera.segment)));
    sheet.histogram("node_segment_seconds", "From an image to its silhouette.", segment)
}

fn answers(sheet: &mut Sheet<'_>, node: &NodeWatch) -> fmt::Result {
    let figures = node.answers();
    let kinds = || QuestionKind::ALL.into_iter().zip(&figures.answered);
    let of = |kind: QuestionKind| vec![("kind", kind.word().to_owned())];
    let points = kinds().map(|(kind, KindFigures { points, .. })| (of(kind), *points as f64));
    sheet.counter("node_points", "Points that were answered about.", points)?;
    let took = kinds().map(|(kind, KindFigures { took, .. })| (of(kind), buckets(took)));
    sheet.histogram("node_answer_seconds", "What computing an answer took.", took)?;
    let reasons = RefusalReason::ALL.into_iter().zip(figures.refused);
    let refused = reasons.map(|(reason, count)| (vec![("reason", reason.word().to_owned())], count as f64));
    sheet.counter("node_questions_refused", "Questions that were refused.", refused)?;
    let (waiting, capacity) = node.queue();
    sheet.gauge("node_queue_length", "Questions that wait or are being answered.", one(waiting as f64))?;
    sheet.gauge("node_queue_capacity", "Questions that may wait.", one(capacity as f64))
}

fn traffic(sheet: &mut Sheet<'_>, node: &NodeWatch) -> fmt::Result {
    let figures = node.traffic();
    sheet.counter("node_received_bytes", "Bytes that the node's port read.", one(figures.received as f64))?;
    sheet.counter("node_sent_bytes", "Bytes that the node's port wrote.", one(figures.sent as f64))?;
    sheet.counter("node_connections_opened", "Connections that were let in.", one(figures.opened as f64))?;
    sheet.gauge("node_connections", "Connections that are open.", one(figures.open as f64))
}
