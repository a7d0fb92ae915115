//! `hulltouch replay`: a recorded run once more.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use clap::Args;
use coordinator::{GoingOn, MemoryUse, PlaybackSettings, Transport};
use node_client::Role;
use recording::{Recording, StepCheck};
use serde_json::{Value, json};
use setup::cli::{Failure, Outcome};
use setup::{ClusterFile, SceneChoice};

use crate::run::options::OutletArguments;
use crate::run::outlets::PageSource;
use crate::run::play::{RunPlan, play};
use crate::run::recorded_pictures::RecordingPictures;
use crate::run::run_setup::{Setup, TransportName};
use crate::run::security::ConsentArguments;

/// Replay a recorded run: the same steps over the same silhouettes. Exit status 1 if a step differs.
#[derive(Debug, Args)]
#[command(after_help = "\
    Example:\n  \
    hulltouch replay out.mcap\n  \
    hulltouch replay out.mcap --unpaced --snapshot pics")]
pub struct ReplayArguments {
    /// The recording.
    file: PathBuf,
    /// As fast as it goes, instead of in real time.
    #[arg(long)]
    unpaced: bool,
    /// End with the recording, also while a page is open.
    #[arg(long)]
    once: bool,
    #[command(flatten)]
    outlets: OutletArguments,
    #[command(flatten)]
    consent: ConsentArguments,
}

/// Replays to the end, or Ctrl-C. While a page is open a replay in real time stays at the end.
pub fn run(arguments: &ReplayArguments) -> Outcome {
    let recording = Recording::open(&arguments.file).map_err(Failure::input)?;
    if let Some(cut_off) = recording.cut_off() {
        tracing::warn!("{}: {cut_off}", arguments.file.display());
    }
    let steps = recording.steps().map_err(Failure::input)?;
    let frames = recording.frames().map_err(Failure::input)?;
    let pictures = RecordingPictures::new(recording.pictures().map_err(Failure::input)?);
    let check = steps.check();
    let setup = setup(&recording, arguments)?;
    setup.prepare_outputs()?;
    let header = recording.header();
    let plan = RunPlan {
        observers: header.observers(),
        recorder: Some(check.recorder()),
        schedule: Some(Box::new(steps)),
        playback: Some(PlaybackSettings {
            length_s: recording.length_s(),
            stays: !arguments.unpaced && !arguments.once,
        }),
        file: None,
        page: Some(PageSource {
            pictures: Box::new(move || Arc::new(pictures)),
            ignored: header.ignored.clone(),
            has_colour: recording.has_colour(),
            length_s: Some(recording.length_s()),
        }),
        connect_timeout: Duration::ZERO,
    };
    let mut outcome = play(&setup, plan, |_, _| Transport::in_process(Box::new(frames)))?;
    outcome.json["replay"] = figures(&recording, &check, &arguments.file);
    outcome.summary += &summary(&recording, &check);
    outcome.report(&setup)?;
    if let Some(problem) = check.difference().map(|difference| difference.to_string()).or(check.problem()) {
        let (file, recorded, this) = (arguments.file.display(), &header.program, env!("CARGO_PKG_VERSION"));
        return Err(Failure::run(format_args!(
            "{file}: {problem} (recorded by version {recorded}, this is {this})"
        )));
    }
    // A run that never had a hull was made again all the same.
    let is_whole = check.steps() == recording.step_count();
    outcome.failure.filter(|_| !is_whole).map_or(Ok(()), Err)
}

fn figures(recording: &Recording, check: &StepCheck, file: &Path) -> Value {
    json!({
        "file": file.display().to_string(),
        "program": recording.header().program,
        "steps": check.steps(),
        "recorded_steps": recording.step_count(),
        "given_steps": check.given(),
        "cut_off": recording.cut_off(),
        "difference": check.difference().map(|difference| difference.to_string()),
    })
}

fn summary(recording: &Recording, check: &StepCheck) -> String {
    let (made, there) = (check.steps(), recording.step_count());
    let mut text = format!("{made} of {there} recorded steps made again");
    if check.given() > 0 {
        text += &format!(", {} of them with the recorded answers", check.given());
    }
    if made == there && check.difference().is_none() {
        text += &format!("; the same digest: {}", recording.digest());
    }
    text + "\n"
}

/// The recorded run's own set-up.
fn setup(recording: &Recording, arguments: &ReplayArguments) -> Outcome<Setup> {
    let header = recording.header();
    let security = arguments.consent.checked();
    let outlets = arguments.outlets.checked(&security)?;
    let file = ClusterFile {
        path: arguments.file.clone(),
        name: "recording".to_owned(),
        rig: header.rig.clone(),
        scene: SceneChoice::Named(header.scene.name().to_owned()),
        fps: header.fps,
        // What is on the disk need not arrive.
        latency_s: None,
        hold_s: header.hold_s,
        going_on: GoingOn { min_cameras: 1, ..GoingOn::default() },
        seed: Some(header.world.seed),
        gravity_m_s2: Some(header.scene.gravity_m_s2()),
        probes: header.probes,
        precision: header.precision,
        max_connection_age_s: 3600.0,
        nodes: Vec::new(),
        cameras: Vec::new(),
    };
    Ok(Setup {
        file,
        scene: header.scene.clone(),
        world: header.world,
        transport: TransportName::Inprocess,
        asks: header.asks,
        lock_step: arguments.unpaced,
        role: Role::Leads,
        dial: security.dial,
        empty: false,
        seconds: None,
        outlets,
        record: None,
        memory: MemoryUse::Off,
    })
}
