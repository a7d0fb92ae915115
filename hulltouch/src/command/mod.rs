//! One module a subcommand.

pub mod certs;
pub mod coordinator;
pub mod demo;
pub mod doctor;
pub mod node;
pub mod query;
pub mod ready;
pub mod record;
pub mod replay;
pub mod rig;
pub mod sample;
pub mod status;
pub mod sync;
