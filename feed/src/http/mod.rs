//! The port: who may use it, its connections, and the page's files.

mod access;
mod connection;
mod files;
mod listener;
mod refusals;
mod registry;

pub(crate) use access::{Access, random_hex};
pub use access::{Origin, OriginError, RandomError, Token, TokenError};
pub(crate) use connection::{BytesSent, Connection};
pub(crate) use files::routes;
pub(crate) use listener::Port;
