//! Runs that are recorded and replayed: the same digest, files that other programs read, and files of runs that
//! were killed.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::Arc;
use std::time::Duration;

use crate::demo::Demo;
use coordinator::hooks::{EndRecord, Recorder as _, StepRecord};
use coordinator::live::{Command as Ask, Follower, Parameters, WorldState, live};
use coordinator::{Coordinator, Figures, Progress, RunSettings, Snapshot, Transport, Watcher};
use futures::StreamExt as _;
use hull::Pose;
use recording::{Overwrites, Recording};
use serde_json::Value;
use sim::{BodyResponse, BodySpec, MassSpec, Scene, Solid, World};
use testkit::{Watch, timely};

/// Physics steps of a second.
const STEPS_PER_S: u64 = 120;

fn hulltouch() -> Command {
    testkit::command(env!("CARGO_BIN_EXE_hulltouch"))
}

fn figures(path: &Path) -> Value {
    serde_json::from_str(&std::fs::read_to_string(path).expect("written")).expect("JSON")
}

fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// A short lock-step run of a small studio in a file; its figures.
fn record(folder: &Path, more: &[&str]) -> (PathBuf, Value) {
    let (file, json) = (folder.join("run.mcap"), folder.join("run.json"));
    let output = hulltouch()
        .args(["demo", "--cameras", "3", "--size", "320x240", "--seconds", "3", "--unpaced", "--headless"])
        .arg("--record")
        .arg(&file)
        .arg("--json")
        .arg(&json)
        .args(more)
        .output()
        .expect("runs");
    assert!(output.status.success(), "{}", said(&output));
    (file, figures(&json))
}

fn replay(file: &Path, more: &[&str]) -> (Output, Value) {
    let json = file.with_extension("replay.json");
    let output = hulltouch()
        .arg("replay")
        .arg(file)
        .args(["--headless", "--json"])
        .arg(&json)
        .args(more)
        .output()
        .expect("runs");
    let figures = if output.status.success() { figures(&json) } else { Value::Null };
    (output, figures)
}

#[test]
fn a_replay_is_the_run_again() {
    let folder = tempfile::tempdir().expect("folder");
    let (file, run) = record(folder.path(), &[]);
    assert!(run["inside_samples"].as_u64().expect("a number") > 20, "bodies meet the person");
    assert_eq!((&run["recording"]["steps"], &run["recording"]["frames"]), (&run["steps"], &run["frames"]));
    assert_eq!(run["recording"]["frames_lost"], 0);
    for more in [&["--unpaced"][..], &[]] {
        let (output, replayed) = replay(&file, more);
        assert!(output.status.success(), "{}", said(&output));
        for key in ["trajectory_digest", "steps", "frames", "inside_samples", "samples", "bodies"] {
            assert_eq!(replayed[key], run[key], "{key}");
        }
        assert_eq!(
            (&replayed["replay"]["given_steps"], &replayed["replay"]["cut_off"]),
            (&Value::from(0), &Value::Null)
        );
        assert!(String::from_utf8_lossy(&output.stdout).contains("the same digest"));
    }
    let again = hulltouch().args(["record", "--seconds", "1"]).arg(&file).output().expect("runs");
    assert_eq!(again.status.code(), Some(2), "a file that is there is not touched");
    assert!(said(&again).contains("is there already"), "{}", said(&again));
}

#[test]
fn rounded_answers_are_taken_as_they_were() {
    let folder = tempfile::tempdir().expect("folder");
    let (file, run) = record(folder.path(), &["--precision", "quantised"]);
    let (output, replayed) = replay(&file, &["--unpaced"]);
    assert!(output.status.success(), "{}", said(&output));
    assert_eq!(replayed["trajectory_digest"], run["trajectory_digest"]);
    assert!(replayed["replay"]["given_steps"].as_u64().expect("a number") > 300);
    assert!(String::from_utf8_lossy(&output.stdout).contains("with the recorded answers"));
}

#[test]
fn a_step_that_differs_is_named_and_the_replay_fails() {
    let folder = tempfile::tempdir().expect("folder");
    let (file, _) = record(folder.path(), &["--transport", "inprocess"]);
    let mut header = Recording::open(&file).expect("a recording").header().clone();
    let mut world = World::new(&header.scene, header.world).expect("a world");
    header.world.seed += 1;
    let other = folder.path().join("other.mcap");
    let (mut recorder, recording) =
        recording::record(&other, Overwrites::Never, &header, None).expect("a new file");
    let responses = vec![BodyResponse::UNTOUCHED; world.moving_bodies().len()];
    for step in 1..=30 {
        world.step(&responses).expect("steps");
        recorder.step(&StepRecord {
            generation: 0,
            step,
            commands: &[],
            film_s: world.time_s(),
            slipped_s: 0.0,
            frame: None,
            responses: &responses,
            collisions: None,
            step_ms: 0.0,
            world: &world,
        });
    }
    recorder.end(&EndRecord { commands: &[], figures: &Figures::default(), world: &world });
    recording.finish().expect("written");
    let (output, _) = replay(&other, &["--unpaced"]);
    assert_eq!(output.status.code(), Some(1), "{}", said(&output));
    assert!(said(&output).contains("step 1 (0.008 s) differs"), "{}", said(&output));
}

#[test]
fn colours_are_recorded_and_a_replay_has_a_page() {
    let folder = tempfile::tempdir().expect("folder");
    let (file, run) = record(folder.path(), &["--record-colour"]);
    let recording = Recording::open(&file).expect("a recording");
    assert!(recording.has_colour());
    let pictures = recording.pictures().expect("readable");
    let cameras = |frame: u64| pictures.frame(frame).expect("readable").unwrap_or_default();
    let coloured = (0..91).flat_map(cameras).filter_map(|camera| camera.colour);
    let jpegs: Vec<_> = coloured.map(|colour| colour.jpeg).collect();
    assert!(jpegs.len() > 30, "{} crops of 91 frames of three cameras", jpegs.len());
    assert!(jpegs.iter().all(|jpeg| jpeg.starts_with(&[0xff, 0xd8])), "they are JPEGs");
    let (output, replayed) = replay(&file, &["--listen", "127.0.0.1:0"]);
    assert!(output.status.success(), "{}", said(&output));
    assert!(said(&output).contains("page: http://127.0.0.1:"), "{}", said(&output));
    assert_eq!(replayed["trajectory_digest"], run["trajectory_digest"]);
    if let Some(found) = read_by_python(&file, &[]) {
        let channels = found["channels"].as_object().expect("an object").iter();
        let counts =
            channels.filter(|(topic, _)| topic.ends_with("/colour")).filter_map(|(_, count)| count.as_u64());
        assert_eq!(counts.sum::<u64>(), jpegs.len() as u64);
    }
}

/// A run without viewers.
struct NoWatcher;

impl Watcher for NoWatcher {
    fn progress(&mut self, _progress: &Progress) {}
    fn wants_snapshot(&mut self, _film_s: f64) -> bool {
        false
    }
    fn snapshot(&mut self, _snapshot: Snapshot<'_>) {}
}

/// Does a little of everything, each at its film time.
async fn steer(mut follower: Follower) {
    let _watching = follower.watch();
    let scene = follower.scene.borrow().clone().expect("published");
    let body = scene.bodies.iter().find(|body| !body.fixed).expect("one that moves").id;
    let ball = BodySpec {
        name: String::new(),
        solid: Solid::Ball { radius_m: 0.1 },
        pose: Pose::new([0.0, 2.0, 0.1], [0.0, 0.0, 0.0, 1.0]).expect("a pose"),
        velocity_m_s: [0.1, -1.0, 0.0],
        mass: MassSpec::MassKg(0.5),
        friction: 0.5,
        restitution: 0.4,
        fixed: false,
        color: [1.0, 0.0, 0.0],
    };
    let lift = Scene::named("lift").expect("a scene");
    let held =
        |height_m: f64| Ask::Grab { body, grip_body_m: [0.05, 0.0, 0.0], target_m: [0.3, height_m, 0.2] };
    let light = Parameters {
        gravity_m_s2: Some([0.0, -4.0, 0.0]),
        hull_friction: Some(0.2),
        ..Parameters::default()
    };
    let orders = [
        (0.2, Ask::Spawn(Box::new(ball.clone()))),
        (0.3, Ask::Push { body, impulse_n_s: [0.0, 2.0, 0.5], at_m: None }),
        (0.4, held(1.0)),
        (0.5, held(1.5)),
        (0.7, Ask::Release { body, velocity_m_s: Some([0.0, 1.0, -2.0]) }),
        (0.8, Ask::Set(light)),
        (0.9, Ask::Pause),
        (0.9, Ask::Resume),
        (1.1, Ask::Remove(body)),
        (1.3, Ask::Reset),
        (1.5, Ask::Spawn(Box::new(ball))),
        (1.7, Ask::Choose(lift)),
    ];
    for (film_s, command) in orders {
        let is_there =
            |world: &Option<Arc<WorldState>>| world.as_ref().is_some_and(|world| world.film_s >= film_s);
        follower.world.wait_for(is_there).await.expect("it runs");
        let said = format!("{command:?}");
        follower.order(command).await.unwrap_or_else(|why| panic!("{said}: {why}"));
    }
}

#[test]
fn what_was_asked_of_a_run_is_asked_again() {
    let folder = tempfile::tempdir().expect("folder");
    let (film, _) = record(folder.path(), &["--transport", "inprocess"]);
    let film = Recording::open(&film).expect("a recording");
    let header = film.header();
    let steered = folder.path().join("steered.mcap");
    let (recorder, file) = recording::record(&steered, Overwrites::Never, header, None).expect("a new file");
    let settings = RunSettings {
        probes: header.probes,
        fps: header.fps,
        latency_s: Some(0.0),
        hold_s: 0.0,
        going_on: coordinator::GoingOn::default(),
        seconds: Some(2.5),
        lock_step: true,
        ask_every: header.asks,
        reuse_within_m: 0.0,
        connect_timeout: Duration::ZERO,
    };
    let world = World::new(&header.scene, header.world).expect("a world");
    let (live, follower) = live();
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().expect("a runtime");
    let (figures, world) = runtime.block_on(async {
        let transport = Transport::in_process(Box::new(film.frames().expect("readable")));
        let coordinator = Coordinator::new(transport, world, header.observers(), settings);
        let coordinator = coordinator.with_live(live).with_recorder(Box::new(recorder));
        let (mut watcher, for_ever) = (NoWatcher, std::future::pending());
        tokio::join!(coordinator.run(&mut watcher, for_ever), steer(follower)).0.expect("it runs")
    });
    assert_eq!(file.finish().expect("written").steps, figures.counts.steps);
    let (output, replayed) = replay(&steered, &["--unpaced"]);
    assert!(output.status.success(), "{}", said(&output));
    assert_eq!(replayed["trajectory_digest"], world.digest().to_string());
    assert_eq!(
        (&replayed["replay"]["given_steps"], &replayed["steps"]),
        (&Value::from(0), &Value::from(figures.counts.steps))
    );
}

/// Follows a run until it has made so many steps; how many it had made last.
async fn followed(address: &str, steps: u64) -> u64 {
    let socket = tokio_tungstenite::connect_async(format!("ws://{address}/state?rate=120")).await;
    let mut socket = socket.expect("connects").0;
    loop {
        let message = socket.next().await.expect("not closed").expect("a message");
        let state: Value = serde_json::from_str(message.to_text().expect("text")).expect("JSON");
        if let Some(made) = state["step"].as_u64().filter(|made| *made >= steps) {
            return made;
        }
    }
}

#[test]
fn a_run_that_is_killed_leaves_a_recording_up_to_its_last_second() {
    let folder = tempfile::tempdir().expect("folder");
    let file = folder.path().join("run.mcap");
    let watch = Watch::start();
    let demo = Demo::start(&["--record", file.to_str().expect("a path")]);
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().expect("a runtime");
    let followed = async {
        tokio::time::timeout(Duration::from_secs(120), followed(&demo.address, 3 * STEPS_PER_S)).await
    };
    let made = runtime.block_on(followed).expect("three seconds of steps are made sooner or later");
    // SIGKILL.
    drop(demo);
    let (output, replayed) = replay(&file, &["--unpaced"]);
    assert!(output.status.success(), "{}", said(&output));
    assert!(said(&output).contains("not complete"), "{}", said(&output));
    let steps = replayed["replay"]["steps"].as_u64().expect("a number");
    assert!(steps > 0, "nothing was recorded");
    timely!(watch, steps + STEPS_PER_S > made, "{steps} steps of {made}");
    assert_eq!(replayed["replay"]["difference"], Value::Null);
    if let Some(found) = read_by_python(&file, &["--stream"]) {
        assert_eq!(
            (&found["cut_off"], &found["channels"]["/step"]),
            (&Value::from(true), &replayed["replay"]["steps"])
        );
    }
}

#[test]
fn python_reads_every_message() {
    let folder = tempfile::tempdir().expect("folder");
    let (file, run) = record(folder.path(), &[]);
    let Some(found) = read_by_python(&file, &[]) else { return };
    let channels = &found["channels"];
    assert_eq!(channels["/step"], run["steps"]);
    assert_eq!(found["digest"], run["trajectory_digest"]);
    assert_eq!(found["inside_samples"], run["inside_samples"]);
    assert_eq!((&found["frames"], &found["cameras"]), (&run["frames"], &run["cameras"]));
    assert_eq!(found["scene"], run["scene"]);
    let silhouettes =
        channels.as_object().expect("an object").iter().filter(|(topic, _)| topic.ends_with("/silhouette"));
    assert!(
        silhouettes.clone().count() == 3 && silhouettes.clone().all(|(_, count)| *count == run["frames"])
    );
    assert!(found["area"].as_u64().expect("a number") > 100_000, "a person is there");
    for topic in ["/header", "/end", "/scene"] {
        assert_eq!(channels[topic], 1, "{topic}");
    }
    for topic in ["/bodies", "/touches", "/figures"] {
        assert!(channels[topic].as_u64().is_some_and(|count| count > 5), "{topic}");
    }
}

/// What `tests/python/recording.py` finds; nothing without a Python that has what it needs.
fn read_by_python(file: &Path, more: &[&str]) -> Option<Value> {
    let Some(python) = std::env::var_os("HULLTOUCH_PYTHON") else {
        testkit::skip("HULLTOUCH_PYTHON names no Python with tests/python/requirements.txt");
        return None;
    };
    let program = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/python/recording.py");
    let output = testkit::command(python).arg(program).arg(file).args(more).output().expect("Python runs");
    assert!(output.status.success(), "{}", said(&output));
    Some(serde_json::from_slice(&output.stdout).expect("JSON"))
}
