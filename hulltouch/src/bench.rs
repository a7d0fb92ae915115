//! `hulltouch bench`: the tables of the README.

mod loads;
mod plot;
mod query;
mod table;

use clap::{Args, Subcommand};

use crate::failure::Outcome;

/// Measures how fast this machine is. Use a release build.
#[derive(Debug, Args)]
pub struct BenchArguments {
    #[command(subcommand)]
    command: BenchCommand,
}

#[derive(Debug, Subcommand)]
enum BenchCommand {
    Query(query::QueryBenchArguments),
}

/// Runs it.
pub fn run(arguments: &BenchArguments) -> Outcome {
    if cfg!(debug_assertions) {
        tracing::warn!("this is a debug build: its figures say nothing");
    }
    match &arguments.command {
        BenchCommand::Query(arguments) => query::run(arguments),
    }
}
