//! `hulltouch demo`: a whole cluster on this machine.

use std::path::{Path, PathBuf};

use clap::Args;
use hull::Rig;
use proto::convert::Precision;
use setup::ClusterFile;
use setup::cli::{Failure, NamedValue, Outcome, PRECISIONS, named, parse_size, temporary_folder};
use sim::{Scene, StageHint};
use stage::{Motion, Prop, studio_rig};

use crate::run::options::{OutletArguments, RecordOptions};
use crate::run::run_locally;
use crate::run::run_setup::{ResponseArguments, Setup, TransportName, checked_seconds, world_settings};
use crate::run::security::ConsentArguments;
use coordinator::{AskEvery, MemoryUse};
use node_client::Role;

/// How long the empty room of a recording is filmed without --seconds.
const EMPTY_RECORDING_S: f64 = 4.0;
/// Cameras of the studio: as many as one node may describe.
const MAX_CAMERAS: usize = 1024;
/// Processes that film; more cameras share them.
const MAX_NODES: usize = 64;
/// How often the hull is asked.
const ASKS: [NamedValue<AskEvery>; 2] = [
    (
        "frame",
        AskEvery::Frame,
        "Once a film frame where that is enough: fewer questions, and with the paper's response the same run",
    ),
    ("step", AskEvery::Step, "At every physics step, about every body: to measure the other against"),
];

/// A whole cluster on this machine: camera nodes as processes, coordinator, physics.
#[derive(Debug, Args)]
#[command(after_help = "\
    Examples:\n  \
    hulltouch demo\n  \
    hulltouch demo --scene crowd --seconds 10 --snapshot pics\n  \
    hulltouch demo --recording deploy/uu_horseman.cluster.toml --unpaced --headless --json out.json")]
pub struct DemoArguments {
    #[command(flatten)]
    studio: StudioArguments,
    /// End after so many seconds of film [default: on Ctrl-C, or when a recording ends].
    #[arg(long, value_name = "S")]
    seconds: Option<f64>,
    #[command(flatten)]
    outlets: OutletArguments,
    #[command(flatten)]
    consent: ConsentArguments,
    /// Use every frame, as fast as frames can be made: two runs of one seed are the same run.
    #[arg(long)]
    unpaced: bool,
    /// Where probes are computed.
    #[arg(long, value_enum, default_value = "auto")]
    transport: TransportName,
    /// How often the hull is asked; the run is the same.
    #[arg(long, value_parser = named(ASKS), default_value = "frame")]
    ask: AskEvery,
    /// How numbers travel to and from the nodes [default: exact, or the recording's].
    #[arg(long, value_parser = named(PRECISIONS))]
    precision: Option<Precision>,
    #[command(flatten)]
    response: ResponseArguments,
    /// Play a cluster file (rig, a source for each camera, background, scene) instead of the studio. It runs programs: each
    /// `command` in it is started as this user.
    #[arg(long, value_name = "CLUSTER.toml")]
    recording: Option<PathBuf>,
    /// The same scene without the person.
    #[arg(long)]
    empty: bool,
    #[command(flatten)]
    record: RecordOptions,
}

/// The synthetic studio, and what decides a run in it.
#[derive(Debug, Args)]
pub struct StudioArguments {
    /// A scene by name (topple, lift, crowd, rest, tray, push, punch, drops, squeeze) or a scene file [default: topple, or the cluster file's].
    #[arg(long, value_name = "NAME|FILE")]
    scene: Option<String>,
    /// How many cameras the studio has.
    #[arg(long, default_value_t = 8, conflicts_with = "recording")]
    cameras: usize,
    /// The size of their images.
    #[arg(long, default_value = "640x480", value_name = "WxH", value_parser = parse_size, conflicts_with = "recording")]
    size: (u32, u32),
    /// Frames per second.
    #[arg(long, default_value_t = 30.0, value_name = "F", conflicts_with = "recording")]
    fps: f64,
    /// Decides what a run leaves to chance [default: 1, or the cluster file's].
    #[arg(long, value_name = "K")]
    pub seed: Option<u64>,
}

/// Runs until film or time ends, or Ctrl-C.
pub fn run(arguments: &DemoArguments) -> Outcome {
    let response = arguments.response.checked()?;
    let seconds = checked_seconds(arguments.seconds)?;
    let security = arguments.consent.checked();
    let mut outlets = arguments.outlets.checked(&security)?;
    if let Some(page) = &mut outlets.page {
        // Two runs that use every frame are the same run, looked at or not.
        page.feed.begins_for_first_page = !arguments.unpaced;
    }
    let record = arguments.record.checked()?;
    if cfg!(debug_assertions) {
        tracing::warn!("this is a debug build and slow: build with --release, or run `cargo demo`");
    }
    let studio = temporary_folder()?;
    let (mut file, scene) = match &arguments.recording {
        Some(path) => arguments.studio.cluster(path)?,
        None => arguments.studio.synthetic(studio.path())?,
    };
    if arguments.empty && arguments.recording.is_some() {
        // A background clip may be a single plate: it is held for as long as the run is to last.
        file.hold_s = arguments.seconds.unwrap_or(EMPTY_RECORDING_S);
    }
    if let Some(precision) = arguments.precision {
        file.precision = precision;
    }
    let setup = Setup {
        world: world_settings(&scene, arguments.studio.seed.or(file.seed).unwrap_or(1), response),
        file,
        scene,
        transport: arguments.transport,
        asks: arguments.ask,
        lock_step: arguments.unpaced,
        role: Role::Leads,
        dial: security.dial,
        empty: arguments.empty,
        seconds,
        outlets,
        record,
        memory: MemoryUse::Off,
    };
    run_locally(&setup)
}

impl StudioArguments {
    /// A cluster file and its scene, or another one.
    pub fn cluster(&self, path: &Path) -> Outcome<(ClusterFile, Scene)> {
        let file = ClusterFile::open(path)?;
        let scene = match &self.scene {
            Some(scene) => load_scene(scene)?,
            None => file.load_scene().map_err(Failure::input)?,
        };
        Ok((file, scene))
    }

    /// Writes the studio's cluster file into a folder of its own, for the node processes to read.
    pub fn synthetic(&self, folder: &Path) -> Outcome<(ClusterFile, Scene)> {
        let scene = load_scene(self.scene.as_deref().unwrap_or("topple"))?;
        if !(1..=MAX_CAMERAS).contains(&self.cameras) {
            let found = self.cameras;
            return Err(Failure::input(format_args!("--cameras is {found}, expected 1 to {MAX_CAMERAS}")));
        }
        if !(self.fps >= 1.0 && self.fps <= 1000.0) {
            return Err(Failure::input(format_args!("--fps is {}, expected 1 to 1000", self.fps)));
        }
        let rig = studio_rig(self.cameras, self.size)
            .map_err(|error| Failure::input(format_args!("--size: {error}")))?;
        let stage = scene.stage().cloned().unwrap_or_default();
        let motion: Motion = if stage.motion.is_empty() {
            Motion::default()
        } else {
            stage
                .motion
                .parse()
                .map_err(|error| Failure::input(format_args!("scene, stage.motion: {error}")))?
        };
        for prop in &stage.props {
            prop.parse::<Prop>()
                .map_err(|error| Failure::input(format_args!("scene, stage.props: {error}")))?;
        }
        let path = folder.join("studio.cluster.toml");
        let text = self.cluster_text(&rig, motion, &stage);
        std::fs::write(folder.join("rig.toml"), rig.to_toml())
            .map_err(|error| Failure::unwritable(folder, error))?;
        std::fs::write(&path, text).map_err(|error| Failure::unwritable(&path, error))?;
        Ok((ClusterFile::open(&path)?, scene))
    }

    /// The studio's cluster file, beside `rig.toml`.
    fn cluster_text(&self, rig: &Rig, motion: Motion, stage: &StageHint) -> String {
        let (fps, min_views, seed) = (self.fps, self.cameras.min(2), self.seed.unwrap_or(1));
        let StageHint { props, person, .. } = stage;
        let mut text =
            format!("rig = \"rig.toml\"\nscene = \"topple\"\nfps = {fps:?}\nmin_views = {min_views}\n");
        let nodes = self.cameras.min(MAX_NODES);
        for (index, camera) in rig.cameras().iter().enumerate() {
            let name = camera.name();
            text += &format!("[[camera]]\nname = {name:?}\n");
            if self.cameras > MAX_NODES {
                // Cameras of one address share a process, which finds a port of its own.
                text += &format!("node = \"node{}.invalid:7001\"\n", index * nodes / self.cameras);
            }
            text += &format!(
                "source = {{ kind = \"stage\", motion = \"{motion}\", \
                 props = {props:?}, person = {person}, seed = {seed} }}\n"
            );
        }
        text
    }
}

/// A scene by name, or from a file.
fn load_scene(name: &str) -> Outcome<Scene> {
    let path = Path::new(name);
    if path.extension().is_none_or(|extension| extension != "toml") {
        return Scene::named(name).map_err(|error| Failure::input(format_args!("--scene: {error}")));
    }
    let text = setup::read_text(path).map_err(|error| Failure::unreadable(path, error))?;
    let name = path.file_stem().unwrap_or_default().to_string_lossy();
    Scene::from_toml(&name, &text).map_err(|error| Failure::unreadable(path, error))
}
