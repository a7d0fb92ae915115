//! Virtual rigid bodies collide with people on film.
//!
//! One module a subcommand. Exit status 0: done; 1: ran and failed; 2: bad input, with one line that names
//! the file and key, what was found and what was expected; 141: standard output was closed.

mod command;
mod interrupt;
mod picture;
mod run;

use std::io::IsTerminal as _;
use std::process::ExitCode;

use clap::{Parser, Subcommand};

use setup::cli::{Failure, Outcome};

use crate::command::{
    certs, coordinator, demo, doctor, node, query, ready, record, replay, rig, sample, status, sync,
};

/// Virtual rigid bodies collide with people on film.
#[derive(Debug, Parser)]
#[command(name = "hulltouch", version, max_term_width = 100)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    Demo(demo::DemoArguments),
    Sample(sample::SampleArguments),
    Node(node::NodeArguments),
    Coordinator(coordinator::CoordinatorArguments),
    Record(record::RecordArguments),
    Replay(replay::ReplayArguments),
    Rig(rig::RigArguments),
    Certs(certs::CertsArguments),
    Doctor(doctor::DoctorArguments),
    Status(status::StatusArguments),
    Sync(sync::SyncArguments),
    Query(query::QueryArguments),
    Ready(ready::ReadyArguments),
}

/// The program, with the arguments of this process.
pub fn main() -> ExitCode {
    let arguments = Arguments::parse();
    run_logged("hulltouch", || match arguments.command {
        Command::Demo(arguments) => demo::run(&arguments),
        Command::Sample(arguments) => sample::run(&arguments),
        Command::Node(arguments) => node::run(&arguments),
        Command::Coordinator(arguments) => coordinator::run(&arguments),
        Command::Record(arguments) => record::run(arguments),
        Command::Replay(arguments) => replay::run(&arguments),
        Command::Certs(arguments) => certs::run(&arguments),
        Command::Rig(arguments) => rig::run(&arguments),
        Command::Doctor(arguments) => doctor::run(&arguments),
        Command::Status(arguments) => status::run(&arguments),
        Command::Sync(arguments) => sync::run(&arguments),
        Command::Query(arguments) => query::run(&arguments),
        Command::Ready(arguments) => ready::run(&arguments),
    })
}

/// Does the work of a program of this name: its logs and its failure, in one line, go to standard error.
pub fn run_logged(name: &str, work: impl FnOnce() -> Outcome) -> ExitCode {
    log_to_stderr();
    match work() {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure @ Failure::Closed) => failure.exit_code(),
        Err(failure) => {
            use std::io::Write as _;
            // A closed standard error is no reason to fail differently.
            let _ = writeln!(std::io::stderr(), "{name}: {failure}");
            failure.exit_code()
        }
    }
}

/// Logs go to standard error; `RUST_LOG` chooses, warnings by default. What HTTP/2 says of untrusted peers is logged by our own code.
fn log_to_stderr() {
    use tracing_subscriber::filter::{LevelFilter, Targets};
    use tracing_subscriber::layer::SubscriberExt as _;
    use tracing_subscriber::util::SubscriberInitExt as _;
    let warnings = || Targets::new().with_default(LevelFilter::WARN).with_target("h2", LevelFilter::ERROR);
    let filter = std::env::var("RUST_LOG").ok().and_then(|text| text.parse().ok()).unwrap_or_else(warnings);
    let lines = tracing_subscriber::fmt::layer()
        .with_writer(std::io::stderr)
        .with_ansi(std::io::stderr().is_terminal())
        .with_target(false)
        .without_time()
        // It would print them to standard error, and panic where that is closed.
        .log_internal_errors(false);
    tracing_subscriber::registry().with(filter).with(lines).init();
}
