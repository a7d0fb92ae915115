//! A run of a scene over a film, and what became of its bodies step by step.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use coordinator::hooks::{EndRecord, FrameRecord, Recorder, StepRecord};
use coordinator::{AskEvery, Coordinator, Figures, Progress, RunSettings, Snapshot, Transport, Watcher};
use hull::{Pose, ProbeSettings};
use nalgebra::{Point3, Quaternion, UnitQuaternion, Vector3};
use sim::{Body, Scene, World, WorldSettings};

use super::film::{Showing, StageFilm};
use super::response::Response;
use cli::{Failure, Outcome};

/// What a run is of.
#[derive(Clone, Copy)]
pub struct RunPlan<'a> {
    /// What is filmed.
    pub film: &'a Arc<StageFilm>,
    /// The bodies.
    pub scene: &'a Scene,
    /// How they answer the hull.
    pub response: Response,
    /// The share of outline pixels that flicker.
    pub flicker: f64,
    /// Which flicker, and which world.
    pub seed: u64,
    /// How much film.
    pub seconds: f64,
}

/// A run that is over.
pub struct Track {
    /// The moving bodies, in their order.
    pub names: Vec<String>,
    /// Every step.
    pub steps: Vec<TrackStep>,
    /// What the coordinator counted.
    pub figures: Figures,
}

/// What holds at the end of a step.
pub struct TrackStep {
    /// The film's time, seconds.
    pub film_s: f64,
    /// The moving bodies.
    pub bodies: Vec<BodyAt>,
}

/// A body at the end of a step.
#[derive(Clone, Copy)]
pub struct BodyAt {
    /// Where it is.
    pub pose: Pose,
    /// How fast its middle moves, m/s; of one that sleeps nothing moves.
    pub speed_m_s: f64,
    /// How fast it turns, rad/s.
    pub spin_rad_s: f64,
    /// Whether it lies still to the bit.
    pub sleeps: bool,
    /// How deep its deepest sample was in the hull before the step, metres; zero outside.
    pub depth_m: f64,
}

impl BodyAt {
    /// Its middle, world, metres.
    pub fn place(&self) -> Point3<f64> {
        Point3::from(self.pose.position_m())
    }

    /// How far it is turned from another pose, degrees.
    pub fn turned_deg(&self, from: &BodyAt) -> f64 {
        turn(self).angle_to(&turn(from)).to_degrees()
    }

    /// How far its upright axis leans, degrees.
    pub fn lean_deg(&self) -> f64 {
        (self.pose.rotation() * Vector3::y()).angle(&Vector3::y()).to_degrees()
    }
}

fn turn(body: &BodyAt) -> UnitQuaternion<f64> {
    let [x, y, z, w] = body.pose.rotation_xyzw();
    UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z))
}

/// Receives the steps.
struct Keeper(Arc<Mutex<Vec<TrackStep>>>);

impl Recorder for Keeper {
    fn frame(&mut self, _: FrameRecord<'_>) {}

    fn step(&mut self, record: &StepRecord<'_>) {
        let body = |(index, body): (usize, &Body)| {
            let touches = record.results.map_or(&[][..], |results| &results[index].touches);
            let inside = touches.iter().filter(|touch| touch.is_inside()).filter_map(|touch| touch.exit_m);
            let speed_m_s = Vector3::from(body.velocity_m_s).norm();
            BodyAt {
                pose: body.pose,
                speed_m_s,
                spin_rad_s: Vector3::from(body.spin_rad_s).norm(),
                sleeps: speed_m_s == 0.0 && body.spin_rad_s == [0.0; 3],
                depth_m: f64::from(inside.fold(0.0, f32::max)),
            }
        };
        let bodies = record.world.moving_bodies().enumerate().map(body).collect();
        let mut steps = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        steps.push(TrackStep { film_s: record.film_s, bodies });
    }

    fn end(&mut self, _: &EndRecord<'_>) {}
}

struct Nobody;

impl Watcher for Nobody {
    fn progress(&mut self, _: &Progress) {}

    fn wants_snapshot(&mut self, _: f64) -> bool {
        false
    }

    fn snapshot(&mut self, _: Snapshot<'_>) {}
}

impl Track {
    /// Makes a run, as fast as it goes.
    pub fn of(plan: RunPlan<'_>) -> Outcome<Track> {
        let RunPlan { film, scene, response, flicker, seed, seconds } = plan;
        let mode = response.mode();
        let settings = WorldSettings { seed, response: mode, ..WorldSettings::default() }.on(scene.hull());
        let world = World::new(scene, settings).map_err(Failure::input)?;
        let names = world.moving_bodies().map(|body| body.name.clone()).collect();
        let steps = Arc::new(Mutex::new(Vec::new()));
        let run = RunSettings {
            probes: ProbeSettings::default(),
            fps: film.stage.fps,
            latency_s: 0.0,
            hold_s: 0.0,
            seconds: Some(seconds),
            lock_step: true,
            ask_every: AskEvery::Frame,
            reuse_within_m: 0.0,
            connect_timeout: Duration::from_secs(1),
        };
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
        let (figures, _) = runtime.map_err(Failure::run)?.block_on(async {
            let transport = Transport::in_process(Box::new(Showing::new(film, flicker, seed)));
            Coordinator::new(transport, world, film.observers.clone(), run)
                .with_recorder(Box::new(Keeper(Arc::clone(&steps))))
                .with_altered(response.alter())
                .run(&mut Nobody, std::future::pending())
                .await
                .map_err(Failure::run)
        })?;
        if let Some(why) = &figures.film_failure {
            return Err(Failure::run(why));
        }
        let steps = std::mem::take(&mut *steps.lock().unwrap_or_else(PoisonError::into_inner));
        Ok(Track { names, steps, figures })
    }

    /// The steps from a time of the film on.
    pub fn since(&self, film_s: f64) -> &[TrackStep] {
        &self.steps[self.steps.partition_point(|step| step.film_s < film_s)..]
    }

    /// The steps between two times of the film.
    pub fn between(&self, from_s: f64, to_s: f64) -> &[TrackStep] {
        let steps = self.since(from_s);
        &steps[..steps.partition_point(|step| step.film_s <= to_s)]
    }

    /// The place of a body in each step.
    pub fn index(&self, name: &str) -> Option<usize> {
        self.names.iter().position(|known| known == name)
    }
}
