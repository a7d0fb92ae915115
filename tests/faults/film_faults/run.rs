//! Runs over a film, and what is measured of their bodies.

use std::sync::{Arc, Mutex};
use std::time::Duration;

use coordinator::hooks::{EndRecord, FrameRecord, Recorder, StepRecord};
use coordinator::{AskEvery, Coordinator, Figures, Progress, RunSettings, Snapshot, Transport, Watcher};
use hull::{Observer, ProbeSettings};
use nalgebra::Vector3;
use setup::RingFrames;
use sim::{ResponseMode, Scene, World, WorldSettings};
use tokio::sync::oneshot;

use super::film::{FPS, Film};

/// A step, and the bodies after it.
#[derive(Clone)]
pub struct Step {
    pub film_s: f64,
    pub frame: Option<u64>,
    pub positions_m: Vec<Vector3<f64>>,
    pub velocities_m_s: Vec<Vector3<f64>>,
    pub contacts: usize,
}

/// Keeps all steps, and tells of one that it was made.
#[derive(Default)]
pub struct Keeper {
    steps: Arc<Mutex<Vec<Step>>>,
    pub tells: Option<(f64, oneshot::Sender<()>)>,
}

impl Recorder for Keeper {
    fn frame(&mut self, _: FrameRecord<'_>) {}

    fn step(&mut self, record: &StepRecord<'_>) {
        let bodies = || record.world.moving_bodies();
        if let Some((_, told)) = self.tells.take_if(|(at_s, _)| record.film_s >= *at_s) {
            drop(told);
        }
        self.steps.lock().expect("whole").push(Step {
            film_s: record.film_s,
            frame: record.frame,
            positions_m: bodies().map(|body| body.pose.position_m().into()).collect(),
            velocities_m_s: bodies().map(|body| body.velocity_m_s.into()).collect(),
            contacts: record.responses.iter().map(|response| response.contacts.len()).sum(),
        });
    }

    fn end(&mut self, _: &EndRecord<'_>) {}
}

pub struct Quiet;

impl Watcher for Quiet {
    fn progress(&mut self, _: &Progress) {}

    fn wants_snapshot(&mut self, _: f64) -> bool {
        false
    }

    fn snapshot(&mut self, _: Snapshot<'_>) {}
}

pub fn world(scene: &Scene) -> World {
    let settings = WorldSettings { response: ResponseMode::Contacts, ..WorldSettings::default() };
    World::new(scene, settings.on(scene.hull())).expect("a world")
}

/// A lock-step run of so many seconds; others change what they like.
pub fn settings(seconds: f64) -> RunSettings {
    RunSettings {
        probes: ProbeSettings::default(),
        fps: FPS,
        latency_s: Some(0.0),
        hold_s: 0.0,
        going_on: coordinator::GoingOn::default(),
        seconds: Some(seconds),
        lock_step: true,
        ask_every: AskEvery::Frame,
        reuse_within_m: 0.0,
        connect_timeout: Duration::from_secs(30),
    }
}

pub async fn play(
    film: Film,
    scene: &Scene,
    settings: RunSettings,
    stop: impl Future<Output = ()>,
) -> (Vec<Step>, Figures) {
    let observers = film.observers.clone();
    let transport = Transport::in_process(Box::new(RingFrames(film)));
    play_over(transport, observers, scene, settings, (Keeper::default(), stop)).await
}

pub async fn play_over(
    transport: Transport,
    observers: Vec<Arc<Observer>>,
    scene: &Scene,
    settings: RunSettings,
    (keeper, stop): (Keeper, impl Future<Output = ()>),
) -> (Vec<Step>, Figures) {
    let kept = Arc::clone(&keeper.steps);
    let run = Coordinator::new(transport, world(scene), observers, settings).with_recorder(Box::new(keeper));
    let (figures, _) = run.run(&mut Quiet, stop).await.expect("runs");
    let steps = std::mem::take(&mut *kept.lock().expect("whole"));
    (steps, figures)
}

/// The fastest body of some steps, m/s; all numbers are numbers.
pub fn fastest_m_s(steps: &[Step]) -> f64 {
    let numbers = steps.iter().flat_map(|step| step.positions_m.iter().chain(&step.velocities_m_s));
    assert!(numbers.into_iter().flatten().all(|number| number.is_finite()));
    let speeds = steps.iter().flat_map(|step| &step.velocities_m_s).map(Vector3::norm);
    speeds.fold(0.0, f64::max)
}

/// The farthest that a body moved between the first and any other of these steps, metres.
pub fn farthest_m(steps: &[Step]) -> f64 {
    let moved = |step: &Step| {
        let pairs = step.positions_m.iter().zip(&steps[0].positions_m);
        pairs.map(|(now, before)| (now - before).norm()).fold(0.0, f64::max)
    };
    steps.iter().map(moved).fold(0.0, f64::max)
}

/// The steps from a film time on.
pub fn since(steps: &[Step], film_s: f64) -> &[Step] {
    &steps[steps.partition_point(|step| step.film_s < film_s - 1e-9)..]
}

/// The steps between two film times.
pub fn between(steps: &[Step], from_s: f64, to_s: f64) -> &[Step] {
    let rest = since(steps, from_s);
    &rest[..rest.len() - since(rest, to_s).len()]
}
