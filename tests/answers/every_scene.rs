//! Every shipped scene under contacts is one run: over all transports, made again from its record, and with whatever
//! vector instructions.

use std::path::Path;
use std::time::Duration;

use camera_node::source::{SourceConfig, StageConfig};
use camera_node::{NodeCamera, NodeConfig};
use coordinator::{
    AskEvery, BoxError, Coordinator, LocalFrames, Progress, RunSettings, Silhouettes, Snapshot, Transport,
    Watcher,
};
use film_time::{FilmState, FrameReport, Pace};
use hull::vector::VectorPath;
use hull::{ProbeSettings, ViewSet};
use segment::SegmentSettings;
use serde_json::Value;
use setup::InProcess;
use sim::{ResponseMode, Scene, World, WorldSettings};
use tokio::sync::watch;

/// Each scene, and after how many seconds of film its bodies have met the hull in so many steps, summed over bodies.
const SCENES: [(&str, f64, u64); 9] = [
    ("rest", 1.0, 50),
    ("tray", 4.0, 50),
    ("push", 4.0, 20),
    ("squeeze", 4.0, 100),
    ("punch", 3.0, 5),
    ("drops", 1.5, 50),
    ("lift", 3.5, 50),
    ("topple", 4.0, 50),
    ("crowd", 2.5, 40),
];
const SIZE: (u32, u32) = (240, 180);
const CAMERAS: usize = 6;

/// Runs the program; returns its figures.
fn figures(json: &Path, arguments: &[&str]) -> Value {
    let program =
        testkit::command(env!("CARGO_BIN_EXE_hulltouch")).args(arguments).arg("--json").arg(json).output();
    let output = program.expect("runs");
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&std::fs::read(json).expect("figures")).expect("JSON")
}

#[test]
fn every_scene_is_one_run_over_every_transport_and_when_it_is_made_again() {
    let folder = tempfile::tempdir().expect("a folder");
    let (json, size, cameras) =
        (folder.path().join("out.json"), format!("{}x{}", SIZE.0, SIZE.1), CAMERAS.to_string());
    for (scene, seconds, least) in SCENES {
        let file = folder.path().join(format!("{scene}.mcap"));
        let (file, seconds) = (file.to_str().expect("text"), seconds.to_string());
        let run = |transport, more: &[&str]| {
            let demo = ["demo", "--unpaced", "--headless", "--transport", transport];
            let film = ["--scene", scene, "--seconds", &seconds, "--size", &size, "--cameras", &cameras];
            figures(&json, &[&demo[..], &film, more].concat())
        };
        let first = run("inprocess", &[]);
        assert_eq!((&first["response"], &first["faults"]), (&"contacts".into(), &0.into()), "{scene}");
        let contacts = first["contacts"].as_u64().expect("a number");
        assert!(contacts >= least, "{scene}: {contacts} contacts");
        let replay = ["replay", file, "--unpaced", "--headless"];
        let others = [
            ("gather", run("gather", &[])),
            ("cluster", run("cluster", &["--record", file])),
            ("replay", figures(&json, &replay)),
        ];
        for (what, other) in others {
            for key in ["trajectory_digest", "steps", "contacts", "inside_samples", "bodies"] {
                assert_eq!(other[key], first[key], "{key} of {scene}, {what}");
            }
        }
    }
}

/// Cameras of this process whose frames are asked with given instructions.
struct OnPath(InProcess, VectorPath);

impl LocalFrames for OnPath {
    fn start(&self, pace: Pace) -> Result<(), BoxError> {
        self.0.start(pace)
    }

    fn credit(&self, up_to_frame: u64) {
        self.0.credit(up_to_frame);
    }

    fn use_frame(&self, frame: u64) {
        self.0.use_frame(frame);
    }

    fn watch(&self) -> watch::Receiver<u64> {
        self.0.watch()
    }

    fn frames(&self) -> Vec<u64> {
        self.0.frames()
    }

    fn report(&self, frame: u64) -> Option<FrameReport> {
        self.0.report(frame)
    }

    fn film(&self) -> FilmState {
        self.0.film()
    }

    fn with_views(&self, frame: u64, use_views: &mut dyn FnMut(&ViewSet)) -> bool {
        self.0.with_views(frame, &mut |views| use_views(&views.clone().with_path(self.1)))
    }

    fn silhouettes(&self, frame: u64) -> Option<Silhouettes> {
        self.0.silhouettes(frame)
    }
}

struct Quiet;

impl Watcher for Quiet {
    fn progress(&mut self, _: &Progress) {}

    fn wants_snapshot(&mut self, _: f64) -> bool {
        false
    }

    fn snapshot(&mut self, _: Snapshot<'_>) {}
}

fn cameras(scene: &Scene) -> NodeConfig {
    let hint = scene.stage().expect("a stage");
    let source = SourceConfig::Stage(StageConfig {
        motion: hint.motion.parse().unwrap_or_default(),
        props: hint.props.iter().map(|prop| prop.parse().expect("a prop")).collect(),
        person: hint.person,
        ..StageConfig::default()
    });
    let rig = stage::studio_rig(CAMERAS, SIZE).expect("a rig");
    let camera = |(rig_index, camera): (u16, &hull::Camera)| NodeCamera {
        camera: camera.clone(),
        rig_index,
        source: source.clone(),
        background: None,
        segmentation: SegmentSettings::default(),
        ignored: None,
    };
    let cameras = (0..).zip(rig.cameras()).map(camera).collect();
    NodeConfig { cameras, settings: ProbeSettings::default(), fps: 30.0 }
}

/// The digest of a run whose frames are asked with these instructions, and how often bodies met the hull.
async fn digest(scene: &Scene, seconds: f64, path: VectorPath) -> (String, u64) {
    let config = cameras(scene);
    let frames = OnPath(InProcess::prepare(&config).expect("films"), path);
    let settings = WorldSettings { response: ResponseMode::Contacts, ..WorldSettings::default() };
    let world = World::new(scene, settings.on(scene.hull())).expect("a world");
    let run = RunSettings {
        probes: config.settings,
        fps: config.fps,
        latency_s: Some(0.0),
        hold_s: 0.0,
        going_on: coordinator::GoingOn::default(),
        seconds: Some(seconds),
        lock_step: true,
        ask_every: AskEvery::Frame,
        reuse_within_m: scene.hull().reuse_within_m,
        connect_timeout: Duration::ZERO,
    };
    let transport = Transport::in_process(Box::new(frames));
    let coordinator = Coordinator::new(transport, world, config.observers(), run);
    let (figures, world) = coordinator.run(&mut Quiet, std::future::pending()).await.expect("runs");
    (world.digest().to_string(), figures.counts.contacts)
}

#[tokio::test]
async fn every_scene_is_one_run_with_whatever_vector_instructions() {
    let others = VectorPath::ALL.into_iter().filter(|path| path.is_available()).skip(1);
    for (name, seconds, least) in SCENES {
        let scene = Scene::named(name).expect("shipped");
        let portable = digest(&scene, seconds, VectorPath::Portable).await;
        assert!(portable.1 >= least, "{name}: {} contacts", portable.1);
        for path in others.clone() {
            assert_eq!(digest(&scene, seconds, path).await, portable, "{name} with {path:?}");
        }
    }
}
