//! What is decided. Nothing here waits, reads a clock or talks to a network; time is an argument.

pub(crate) mod answering;
pub(crate) mod ask_policy;
pub(crate) mod budget;
pub(crate) mod choice;
pub(crate) mod clock;
pub(crate) mod command;
pub(crate) mod holds;
pub(crate) mod latency;
pub(crate) mod playback;
pub mod query;
#[cfg(test)]
pub(crate) mod room;
pub mod roster;
pub(crate) mod round_trips;
pub(crate) mod run;
