//! The page's socket: what a page gets, and when.

mod frames;
pub(crate) mod incoming;
mod link;
mod outbox;
mod socket;
mod state;

pub(crate) use socket::routes;

use std::time::Duration;

/// A page whose socket takes nothing for so long, or that does not answer a ping, is dropped.
const WRITE_TIMEOUT: Duration = Duration::from_secs(5);
/// How often a page's link is judged and its status sent.
const STATUS_EVERY: Duration = Duration::from_millis(250);
