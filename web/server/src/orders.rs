//! The commands of one page or program on their way, and what brings back what the last of them took away.

use std::time::{Duration, Instant};

use coordinator::live::{Command, Follower, Outcome, Refusal};
use futures::StreamExt as _;
use futures::future::BoxFuture;
use futures::stream::FuturesOrdered;

use crate::commands::{Ask, Request};
use crate::text;

/// Commands of one client that wait for the loop, at most.
const MAX_ORDERS: usize = 64;
/// What a command took away can be brought back for so long: later it would surprise those who have gone on.
const UNDO_WITHIN: Duration = Duration::from_secs(30);

type Order = BoxFuture<'static, (u64, Result<Outcome, Refusal>)>;

/// The client's connection to the run. What it holds is released once this and all its orders are dropped.
pub(crate) struct Orders {
    follower: Follower,
    /// How to get the right to steer, if the client has not.
    refusal: Option<&'static str>,
    /// In their order: a release must not overtake its grab.
    waiting: FuturesOrdered<Order>,
    revocable: Option<Revocable>,
}

/// The last command that took something away.
struct Revocable {
    id: u64,
    done_at: Instant,
    /// What brings it back.
    command: Command,
}

impl Orders {
    pub fn new(follower: Follower, refusal: Option<&'static str>) -> Orders {
        Orders { follower, refusal, waiting: FuturesOrdered::new(), revocable: None }
    }

    /// Passes a command on to the run; returns the answer if it is refused at once.
    pub fn order(&mut self, Request { id, command }: Request) -> Option<String> {
        let refused = |why: &str| Some(text::refused(Some(id), why));
        if let Some(how) = self.refusal {
            return refused(&format!("a viewer cannot steer: {how}"));
        }
        if self.waiting.len() >= MAX_ORDERS {
            return refused(&format!("{MAX_ORDERS} commands wait, expected fewer"));
        }
        let command = match command {
            Ok(Ask::Run(command)) => command,
            Ok(Ask::Undo { of }) => match self.take_revocable(of) {
                Some(command) => command,
                None => return refused(&format!("command {of} cannot be undone, or not any more")),
            },
            Err(why) => return refused(&why.to_string()),
        };
        let follower = self.follower.clone();
        self.waiting.push_back(Box::pin(async move { (id, follower.order(command).await) }));
        None
    }

    fn take_revocable(&mut self, id: u64) -> Option<Command> {
        let is_of = |last: &mut Revocable| last.id == id && last.done_at.elapsed() <= UNDO_WITHIN;
        self.revocable.take_if(is_of).map(|last| last.command)
    }

    /// The next answer; pending for ever if no command waits.
    pub async fn answered(&mut self) -> String {
        let Some((id, answer)) = self.waiting.next().await else { return std::future::pending().await };
        let outcome = match answer {
            Ok(outcome) => outcome,
            Err(why) => return text::refused(Some(id), &why.to_string()),
        };
        let answer = text::done(id, &outcome);
        if let Outcome::Revocable(command) = outcome {
            self.revocable = Some(Revocable { id, done_at: Instant::now(), command: *command });
        }
        answer
    }

    /// The client has disconnected: what it has asked for already is still done.
    pub fn end(mut self) {
        tokio::spawn(async move {
            while !self.waiting.is_empty() {
                self.answered().await;
            }
        });
    }
}
