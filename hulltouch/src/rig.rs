//! `hulltouch rig`.

use clap::Args;

use crate::failure::Outcome;

/// To be written.
#[derive(Debug, Args)]
pub struct RigArguments {}

/// Runs it.
pub fn run(_: &RigArguments) -> Outcome {
    Ok(())
}
