//! The port: who may use it, its connections, and the page's files.

mod access;
mod connection;
mod files;
mod guesses;
mod linger;
mod listener;
mod progress;
mod refusals;
mod registry;

pub(crate) use access::{Access, bearer_token, random_hex};
pub use access::{Origin, OriginError, RandomError, Token, TokenError};
pub(crate) use connection::Connection;
pub(crate) use files::routes;
pub(crate) use guesses::Guesses;
pub(crate) use listener::Port;
pub(crate) use progress::BytesSent;
