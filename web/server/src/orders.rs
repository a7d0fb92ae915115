//! The commands of one page or program on their way, and the bodies that it holds.

use std::collections::BTreeSet;

use coordinator::live::{BodyId, Command, Follower, Outcome, Refusal};
use futures::StreamExt as _;
use futures::future::BoxFuture;
use futures::stream::FuturesOrdered;

use crate::commands::Request;
use crate::text;

/// Commands of one client that wait for the loop, at most.
const MAX_ORDERS: usize = 64;

/// What a command changes about the bodies that its client holds, once it is done.
#[derive(Clone, Copy)]
enum Hold {
    Grab(BodyId),
    Release(BodyId),
}

type Order = BoxFuture<'static, (u64, Option<Hold>, Result<Outcome, Refusal>)>;

pub(crate) struct Orders {
    follower: Follower,
    /// How to get the right to steer, if the client has not.
    refusal: Option<&'static str>,
    /// In their order: a release must not overtake its grab.
    waiting: FuturesOrdered<Order>,
    held: BTreeSet<BodyId>,
}

impl Orders {
    pub fn new(follower: Follower, refusal: Option<&'static str>) -> Orders {
        Orders { follower, refusal, waiting: FuturesOrdered::new(), held: BTreeSet::new() }
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
            Ok(command) => command,
            Err(why) => return refused(&why.to_string()),
        };
        let hold = match command {
            Command::Grab { body, .. } => Some(Hold::Grab(body)),
            Command::Release { body, .. } | Command::Remove(body) => Some(Hold::Release(body)),
            _ => None,
        };
        let follower = self.follower.clone();
        self.waiting.push_back(Box::pin(async move { (id, hold, follower.order(command).await) }));
        None
    }

    /// The next answer; pending for ever if no command waits.
    pub async fn answered(&mut self) -> String {
        let Some((id, hold, answer)) = self.waiting.next().await else { return std::future::pending().await };
        match (&answer, hold) {
            (Ok(_), Some(Hold::Grab(body))) => drop(self.held.insert(body)),
            (Ok(_), Some(Hold::Release(body))) => drop(self.held.remove(&body)),
            _ => {}
        }
        match answer {
            Ok(done) => text::done(id, done),
            Err(why) => text::refused(Some(id), &why.to_string()),
        }
    }

    /// Another world has begun: its bodies are others.
    pub fn forget_held(&mut self) {
        self.held.clear();
    }

    /// The client has disconnected: releases what it holds, and what it was about to hold.
    pub fn end(mut self) {
        tokio::spawn(async move {
            while !self.waiting.is_empty() {
                self.answered().await;
            }
            for body in self.held {
                // A body that is gone needs no release.
                let _ = self.follower.order(Command::Release { body, velocity_m_s: None }).await;
            }
        });
    }
}
