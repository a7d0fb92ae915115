//! Drives a pass over the network: each question to the nodes that it asks, each reply to the pass.

use std::sync::Arc;
use std::time::{Duration, Instant};

use hull::pass::{AnswerError, Pass, Round};
use hull::question::{Answer, Standing};
use proto::convert::{Precision, ProbeAnswer, QuestionWriter, RefusalReason, WrittenQuestion};
use thiserror::Error;
use tokio::sync::mpsc;

use crate::camera_client::{Event, Link};
use crate::ways::Ways;

/// Why a pass has no result; the step goes on without.
#[derive(Debug, Error)]
pub(crate) enum PassError {
    #[error("node {0} is not there")]
    Down(String),
    #[error("node {node} did not answer within {waited_ms} ms")]
    Late { node: String, waited_ms: u128 },
    #[error("node {node} refused: {message}")]
    Refused { node: String, message: String },
    #[error("node {node}: {error}")]
    Answer { node: String, error: AnswerError },
}

/// The requests of a run: their ids, and where replies arrive.
pub(crate) struct Fanout {
    pub links: Vec<Arc<Link>>,
    pub events: mpsc::Receiver<Event>,
    writer: QuestionWriter,
    ways: Ways,
    next_id: u64,
}

/// A question on its way to several nodes.
struct Asking {
    id: u64,
    frame: u64,
    question: WrittenQuestion,
    points: usize,
    began: Instant,
    deadline: tokio::time::Instant,
    patience: Duration,
}

impl Fanout {
    pub fn new(links: Vec<Arc<Link>>, events: mpsc::Receiver<Event>, precision: Precision) -> Fanout {
        let ways = Ways::new(links.len());
        Fanout { links, events, writer: QuestionWriter::new(precision), ways, next_id: 0 }
    }

    /// From now on numbers travel like this.
    pub fn set_precision(&mut self, precision: Precision) {
        self.writer = QuestionWriter::new(precision);
        self.links.iter().for_each(|link| link.forget());
    }

    /// Asks until the pass is done. `took` is told each round and the milliseconds it took.
    pub async fn run(
        &mut self,
        pass: &mut Pass,
        frame: u64,
        patience: Duration,
        took: &mut dyn FnMut(Round, f64),
    ) -> Result<(), PassError> {
        let (mut classes_ms, mut classes_points, mut selectively) = (0.0, 0, false);
        while let Some(question) = pass.question() {
            let (round, began, points) = (pass.round(), Instant::now(), question.len());
            selectively |= round == Round::Classes && (0..self.links.len()).any(|index| !pass.asks(index));
            self.round(pass, frame, patience).await?;
            let ms = began.elapsed().as_secs_f64() * 1e3;
            took(round, ms);
            if round == Round::Classes {
                classes_points = classes_points.max(points);
                classes_ms += ms;
            }
        }
        self.ways.took(selectively, classes_points, classes_ms);
        pass.ask_first(&self.ways.first());
        Ok(())
    }

    async fn round(&mut self, pass: &mut Pass, frame: u64, patience: Duration) -> Result<(), PassError> {
        let Some(question) = pass.question() else { return Ok(()) };
        let asking = Asking {
            id: self.next_id,
            frame,
            question: self.writer.write(0, question),
            points: question.len(),
            began: Instant::now(),
            deadline: tokio::time::Instant::now() + patience,
            patience,
        };
        self.next_id += 1;
        // What was told before this question is no answer to it.
        while self.events.try_recv().is_ok() {}
        let mut waiting: Vec<bool> = (0..self.links.len()).map(|index| pass.asks(index)).collect();
        for index in (0..waiting.len()).filter(|&index| waiting[index]) {
            self.ask(index, &asking)?;
        }
        while let Some(first) = waiting.iter().position(|&waits| waits) {
            match self.event(first, &asking).await? {
                Event::Down(index) if waiting[index] => return Err(PassError::Down(self.name(index))),
                Event::Reply(index, id, answer, compute_ms) if id == asking.id && waiting[index] => {
                    if let Some(answer) = self.answer_of(index, answer, &asking).await? {
                        self.note(pass.round(), index, &answer, &asking, compute_ms);
                        let refused = |error| PassError::Answer { node: self.name(index), error };
                        waiting[index] = false;
                        pass.answer(index, &answer).map_err(refused)?;
                    }
                }
                Event::Down(_) | Event::Reply(..) => {}
            }
        }
        Ok(())
    }

    fn name(&self, index: usize) -> String {
        self.links[index].node.address.to_string()
    }

    fn ask(&self, index: usize, asking: &Asking) -> Result<(), PassError> {
        let sent = self.links[index].ask(asking.id, asking.frame, &asking.question);
        if sent { Ok(()) } else { Err(PassError::Down(self.name(index))) }
    }

    async fn event(&mut self, waited_for: usize, asking: &Asking) -> Result<Event, PassError> {
        let event = tokio::time::timeout_at(asking.deadline, self.events.recv()).await;
        let waited_ms = asking.patience.as_millis();
        event.ok().flatten().ok_or_else(|| PassError::Late { node: self.name(waited_for), waited_ms })
    }

    /// The answer, or nothing if the node was asked once more.
    async fn answer_of(
        &self,
        index: usize,
        answer: ProbeAnswer,
        asking: &Asking,
    ) -> Result<Option<Answer>, PassError> {
        let (reason, message) = match answer {
            ProbeAnswer::Answer(answer) => return Ok(Some(answer)),
            ProbeAnswer::Refused(reason, message) => (reason, message),
        };
        let link = &self.links[index];
        let refused = |message| PassError::Refused { node: self.name(index), message };
        // Whatever it did not understand, it is told everything anew.
        link.forget();
        match reason {
            RefusalReason::UnknownShape => {
                // The node began anew since the shapes were registered.
                let registered = tokio::time::timeout_at(asking.deadline, link.register_shapes());
                let registered = registered.await.map_err(|_| refused("took too long".into()))?;
                registered.map_err(|status| refused(status.message().to_owned()))?;
            }
            RefusalReason::UnknownList => {}
            _ => return Err(refused(message)),
        }
        self.ask(index, asking).map(|()| None)
    }

    fn note(&mut self, round: Round, index: usize, answer: &Answer, asking: &Asking, compute_ms: f64) {
        if round == Round::Classes {
            let took_ms = asking.began.elapsed().as_secs_f64() * 1e3;
            let outside = |standing: &&Standing| **standing == Standing::OUTSIDE;
            let rejected = answer.standings.iter().filter(outside).count();
            self.ways.answered(index, asking.points, rejected, took_ms, compute_ms);
        }
    }
}
