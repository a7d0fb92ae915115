//! What one page asks of the run, and what it holds on to.

use std::collections::BTreeSet;

use coordinator::live::{BodyId, Command, Done, Follower, Refused};
use futures::StreamExt as _;
use futures::future::BoxFuture;
use futures::stream::FuturesOrdered;

use crate::commands::Request;
use crate::text;

/// Commands of one page that wait for the loop.
const MAX_ORDERS: usize = 64;

/// What a command that is done changes about who holds what.
#[derive(Clone, Copy)]
enum Hold {
    Takes(BodyId),
    Leaves(BodyId),
}

type Order = BoxFuture<'static, (u64, Option<Hold>, Result<Done, Refused>)>;

pub(crate) struct Orders {
    follower: Follower,
    is_controller: bool,
    /// In their order: a release must not overtake its grab.
    waiting: FuturesOrdered<Order>,
    held: BTreeSet<BodyId>,
}

impl Orders {
    pub fn new(follower: Follower, is_controller: bool) -> Orders {
        Orders { follower, is_controller, waiting: FuturesOrdered::new(), held: BTreeSet::new() }
    }

    /// Passes a command on to the run; what refuses it at once is the answer.
    pub fn take(&mut self, Request { id, command }: Request) -> Option<String> {
        let refused = |why: &str| Some(text::refused(id, why));
        if !self.is_controller {
            return refused("a viewer cannot steer: open the page with its token");
        }
        if self.waiting.len() >= MAX_ORDERS {
            return refused(&format!("{MAX_ORDERS} commands wait, expected fewer"));
        }
        let command = match command {
            Ok(command) => command,
            Err(why) => return refused(&why),
        };
        let hold = match command {
            Command::Grab { body, .. } => Some(Hold::Takes(body)),
            Command::Release { body, .. } => Some(Hold::Leaves(body)),
            _ => None,
        };
        let follower = self.follower.clone();
        self.waiting.push_back(Box::pin(async move { (id, hold, follower.order(command).await) }));
        None
    }

    /// Waits for the next answer; for ever if nothing was asked.
    pub async fn answered(&mut self) -> String {
        let Some((id, hold, answer)) = self.waiting.next().await else { return std::future::pending().await };
        match (&answer, hold) {
            (Ok(_), Some(Hold::Takes(body))) => drop(self.held.insert(body)),
            (Ok(_), Some(Hold::Leaves(body))) => drop(self.held.remove(&body)),
            _ => {}
        }
        match answer {
            Ok(done) => text::done(id, done),
            Err(Refused(why)) => text::refused(id, &why),
        }
    }

    /// Another world has begun: what was held is no more.
    pub fn forget_held(&mut self) {
        self.held.clear();
    }

    /// The page has gone: what it held falls, and what it was about to hold.
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
