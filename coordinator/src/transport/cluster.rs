//! Questions travel, nodes compute: each question of a pass to the nodes that it asks, each reply to the pass.

use std::time::{Duration, Instant};

use hull::pass::{Pass, Round};
use hull::question::{Answer, Question, QuestionKind, Standing};
use node_client::NodeError;
use proto::convert::{Precision, ProbeAnswer, QuestionWriter, RefusalReason, WrittenQuestion};
use tokio::time::Instant as Deadline;

use super::TransportError;
use super::nodes::{Nodes, PassEvent};
use crate::ask_policy::AskPolicy;
use crate::roster::Roster;

/// Nodes that are asked.
pub(super) struct Cluster {
    pub nodes: Nodes,
    writer: QuestionWriter,
    /// Whether some nodes are asked for classes before the others,
    classes: AskPolicy,
    /// and for edges and exits.
    distances: AskPolicy,
    next_id: u64,
}

/// A question on its way to several nodes.
struct Asking {
    id: u64,
    frame: u64,
    written: WrittenQuestion,
    began: Instant,
    deadline: Deadline,
    timeout: Duration,
}

/// What the rounds of one pass cost that can be asked in two phases.
#[derive(Clone, Copy, Default)]
struct RoundCost {
    points: usize,
    ms: f64,
    in_two_phases: bool,
}

impl Cluster {
    pub fn new(nodes: Nodes, precision: Precision) -> Cluster {
        let count = nodes.clients.len();
        let (classes, distances) =
            (AskPolicy::of_classes(count, precision), AskPolicy::of_distances(count, precision));
        Cluster { nodes, writer: QuestionWriter::new(precision), classes, distances, next_id: 0 }
    }

    /// The same nodes, asked with numbers of another precision.
    pub fn with_precision(self, precision: Precision) -> Cluster {
        self.nodes.clients.iter().for_each(|client| client.forget_sent());
        Cluster { next_id: self.next_id, ..Cluster::new(self.nodes, precision) }
    }

    /// Asks until the pass is done; every round may take `timeout`. `took` receives each round and its
    /// milliseconds.
    pub async fn run_pass(
        &mut self,
        pass: &mut Pass,
        frame: u64,
        timeout: Duration,
        roster: &mut Roster,
        took: &mut dyn FnMut(Round, f64),
    ) -> Result<(), TransportError> {
        // What came before these questions is no answer to them.
        self.nodes.drain(roster);
        pass.ask_in_two_phases(self.distances.asks_in_two_phases());
        pass.save_bytes(self.writer.precision() == Precision::Quantised);
        if pass.question().is_none() {
            pass.ask_first(&self.classes.first());
            return Ok(());
        }
        let (mut classes, mut distances) = (RoundCost::default(), RoundCost::default());
        while let Some(question) = pass.question() {
            let (kind, round, points) = (question.kind, pass.round(), question.len());
            let asks_all = (0..self.nodes.clients.len()).all(|node| pass.asks(node));
            let asking = self.asking(question, frame, timeout);
            let answered = self.run_round(pass, &asking, roster).await;
            if answered.is_err() {
                self.forget_sent();
            }
            answered?;
            let ms = asking.began.elapsed().as_secs_f64() * 1e3;
            took(round, ms);
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
        Ok(())
    }

    /// Some nodes may have been sent what others were not: the next question is sent whole.
    fn forget_sent(&mut self) {
        self.writer = QuestionWriter::new(self.writer.precision());
        self.nodes.clients.iter().for_each(|client| client.forget_sent());
    }

    fn asking(&mut self, question: &Question, frame: u64, timeout: Duration) -> Asking {
        self.next_id += 1;
        Asking {
            id: self.next_id,
            frame,
            written: self.writer.write(question),
            began: Instant::now(),
            deadline: Deadline::now() + timeout,
            timeout,
        }
    }

    /// Asks the pass's question of all nodes that it asks, and hands it their answers.
    async fn run_round(
        &mut self,
        pass: &mut Pass,
        asking: &Asking,
        roster: &mut Roster,
    ) -> Result<(), TransportError> {
        let round = pass.round();
        let mut waiting: Vec<bool> = (0..self.nodes.clients.len()).map(|node| pass.asks(node)).collect();
        for node in (0..waiting.len()).filter(|&node| waiting[node]) {
            self.ask(node, pass, asking)?;
        }
        while let Some(slowest) = waiting.iter().position(|&waits| waits) {
            let event = tokio::time::timeout_at(asking.deadline, self.nodes.next(roster)).await;
            if event.is_err() {
                roster.silent(slowest);
            }
            let (node, answer, compute_ms) = match event.map_err(|_| self.late(slowest, asking))? {
                Some(PassEvent::Reply(node, id, answer, compute_ms)) if id == asking.id && waiting[node] => {
                    (node, answer, compute_ms)
                }
                Some(PassEvent::Down(node, error)) if waiting[node] => return Err(self.failed(node, error)),
                Some(PassEvent::Reply(..) | PassEvent::Down(..)) | None => continue,
            };
            let Some(answer) = self.answer_or_ask_again(node, answer, pass, asking).await? else { continue };
            waiting[node] = false;
            if round == Round::Classes {
                self.note_classes(node, &answer, asking, compute_ms);
            }
            let invalid = |error| TransportError::Answer { node: self.name(node), error };
            pass.answer(node, &answer).map_err(invalid)?;
        }
        Ok(())
    }

    fn ask(&self, node: usize, pass: &Pass, asking: &Asking) -> Result<(), TransportError> {
        let Some(question) = pass.question() else { return Ok(()) };
        let sent = self.nodes.clients[node].ask(asking.id, asking.frame, question, &asking.written);
        sent.map_err(|error| self.failed(node, error))
    }

    /// The answer, or nothing if the node had to be asked once more.
    async fn answer_or_ask_again(
        &self,
        node: usize,
        answer: ProbeAnswer,
        pass: &Pass,
        asking: &Asking,
    ) -> Result<Option<Answer>, TransportError> {
        let (reason, message) = match answer {
            ProbeAnswer::Answer(answer) => return Ok(Some(answer)),
            ProbeAnswer::Refused(reason, message) => (reason, message),
        };
        let client = &self.nodes.clients[node];
        // Whatever it did not understand, it is sent everything anew.
        client.forget_sent();
        match reason {
            RefusalReason::UnknownShape => {
                // The node began anew since the shapes were registered.
                let registered = tokio::time::timeout_at(asking.deadline, client.register_again()).await;
                registered.map_err(|_| self.late(node, asking))?.map_err(|error| self.failed(node, error))?;
            }
            RefusalReason::UnknownList => {}
            RefusalReason::Held => return Err(self.failed(node, NodeError::Held(message))),
            _ => return Err(self.failed(node, NodeError::Refused(message))),
        }
        self.ask(node, pass, asking).map(|()| None)
    }

    fn note_classes(&mut self, node: usize, answer: &Answer, asking: &Asking, compute_ms: f64) {
        let took_ms = asking.began.elapsed().as_secs_f64() * 1e3;
        let rejected = answer.standings.iter().filter(|standing| **standing == Standing::OUTSIDE).count();
        self.classes.answered(node, answer.len(), rejected, took_ms, compute_ms);
    }

    fn name(&self, node: usize) -> String {
        self.nodes.clients[node].node().to_string()
    }

    fn failed(&self, node: usize, error: NodeError) -> TransportError {
        TransportError::of(&self.nodes.clients[node], error)
    }

    fn late(&self, node: usize, asking: &Asking) -> TransportError {
        self.failed(node, NodeError::Timeout(asking.timeout))
    }
}
