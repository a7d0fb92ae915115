//! Drives a pass over the network: each question to the nodes that it asks, each reply to the pass.

use std::sync::Arc;
use std::time::{Duration, Instant};

use hull::pass::{AnswerError, Pass, Round};
use hull::question::{Answer, QuestionKind, Standing};
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
    /// Whether some nodes are asked for classes before the others,
    ways: Ways,
    /// and for edges and exits.
    narrowing: Ways,
    next_id: u64,
}

/// How a pass in flight stands: one of several, each with a list of bodies of its own.
struct Lane {
    asking: Asking,
    round: Round,
    /// Which nodes have yet to answer.
    waiting: Vec<bool>,
    taken: Taken,
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

/// What the rounds of a pass took that can be asked in two ways.
#[derive(Clone, Copy, Default)]
struct Taken {
    classes: WayTaken,
    distances: WayTaken,
}

#[derive(Clone, Copy, Default)]
struct WayTaken {
    points: usize,
    ms: f64,
    selectively: bool,
}

impl Fanout {
    pub fn new(links: Vec<Arc<Link>>, events: mpsc::Receiver<Event>, precision: Precision) -> Fanout {
        let (ways, narrowing) =
            (Ways::of_classes(links.len(), precision), Ways::of_distances(links.len(), precision));
        Fanout { links, events, writer: QuestionWriter::new(precision), ways, narrowing, next_id: 0 }
    }

    /// From now on numbers travel like this.
    pub fn set_precision(&mut self, precision: Precision) {
        self.writer = QuestionWriter::new(precision);
        self.ways = Ways::of_classes(self.links.len(), precision);
        self.narrowing = Ways::of_distances(self.links.len(), precision);
        self.links.iter().for_each(|link| link.forget());
    }

    /// Asks until all passes are done. `took` is told each round and the milliseconds it took.
    pub async fn run(
        &mut self,
        passes: &mut [&mut Pass],
        frame: u64,
        patience: Duration,
        took: &mut dyn FnMut(Round, f64),
    ) -> Result<(), PassError> {
        // What was told before these questions is no answer to them.
        while self.events.try_recv().is_ok() {}
        let narrows = self.narrowing.is_selective();
        let saves_bytes = self.writer.precision() == Precision::Quantised;
        for pass in passes.iter_mut() {
            pass.ask_in_two_phases(narrows);
            pass.save_bytes(saves_bytes);
        }
        let mut lanes = Vec::with_capacity(passes.len());
        for pass in passes.iter() {
            lanes.push(self.next_round(pass, Taken::default(), frame, patience)?);
        }
        while let Some(soonest) = lanes.iter().flatten().min_by_key(|lane| lane.asking.deadline) {
            let (index, id, answer, compute_ms) = match self.event(soonest).await? {
                Event::Reply(index, id, answer, compute_ms) => (index, id, answer, compute_ms),
                Event::Down(index) if lanes.iter().flatten().any(|lane| lane.waiting[index]) => {
                    return Err(PassError::Down(self.name(index)));
                }
                Event::Down(_) => continue,
            };
            let of_it = |lane: &Option<Lane>| {
                lane.as_ref().is_some_and(|lane| lane.asking.id == id && lane.waiting[index])
            };
            let Some(list) = lanes.iter().position(of_it) else { continue };
            let Some(lane) = &mut lanes[list] else { continue };
            let Some(answer) = self.answer_of(index, answer, &lane.asking).await? else { continue };
            lane.waiting[index] = false;
            self.note(lane, index, &answer, compute_ms);
            let refused = |error| PassError::Answer { node: self.name(index), error };
            passes[list].answer(index, &answer).map_err(refused)?;
            if lane.waiting.contains(&true) {
                continue;
            }
            took(lane.round, lane.end_round());
            let taken = lane.taken;
            lanes[list] = self.next_round(passes[list], taken, frame, patience)?;
            if lanes[list].is_none() {
                let Taken { classes, distances } = taken;
                self.ways.took(classes.selectively, classes.points, classes.ms);
                self.narrowing.took(distances.selectively, distances.points, distances.ms);
            }
        }
        let first = self.ways.first();
        passes.iter_mut().for_each(|pass| pass.ask_first(&first));
        Ok(())
    }

    /// Asks a pass's next question; `None` if it has none.
    fn next_round(
        &mut self,
        pass: &Pass,
        mut taken: Taken,
        frame: u64,
        patience: Duration,
    ) -> Result<Option<Lane>, PassError> {
        let Some(question) = pass.question() else { return Ok(None) };
        let asking = Asking {
            id: self.next_id,
            frame,
            question: self.writer.write(question),
            points: question.len(),
            began: Instant::now(),
            deadline: tokio::time::Instant::now() + patience,
            patience,
        };
        self.next_id += 1;
        let waiting: Vec<bool> = (0..self.links.len()).map(|index| pass.asks(index)).collect();
        let of_kind =
            if question.kind == QuestionKind::Classes { &mut taken.classes } else { &mut taken.distances };
        of_kind.selectively |= waiting.contains(&false);
        let lane = Lane { asking, round: pass.round(), waiting, taken };
        self.ask_all(&lane)?;
        Ok(Some(lane))
    }

    fn ask_all(&self, lane: &Lane) -> Result<(), PassError> {
        let mut asked = (0..lane.waiting.len()).filter(|&index| lane.waiting[index]);
        asked.try_for_each(|index| self.ask(index, &lane.asking))
    }

    fn name(&self, index: usize) -> String {
        self.links[index].node.address.to_string()
    }

    fn ask(&self, index: usize, asking: &Asking) -> Result<(), PassError> {
        let sent = self.links[index].ask(asking.id, asking.frame, &asking.question);
        if sent { Ok(()) } else { Err(PassError::Down(self.name(index))) }
    }

    async fn event(&mut self, soonest: &Lane) -> Result<Event, PassError> {
        let event = tokio::time::timeout_at(soonest.asking.deadline, self.events.recv()).await;
        event.ok().flatten().ok_or_else(|| {
            let waited_for = soonest.waiting.iter().position(|&waits| waits).unwrap_or_default();
            PassError::Late { node: self.name(waited_for), waited_ms: soonest.asking.patience.as_millis() }
        })
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

    fn note(&mut self, lane: &Lane, index: usize, answer: &Answer, compute_ms: f64) {
        if lane.round == Round::Classes {
            let took_ms = lane.asking.began.elapsed().as_secs_f64() * 1e3;
            let outside = |standing: &&Standing| **standing == Standing::OUTSIDE;
            let rejected = answer.standings.iter().filter(outside).count();
            self.ways.answered(index, lane.asking.points, rejected, took_ms, compute_ms);
        }
    }
}

impl Lane {
    /// The milliseconds that the round took.
    fn end_round(&mut self) -> f64 {
        let ms = self.asking.began.elapsed().as_secs_f64() * 1e3;
        let taken = match self.round {
            Round::Classes => &mut self.taken.classes,
            Round::Edges | Round::Exits | Round::BodyExits => &mut self.taken.distances,
            Round::Check | Round::Done => return ms,
        };
        taken.points = taken.points.max(self.asking.points);
        taken.ms += ms;
        ms
    }
}
