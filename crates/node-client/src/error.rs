//! Why a node does not do what it is asked.

use std::time::Duration;

use hull::ProbeSettings;
use hull::rule::{NormalWindow, OutOfView};
use proto::Address;
use proto::convert::ConvertError;
use proto::framing::TooLong;
use proto::text::{MAX_MESSAGE_CHARS, clean};
use thiserror::Error;

/// Why a node does not do what it is asked. Texts of the node are cleaned.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum NodeError {
    /// There is no connection at present.
    #[error("not connected")]
    NotConnected,
    /// A connection could not be made.
    #[error("cannot connect: {0}")]
    Unreachable(String),
    /// It is not announced, and has no address.
    #[error("not found by its name (DNS-SD): expected it to run and to announce itself, or an address")]
    NotFound,
    /// Its version has no [`StatusClient`](crate::StatusClient)'s call.
    #[error("it does not tell how it is: expected a node of this version of hulltouch")]
    NoStatus,
    /// At an address that was only found.
    #[error("at {address}: {error}")]
    At {
        /// The address.
        address: Address,
        /// What happened there.
        error: Box<NodeError>,
    },
    /// It did not answer in time.
    #[error("no answer within {} ms", .0.as_millis())]
    Timeout(Duration),
    /// The connection broke during a call.
    #[error("connection lost: {0}")]
    Lost(String),
    /// The connection broke before it was of any use.
    #[error("the connection broke at once ({why}): {hint}")]
    AtOnce {
        /// The error of the connection.
        why: String,
        /// What may be wrong.
        hint: String,
    },
    /// The node closed a stream that should stay open.
    #[error("it closed the stream")]
    Closed,
    /// The node refused the call, and why.
    #[error("{0}")]
    Refused(String),
    /// Another leads the node: who.
    #[error("{0}")]
    Held(String),
    /// A reply that cannot be.
    #[error("invalid reply: {0}")]
    Invalid(#[from] ConvertError),
    /// A reply about cameras that it was not asked about, or not all of them.
    #[error("invalid reply: {found} silhouettes, expected {expected}, one a camera")]
    Cameras {
        /// Silhouettes found.
        found: usize,
        /// Cameras of the node.
        expected: usize,
    },
    /// A reply that is longer than its question allows.
    #[error("invalid reply: {0}")]
    TooLong(#[from] TooLong),
    /// A reply without a picture.
    #[error("invalid reply: no picture")]
    NoPictures,
    /// Pictures of another frame than the one asked for.
    #[error("invalid reply: pictures of frame {found}, expected {expected}")]
    OtherFrame {
        /// The frame found.
        found: u64,
        /// The frame asked for.
        expected: u64,
    },
    /// It reads nothing that is sent: requests wait.
    #[error("it does not read its requests")]
    Stalled,
    /// Frames whose capture times run backwards.
    #[error(
        "invalid reply: frame {frame} was captured at {found_s} s, before frame {before} at {before_s} s"
    )]
    Backwards {
        /// The later frame.
        frame: u64,
        /// Its film time, seconds.
        found_s: f64,
        /// The earlier frame.
        before: u64,
        /// Its film time, seconds.
        before_s: f64,
    },
    /// Messages without end that answer nothing.
    #[error("invalid reply: {count} messages within a second that answer nothing, or tell film again")]
    Flood {
        /// Number of these messages within a second.
        count: u32,
    },
    /// Another node than the one meant.
    #[error(transparent)]
    Mismatch(#[from] Mismatch),
}

impl NodeError {
    /// What happened, without the address at which it happened.
    pub fn innermost(&self) -> &NodeError {
        match self {
            NodeError::At { error, .. } => error.innermost(),
            error => error,
        }
    }

    /// Whether the node answered what cannot be: it lies, or is broken.
    pub fn is_invalid(&self) -> bool {
        match self {
            NodeError::At { error, .. } => error.is_invalid(),
            other => matches!(
                other,
                NodeError::Invalid(_)
                    | NodeError::TooLong(_)
                    | NodeError::Cameras { .. }
                    | NodeError::NoPictures
                    | NodeError::OtherFrame { .. }
                    | NodeError::Backwards { .. }
                    | NodeError::Flood { .. }
            ),
        }
    }

    /// Whether the node is another than the cluster file means.
    pub fn is_mismatch(&self) -> bool {
        matches!(self.innermost(), NodeError::Mismatch(_))
    }

    /// Of two attempts, the failure to report: that a node refused says more than that an address is silent.
    pub(crate) fn or_more_telling(self, later: NodeError) -> NodeError {
        if later.is_absence() && !self.is_absence() { self } else { later }
    }

    /// Whether the node is away, rather than there and another than is expected: its PC, its program or its cable.
    pub fn is_absence(&self) -> bool {
        match self {
            NodeError::NotConnected
            | NodeError::Unreachable(_)
            | NodeError::NotFound
            | NodeError::Timeout(_)
            | NodeError::Lost(_)
            | NodeError::Closed
            | NodeError::Stalled => true,
            NodeError::At { error, .. } => error.is_absence(),
            NodeError::NoStatus
            | NodeError::AtOnce { .. }
            | NodeError::Refused(_)
            | NodeError::Held(_)
            | NodeError::Invalid(_)
            | NodeError::TooLong(_)
            | NodeError::Cameras { .. }
            | NodeError::NoPictures
            | NodeError::OtherFrame { .. }
            | NodeError::Backwards { .. }
            | NodeError::Flood { .. }
            | NodeError::Mismatch(_) => false,
        }
    }
}

/// How a node differs from the one that the cluster file means.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum Mismatch {
    /// The hull rule or the probes' settings.
    #[error("hull rule differs: {0}")]
    Settings(String),
    /// The frame rate.
    #[error("it films {found} frames/s, expected {expected}")]
    FrameRate {
        /// The node's.
        found: f64,
        /// The cluster file's.
        expected: f64,
    },
    /// A camera is missing.
    #[error("it has no camera {0:?}")]
    NoCamera(String),
    /// The camera's calibration.
    #[error("its calibration of camera {0:?} is not the rig's")]
    Calibration(String),
    /// The camera's place.
    #[error("it has camera {name:?} at place {found}, expected {expected}")]
    Place {
        /// The camera.
        name: String,
        /// Its place in the node's rig.
        found: u16,
        /// Its place in ours.
        expected: u16,
    },
    /// Cameras that are not expected there.
    #[error("it has {found} cameras, expected {expected}")]
    Count {
        /// Cameras of the node.
        found: usize,
        /// Cameras of the cluster file.
        expected: usize,
    },
}

impl Mismatch {
    /// The settings that differ, each with what was found and expected.
    pub(crate) fn of_settings(found: &ProbeSettings, expected: &ProbeSettings) -> Mismatch {
        let view = |settings: &ProbeSettings| match settings.rule().out_of_view {
            OutOfView::Outside => "outside".to_owned(),
            OutOfView::Abstain => "abstain".to_owned(),
        };
        let window = |settings: &ProbeSettings| match settings.normal_window() {
            NormalWindow::Auto => "auto".to_owned(),
            NormalWindow::Pixels(k) => k.to_string(),
        };
        let pairs = [
            ("out_of_view", view(found), view(expected)),
            ("min_views", found.rule().min_views.to_string(), expected.rule().min_views.to_string()),
            ("normal_window", window(found), window(expected)),
            ("max_depth_m", found.max_depth_m().to_string(), expected.max_depth_m().to_string()),
        ];
        let differing = pairs.iter().filter(|(_, found, expected)| found != expected);
        let texts = differing.map(|(key, found, expected)| format!("{key} is {found}, expected {expected}"));
        Mismatch::Settings(texts.collect::<Vec<_>>().join("; "))
    }
}

impl From<tonic::Status> for NodeError {
    fn from(status: tonic::Status) -> NodeError {
        if let Some(too_long) = cause_of(&status) {
            return NodeError::TooLong(too_long);
        }
        let said = std::error::Error::source(&status).map_or_else(|| status.message().to_owned(), root_cause);
        let message = clean(&said, MAX_MESSAGE_CHARS);
        match status.code() {
            tonic::Code::Unavailable
            | tonic::Code::Cancelled
            | tonic::Code::Unknown
            | tonic::Code::Internal => NodeError::Lost(message),
            tonic::Code::Aborted => NodeError::Held(message),
            // Of a server that says no more.
            tonic::Code::Unimplemented if message.is_empty() => {
                NodeError::Refused("it has no such call: expected a node of this version of hulltouch".into())
            }
            _ => NodeError::Refused(message),
        }
    }
}

/// Why we did not read on, if that is why the call failed.
fn cause_of(status: &tonic::Status) -> Option<TooLong> {
    let mut cause = std::error::Error::source(status);
    while let Some(error) = cause {
        if let Some(too_long) = error.downcast_ref() {
            return Some(*too_long);
        }
        cause = error.source();
    }
    None
}

/// The innermost cause: tonic's own words alone say only "transport error".
pub(crate) fn root_cause(error: &(dyn std::error::Error + 'static)) -> String {
    let mut cause = error;
    while let Some(inner) = cause.source() {
        cause = inner;
    }
    cause.to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_that_differ_are_named_one_by_one() {
        let rule = |out_of_view, min_views| hull::HullRule { out_of_view, min_views };
        let settings = |rule, depth_m| ProbeSettings::new(rule, NormalWindow::Auto, depth_m).expect("valid");
        let found = settings(rule(OutOfView::Abstain, 3), 1.0);
        let expected = settings(rule(OutOfView::Outside, 2), 1.0);
        let text = Mismatch::of_settings(&found, &expected).to_string();
        assert_eq!(
            text,
            "hull rule differs: out_of_view is abstain, expected outside; min_views is 3, expected 2"
        );
    }
}
