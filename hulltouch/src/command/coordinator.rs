//! `hulltouch coordinator`: asks the nodes of a cluster file and steps the world.

use std::path::PathBuf;
use std::time::Duration;

use clap::Args;
use setup::ClusterFile;
use setup::cli::{Failure, Outcome};

use crate::run::options::{OutletArguments, Outlets, RecordOptions};
use crate::run::run_deployed;
use crate::run::run_setup::{ResponseArguments, Setup, TransportName, checked_seconds, world_settings};
use crate::run::security::SecurityArguments;
use coordinator::{AskEvery, MemoryUse};
use node_client::Role;

/// Ask the nodes of a cluster file, merge their answers and step the world.
#[derive(Debug, Args)]
#[command(after_help = "\
    Example, with nodes running on the camera PCs:\n  \
    hulltouch coordinator studio.cluster.toml --certs /etc/hulltouch/certs --json figures.json\n\n\
    Another, on another screen:\n  \
    hulltouch coordinator studio.cluster.toml --certs /etc/hulltouch/certs --observe")]
pub struct CoordinatorArguments {
    /// The cluster file.
    cluster: PathBuf,
    /// End after so many seconds of film [default: when film ends, or on Ctrl-C].
    #[arg(long, value_name = "S")]
    seconds: Option<f64>,
    /// Where probes are computed.
    #[arg(long, value_enum, default_value = "auto")]
    transport: TransportName,
    #[command(flatten)]
    response: ResponseArguments,
    /// Decides what a run leaves to chance [default: the cluster file's, or 1].
    #[arg(long)]
    seed: Option<u64>,
    /// Use every frame, as fast as nodes make them, instead of real time.
    #[arg(long)]
    unpaced: bool,
    /// Displace another coordinator that leads the nodes.
    #[arg(long)]
    take_over: bool,
    /// Show the run of the coordinator that leads the nodes, and change nothing: cameras as they film, bodies as the nodes
    /// remember them, once a second.
    #[arg(long, conflicts_with_all = ["take_over", "fresh", "unpaced", "record", "json", "snapshot", "seed", "transport"])]
    observe: bool,
    /// Begin with the scene, whatever world the nodes remember of an earlier run.
    #[arg(long)]
    fresh: bool,
    /// How long to wait for all nodes at the beginning, and then for their first frame, seconds. A live run then begins
    /// without those that are away, if min_cameras are there. One that is restarted within five minutes waits 2 s for them.
    #[arg(long, value_name = "S", default_value_t = 60.0)]
    patience: f64,
    #[command(flatten)]
    security: SecurityArguments,
    #[command(flatten)]
    outlets: OutletArguments,
    #[command(flatten)]
    record: RecordOptions,
}

impl CoordinatorArguments {
    fn role(&self) -> Role {
        match (self.observe, self.take_over) {
            (true, _) => Role::Observes,
            (false, true) => Role::TakesOver,
            (false, false) => Role::Leads,
        }
    }
}

/// Runs until film or time ends.
pub fn run(arguments: &CoordinatorArguments) -> Outcome {
    let response = arguments.response.checked()?;
    if arguments.transport == TransportName::Inprocess {
        return Err(Failure::input("--transport inprocess has no nodes, expected auto, cluster or gather"));
    }
    let connect_timeout = Duration::try_from_secs_f64(arguments.patience)
        .map_err(|error| Failure::input(format_args!("--patience {}: {error}", arguments.patience)))?;
    let file = ClusterFile::open(&arguments.cluster)?;
    let scene = file.load_scene().map_err(Failure::input)?;
    let security = arguments.security.checked(&file)?;
    let outlets = Outlets { silent: arguments.observe, ..arguments.outlets.checked(&security)? };
    let setup = Setup {
        world: world_settings(&scene, arguments.seed.or(file.seed).unwrap_or(1), response),
        file,
        scene,
        transport: arguments.transport,
        asks: AskEvery::default(),
        lock_step: arguments.unpaced,
        role: arguments.role(),
        dial: security.dial,
        empty: false,
        seconds: checked_seconds(arguments.seconds)?,
        outlets,
        record: arguments.record.checked()?,
        memory: if arguments.fresh { MemoryUse::Fresh } else { MemoryUse::GoOn },
    };
    run_deployed(&setup, connect_timeout)
}
