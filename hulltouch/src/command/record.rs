//! `hulltouch record`, and recording in other runs.

use std::path::PathBuf;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use clap::Args;
use coordinator::Asks;
use proto::convert::Precision;
use recording::{ColourSource, Overwrites, RecordingFile, RunHeader, RunRecorder, WriteError};
use sim::WorldSettings;

use crate::command::coordinator::checked_seconds;
use crate::command::demo::StudioArguments;
use crate::run::outlets::Outlets;
use crate::run::{AskName, Setup, TransportName, run_deployed, run_locally};
use cli::{Failure, Outcome};
use cluster::node_config;

/// How long deployed nodes are waited for.
const CONNECT_PATIENCE: Duration = Duration::from_secs(60);

/// Record a run: silhouettes, steps and bodies in an MCAP file, for `hulltouch replay` and other tools.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  hulltouch record out.mcap --seconds 10\n  \
    hulltouch record out.mcap --cluster studio.cluster.toml --seconds 60")]
pub struct RecordArguments {
    /// The file to write.
    file: PathBuf,
    /// The cluster file: its nodes if it names where they are, else all of it on this machine [default: the
    /// synthetic studio].
    #[arg(long = "cluster", value_name = "CLUSTER.toml")]
    recording: Option<PathBuf>,
    #[command(flatten)]
    studio: StudioArguments,
    /// End after so many seconds of film [default: when film ends, or on Ctrl-C].
    #[arg(long, value_name = "S")]
    seconds: Option<f64>,
    /// Use every frame, as fast as frames can be made, instead of real time.
    #[arg(long)]
    unpaced: bool,
    /// Keep the colours around the foreground, too.
    #[arg(long)]
    colour: bool,
    /// Replace the file if it is there.
    #[arg(long)]
    force: bool,
    /// Write the run's figures.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// Recording beside whatever else a run does.
#[derive(Debug, Args)]
pub struct RecordOptions {
    /// Record the run in an MCAP file, for `hulltouch replay` and other tools.
    #[arg(long, value_name = "FILE")]
    record: Option<PathBuf>,
    /// Keep the colours around the foreground, too.
    #[arg(long = "record-colour", requires = "record")]
    colour: bool,
    /// Replace the file of --record if it is there.
    #[arg(long, requires = "record")]
    force: bool,
}

/// Where a run is recorded.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RecordTo {
    /// The file.
    pub path: PathBuf,
    /// Whether it may take the place of another.
    pub overwrites: Overwrites,
    /// With colours.
    pub colour: bool,
}

impl RecordTo {
    fn checked(path: PathBuf, force: bool, colour: bool) -> Outcome<RecordTo> {
        if path.exists() && !force {
            return Err(Failure::input(WriteError::Exists(path)));
        }
        let overwrites = if force { Overwrites::AtTheEnd } else { Overwrites::Never };
        Ok(RecordTo { path, overwrites, colour })
    }
}

impl RecordOptions {
    /// Says now what would fail later.
    pub fn checked(&self) -> Outcome<Option<RecordTo>> {
        self.record.clone().map(|path| RecordTo::checked(path, self.force, self.colour)).transpose()
    }
}

/// Runs until film or time ends, or Ctrl-C.
pub fn run(arguments: RecordArguments) -> Outcome {
    let record = RecordTo::checked(arguments.file, arguments.force, arguments.colour)?;
    let studio = tempfile::tempdir().map_err(Failure::run)?;
    let (file, scene) = match &arguments.recording {
        Some(path) => arguments.studio.cluster(path)?,
        None => arguments.studio.synthetic(studio.path())?,
    };
    let is_deployed = file.cameras.iter().all(|camera| camera.node.is_some());
    let setup = Setup {
        seed: arguments.studio.seed.or(file.seed).unwrap_or(1),
        file,
        scene,
        transport: TransportName::Cluster,
        ask: AskName::default(),
        lock_step: arguments.unpaced,
        empty: false,
        seconds: checked_seconds(arguments.seconds)?,
        live_line: true,
        outlets: Outlets::default(),
        json: arguments.json,
        snapshots: None,
        record: Some(record),
    };
    if is_deployed { run_deployed(&setup, CONNECT_PATIENCE) } else { run_locally(&setup) }
}

/// Begins the recording of a run.
pub fn begin(
    setup: &Setup,
    to: &RecordTo,
    world: WorldSettings,
    colours: Option<ColourSource>,
) -> Outcome<(RunRecorder, RecordingFile)> {
    let all: Vec<usize> = (0..setup.file.cameras.len()).collect();
    let cameras = node_config(&setup.file, &all, false)?.cameras;
    let header = RunHeader {
        program: env!("CARGO_PKG_VERSION").to_owned(),
        began_unix_s: SystemTime::now().duration_since(UNIX_EPOCH).map_or(0.0, |since| since.as_secs_f64()),
        rig: setup.file.rig.clone(),
        ignored: cameras.into_iter().map(|camera| camera.ignored).collect(),
        fps: setup.file.fps,
        latency_s: setup.file.latency_s,
        hold_s: setup.file.hold_s,
        probes: setup.file.probes,
        scene: setup.scene.clone(),
        world,
        // Only questions to nodes are ever rounded.
        precision: match setup.transport {
            TransportName::Cluster => setup.file.precision,
            TransportName::Gather | TransportName::Inprocess => Precision::Exact,
        },
        asks: match setup.ask {
            AskName::Frame => Asks::EachFrame,
            AskName::Step => Asks::EachStep,
        },
        transport: setup.transport.name().to_owned(),
        lock_step: setup.lock_step,
    };
    recording::record(&to.path, to.overwrites, &header, colours).map_err(failure)
}

/// A recording that failed.
pub fn failure(error: WriteError) -> Failure {
    match error {
        WriteError::Exists(_) => Failure::input(error),
        WriteError::Unwritable { .. } => Failure::run(error),
    }
}
