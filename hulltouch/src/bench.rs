//! `hulltouch bench`.

use clap::Args;

use crate::failure::Outcome;

/// To be written.
#[derive(Debug, Args)]
pub struct BenchArguments {}

/// Runs it.
pub fn run(_: &BenchArguments) -> Outcome {
    Ok(())
}
