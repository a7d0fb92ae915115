//! What others may do to a world between two steps. Each does all or nothing, and the same commands at the
//! same steps give the same world, bit for bit.

use super::limits::{LimitError, Placed, SampleCount, check_pairs};
use super::{Body, World, WorldError, WorldSettings};
use crate::response::ResponseMode;
use crate::samples::{self, normals};
use crate::scene::{
    BodySpec, MAX_BODIES, MAX_GRAVITY_M_S2, MAX_POSITION_M, MAX_SPEED_M_S, Scene, ValueError, all_within,
    check_speed, wrong,
};
use crate::solid::Solid;
use crate::solver::Surface;
use hull::contact::OFFSET_M;
use hull::faces::FaceNormals;
use hull::{Pose, Shape};
use nalgebra::Vector3;
use std::sync::Arc;
use thiserror::Error;

/// A body's number: unique within a world, never given twice.
pub type BodyId = u32;

/// A grip or a push may lie this far off the body's bounding ball, metres: pages point at where it was.
const BESIDE_M: f64 = 0.5;

/// Why a command did nothing. Every message is one line.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum CommandError {
    /// No such body, any more or yet.
    #[error("there is no body {0}")]
    NoSuchBody(BodyId),
    /// A body that never moves.
    #[error("body `{0}` is fixed and never moves")]
    Fixed(String),
    /// A value that cannot be.
    #[error(transparent)]
    Value(#[from] ValueError),
    /// More than a world may hold.
    #[error(transparent)]
    Limit(#[from] LimitError),
    /// Geometry that the solver or the sampling refuses.
    #[error(transparent)]
    World(#[from] WorldError),
}

/// A body that is checked and sampled, ready for the world that prepared it.
#[derive(Clone, Debug)]
pub struct PreparedBody {
    spec: BodySpec,
    samples: BodySamples,
}

/// A body's samples, and what the hull is asked about.
#[derive(Clone, Debug)]
pub(super) struct BodySamples {
    pub shape: Arc<Shape>,
    pub probes: Arc<Shape>,
    pub around: Option<Arc<Shape>>,
    pub faces: Option<Arc<FaceNormals>>,
}

impl BodySamples {
    pub fn asked_shapes(&self) -> impl Iterator<Item = Arc<Shape>> {
        [Some(&self.probes), self.around.as_ref()].into_iter().flatten().map(Arc::clone)
    }
}

/// What may be changed while a world runs; `None` leaves it as it is.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Parameters {
    /// Whether bodies answer the hull at all.
    pub answers_hull: Option<bool>,
    /// The share of the speed into the hull that is mirrored, within [`RESTITUTION`](crate::RESTITUTION).
    pub hull_restitution: Option<f64>,
    /// Coulomb friction of the hull, within [`FRICTION`](crate::FRICTION).
    pub hull_friction: Option<f64>,
    /// World, m/s², within ±100 along each axis.
    pub gravity_m_s2: Option<[f64; 3]>,
}

impl PreparedBody {
    /// What is to be registered with the nodes before it is asked about. A fixed body never is.
    pub fn asked_shapes(&self) -> impl Iterator<Item = Arc<Shape>> {
        self.samples.asked_shapes().filter(|_| !self.spec.fixed)
    }
}

impl World {
    /// Checks a body and samples it. A body without a name gets one; a name that is taken is refused.
    pub fn prepare(&self, mut spec: BodySpec) -> Result<PreparedBody, CommandError> {
        let found = self.bodies.len() + 1;
        if found > MAX_BODIES {
            return Err(LimitError::Bodies { found }.into());
        }
        let is_taken = |name: &str| self.bodies.iter().any(|body| body.name == name);
        if spec.name.is_empty() {
            let mut names = (self.next_id..).map(|number| format!("{}_{number}", spec.solid.kind()));
            spec.name = names.find(|name| !is_taken(name)).unwrap_or_default();
        } else if is_taken(&spec.name) {
            return Err(wrong("name", format_args!("`{}`", spec.name), "one that no body has").into());
        }
        all_within("position", &spec.pose.position_m(), -MAX_POSITION_M..=MAX_POSITION_M)?;
        check_speed(spec.velocity_m_s)?;
        let samples = self.samples_of(&spec)?;
        SampleCount::of(&self.bodies).admit(&spec, &samples)?;
        let placed: Vec<Placed<'_>> =
            self.bodies.iter().map(Into::into).chain([Placed::from(&spec)]).collect();
        check_pairs(placed.iter().copied())?;
        Ok(PreparedBody { spec, samples })
    }

    /// Puts a body into the world.
    pub fn spawn(&mut self, prepared: PreparedBody) -> Result<BodyId, CommandError> {
        let PreparedBody { spec, samples } = prepared;
        if self.solver.add(&spec).is_none() {
            return Err(WorldError::Solid { body: spec.name }.into());
        }
        let id = self.next_id;
        self.take_in(spec, samples);
        if let Some(body) = self.bodies.last() {
            self.trajectory.add_body(id, &body.pose);
        }
        Ok(id)
    }

    /// Takes a body away.
    pub fn remove(&mut self, id: BodyId) -> Result<(), CommandError> {
        let index = self.index_of(id)?;
        self.solver.remove(index);
        self.bodies.remove(index);
        self.summaries.remove(index);
        self.moving = (0..self.bodies.len()).filter(|&index| !self.bodies[index].fixed).collect();
        self.trajectory.remove_body(id);
        Ok(())
    }

    /// Pushes a body, N s, at a point of the world on or near it, metres, or at its centre of mass.
    pub fn push(
        &mut self,
        id: BodyId,
        impulse_n_s: [f64; 3],
        at_m: Option<[f64; 3]>,
    ) -> Result<(), CommandError> {
        let index = self.moving_index(id)?;
        let most_n_s = self.solver.mass_kg(index) * MAX_SPEED_M_S;
        let found_n_s = Vector3::from(impulse_n_s).norm();
        if found_n_s.is_nan() || found_n_s > most_n_s {
            let expected = format!("at most {most_n_s:.3} N s for a body of this mass");
            return Err(wrong("impulse", format_args!("{found_n_s} N s"), expected).into());
        }
        if let Some(at_m) = at_m {
            let body = &self.bodies[index];
            near("at", Vector3::from(at_m) - Vector3::from(body.pose.position_m()), body)?;
        }
        self.solver.push(index, impulse_n_s, at_m);
        self.bodies[index].velocity_m_s = self.solver.state(index).velocity_m_s.map(f64::from);
        Ok(())
    }

    /// Holds a body by a point of it (body frame) and draws that point to a target (world), metres, until it
    /// is let go; held again, it starts from the new point.
    pub fn grab(
        &mut self,
        id: BodyId,
        grip_body_m: [f64; 3],
        target_m: [f64; 3],
    ) -> Result<(), CommandError> {
        let index = self.moving_index(id)?;
        near("grip", Vector3::from(grip_body_m), &self.bodies[index])?;
        all_within("target", &target_m, -MAX_POSITION_M..=MAX_POSITION_M)?;
        self.solver.hold(index, grip_body_m, target_m);
        Ok(())
    }

    /// Lets a body go. It keeps the velocity it has, or is thrown with another, m/s. A body that is not held
    /// may be thrown, too.
    pub fn release(&mut self, id: BodyId, velocity_m_s: Option<[f64; 3]>) -> Result<(), CommandError> {
        let index = self.moving_index(id)?;
        if let Some(velocity_m_s) = velocity_m_s {
            check_speed(velocity_m_s)?;
            self.solver.set_velocity(index, velocity_m_s);
            self.bodies[index].velocity_m_s = velocity_m_s;
        }
        self.solver.let_go(index);
        Ok(())
    }

    /// Sets parameters: all of them, or none if one cannot be.
    pub fn set(&mut self, set: Parameters) -> Result<(), CommandError> {
        let mut settings = self.settings;
        settings.mirror_restitution = set.hull_restitution.unwrap_or(settings.mirror_restitution);
        settings.hull_friction = set.hull_friction.unwrap_or(settings.hull_friction);
        settings.check()?;
        if let Some(gravity_m_s2) = set.gravity_m_s2 {
            all_within("gravity", &gravity_m_s2, -MAX_GRAVITY_M_S2..=MAX_GRAVITY_M_S2)?;
            self.gravity_m_s2 = gravity_m_s2;
            self.solver.set_gravity(gravity_m_s2);
        }
        self.settings = settings;
        self.answers_hull = set.answers_hull.unwrap_or(self.answers_hull);
        Ok(())
    }

    /// Puts solids, each at its pose in the world, where they are at the end of the next step: bodies meet them as they
    /// meet the hull, and they move as they are told. They are no bodies. Those of before that
    /// are not given are taken away; one of another form takes its predecessor's place at once. For experiments that compare the hull with what truly stands there.
    pub fn set_true_solids(&mut self, solids: &[(Solid, Pose)]) -> Result<(), WorldError> {
        let WorldSettings { mirror_restitution: restitution, hull_friction: friction, .. } = self.settings;
        let surface = Surface { friction, restitution };
        let placed = self.solver.place_true_solids(&mut self.true_solids, solids, surface);
        placed.map_err(|index| WorldError::Solid { body: format!("true solid {index}") })
    }

    /// Every parameter as it is.
    pub fn parameters(&self) -> Parameters {
        Parameters {
            answers_hull: Some(self.answers_hull),
            hull_restitution: Some(self.settings.mirror_restitution),
            hull_friction: Some(self.settings.hull_friction),
            gravity_m_s2: Some(self.gravity_m_s2),
        }
    }

    /// The same scene from its start, with all that it was made with.
    pub fn again(&self) -> Result<World, WorldError> {
        World::new(&self.scene, self.start)
    }

    /// Another scene, with the same seed and length of a step.
    pub fn with_scene(&self, scene: &Scene) -> Result<World, WorldError> {
        World::new(scene, self.start.on(scene.hull()))
    }

    /// A body.
    pub fn body(&self, id: BodyId) -> Option<&Body> {
        self.index_of(id).ok().map(|index| &self.bodies[index])
    }

    /// Whether a body is held.
    pub fn is_grabbed(&self, id: BodyId) -> bool {
        self.index_of(id).is_ok_and(|index| self.solver.is_held(index))
    }

    /// Whether the solver has put a body to sleep, because it lies still; never true of fixed ones.
    pub fn is_asleep(&self, id: BodyId) -> bool {
        self.moving_index(id).is_ok_and(|index| self.solver.sleeps(index))
    }

    fn index_of(&self, id: BodyId) -> Result<usize, CommandError> {
        self.bodies.binary_search_by_key(&id, |body| body.id).map_err(|_| CommandError::NoSuchBody(id))
    }

    fn moving_index(&self, id: BodyId) -> Result<usize, CommandError> {
        let index = self.index_of(id)?;
        let body = &self.bodies[index];
        if body.fixed { Err(CommandError::Fixed(body.name.clone())) } else { Ok(index) }
    }

    /// The samples of a solid; bodies of equal ones share them.
    pub(super) fn samples_of(&self, spec: &BodySpec) -> Result<BodySamples, WorldError> {
        if let Some(body) = self.bodies.iter().find(|body| body.solid == spec.solid) {
            let Body { shape, probes, around, faces, .. } = body.clone();
            return Ok(BodySamples { shape, probes, around, faces });
        }
        let refused = |source| WorldError::Samples { body: spec.name.clone(), source };
        let shape = samples::shape(&spec.solid, self.settings.covering_radius_m).map_err(refused)?;
        let shape = Arc::new(shape);
        if self.settings.response == ResponseMode::Paper {
            return Ok(BodySamples { probes: Arc::clone(&shape), shape, around: None, faces: None });
        }
        let faces = normals::face_normals(&spec.solid, &shape);
        let probes = normals::with_offset_samples(&faces, &shape, OFFSET_M).map_err(refused)?;
        let around = Shape::new(samples::cloud(&shape).collect()).map_err(refused)?;
        let (probes, around) = (Arc::new(probes), Some(Arc::new(around)));
        Ok(BodySamples { shape, probes, around, faces: Some(Arc::new(faces)) })
    }
}

/// Whether a point (from the body's origin) is one of the body, or nearly.
fn near(key: &str, from_origin_m: Vector3<f64>, body: &Body) -> Result<(), ValueError> {
    let (found_m, most_m) = (from_origin_m.norm(), body.solid.radius_m() + BESIDE_M);
    if found_m <= most_m {
        return Ok(());
    }
    let expected = format!("at most {most_m:.2} m for body `{}`", body.name);
    Err(wrong(key, format_args!("{found_m:.2} m from the body's origin"), expected))
}
