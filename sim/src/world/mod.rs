//! The world: bodies, and one step of all of them with the hull's answers applied (paper §3).
//!
//! Step k (counted from 1) ends at k · dt. The caller asks the hull about the bodies as they are before
//! the step, with the film of the step's end, and hands in the answers; the step applies them and then
//! lets the solver move all bodies by dt.

mod commands;
mod foresight;
mod limits;
mod settings;
mod snapshot;
mod step;
#[cfg(test)]
mod tests;

pub use commands::{BodyId, CommandError, Parameters, PreparedBody};
pub use limits::{LimitError, MAX_PAIRS, MAX_SAMPLES};
pub use settings::{WorldError, WorldSettings};
pub use snapshot::{BodySnapshot, WorldSnapshot};
pub use step::{Fault, FaultKind, StepReport};

use crate::response::{HullPatch, ResponseMode};
use crate::scene::{BodySpec, MassSpec, Scene};
use crate::solid::Solid;
use crate::solver::{Solver, TrueSolids};
use crate::summary::BodySummary;
use crate::trajectory::{Trajectory, TrajectoryDigest};
use commands::BodySamples;
use hull::faces::FaceNormals;
use hull::{Pose, Shape};
use limits::{SampleCount, check_pairs};
use nalgebra::Vector3;
use std::sync::Arc;

/// One body as it is now, with what a renderer needs.
#[derive(Clone, Debug)]
pub struct Body {
    /// Counts all bodies that there ever were in the world: none is given twice.
    pub id: BodyId,
    /// Unique in the world.
    pub name: String,
    /// Its samples; bodies of the same solid share one shape.
    pub shape: Arc<Shape>,
    /// What the hull is asked about: the samples, and under [`ResponseMode::Contacts`](crate::ResponseMode::Contacts) after them an offset sample of each.
    pub probes: Arc<Shape>,
    /// Points around it that tell how surfaces slide; `None` where that is not used.
    pub around: Option<Arc<Shape>>,
    /// Which way its surface faces at the samples; `None` where that is not used.
    pub faces: Option<Arc<FaceNormals>>,
    /// Its geometry, body frame.
    pub solid: Solid,
    /// sRGB, 0 to 1.
    pub color: [f32; 3],
    /// Whether it never moves; such bodies have no part in the responses.
    pub fixed: bool,
    /// How heavy it is.
    pub mass: MassSpec,
    /// Coulomb friction coefficient.
    pub friction: f64,
    /// Share of the speed that a bounce returns.
    pub restitution: f64,
    /// Where it is, world from body: the solver's numbers, widened.
    pub pose: Pose,
    /// Velocity of its origin in the world, m/s.
    pub velocity_m_s: [f64; 3],
    /// Angular velocity in the world, rad/s.
    pub spin_rad_s: [f64; 3],
}

impl Body {
    /// Its samples and the points around it, about which nodes are asked.
    pub fn asked_shapes(&self) -> impl Iterator<Item = Arc<Shape>> {
        [Some(&self.probes), self.around.as_ref()].into_iter().flatten().map(Arc::clone)
    }
}

/// All bodies of a scene and the solver that moves them.
pub struct World {
    scene: Scene,
    /// What it was made with.
    start: WorldSettings,
    /// What holds now.
    settings: WorldSettings,
    answers_hull: bool,
    gravity_m_s2: [f64; 3],
    up: Vector3<f64>,
    solver: Solver,
    true_solids: TrueSolids,
    bodies: Vec<Body>,
    summaries: Vec<BodySummary>,
    next_id: BodyId,
    /// Indices of the bodies that are not fixed.
    moving: Vec<usize>,
    trajectory: Trajectory,
    steps: u64,
}

impl World {
    /// The scene's bodies at time 0. Fails on settings that cannot be, on geometry that the solver or the sampling does
    /// not take, and on more than a world may hold.
    pub fn new(scene: &Scene, settings: WorldSettings) -> Result<World, WorldError> {
        let specs = scene.bodies(settings.seed);
        let mut world = World::without_bodies(scene, settings, &specs)?;
        let mut count = SampleCount::default();
        for spec in specs {
            let samples = world.samples_of(&spec)?;
            count.admit(&spec, &samples)?;
            world.take_in(spec, samples);
        }
        world.trajectory.add(world.bodies.iter().map(|body| &body.pose));
        Ok(world)
    }

    /// A world whose solver has bodies that it has still to take in.
    fn without_bodies(
        scene: &Scene,
        settings: WorldSettings,
        specs: &[BodySpec],
    ) -> Result<World, WorldError> {
        settings.check()?;
        check_pairs(specs.iter())?;
        let solver = Solver::new(scene, specs, settings.dt_s, settings.covering_radius_m)
            .map_err(|index| WorldError::Solid { body: specs[index].name.clone() })?;
        Ok(World {
            scene: scene.clone(),
            start: settings,
            settings,
            answers_hull: true,
            gravity_m_s2: scene.gravity_m_s2(),
            up: scene.up().into(),
            solver,
            true_solids: TrueSolids::default(),
            bodies: vec![],
            summaries: vec![],
            next_id: 0,
            moving: vec![],
            trajectory: Trajectory::default(),
            steps: 0,
        })
    }

    /// Takes in the body that the solver has next.
    fn take_in(&mut self, spec: BodySpec, samples: BodySamples) {
        let BodySamples { shape, probes, around, faces } = samples;
        let index = self.bodies.len();
        // The pose as the solver has it, so that what is asked and what is stepped are the same.
        let pose = self.solver.state(index).pose().unwrap_or(spec.pose);
        self.summaries.push(BodySummary::new(&spec.name, pose));
        if !spec.fixed {
            self.moving.push(index);
        }
        self.bodies.push(Body {
            id: self.next_id,
            name: spec.name,
            shape,
            probes,
            around,
            faces,
            solid: spec.solid,
            color: spec.color,
            fixed: spec.fixed,
            mass: spec.mass,
            friction: spec.friction,
            restitution: spec.restitution,
            pose,
            velocity_m_s: spec.velocity_m_s,
            spin_rad_s: [0.0; 3],
        });
        self.next_id += 1;
    }

    /// What it began as.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// Every body as it is now, fixed ones too, in the order in which they came: ids ascend.
    pub fn bodies(&self) -> &[Body] {
        &self.bodies
    }

    /// The bodies that are not fixed: the hull is asked about these, and responses come in this order.
    pub fn moving_bodies(&self) -> impl ExactSizeIterator<Item = &Body> {
        self.moving.iter().map(|&index| &self.bodies[index])
    }

    /// All shapes that nodes are asked about. Some may be there more than once.
    pub fn asked_shapes(&self) -> impl Iterator<Item = Arc<Shape>> {
        let by_contacts = self.settings.response == ResponseMode::Contacts;
        let grid = by_contacts.then(hull::surface::grid);
        self.moving_bodies().flat_map(Body::asked_shapes).chain(grid)
    }

    /// The hull's surface at the bodies after the last step, at most [`MAX_PATCHES`](crate::MAX_PATCHES) a body, in their
    /// order; nothing but under [`ResponseMode::Contacts`](crate::ResponseMode::Contacts).
    pub fn patches(&self) -> impl Iterator<Item = HullPatch> {
        self.moving.iter().flat_map(|&index| self.solver.patches_of(index))
    }

    /// What every body did so far, in the order of [`World::bodies`].
    pub fn summaries(&self) -> &[BodySummary] {
        &self.summaries
    }

    /// The hash over every pose so far.
    pub fn digest(&self) -> TrajectoryDigest {
        self.trajectory.digest()
    }

    /// What holds for the world: what it was made with, but for what was set since.
    pub fn settings(&self) -> &WorldSettings {
        &self.settings
    }

    /// The unit vector against the scene's gravity.
    pub fn up(&self) -> [f64; 3] {
        self.up.into()
    }

    /// How many steps were made.
    pub fn steps(&self) -> u64 {
        self.steps
    }

    /// The end of the last step, seconds.
    pub fn time_s(&self) -> f64 {
        self.steps as f64 * self.settings.dt_s
    }

    /// The end of the next step, seconds: the film of this instant answers for it.
    pub fn next_time_s(&self) -> f64 {
        (self.steps + 1) as f64 * self.settings.dt_s
    }
}
