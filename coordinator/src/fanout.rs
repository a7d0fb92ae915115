//! Drives a pass over the network: each question to every node, each reply to the pass.

use std::sync::Arc;
use std::time::{Duration, Instant};

use hull::pass::{AnswerError, Pass, Round};
use proto::convert::{ProbeAnswer, RefusalReason};
use thiserror::Error;
use tokio::sync::mpsc;

use crate::camera_client::{Event, Link};

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
    next_id: u64,
}

impl Fanout {
    pub fn new(links: Vec<Arc<Link>>, events: mpsc::Receiver<Event>) -> Fanout {
        Fanout { links, events, next_id: 0 }
    }

    /// Asks until the pass is done. `took` is told each round and the milliseconds it took.
    pub async fn run(
        &mut self,
        pass: &mut Pass,
        frame: u64,
        patience: Duration,
        took: &mut dyn FnMut(Round, f64),
    ) -> Result<(), PassError> {
        while pass.question().is_some() {
            let (round, began) = (pass.round(), Instant::now());
            self.round(pass, frame, patience).await?;
            took(round, began.elapsed().as_secs_f64() * 1e3);
        }
        Ok(())
    }

    async fn round(&mut self, pass: &mut Pass, frame: u64, patience: Duration) -> Result<(), PassError> {
        let Some(question) = pass.question().cloned() else { return Ok(()) };
        let id = self.next_id;
        self.next_id += 1;
        // What was told before this question is no answer to it.
        while self.events.try_recv().is_ok() {}
        let name = |links: &[Arc<Link>], index: usize| links[index].node.address.to_string();
        let mut waiting: Vec<bool> = (0..self.links.len()).map(|index| pass.asks(index)).collect();
        for (index, link) in self.links.iter().enumerate().filter(|&(index, _)| waiting[index]) {
            if !link.ask(id, frame, &question) {
                return Err(PassError::Down(name(&self.links, index)));
            }
        }
        let deadline = tokio::time::Instant::now() + patience;
        while let Some(first) = waiting.iter().position(|&waits| waits) {
            let event = tokio::time::timeout_at(deadline, self.events.recv()).await;
            let late = || PassError::Late { node: name(&self.links, first), waited_ms: patience.as_millis() };
            let (index, answer) = match event.map_err(|_| late())?.ok_or_else(late)? {
                Event::Down(index) if waiting[index] => {
                    return Err(PassError::Down(name(&self.links, index)));
                }
                Event::Down(_) => continue,
                Event::Reply(_, of, _) if of != id => continue,
                Event::Reply(index, _, answer) => (index, answer),
            };
            let node = || name(&self.links, index);
            match answer {
                ProbeAnswer::Answer(answer) => {
                    pass.answer(index, &answer).map_err(|error| PassError::Answer { node: node(), error })?;
                    waiting[index] = false;
                }
                ProbeAnswer::Refused(RefusalReason::UnknownShape, _) => {
                    // The node began anew since the shapes were registered.
                    let refused = |message| PassError::Refused { node: node(), message };
                    let link = &self.links[index];
                    let registered = tokio::time::timeout_at(deadline, link.register_shapes());
                    let registered = registered.await.map_err(|_| refused("took too long".into()))?;
                    registered.map_err(|status| refused(status.message().to_owned()))?;
                    if !link.ask(id, frame, &question) {
                        return Err(PassError::Down(node()));
                    }
                }
                ProbeAnswer::Refused(_, message) => {
                    return Err(PassError::Refused { node: node(), message });
                }
            }
        }
        Ok(())
    }
}
