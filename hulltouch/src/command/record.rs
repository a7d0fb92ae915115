//! `hulltouch record`.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use clap::Args;
use coordinator::{AskEvery, MemoryUse};
use node_client::{Role, Sockets};
use setup::cli::{Outcome, temporary_folder};

use crate::command::demo::StudioArguments;
use crate::run::options::{Outlets, RecordTo};
use crate::run::run_setup::{ResponseArguments, Setup, TransportName, checked_seconds, world_settings};
use crate::run::security::SecurityArguments;
use crate::run::{run_deployed, run_locally};

/// How long deployed nodes may take to connect.
const CONNECT_TIMEOUT: Duration = Duration::from_secs(60);

/// Record a run: silhouettes, steps and bodies in an MCAP file, for `hulltouch replay` and other tools.
#[derive(Debug, Args)]
#[command(after_help = "\
    Examples:\n  \
    hulltouch record out.mcap --seconds 10\n  \
    hulltouch record out.mcap --cluster studio.cluster.toml --certs /etc/hulltouch/certs --seconds 60")]
pub struct RecordArguments {
    /// The file to write.
    file: PathBuf,
    /// The cluster file: its nodes if it names where they are, else all of it on this machine [default: the
    /// synthetic studio]. On this machine it runs programs: each `command` in it is started as this user.
    #[arg(long = "cluster", value_name = "CLUSTER.toml")]
    recording: Option<PathBuf>,
    #[command(flatten)]
    studio: StudioArguments,
    /// End after so many seconds of film [default: when film ends, or on Ctrl-C].
    #[arg(long, value_name = "S")]
    seconds: Option<f64>,
    #[command(flatten)]
    response: ResponseArguments,
    /// Use every frame, as fast as frames can be made, instead of real time.
    #[arg(long)]
    unpaced: bool,
    /// Keep the colours around the foreground, too.
    #[arg(long)]
    colour: bool,
    #[command(flatten)]
    security: SecurityArguments,
    /// Replace the file if it is there.
    #[arg(long)]
    force: bool,
    /// Write the run's figures.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// Runs until film or time ends, or Ctrl-C.
pub fn run(arguments: RecordArguments) -> Outcome {
    let record = RecordTo::checked(arguments.file, arguments.force, arguments.colour)?;
    let studio = temporary_folder()?;
    let (file, scene) = match &arguments.recording {
        Some(path) => arguments.studio.cluster(path)?,
        None => arguments.studio.synthetic(studio.path())?,
    };
    let is_deployed = file.is_deployed();
    let dial = if is_deployed { arguments.security.sockets(&file)? } else { Arc::new(Sockets::default()) };
    let setup = Setup {
        world: world_settings(
            &scene,
            arguments.studio.seed.or(file.seed).unwrap_or(1),
            arguments.response.checked()?,
        ),
        file,
        scene,
        transport: TransportName::Auto,
        asks: AskEvery::default(),
        lock_step: arguments.unpaced,
        role: Role::Leads,
        dial,
        empty: false,
        seconds: checked_seconds(arguments.seconds)?,
        outlets: Outlets { live_line: true, json: arguments.json, ..Outlets::default() },
        record: Some(record),
        memory: MemoryUse::Off,
    };
    if is_deployed { run_deployed(&setup, CONNECT_TIMEOUT) } else { run_locally(&setup) }
}
