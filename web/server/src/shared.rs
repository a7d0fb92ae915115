//! What every part of the server shares.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use coordinator::live::{Command, Follower};
use tokio::sync::watch;

use crate::http::{Access, Connection, Guesses};
use crate::message_cache::MessageCache;
use crate::run_info::{RunInfo, Volume};

/// What every part of the server shares.
pub(crate) struct Shared {
    pub info: RunInfo,
    /// The info's own; finding it takes a while.
    pub volume: Volume,
    pub follower: Follower,
    /// See [`FeedSettings`](crate::FeedSettings).
    pub begins_for_first_page: bool,
    pub messages: MessageCache,
    pub access: Access,
    pub guesses: Guesses,
    /// New with every start of a server: a page that connects again notices another run.
    pub session: String,
    /// How many pages are connected.
    pub pages: Seats,
    /// How many programs follow, over JSON or gRPC.
    pub programs: Seats,
    /// True once the server ends.
    pub ending: watch::Receiver<bool>,
}

impl Shared {
    /// A page has come: of a run that none has steered yet it sees the scene from its start.
    pub fn page_came(&self) {
        if self.begins_for_first_page && self.follower.is_first_to_steer() {
            let follower = self.follower.clone();
            // A run that ends meanwhile begins nothing.
            tokio::spawn(async move { drop(follower.order(Command::Reset).await) });
        }
    }

    /// Whether a peer may steer that offers a token over this connection, or none. Of a machine that guesses tokens they are
    /// judged late, but over connections that have shown the right one.
    pub async fn may_steer(&self, connection: &Connection, token: Option<&str>) -> bool {
        let from = connection.from();
        if token.is_none() || !(connection.has_shown_token() || self.guesses.turn(from).await) {
            return false;
        }
        let may_steer = self.access.may_steer(token);
        connection.shows_token(may_steer);
        if !may_steer {
            self.guesses.wrong(from);
        }
        may_steer
    }
}

/// Pages at once, and programs at once: a hundred megabits a second carry seven pages at full rate, and each program has
/// states of its own encoded.
const MAX_SEATS: usize = 64;
/// Of them, those that only holders of the token get.
const KEPT_SEATS: usize = 8;

/// Places for a bounded number of sockets, some of them for holders of the token alone.
#[derive(Clone, Debug, Default)]
pub(crate) struct Seats(Arc<AtomicUsize>);

/// One of them, given back when dropped.
#[derive(Debug)]
pub(crate) struct Seat(Seats);

impl Seats {
    /// A seat, if one is free for a peer with or without the token.
    pub fn take(&self, has_token: bool) -> Option<Seat> {
        let before = self.0.fetch_add(1, Ordering::AcqRel);
        let seat = Seat(self.clone());
        (before < Seats::open_to(has_token)).then_some(seat)
    }

    /// How many seats may be taken when a peer with or without the token comes.
    pub fn open_to(has_token: bool) -> usize {
        if has_token { MAX_SEATS } else { MAX_SEATS - KEPT_SEATS }
    }

    /// How many are taken.
    pub fn taken(&self) -> usize {
        self.0.load(Ordering::Relaxed)
    }
}

impl Drop for Seat {
    fn drop(&mut self) {
        self.0.0.fetch_sub(1, Ordering::AcqRel);
    }
}
