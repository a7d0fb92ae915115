//! Film that begins late, or never: what a live world does.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use camera_node::frames::{CameraFrame, FrameRing, Stamp};
use coordinator::hooks::{EndRecord, FrameRecord, Recorder, StepRecord};
use coordinator::{
    AskEvery, BoxError, Coordinator, Figures, LocalFrames, Progress, RunSettings, Snapshot, Transport,
    Watcher,
};
use hull::{Observer, ProbeSettings, Rig, Silhouette, ViewSet};
use proto::{FilmState, FrameReport, Pace, unix_now_s};
use sim::{ResponseMode, Scene, World, WorldSettings};
use stage::{StageSettings, studio_rig, true_silhouette};
use tokio::sync::watch;

const FPS: f64 = 30.0;

/// A film of the studio, drawn as it is asked for, and what is wrong with it.
struct Film {
    stage: StageSettings,
    observers: Vec<Arc<Observer>>,
    ring: FrameRing,
    /// The number of each frame, and the frame of the studio that it shows.
    shown: Vec<(u64, u64)>,
    drawn: Mutex<usize>,
    seen: Mutex<BTreeMap<u64, Vec<Silhouette>>>,
    /// Live: the epoch, once it is known, and how long after it the first frame comes.
    epoch_unix_s: Mutex<Option<f64>>,
    late_s: f64,
}

impl Film {
    /// A film of a scene that shows these frames.
    fn of(scene: &Scene, rig: &Rig, shown: Vec<(u64, u64)>) -> Film {
        let hint = scene.stage().expect("a stage");
        let stage = StageSettings {
            motion: hint.motion.parse().unwrap_or_default(),
            person: hint.person,
            props: hint.props.iter().map(|prop| prop.parse().expect("a prop")).collect(),
            ..StageSettings::default()
        };
        let observer = |(index, camera): (u16, &hull::Camera)| {
            Arc::new(Observer::new(camera.clone(), index, ProbeSettings::default(), None))
        };
        Film {
            stage,
            observers: (0..).zip(rig.cameras()).map(observer).collect(),
            ring: FrameRing::new(rig.cameras().len()),
            shown,
            drawn: Mutex::default(),
            seen: Mutex::default(),
            epoch_unix_s: Mutex::default(),
            late_s: 0.0,
        }
    }

    fn draw(&self, number: u64, content: u64) {
        // Nothing moves where there is nobody.
        let content = if self.stage.person { content } else { 0 };
        let time_s = self.stage.time_s(content);
        let mut seen = self.seen.lock().expect("whole");
        let silhouettes = seen.entry(content).or_insert_with(|| {
            let cameras = self.observers.iter().map(|observer| observer.camera());
            cameras.map(|camera| true_silhouette(&self.stage, camera, time_s).expect("drawn")).collect()
        });
        if self.ring.newest().is_ok_and(|newest| newest.number >= number) {
            self.ring.clear();
        }
        let stamp = Stamp { number, capture_time_s: time_s, captured_unix_s: time_s, skipped: 0 };
        for (index, (observer, silhouette)) in self.observers.iter().zip(silhouettes).enumerate() {
            self.ring.offer(index, stamp, CameraFrame::new(observer, silhouette.clone(), 0.0));
        }
    }
}

impl LocalFrames for Film {
    fn start(&self, pace: Pace) -> Result<(), BoxError> {
        *self.epoch_unix_s.lock().expect("whole") = (!pace.lock_step).then_some(pace.epoch_unix_s);
        Ok(())
    }

    fn credit(&self, up_to_frame: u64) {
        let mut drawn = self.drawn.lock().expect("whole");
        // Always one that new: film that drops frames goes on to the next that there is.
        while self.ring.newest().map_or(0, |frame| frame.number + 1) <= up_to_frame {
            let Some(&(number, content)) = self.shown.get(*drawn) else {
                return (0..self.observers.len()).for_each(|camera| self.ring.end(camera));
            };
            self.draw(number, content);
            *drawn += 1;
        }
    }

    fn use_frame(&self, frame: u64) {
        self.ring.hold(frame);
    }

    fn watch(&self) -> watch::Receiver<u64> {
        self.ring.watch()
    }

    fn frames(&self) -> Vec<u64> {
        if let Some(epoch_unix_s) = *self.epoch_unix_s.lock().expect("whole") {
            let film_s = unix_now_s() - epoch_unix_s;
            if film_s < self.late_s {
                return vec![];
            }
            self.credit((film_s * FPS) as u64);
        }
        self.ring.since(None).frames.iter().map(|frame| frame.number).collect()
    }

    fn report(&self, frame: u64) -> Option<FrameReport> {
        Some(self.ring.get(frame).ok()?.report())
    }

    fn film(&self) -> FilmState {
        self.ring.state()
    }

    fn with_views(&self, frame: u64, use_views: &mut dyn FnMut(&ViewSet)) -> bool {
        let found = self.ring.get(frame).ok();
        found.is_some_and(|frame| {
            use_views(&frame.views);
            true
        })
    }

    fn silhouettes(&self, frame: u64) -> Option<Vec<Arc<Silhouette>>> {
        let frame = self.ring.get(frame).ok()?;
        Some(frame.cameras.iter().map(|camera| Arc::clone(&camera.silhouette)).collect())
    }
}

/// A step, and the bodies after it.
#[derive(Clone)]
struct Step {
    film_s: f64,
    frame: Option<u64>,
}

#[derive(Clone, Default)]
struct Keeper(Arc<Mutex<Vec<Step>>>);

impl Recorder for Keeper {
    fn frame(&mut self, _: FrameRecord<'_>) {}

    fn step(&mut self, record: &StepRecord<'_>) {
        self.0.lock().expect("whole").push(Step { film_s: record.film_s, frame: record.frame });
    }

    fn end(&mut self, _: &EndRecord<'_>) {}
}

struct Quiet;

impl Watcher for Quiet {
    fn progress(&mut self, _: &Progress) {}

    fn wants_snapshot(&mut self, _: f64) -> bool {
        false
    }

    fn snapshot(&mut self, _: Snapshot<'_>) {}
}

fn world(scene: &Scene) -> World {
    let settings = WorldSettings { response: ResponseMode::Contacts, ..WorldSettings::default() };
    World::new(scene, settings.on(scene.hull())).expect("a world")
}

/// A lock-step run of so many seconds; others change what they like.
fn settings(seconds: f64) -> RunSettings {
    RunSettings {
        probes: ProbeSettings::default(),
        fps: FPS,
        latency_s: 0.0,
        hold_s: 0.0,
        seconds: Some(seconds),
        lock_step: true,
        ask_every: AskEvery::Frame,
        reuse_within_m: 0.0,
        connect_timeout: Duration::from_secs(30),
    }
}

async fn play(
    film: Film,
    scene: &Scene,
    settings: RunSettings,
    stop: impl Future<Output = ()>,
) -> (Vec<Step>, Figures) {
    let keeper = Keeper::default();
    let observers = film.observers.clone();
    let (figures, _) =
        Coordinator::new(Transport::in_process(Box::new(film)), world(scene), observers, settings)
            .with_recorder(Box::new(keeper.clone()))
            .run(&mut Quiet, stop)
            .await
            .expect("runs");
    let steps = keeper.0.lock().expect("whole").clone();
    (steps, figures)
}

fn rig() -> Rig {
    studio_rig(4, (320, 240)).expect("a rig")
}

/// So many frames, each shown in its turn.
fn all(frames: u64) -> Vec<(u64, u64)> {
    (0..frames).map(|frame| (frame, frame)).collect()
}

#[tokio::test]
async fn a_live_world_stands_still_until_its_first_frame_comes() {
    let scene = Scene::named("rest").expect("shipped");
    let film = Film { late_s: 0.5, ..Film::of(&scene, &rig(), all(1000)) };
    let live = RunSettings { lock_step: false, ..settings(1.5) };
    let (steps, figures) = play(film, &scene, live, std::future::pending()).await;
    assert!(figures.steps > 0 && steps.iter().all(|step| step.frame.is_some()), "no step is blind");
    assert_eq!(figures.blind_steps, 0);
    assert!(steps[0].film_s > 0.45, "film went by meanwhile: {}", steps[0].film_s);
    assert!(steps[0].frame > Some(10), "the first step sees the film of then: {:?}", steps[0].frame);
    let made_s = figures.steps as f64 / 120.0;
    let slipped_s = figures.slipped_s;
    assert!((made_s + slipped_s - 1.5).abs() < 0.02, "{made_s} s made, {slipped_s} s slipped");
}

#[tokio::test]
async fn a_live_world_does_not_wait_for_its_first_frame_for_ever() {
    let scene = Scene::named("rest").expect("shipped");
    let film = || Film { late_s: 1000.0, ..Film::of(&scene, &rig(), all(8)) };
    let live = |seconds| RunSettings { lock_step: false, ..settings(seconds) };
    let patient = RunSettings { connect_timeout: Duration::from_millis(200), ..live(0.8) };
    let (steps, figures) = play(film(), &scene, patient, std::future::pending()).await;
    assert!(figures.steps > 0, "it goes on without a hull");
    assert!(steps.iter().all(|step| step.frame.is_none() && step.film_s > 0.2));
    assert_eq!(figures.blind_steps, figures.steps);
    let (_, figures) = play(film(), &scene, live(0.2), std::future::pending()).await;
    assert_eq!(figures.steps, 0, "its time is over");
    assert_eq!(figures.film_failure.as_deref(), Some("the first frame has not come yet"));
    let stop = tokio::time::sleep(Duration::from_millis(500));
    let (_, figures) = play(film(), &scene, live(1000.0), stop).await;
    assert_eq!((figures.steps, figures.film_failure), (0, None), "it was stopped");
}
