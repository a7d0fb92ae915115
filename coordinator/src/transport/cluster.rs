//! Questions travel, nodes compute: each question of a pass to the nodes that it asks, each reply to the pass.

use std::sync::Arc;
use std::time::Duration;

use film_time::monotonic_s;
use hull::pass::{Pass, Round};
use hull::question::{Answer, Question, QuestionKind, Standing};
use node_client::NodeError;
use proto::convert::{Precision, ProbeAnswer, QuestionWriter, RefusalReason, WrittenQuestion};
use telemetry::Span;
use tokio::time::Instant;

use super::TransportError;
use super::nodes::{CALL_TIMEOUT, Nodes, PassEvent};
use super::trace::question_span;
use crate::core::ask_policy::AskPolicy;
use crate::core::round_trips::RoundTrips;
use crate::figures::Stage;
use crate::roster::{Roster, RosterNode};

/// Nodes that are asked.
pub(super) struct Cluster {
    writer: QuestionWriter,
    /// Whether some nodes are asked for classes before the others.
    classes: AskPolicy,
    /// Whether some nodes are asked for edges and exits before the others.
    distances: AskPolicy,
    round_trips: RoundTrips,
    next_id: u64,
    /// Which nodes each question of the last pass asked.
    pub(super) asked: Vec<Vec<bool>>,
}

/// A question on its way to several nodes.
pub(super) struct Asking {
    /// It is the pass's speculative question.
    is_speculative: bool,
    pub id: u64,
    pub frame: u64,
    /// The cameras that each node reported of the frame, by their places in the rig.
    pub cameras: Vec<Vec<u32>>,
    pub written: WrittenQuestion,
    began: Instant,
    pub deadline: Instant,
    timeout: Duration,
}

/// A question that a node has not answered.
struct OpenQuestion<'a> {
    node: usize,
    asking: &'a Asking,
    span: Span,
    is_asked_again: bool,
}

/// What the rounds of one pass cost that can be asked in two phases.
#[derive(Clone, Copy, Default)]
struct RoundCost {
    points: usize,
    ms: f64,
    in_two_phases: bool,
}

impl Cluster {
    pub fn new(nodes: &Nodes, precision: Precision) -> Cluster {
        let count = nodes.clients.len();
        let (classes, distances) =
            (AskPolicy::of_classes(count, precision), AskPolicy::of_distances(count, precision));
        Cluster {
            writer: QuestionWriter::new(precision),
            classes,
            distances,
            round_trips: RoundTrips::new(count, nodes.agreement.fps()),
            next_id: 0,
            asked: Vec::new(),
        }
    }

    /// The same nodes, asked with numbers of another precision.
    pub fn with_precision(self, nodes: &Nodes, precision: Precision) -> Cluster {
        nodes.clients.iter().for_each(|client| client.forget_sent());
        Cluster { next_id: self.next_id, ..Cluster::new(nodes, precision) }
    }

    /// Asks until the pass is done; every round may take `timeout`, or without one what is usual. `took` receives each round
    /// and its milliseconds. Returns what all nodes computed, milliseconds.
    pub async fn run_pass(
        &mut self,
        nodes: &mut Nodes,
        pass: &mut Pass,
        frame: u64,
        timeout: Option<Duration>,
        roster: &mut Roster,
        took: &mut dyn FnMut(Round, f64),
    ) -> Result<f64, TransportError> {
        let timeout = timeout.unwrap_or_else(|| self.round_trips.timeout(roster, monotonic_s()));
        // What came before these questions is no answer to them.
        nodes.drain(roster);
        self.asked.clear();
        pass.ask_in_two_phases(self.distances.asks_in_two_phases());
        pass.save_bytes(self.writer.precision() == Precision::Quantised);
        if pass.question().is_none() {
            pass.ask_first(&self.classes.first());
            return Ok(0.0);
        }
        let (mut classes, mut distances) = (RoundCost::default(), RoundCost::default());
        let mut computed_ms = 0.0;
        while let Some(question) = pass.question() {
            let (kind, round, points) = (question.kind, pass.round(), question.len());
            let asks_all = (0..nodes.clients.len()).all(|node| pass.asks(node));
            let mut asked = vec![self.asking(question, frame, roster, timeout)];
            if let Some(question) = pass.speculative_question() {
                asked.push(Asking { is_speculative: true, ..self.asking(question, frame, roster, timeout) });
            }
            let span = nodes.trace.part(Stage::from(round).name());
            span.count("hulltouch.points", points);
            let answered = self.run_round(nodes, pass, &asked, (roster, &span)).await;
            if let Err(error) = &answered {
                span.fail(error);
                self.forget_sent(nodes);
            }
            computed_ms += answered?;
            let ms = asked[0].began.elapsed().as_secs_f64() * 1e3;
            took(round, ms);
            if round == Round::Edges && pass.asks_planes() {
                // Asked together with the classes if these are asked in one phase.
                classes.ms += ms;
                continue;
            }
            let cost = if kind == QuestionKind::Classes { &mut classes } else { &mut distances };
            cost.in_two_phases |= !asks_all;
            if round != Round::Check {
                cost.points = cost.points.max(points);
                cost.ms += ms;
            }
        }
        self.classes.took(classes.in_two_phases, classes.points, classes.ms);
        self.distances.took(distances.in_two_phases, distances.points, distances.ms);
        pass.ask_first(&self.classes.first());
        Ok(computed_ms)
    }

    /// Some nodes may have been sent what others were not: the next question is sent whole.
    fn forget_sent(&mut self, nodes: &Nodes) {
        self.writer = QuestionWriter::new(self.writer.precision());
        nodes.clients.iter().for_each(|client| client.forget_sent());
    }

    pub(super) fn asking(
        &mut self,
        question: &Question,
        frame: u64,
        roster: &Roster,
        timeout: Duration,
    ) -> Asking {
        let cameras = |node: &RosterNode| {
            let reported = node.report(frame).into_iter().flat_map(|report| &report.cameras);
            reported.map(|camera| camera.rig_index.into()).collect()
        };
        self.next_id += 1;
        Asking {
            is_speculative: false,
            id: self.next_id,
            frame,
            cameras: roster.nodes().iter().map(cameras).collect(),
            written: self.writer.write(question),
            began: Instant::now(),
            deadline: Instant::now() + timeout,
            timeout,
        }
    }

    /// Asks the pass's question, and the speculative one, of all nodes that it asks, and hands it their answers. Returns what
    /// they computed, milliseconds.
    async fn run_round(
        &mut self,
        nodes: &mut Nodes,
        pass: &mut Pass,
        asked: &[Asking],
        (roster, span): (&mut Roster, &Span),
    ) -> Result<f64, TransportError> {
        let mut computed_ms = 0.0;
        let is_asked: Vec<bool> = (0..nodes.clients.len()).map(|node| pass.asks(node)).collect();
        let mut open = Vec::with_capacity(asked.len() * is_asked.len());
        for node in (0..is_asked.len()).filter(|&node| is_asked[node]) {
            for asking in asked {
                let span = question_span(span, "ask a node", &nodes.clients[node]);
                ask(nodes, node, pass, asking, &span)
                    .inspect_err(|error| record_failure(roster, node, error))?;
                open.push(OpenQuestion { node, asking, span, is_asked_again: false });
            }
        }
        self.asked.push(is_asked);
        let mut nodes_ms: Vec<(usize, f64)> = Vec::with_capacity(open.len());
        while let Some(&OpenQuestion { node: slowest, asking, .. }) = open.first() {
            let event = tokio::time::timeout_at(asking.deadline, nodes.next(roster)).await;
            // Messages that never end are no reason to wait for longer.
            let is_late = event.is_err() || Instant::now() > asking.deadline;
            if is_late {
                let mut late: Vec<usize> = open.iter().map(|open| open.node).collect();
                late.dedup();
                nodes_ms.extend(late.iter().map(|&node| (node, asking.timeout.as_secs_f64() * 1e3)));
                self.round_trips.record(&nodes_ms);
                roster.record_late(&late, monotonic_s(), &NodeError::Timeout(asking.timeout).to_string());
            }
            let event = event.ok().filter(|_| !is_late).ok_or_else(|| late(nodes, slowest, asking))?;
            let (place, answer, compute_ms) = match event {
                Some(PassEvent::Reply(node, id, answer, compute_ms)) => {
                    let is_its = |open: &OpenQuestion<'_>| open.node == node && open.asking.id == id;
                    let Some(place) = open.iter().position(is_its) else { continue };
                    (place, answer, compute_ms)
                }
                Some(PassEvent::Down(node, error)) if open.iter().any(|open| open.node == node) => {
                    return Err(failed(nodes, node, error));
                }
                Some(PassEvent::Down(..)) | None => continue,
            };
            let OpenQuestion { node, asking, span, is_asked_again } = &mut open[place];
            let (node, asking) = (*node, *asking);
            let may_ask_again = !std::mem::replace(is_asked_again, true);
            let refusal = match &answer {
                ProbeAnswer::Refused(reason, _) => Some(*reason),
                ProbeAnswer::Answer(_) => None,
            };
            let answered = match answer {
                ProbeAnswer::Answer(answer) => Ok(Some(answer)),
                ProbeAnswer::Refused(reason, message) if may_ask_again => {
                    ask_again(nodes, node, reason, message, (pass, span), asking).await
                }
                ProbeAnswer::Refused(_, message) => Err(failed(nodes, node, NodeError::Refused(message))),
            };
            let is_excused = refusal.is_some_and(|reason| roster.excuses(node, reason, asking.frame));
            let note = |error: &TransportError| match is_excused {
                true => roster.record_late(&[node], monotonic_s(), &error.to_string()),
                false => record_failure(roster, node, error),
            };
            let Some(answer) = answered.inspect_err(note)? else {
                continue;
            };
            open.remove(place);
            nodes_ms.push((node, asking.began.elapsed().as_secs_f64() * 1e3));
            computed_ms += compute_ms;
            if answer.kind == QuestionKind::Classes && pass.round() == Round::Classes {
                self.note_classes(node, &answer, asking, compute_ms);
            }
            let invalid =
                |error| TransportError::Answer { node: nodes.clients[node].node().to_string(), error };
            let taken = pass.answer(node, &answer).map_err(invalid);
            taken.inspect_err(|error| record_failure(roster, node, error))?;
        }
        self.round_trips.record(&nodes_ms);
        Ok(computed_ms)
    }

    fn note_classes(&mut self, node: usize, answer: &Answer, asking: &Asking, compute_ms: f64) {
        let took_ms = asking.began.elapsed().as_secs_f64() * 1e3;
        // Without branches.
        let is_outside = |standing: &Standing| u32::from(*standing == Standing::OUTSIDE);
        let rejected = answer.standings.iter().map(is_outside).sum::<u32>() as usize;
        self.classes.answered(node, answer.len(), rejected, took_ms, compute_ms);
    }
}

fn ask(nodes: &Nodes, node: usize, pass: &Pass, asking: &Asking, span: &Span) -> Result<(), TransportError> {
    let question = if asking.is_speculative { pass.speculative_question() } else { pass.question() };
    let Some(question) = question else { return Ok(()) };
    let sent = nodes.clients[node].ask(
        asking.id,
        (asking.frame, asking.cameras[node].clone()),
        question,
        &asking.written,
        span.parent(),
    );
    sent.map_err(|error| failed(nodes, node, error))
}

/// Records why a node's answer is missing: a refusal or a wrong answer is a fault, all else is late.
fn record_failure(roster: &mut Roster, node: usize, error: &TransportError) {
    match error {
        TransportError::Node { error, .. } if error.is_absence() => {
            roster.record_late(&[node], monotonic_s(), &error.to_string());
        }
        error => roster.fault(node, monotonic_s(), error.to_string()),
    }
}

/// Asks a node that lacked something once more: then there is no answer yet.
async fn ask_again(
    nodes: &Nodes,
    node: usize,
    reason: RefusalReason,
    message: String,
    (pass, span): (&Pass, &Span),
    asking: &Asking,
) -> Result<Option<Answer>, TransportError> {
    let client = &nodes.clients[node];
    // Whatever it did not understand, it is sent everything again.
    client.forget_sent();
    match reason {
        RefusalReason::UnknownShape => {
            // The node was restarted since the shapes were registered.
            // A narrow link may take longer than this round lasts.
            let registering = Arc::clone(client);
            let registering = tokio::spawn(async move {
                let registered = tokio::time::timeout(CALL_TIMEOUT, registering.register_again()).await;
                registered.unwrap_or(Err(NodeError::Timeout(CALL_TIMEOUT)))
            });
            let registered = tokio::time::timeout_at(asking.deadline, registering).await;
            let registered = registered.map_err(|_| late(nodes, node, asking))?;
            registered.unwrap_or(Err(NodeError::Closed)).map_err(|error| failed(nodes, node, error))?;
        }
        RefusalReason::UnknownList => {}
        RefusalReason::Held => return Err(failed(nodes, node, NodeError::Held(message))),
        _ => return Err(failed(nodes, node, NodeError::Refused(message))),
    }
    ask(nodes, node, pass, asking, span).map(|()| None)
}

pub(super) fn failed(nodes: &Nodes, node: usize, error: NodeError) -> TransportError {
    TransportError::of(&nodes.clients[node], error)
}

pub(super) fn late(nodes: &Nodes, node: usize, asking: &Asking) -> TransportError {
    failed(nodes, node, NodeError::Timeout(asking.timeout))
}
