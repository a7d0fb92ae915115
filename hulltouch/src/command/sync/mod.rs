//! `hulltouch sync`: the cameras' times.

mod check;
mod film;
mod report;

use clap::{Args, Subcommand};

use setup::cli::Outcome;

/// Finds each camera's time against the others.
#[derive(Debug, Args)]
pub struct SyncArguments {
    #[command(subcommand)]
    command: SyncCommand,
}

#[derive(Debug, Subcommand)]
enum SyncCommand {
    Check(check::SyncCheckArguments),
}

/// Runs it.
pub fn run(arguments: &SyncArguments) -> Outcome {
    match &arguments.command {
        SyncCommand::Check(arguments) => check::run(arguments),
    }
}
