//! Our own types as messages and back. A file is not trusted: what comes back is checked.

mod command;
mod contacts;
mod header;
mod numbers;
mod world;

pub(crate) use command::{command_from_message, command_to_message};
pub(crate) use contacts::{contacts_from_bytes, contacts_to_bytes};
pub use header::RunHeader;
pub(crate) use numbers::{SEGMENT_MS, UNIX_S, within};
pub(crate) use world::{bodies, patches, scene, touches};
