//! A run of a scene over a film, and what became of its bodies step by step.

use std::sync::Arc;
use std::time::Duration;

use coordinator::hooks::{EndRecord, FrameRecord, Recorder, StepRecord};
use coordinator::{AskEvery, Coordinator, LocalFrames, Progress, RunSettings, Snapshot, Transport, Watcher};
use hull::{Observer, Pose, ProbeSettings};
use nalgebra::{Point3, Quaternion, UnitQuaternion, Vector3};
use parking_lot::Mutex;
use setup::cli::{Failure, Outcome};
use setup::{ClusterFile, InProcess, RingFrames};
use sim::{Body, BodyId, BodyResponse, BodySpec, Scene, World, WorldSettings};
use stage::{StageSettings, Truth};

use super::film::{Showing, StageFilm};
use super::response::Response;
use super::solids::TrueSolids;
use crate::random::Random;

/// The scene whose bodies are to fall each by itself.
pub const DROPS: &str = "drops";
/// The seed by which bodies are placed before their starts are moved: that of the run whose starts are not.
const PLACED: u64 = 1;
/// How far a start is moved, metres.
pub const MOVED_M: f64 = 1e-3;

/// What a run is of.
#[derive(Clone, Copy)]
pub struct RunPlan<'a> {
    /// The bodies.
    pub scene: &'a Scene,
    /// How they answer the hull.
    pub response: Response,
    /// Which world, and whose starts are moved.
    pub seed: u64,
    /// Whether every body starts a millimetre from its place, in a direction of the seed's.
    pub is_moved: bool,
    /// Length of the film, seconds.
    pub seconds: f64,
    /// Bodies beside the scene's.
    pub guests: &'a [BodySpec],
    /// On true solids each step is made of so many: what is fast passes through what is thin.
    pub substeps: u32,
}

/// What the bodies of a run meet.
pub enum Film {
    /// The studio as its cameras see it, with a share of outline pixels that flicker.
    Studio(Arc<StageFilm>, f64),
    /// The studio's true solids.
    Solids(StageSettings),
    /// A recording.
    Recording(Box<ClusterFile>),
}

/// A run that is over.
pub struct Track {
    /// The moving bodies, in their order.
    pub names: Vec<String>,
    /// How far each reaches along its axes, metres.
    pub reaches_m: Vec<[f64; 3]>,
    /// Every step.
    pub steps: Vec<TrackStep>,
    /// How often the hull was asked; no number where there is none.
    pub passes_a_frame: f64,
}

/// What holds at the end of a step.
pub struct TrackStep {
    /// The moment of the film at which the hull is met, seconds.
    pub film_s: f64,
    /// The moving bodies.
    pub bodies: Vec<BodyAt>,
}

/// A body at the end of a step.
#[derive(Clone, Copy)]
pub struct BodyAt {
    /// Where it is.
    pub pose: Pose,
    /// How its origin moves, world, m/s; of one that sleeps nothing moves.
    pub velocity_m_s: Vector3<f64>,
    /// How fast it turns, rad/s.
    pub spin_rad_s: f64,
    /// Whether it lies still to the bit.
    pub sleeps: bool,
    /// How deep its deepest sample was in the hull before the step, metres; zero outside.
    pub depth_m: f64,
}

impl BodyAt {
    fn of(body: &Body, depth_m: f64) -> BodyAt {
        BodyAt {
            pose: body.pose,
            velocity_m_s: body.velocity_m_s.into(),
            spin_rad_s: Vector3::from(body.spin_rad_s).norm(),
            sleeps: body.velocity_m_s == [0.0; 3] && body.spin_rad_s == [0.0; 3],
            depth_m,
        }
    }

    /// How fast its origin moves, m/s.
    pub fn speed_m_s(&self) -> f64 {
        self.velocity_m_s.norm()
    }

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
            let deepest_m = record.collisions.and_then(|collisions| collisions[index].deepest_m());
            BodyAt::of(body, f64::from(deepest_m.unwrap_or(0.0)))
        };
        let bodies = record.world.moving_bodies().enumerate().map(body).collect();
        let mut steps = self.0.lock();
        steps.push(TrackStep { film_s: record.film_s, bodies });
    }

    fn end(&mut self, _: &EndRecord<'_>) {}
}

struct NoWatcher;

impl Watcher for NoWatcher {
    fn progress(&mut self, _: &Progress) {}

    fn wants_snapshot(&mut self, _: f64) -> bool {
        false
    }

    fn snapshot(&mut self, _: Snapshot<'_>) {}
}

impl Track {
    /// Makes a run, as fast as it goes.
    pub fn of(film: &Film, plan: RunPlan<'_>) -> Outcome<Track> {
        match film {
            Film::Solids(stage) => Track::over_solids(stage, plan),
            Film::Studio(film, flicker) => {
                let showing = Showing::new(film, *flicker, plan.seed);
                let frames = Box::new(RingFrames(showing.telling_speeds(plan.response.tells_speeds())));
                let setup = (ProbeSettings::default(), film.stage.fps, film.observers.clone());
                Track::over_film(frames, setup, plan)
            }
            Film::Recording(file) => {
                let cameras = file.rig_config(false)?;
                let frames = Box::new(InProcess::prepare(&cameras)?);
                Track::over_film(frames, (file.probes, file.fps, cameras.observers()), plan)
            }
        }
    }

    fn over_film(
        frames: Box<dyn LocalFrames>,
        (probes, fps, observers): (ProbeSettings, f64, Vec<Arc<Observer>>),
        plan: RunPlan<'_>,
    ) -> Outcome<Track> {
        let world = plan.world(1)?;
        let (names, reaches_m) = (names(&world), reaches_m(&world));
        let steps = Arc::new(Mutex::new(Vec::new()));
        let run = RunSettings {
            probes,
            fps,
            latency_s: Some(0.0),
            hold_s: 0.0,
            going_on: coordinator::GoingOn::default(),
            seconds: Some(plan.seconds),
            lock_step: true,
            ask_every: AskEvery::Frame,
            reuse_within_m: 0.0,
            connect_timeout: Duration::from_secs(1),
        };
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
        let (figures, _) = runtime.map_err(Failure::run)?.block_on(async {
            Coordinator::new(Transport::in_process(frames), world, observers, run)
                .with_recorder(Box::new(Keeper(Arc::clone(&steps))))
                .with_altered(plan.response.alter())
                .run(&mut NoWatcher, std::future::pending())
                .await
                .map_err(Failure::run)
        })?;
        if let Some(why) = &figures.film_failure {
            return Err(Failure::run(why));
        }
        let mut steps = std::mem::take(&mut *steps.lock());
        let later_s = plan.response.hull_time().frames_later() / fps;
        steps.iter_mut().for_each(|step| step.film_s -= later_s);
        let passes_a_frame = figures.counts.passes.asked as f64 / figures.counts.frames.max(1) as f64;
        Ok(Track { names, reaches_m, steps, passes_a_frame })
    }

    /// No hull is asked: the bodies stand on the studio's solids.
    fn over_solids(stage: &StageSettings, plan: RunPlan<'_>) -> Outcome<Track> {
        let mut world = plan.world(plan.substeps)?;
        let (names, reaches_m) = (names(&world), reaches_m(&world));
        let untouched = vec![BodyResponse::UNTOUCHED; world.moving_bodies().len()];
        let (mut solids, mut steps) = (TrueSolids::default(), Vec::new());
        while world.next_time_s() <= plan.seconds + 1e-9 {
            let film_s = world.next_time_s();
            world.set_true_solids(&solids.at(stage, film_s)?).map_err(Failure::run)?;
            let is_kept = (world.steps() + 1).is_multiple_of(u64::from(plan.substeps));
            let depths_m: Vec<f64> = if is_kept {
                let truth = Truth::new(stage, film_s);
                world.moving_bodies().map(|body| depth_m(body, &truth)).collect()
            } else {
                Vec::new()
            };
            world.step(&untouched).map_err(Failure::run)?;
            if !is_kept {
                continue;
            }
            let bodies = world.moving_bodies().zip(depths_m);
            steps.push(TrackStep {
                film_s,
                bodies: bodies.map(|(body, depth_m)| BodyAt::of(body, depth_m)).collect(),
            });
        }
        Ok(Track { names, reaches_m, steps, passes_a_frame: f64::NAN })
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

impl RunPlan<'_> {
    /// The scene's bodies as they start, in a world that makes so many steps of each.
    fn world(&self, substeps: u32) -> Outcome<World> {
        let RunPlan { scene, response, seed, is_moved, guests, .. } = *self;
        let (hull_time, response) = (response.hull_time(), response.mode());
        let dt_s = WorldSettings::default().dt_s / f64::from(substeps);
        let settings = WorldSettings { dt_s, seed, response, hull_time, ..WorldSettings::default() };
        let mut world = World::new(scene, settings.on(scene.hull())).map_err(Failure::input)?;
        if scene.name() == DROPS {
            // One a run: another that strikes it would give it energy.
            let ids: Vec<BodyId> = world.moving_bodies().map(|body| body.id).collect();
            let chosen = (seed % ids.len() as u64) as usize;
            let others = ids.iter().enumerate().filter(|&(index, _)| index != chosen);
            others.into_iter().try_for_each(|(_, &id)| world.remove(id)).map_err(Failure::run)?;
        }
        if is_moved {
            let ids: Vec<BodyId> = world.bodies().iter().map(|body| body.id).collect();
            ids.into_iter().try_for_each(|id| world.remove(id)).map_err(Failure::run)?;
            let mut random = Random::new(seed);
            for mut spec in scene.bodies(PLACED) {
                let [x, z] = random.unit().map(|share: f64| share * MOVED_M);
                if !spec.fixed {
                    spec.pose = spec.pose.moved([x, 0.0, z]);
                }
                let prepared = world.prepare(spec).map_err(Failure::run)?;
                world.spawn(prepared).map_err(Failure::run)?;
            }
        }
        for guest in guests {
            let prepared = world.prepare(guest.clone()).map_err(Failure::run)?;
            world.spawn(prepared).map_err(Failure::run)?;
        }
        Ok(world)
    }
}

fn names(world: &World) -> Vec<String> {
    world.moving_bodies().map(|body| body.name.clone()).collect()
}

fn reaches_m(world: &World) -> Vec<[f64; 3]> {
    let axes = [Vector3::x(), Vector3::y(), Vector3::z()];
    world.moving_bodies().map(|body| axes.map(|axis| body.solid.reach_m(axis))).collect()
}

/// How deep the deepest sample of a body is in what truly stands there, metres; zero outside.
fn depth_m(body: &Body, truth: &Truth) -> f64 {
    let world = body.pose.world_from_body();
    let depths = body.shape.samples_body().iter().map(|&sample| -truth.signed_distance_m(&world(sample)));
    depths.fold(0.0, f64::max)
}
