//! `hulltouch rig`: calibrations from elsewhere, and whether they fit.

mod check;
mod import;

use clap::{Args, Subcommand};

use setup::cli::Outcome;

/// Imports other programs' calibrations, and checks a rig against silhouettes.
#[derive(Debug, Args)]
pub struct RigArguments {
    #[command(subcommand)]
    command: RigCommand,
}

#[derive(Debug, Subcommand)]
enum RigCommand {
    Import(import::ImportArguments),
    Check(check::CheckArguments),
}

/// Runs it.
pub fn run(arguments: &RigArguments) -> Outcome {
    match &arguments.command {
        RigCommand::Import(arguments) => import::run(arguments),
        RigCommand::Check(arguments) => check::run(arguments),
    }
}
