//! The port: who may use it, its connections, and the page's files.

mod access;
mod connection;
mod files;
mod guesses;
mod linger;
mod listener;
mod progress;
mod refusals;

use net::admission::Policy;

pub(crate) use access::{Access, bearer_token, random_hex};
pub use access::{Origin, OriginError, RandomError, Token, TokenError};
pub(crate) use connection::Connection;
pub(crate) use files::routes;
pub(crate) use guesses::Guesses;
pub(crate) use listener::Port;
pub(crate) use progress::BytesSent;

/// Connections whose first request has not come, of all peers together.
const MAX_BEGINNING: usize = 64;
/// Connections that have asked something and do not stay: a page opens six, and browsers leave some of them silent.
const MAX_PASSING: usize = 64;
const POLICY: Policy = Policy { beginning: MAX_BEGINNING, passing: Some(MAX_PASSING) };
