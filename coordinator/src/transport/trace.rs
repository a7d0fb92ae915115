//! The spans of a pass: itself, its rounds, and each question to a node; what the node does then is its own to tell.

use hull::pass::Pass;
use node_client::NodeClient;
use telemetry::Span;

/// The span of a pass over a frame; nothing if it asks nothing, or is not sampled.
pub(super) fn pass_span(pass: &Pass, frame: u64, layout: &'static str) -> Span {
    let Some(question) = pass.question() else { return Span::NONE };
    let span = Span::root("pass");
    span.count("hulltouch.frame", usize::try_from(frame).unwrap_or(usize::MAX));
    span.count("hulltouch.points", question.len());
    span.note("hulltouch.layout", layout);
    span
}

/// The span of a question to a node, a part of another.
pub(super) fn question_span(part_of: &Span, name: &'static str, client: &NodeClient) -> Span {
    let span = part_of.question(name);
    if !span.is_none() {
        span.note("hulltouch.node", client.node().to_string());
    }
    span
}
