//! `hulltouch query`.

use clap::Args;

use crate::failure::Outcome;

/// To be written.
#[derive(Debug, Args)]
pub struct QueryArguments {}

/// Runs it.
pub fn run(_: &QueryArguments) -> Outcome {
    Ok(())
}
