//! What every part of the server shares.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use coordinator::live::Follower;
use tokio::sync::watch;

use crate::http::Access;
use crate::message_cache::MessageCache;
use crate::run_info::{RunInfo, Volume};

/// What every part of the server shares.
pub(crate) struct Shared {
    pub info: RunInfo,
    /// The info's own; finding it takes a while.
    pub volume: Volume,
    pub follower: Follower,
    pub messages: MessageCache,
    pub access: Access,
    /// New with every start of a server: a page that connects again notices another run.
    pub session: String,
    /// How many pages are connected.
    pub pages: Arc<AtomicUsize>,
    /// How many programs follow, over JSON or gRPC.
    pub programs: Arc<AtomicUsize>,
    /// True once the server ends.
    pub ending: watch::Receiver<bool>,
}

/// One of a bounded number of connections, given back when dropped.
pub(crate) struct Seat(Arc<AtomicUsize>);

impl Seat {
    /// A seat, if one is free.
    pub fn take(taken: &Arc<AtomicUsize>, most: usize) -> Option<Seat> {
        let before = taken.fetch_add(1, Ordering::AcqRel);
        let seat = Seat(Arc::clone(taken));
        (before < most).then_some(seat)
    }
}

impl Drop for Seat {
    fn drop(&mut self) {
        self.0.fetch_sub(1, Ordering::AcqRel);
    }
}
