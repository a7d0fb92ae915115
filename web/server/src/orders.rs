//! The commands of one page or program on their way, and what brings back what the last of them took away.

use std::time::{Duration, Instant};

use coordinator::live::{Command, Follower, Outcome, Refusal};
use futures::StreamExt as _;
use futures::future::BoxFuture;
use futures::stream::{FuturesOrdered, FuturesUnordered};

use crate::commands::{Ask, Request};
use crate::text;

/// Commands of one client that wait for the loop, at most.
const MAX_ORDERS: usize = 64;
/// What a command took away can be brought back for so long: later it would surprise those who have gone on.
const UNDO_WITHIN: Duration = Duration::from_secs(30);

/// The command's number, what it undoes, and what became of it.
type Order = BoxFuture<'static, (u64, Option<Revocable>, Result<Outcome, Refusal>)>;

/// The client's connection to the run. What it holds is released once this and all its orders are dropped.
pub(crate) struct Orders {
    follower: Follower,
    /// How to get the right to steer, if the client has not.
    refusal: Option<&'static str>,
    /// In their order: a release must not overtake its grab.
    waiting: FuturesOrdered<Order>,
    /// Those that take as long as cameras film; others are answered meanwhile.
    filming: FuturesUnordered<Order>,
    revocable: Option<Revocable>,
}

/// The last command that took something away.
struct Revocable {
    id: u64,
    done_at: Instant,
    /// The world that it left: in another one only a background is brought back.
    generation: Option<u32>,
    /// What brings it back.
    command: Command,
}

impl Orders {
    pub fn new(follower: Follower, refusal: Option<&'static str>) -> Orders {
        Orders {
            follower,
            refusal,
            waiting: FuturesOrdered::new(),
            filming: FuturesUnordered::new(),
            revocable: None,
        }
    }

    /// Passes a command on to the run; returns the answer if it is refused at once.
    pub fn order(&mut self, Request { id, command }: Request) -> Option<String> {
        let refused = |why: &str| Some(text::refused(Some(id), why));
        if let Some(how) = self.refusal {
            return refused(&format!("a viewer cannot steer: {how}"));
        }
        if self.waiting.len() + self.filming.len() >= MAX_ORDERS {
            return refused(&format!("{MAX_ORDERS} commands wait, expected fewer"));
        }
        let (command, undone) = match command {
            Ok(Ask::Run(command)) => (command, None),
            Ok(Ask::Undo { of }) => match self.take_revocable(of) {
                Some(last) => (last.command.clone(), Some(last)),
                None => return refused(&format!("command {of} cannot be undone, or not any more")),
            },
            Err(why) => return refused(&why.to_string()),
        };
        if command.is_of_background() {
            // What the client holds is not held for as long as cameras film.
            let follower = self.follower.apart();
            self.filming.push(Box::pin(async move { (id, undone, follower.order(command).await) }));
        } else {
            let follower = self.follower.clone();
            self.waiting.push_back(Box::pin(async move { (id, undone, follower.order(command).await) }));
        }
        None
    }

    /// What the client's command of that number took away. What is too old, or of another world, is dropped.
    fn take_revocable(&mut self, id: u64) -> Option<Revocable> {
        let generation = self.generation();
        let is_of_another =
            |last: &Revocable| last.generation != generation && !last.command.is_of_background();
        self.revocable.take_if(|last| last.done_at.elapsed() > UNDO_WITHIN || is_of_another(last));
        self.revocable.take_if(|last| last.id == id)
    }

    fn generation(&self) -> Option<u32> {
        self.follower.scene.borrow().as_ref().map(|scene| scene.generation)
    }

    /// The next answer; pending for ever if no command waits.
    pub async fn answered(&mut self) -> String {
        let (id, undone, answer) = tokio::select! {
            Some(answered) = self.waiting.next() => answered,
            Some(answered) = self.filming.next() => answered,
            else => return std::future::pending().await,
        };
        let outcome = match answer {
            Ok(outcome) => outcome,
            Err(why) => {
                // It may be asked for again.
                self.revocable = self.revocable.take().or(undone);
                return text::refused(Some(id), &why.to_string());
            }
        };
        let answer = text::done(id, &outcome);
        if let Outcome::Revocable(command) = outcome {
            let generation = self.generation();
            self.revocable = Some(Revocable { id, done_at: Instant::now(), generation, command: *command });
        }
        answer
    }

    /// The client has disconnected: what it has asked for already is still done.
    pub fn end(mut self) {
        tokio::spawn(async move {
            while !(self.waiting.is_empty() && self.filming.is_empty()) {
                self.answered().await;
            }
        });
    }
}
