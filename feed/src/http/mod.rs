//! The port: who may use it, its connections, and the page's files.

mod access;
mod connection;
mod files;

pub(crate) use access::{Access, random_hex};
pub use access::{Origin, OriginError, RandomError, Token, TokenError};
pub(crate) use connection::{BytesSent, CountingListener};
pub(crate) use files::routes;
