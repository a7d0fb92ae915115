//! Makes a run: connects, steps until film or time ends, and gathers what is known of it.

use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

use coordinator::hooks::{Recorder, Schedule};
use coordinator::metrics::MetricsSender;
use coordinator::{Coordinator, Figures, Placement, PlaybackSettings, RunError, RunSettings, Transport};
use hull::Observer;
use node_client::Role;
use recording::{Recorded, RecordingFile, WriteError};
use serde_json::Value;
use setup::cli::{Failure, Outcome, out, write_whole};
use sim::World;
use telemetry::{Pulse, TelemetryPort, systemd};
use tokio::task::JoinError;

use super::console::Console;
use super::metrics;
use super::outlets::{self, PageSource};
use super::recording::failure as recording_failure;
use super::report::{self, Overlap};
use super::run_setup::{Setup, TransportName};
use super::snapshot::Album;
use crate::interrupt::interrupted;

/// What a run needs besides its set-up.
pub struct RunPlan {
    /// The whole rig's observers, in rig order.
    pub observers: Vec<Arc<Observer>>,
    /// Receives every step.
    pub recorder: Option<Box<dyn Recorder>>,
    /// The steps to follow.
    pub schedule: Option<Box<dyn Schedule>>,
    /// How these steps are played, if they are a recording's.
    pub playback: Option<PlaybackSettings>,
    /// The file that the recorder fills.
    pub file: Option<RecordingFile>,
    /// What a page shows of the cameras; without it no page is served.
    pub page: Option<PageSource>,
    /// How long nodes may take to connect.
    pub connect_timeout: Duration,
}

/// A run that is over.
pub struct RunOutcome {
    /// Its figures.
    pub json: Value,
    /// The same in a few lines.
    pub summary: String,
    /// Why it failed, if it did.
    pub failure: Option<Failure>,
}

/// How a run and its recording ended.
struct Ended {
    run: Result<(Figures, World), RunError>,
    recording: Option<Result<Result<Recorded, WriteError>, JoinError>>,
}

/// Makes a run. `transport` is called within the run's runtime.
pub fn play(
    setup: &Setup,
    plan: RunPlan,
    transport: impl FnOnce(&World, Placement) -> Transport,
) -> Outcome<RunOutcome> {
    let RunPlan { observers, recorder, schedule, playback, file, page, connect_timeout } = plan;
    let world = World::new(&setup.scene, setup.world).map_err(Failure::input)?;
    // In one process there are no connections to nodes.
    let asks_nodes = setup.transport != TransportName::Inprocess;
    let threads = if asks_nodes { coordinator::threads_for(setup.file.nodes.len()) } else { 0 };
    let runtime = coordinator::runtime(threads).map_err(Failure::run)?;
    // Before the page is announced: from then on a signal may come.
    let stop = {
        let _within = runtime.enter();
        interrupted()
    };
    let (served, live) = outlets::serve(setup, page)?.unzip();
    let (metrics, telemetry) = serve_metrics(setup, schedule.is_some())?.unzip();
    let _traces = metrics::send_traces(setup.outlets.otlp.as_ref(), "coordinator", (&setup.file.name, ""))?;
    let pulse = Pulse::default();
    let beat = pulse.beat("the run");
    let mut console = Console::new(setup, &observers, Arc::clone(&beat));
    let placement = match setup.transport {
        TransportName::Auto if !setup.lock_step => Placement::Fastest(observers.clone()),
        TransportName::Gather => Placement::Here(observers.clone()),
        TransportName::Auto | TransportName::Cluster | TransportName::Inprocess => Placement::Nodes,
    };
    let run = async {
        systemd::ready("waits for its cameras");
        let transport = transport(&world, placement);
        let settings = run_settings(setup, connect_timeout);
        let coordinator = Coordinator::new(transport, world, observers, settings);
        let mut coordinator = coordinator.with_memory(setup.memory);
        if let Some(live) = live {
            coordinator = coordinator.with_live(live);
        }
        if let Some(metrics) = metrics {
            coordinator = coordinator.with_metrics(metrics);
        }
        if let Some(recorder) = recorder {
            coordinator = coordinator.with_recorder(recorder);
        }
        if let Some(schedule) = schedule {
            coordinator = coordinator.with_schedule(schedule);
        }
        if let Some(playback) = playback {
            coordinator = coordinator.with_playback(playback);
        }
        let run = match setup.role {
            Role::Observes => coordinator.observe(&mut console, stop).await,
            Role::Leads | Role::TakesOver => coordinator.run(&mut console, stop).await,
        };
        beat.waits();
        systemd::stopping();
        // The last frames are still on their way to the file, over connections that live here.
        let recording = match file {
            Some(file) => Some(tokio::task::spawn_blocking(move || file.finish()).await),
            None => None,
        };
        Ended { run, recording }
    };
    let ended = runtime.block_on(systemd::watched(&pulse, run));
    // Pages hear of the end before figures are written.
    drop(served);
    drop(telemetry);
    let overlaps = match console.finish() {
        Some(album) => runtime.block_on(finish(album)),
        None => Ok(Vec::new()),
    };
    // A certificate that cannot be read, on a drive that hangs, keeps a thread: the run does not wait for it.
    runtime.shutdown_background();
    ended.outcome(setup, &overlaps?)
}

/// Serves metrics where the outlets say. What is returned beside the port belongs to the run.
fn serve_metrics(setup: &Setup, is_replay: bool) -> Outcome<Option<(MetricsSender, TelemetryPort)>> {
    let Some(listen) = setup.outlets.metrics else { return Ok(None) };
    let (sender, telemetry) = metrics::metrics(setup, !setup.lock_step && !is_replay);
    let port = metrics::serve(listen, &[("room", setup.file.name.clone())], Arc::new(telemetry))?;
    Ok(Some((sender, port)))
}

fn run_settings(setup: &Setup, connect_timeout: Duration) -> RunSettings {
    RunSettings {
        probes: setup.file.probes,
        fps: setup.file.fps,
        latency_s: setup.file.latency_s,
        hold_s: setup.file.hold_s,
        going_on: setup.file.going_on,
        seconds: setup.seconds,
        lock_step: setup.lock_step,
        ask_every: setup.asks,
        reuse_within_m: setup.scene.hull().reuse_within_m,
        connect_timeout,
    }
}

/// Waits for the pictures; an interrupt leaves out those not yet begun.
async fn finish(album: Album) -> Outcome<Vec<Overlap>> {
    let hurry = album.hurry();
    let mut drawn = tokio::task::spawn_blocking(|| album.finish());
    let drawn = tokio::select! {
        drawn = &mut drawn => drawn,
        () = interrupted() => {
            hurry.store(true, Ordering::Relaxed);
            drawn.await
        }
    };
    drawn.map_err(Failure::run)?
}

impl Ended {
    fn outcome(self, setup: &Setup, overlaps: &[Overlap]) -> Outcome<RunOutcome> {
        if let (Err(_), Some(Ok(Err(error)))) = (&self.run, &self.recording) {
            // The run's own failure is what it ends with.
            tracing::error!("{error}");
        }
        let (figures, world) = self.run.map_err(Failure::run)?;
        let mut json = report::json(setup, &figures, &world, overlaps);
        let mut summary = report::summary(setup, &figures, &world);
        let film_failed = figures.film_failure.as_ref();
        let mut failure = film_failed.map(|why| Failure::run(format_args!("film failed: {why}")));
        match self.recording.transpose().map_err(Failure::run)? {
            Some(Ok(recorded)) => {
                let path = setup.record.as_ref().map(|to| to.path.display().to_string());
                let name = path.unwrap_or_default();
                summary += &report::recorded(&name, &recorded);
                json["recording"] = report::recorded_json(&name, &recorded);
            }
            Some(Err(error)) => failure = failure.or(Some(recording_failure(error))),
            None => {}
        }
        Ok(RunOutcome { json, summary, failure })
    }
}

impl RunOutcome {
    /// Prints the summary, and writes the figures where the set-up wants them.
    pub fn report(&self, setup: &Setup) -> Outcome {
        if let Some(path) = &setup.outlets.json {
            let text = serde_json::to_string_pretty(&self.json).map_err(Failure::run)?;
            write_whole(path, text.as_bytes())?;
        }
        if setup.outlets.silent {
            return Ok(());
        }
        let printed = out!("{}", self.summary);
        // Why a run failed counts for more than a summary that was not printed.
        if self.failure.is_some() { Ok(()) } else { printed }
    }
}
