//! A run from a cluster file: what `demo` and `coordinator` share.

pub mod colours;
pub mod outlets;
pub mod report;
mod snapshot;

use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use clap::ValueEnum;
use coordinator::record::{Recorder, Schedule};
use coordinator::{Asks, Coordinator, ExpectedNode, Progress, RunSettings, Snapshot, Transport, Watcher};
use feed::pictures::{NodePictures, Pictures};
use indicatif::{ProgressBar, ProgressStyle};
use proto::Address;
use proto::convert::Precision;
use recording::{ColourSource, RecordingFile};
use serde_json::Value;
use sim::{Scene, World, WorldSettings};

use crate::command::node::interrupted;
use crate::command::record::{self, RecordTo};
use crate::run::colours::colours;
use crate::run::outlets::{Outlets, PageSource};
use crate::run::report::Overlap;
use crate::run::snapshot::Album;
use cli::{Failure, Outcome, check_writable, write_whole};
use cluster::ClusterFile;
use cluster::node_config;
use cluster::{InProcess, LocalCluster, expected_node};

/// Where probes are computed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum TransportName {
    /// At the nodes: questions travel, silhouettes stay.
    Cluster,
    /// Here: silhouettes travel (the paper's layout).
    Gather,
    /// Here, and cameras are filmed here too.
    Inprocess,
}

impl TransportName {
    /// As on the command line.
    pub fn name(self) -> &'static str {
        match self {
            TransportName::Cluster => "cluster",
            TransportName::Gather => "gather",
            TransportName::Inprocess => "inprocess",
        }
    }
}

/// How bodies answer the hull.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum ResponseName {
    /// The paper's: translate, and mirror the velocity.
    Paper,
    /// Contacts for the physics solver.
    Contacts,
}

/// How numbers travel between coordinator and nodes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum PrecisionName {
    /// Every bit: the same run over every transport.
    Exact,
    /// About half the bytes; responses within 0.1 mm but for rays that graze a pixel's corner.
    Quantised,
}

impl From<PrecisionName> for Precision {
    fn from(name: PrecisionName) -> Precision {
        match name {
            PrecisionName::Exact => Precision::Exact,
            PrecisionName::Quantised => Precision::Quantised,
        }
    }
}

/// How often the hull is asked.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum AskName {
    /// Once a film frame where that is enough: the same run, with fewer questions.
    #[default]
    Frame,
    /// At every physics step, about every body: to measure the other against.
    Step,
}

/// Everything a run needs, checked.
pub struct Setup {
    /// Rig, cameras and rules.
    pub file: ClusterFile,
    /// What happens.
    pub scene: Scene,
    /// Decides what is left to chance.
    pub seed: u64,
    /// Where probes are computed.
    pub transport: TransportName,
    /// How often the hull is asked.
    pub ask: AskName,
    /// Every frame, as fast as it can be made.
    pub lock_step: bool,
    /// The scene without the person.
    pub empty: bool,
    /// The run ends after so much film.
    pub seconds: Option<f64>,
    /// A live line of figures on a terminal.
    pub live_line: bool,
    /// Where it can be seen and steered.
    pub outlets: Outlets,
    /// Where figures go.
    pub json: Option<PathBuf>,
    /// Where pictures go.
    pub snapshots: Option<PathBuf>,
    /// Where the run is recorded.
    pub record: Option<RecordTo>,
}

/// What decides a run besides its set-up.
pub struct Course {
    /// The world's settings.
    pub world: WorldSettings,
    /// The whole rig's observers, in rig order.
    pub observers: Vec<Arc<hull::Observer>>,
    /// Who is told of every step.
    pub recorder: Option<Box<dyn Recorder>>,
    /// What the run follows.
    pub schedule: Option<Box<dyn Schedule>>,
    /// The file that the recorder fills.
    pub file: Option<RecordingFile>,
    /// What a page shows of the cameras; without it no page is served.
    pub pictures: Option<PageSource>,
}

/// A run that is over.
pub struct Played {
    /// Its figures.
    pub json: Value,
    /// The same in a few lines.
    pub summary: String,
    /// Why it failed, if it did.
    pub failure: Option<Failure>,
}

/// Refuses what is not there yet.
pub fn check_response(response: ResponseName) -> Outcome {
    if response == ResponseName::Contacts {
        return Err(Failure::input("--response contacts is not in this version, expected paper"));
    }
    Ok(())
}

/// Runs on this machine: nodes as processes, or everything in this one.
pub fn run_locally(setup: &Setup) -> Outcome {
    prepare_outputs(setup)?;
    match setup.transport {
        TransportName::Inprocess => {
            let all: Vec<usize> = (0..setup.file.cameras.len()).collect();
            let config = node_config(&setup.file, &all, setup.empty)?;
            let frames = InProcess::prepare(&config)?;
            let pictures = Arc::new(frames.pictures(&config)?);
            let of_run = Arc::clone(&pictures);
            let colours = record_colours(setup, || of_run);
            let pictures = PageSource::of_cameras(&setup.file, || pictures)?;
            run(setup, |_, _| Transport::in_process(Box::new(frames)), pictures, colours, Duration::ZERO)
        }
        TransportName::Cluster | TransportName::Gather => {
            let cluster = LocalCluster::start(&setup.file, setup.empty)?;
            let nodes = cluster.nodes().to_vec();
            let (pictures, colours) = node_pictures(setup, &nodes)?;
            let transport = |world: &World, gather| connect(setup, nodes, world, gather);
            run(setup, transport, pictures, colours, Duration::from_secs(20))
        }
    }
}

/// Runs against the nodes at the addresses of the cluster file.
pub fn run_deployed(setup: &Setup, patience: Duration) -> Outcome {
    prepare_outputs(setup)?;
    let mut nodes = Vec::new();
    for (address, indices) in setup.file.nodes() {
        let address = address.ok_or_else(|| {
            let (path, name) = (setup.file.path.display(), &setup.file.cameras[indices[0]].name);
            let expected = "expected \"host:port\" or \"unix:/path\"";
            Failure::input(format_args!("{path}, camera {name:?}: no node, {expected}"))
        })?;
        nodes.push(expected_node(&setup.file, address.clone(), &indices));
    }
    let (pictures, colours) = node_pictures(setup, &nodes)?;
    run(setup, |world, gather| connect(setup, nodes, world, gather), pictures, colours, patience)
}

/// Colours for the recording, if it is to have any.
fn record_colours<P: Pictures + 'static>(
    setup: &Setup,
    make: impl FnOnce() -> Arc<P> + Send + 'static,
) -> Option<ColourSource> {
    setup.record.as_ref().filter(|to| to.colour).map(|_| colours(make))
}

/// Asks the nodes themselves, over connections of the page's and of the recording's own.
fn node_pictures(setup: &Setup, nodes: &[ExpectedNode]) -> Outcome<(PageSource, Option<ColourSource>)> {
    let cameras = |node: &ExpectedNode| node.cameras.iter().map(|camera| camera.rig_index).collect();
    let nodes: Vec<(Address, Vec<u16>)> =
        nodes.iter().map(|node| (node.address.clone(), cameras(node))).collect();
    let of_run = nodes.clone();
    let colours = record_colours(setup, || Arc::new(NodePictures::new(of_run)));
    Ok((PageSource::of_cameras(&setup.file, || Arc::new(NodePictures::new(nodes)))?, colours))
}

/// Says now what would fail at the end.
pub fn prepare_outputs(setup: &Setup) -> Outcome {
    if let Some(json) = &setup.json {
        check_writable("--json", json)?;
    }
    if let Some(folder) = &setup.snapshots {
        std::fs::create_dir_all(folder)
            .map_err(|error| Failure::input(format_args!("--snapshot {}: {error}", folder.display())))?;
    }
    Ok(())
}

fn connect(
    setup: &Setup,
    nodes: Vec<ExpectedNode>,
    world: &World,
    gather: Option<Vec<Arc<hull::Observer>>>,
) -> Transport {
    let mut shapes: Vec<Arc<hull::Shape>> =
        world.moving_bodies().map(|body| Arc::clone(&body.shape)).collect();
    shapes.sort_by_key(|shape| shape.digest());
    shapes.dedup_by_key(|shape| shape.digest());
    Transport::connect(nodes, gather, setup.file.probes, setup.file.fps, shapes)
        .with_precision(setup.file.precision)
}

/// The whole rig's observers; refuses a rule that no point could ever meet.
fn observers(setup: &Setup) -> Outcome<Vec<Arc<hull::Observer>>> {
    let all: Vec<usize> = (0..setup.file.cameras.len()).collect();
    let min_views = setup.file.probes.rule().min_views;
    if min_views as usize > all.len() {
        let found = all.len();
        return Err(Failure::input(format_args!(
            "min_views is {min_views}, expected at most the {found} cameras"
        )));
    }
    node_config(&setup.file, &all, false).map(|config| config.observers())
}

fn run(
    setup: &Setup,
    transport: impl FnOnce(&World, Option<Vec<Arc<hull::Observer>>>) -> Transport,
    pictures: PageSource,
    colours: Option<ColourSource>,
    connect_patience: Duration,
) -> Outcome {
    let world = WorldSettings { seed: setup.seed, ..WorldSettings::default() }.on(setup.scene.hull());
    let mut course = Course {
        world,
        observers: observers(setup)?,
        recorder: None,
        schedule: None,
        file: None,
        pictures: Some(pictures),
    };
    if let Some(to) = &setup.record {
        let (recorder, file) = record::begin(setup, to, world, colours)?;
        course.recorder = Some(Box::new(recorder));
        course.file = Some(file);
    }
    let played = play(setup, course, transport, connect_patience)?;
    played.tell(setup)?;
    played.failure.map_or(Ok(()), Err)
}

/// Makes a run.
pub fn play(
    setup: &Setup,
    course: Course,
    transport: impl FnOnce(&World, Option<Vec<Arc<hull::Observer>>>) -> Transport,
    connect_patience: Duration,
) -> Outcome<Played> {
    let Course { world: settings, observers, recorder, schedule, file, pictures } = course;
    let world = World::new(&setup.scene, settings).map_err(Failure::input)?;
    let run_settings = RunSettings {
        probes: setup.file.probes,
        fps: setup.file.fps,
        latency_s: setup.file.latency_s,
        hold_s: setup.file.hold_s,
        seconds: setup.seconds,
        lock_step: setup.lock_step,
        asks: match setup.ask {
            AskName::Frame => Asks::EachFrame,
            AskName::Step => Asks::EachStep,
        },
        reuse_within_m: setup.scene.hull().reuse_within_m,
        connect_patience,
    };
    let (served, live) = outlets::serve(setup, settings.dt_s, pictures)?.unzip();
    let mut watcher = Console::new(setup, &observers);
    let for_gather = (setup.transport == TransportName::Gather).then(|| observers.clone());
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().map_err(Failure::run)?;
    let (ran, recorded) = runtime.block_on(async {
        let transport = transport(&world, for_gather);
        let mut coordinator = Coordinator::new(transport, world, observers, run_settings);
        if let Some(live) = live {
            coordinator = coordinator.with_live(live);
        }
        if let Some(recorder) = recorder {
            coordinator = coordinator.with_recorder(recorder);
        }
        if let Some(schedule) = schedule {
            coordinator = coordinator.with_schedule(schedule);
        }
        let ran = coordinator.run(&mut watcher, interrupted()).await;
        // The last frames are still on their way to the file, over connections that live here.
        let complete = file.map(|file| tokio::task::spawn_blocking(move || file.finish()));
        let recorded = match complete {
            Some(complete) => Some(complete.await),
            None => None,
        };
        (ran, recorded)
    });
    // Pages hear that it is over before figures are written.
    drop(served);
    watcher.line.finish_and_clear();
    let overlaps = match watcher.album {
        Some(album) => runtime.block_on(finish(album))?,
        None => Vec::new(),
    };
    if let (Err(_), Some(Ok(Err(error)))) = (&ran, &recorded) {
        // The run's own failure is what it ends with.
        tracing::error!("{error}");
    }
    let (figures, world) = ran.map_err(Failure::run)?;
    let mut json: Value = report::json(setup, &figures, &world, &overlaps);
    let mut summary = report::summary(setup, &figures, &world);
    let mut failure =
        figures.film_failure.as_ref().map(|why| Failure::run(format_args!("film failed: {why}")));
    match recorded.transpose().map_err(Failure::run)? {
        Some(Ok(recorded)) => {
            let name = setup.record.as_ref().map_or_else(String::new, |to| to.path.display().to_string());
            summary += &report::recorded(&name, &recorded);
            json["recording"] = report::recorded_json(&name, &recorded);
        }
        Some(Err(error)) => failure = failure.or(Some(record::failure(error))),
        None => {}
    }
    Ok(Played { json, summary, failure })
}

impl Played {
    /// Prints and writes what is known of the run.
    pub fn tell(&self, setup: &Setup) -> Outcome {
        if let Some(path) = &setup.json {
            let text = serde_json::to_string_pretty(&self.json).map_err(Failure::run)?;
            write_whole(path, text.as_bytes())?;
        }
        use std::io::Write as _;
        // A closed standard output is no reason to fail a run that went well.
        let _ = std::io::stdout().write_all(self.summary.as_bytes());
        Ok(())
    }
}

/// Waits for the pictures; an interrupt leaves out those not yet begun.
async fn finish(album: Album) -> Outcome<Vec<Overlap>> {
    let hurry = album.hurry();
    let mut drawn = tokio::task::spawn_blocking(|| album.finish());
    let drawn = tokio::select! {
        drawn = &mut drawn => drawn,
        () = interrupted() => {
            hurry.store(true, std::sync::atomic::Ordering::Relaxed);
            drawn.await
        }
    };
    drawn.map_err(Failure::run)?
}

/// The live line and the pictures.
struct Console {
    line: ProgressBar,
    album: Option<Album>,
    next_picture_s: f64,
}

/// Film time between pictures, seconds.
const PICTURE_EVERY_S: f64 = 1.0;

impl Console {
    fn new(setup: &Setup, observers: &[Arc<hull::Observer>]) -> Console {
        let line = if setup.live_line { ProgressBar::new_spinner() } else { ProgressBar::hidden() };
        if let Ok(style) = ProgressStyle::with_template("{msg}") {
            line.set_style(style);
        }
        let floor_m = setup.scene.floor().map(|floor| floor.height_m);
        let begin =
            |folder: &PathBuf| Album::begin(folder, setup.file.rig.clone(), observers.to_vec(), floor_m);
        Console { line, album: setup.snapshots.as_ref().map(begin), next_picture_s: 0.5 }
    }
}

impl Watcher for Console {
    fn progress(&mut self, progress: &Progress) {
        let hull = progress.blind.as_ref().map_or_else(String::new, |why| format!("  NO HULL: {why}"));
        self.line.set_message(format!(
            "{:6.1} s  frame {}  {:4.0} steps/s  {:3.0} passes/s  p50 {:.2} ms  p99 {:.2} ms  {} samples  {} contacts  {:.0} KB/s{hull}",
            progress.film_s,
            progress.frame.map_or_else(|| "-".to_owned(), |frame| frame.to_string()),
            progress.steps_per_s,
            progress.passes_per_s,
            progress.p50_ms,
            progress.p99_ms,
            progress.samples,
            progress.contacts,
            progress.bytes_per_s / 1e3,
        ));
    }

    fn wants_snapshot(&mut self, film_s: f64) -> bool {
        let wants = self.album.is_some() && film_s >= self.next_picture_s;
        if wants {
            self.next_picture_s += PICTURE_EVERY_S;
        }
        wants
    }

    fn snapshot(&mut self, snapshot: Snapshot<'_>) {
        if let Some(album) = &self.album {
            album.add(snapshot);
        }
    }
}
