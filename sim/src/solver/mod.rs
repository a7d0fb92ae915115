//! The rigid-body solver. No other file knows rapier's worlds, and none of its types leave the crate.

mod arrival;
mod hold;
mod patches;
mod true_solids;

use crate::scene::{BodySpec, MassSpec, Scene};
use crate::solid::Solid;
use hull::Pose;
use rapier3d::prelude::{
    Collider, ColliderBuilder, CollisionPipeline, PhysicsPipeline, PhysicsWorld, RigidBodyBuilder,
    RigidBodyHandle, Rotation, SharedShape, Vector,
};

use arrival::Arrival;
use hold::Hold;
use patches::{BodyPatches, Dispatcher, OwnBody, groups_of_bodies};

pub use patches::MAX_PATCHES;
pub(crate) use patches::Surface;
pub(crate) use true_solids::TrueSolids;

/// Deep overlaps (a response may push a body centimetres into a neighbour) are pushed apart no faster
/// than this, m/s. A resting body that is overlapped is never thrown: it glides out at this speed.
const MAX_CORRECTIVE_SPEED_M_S: f32 = 1.0;
/// What rolls loses its spin at this rate: the solver knows no rolling resistance, and balls would roll
/// out of the room.
const ROLLING_DAMPING_PER_S: f32 = 1.5;
/// Solver iterations per step: twice the default, for stacks.
const SOLVER_ITERATIONS: usize = 8;

/// Bodies in rapier, known by their index.
pub(crate) struct Solver {
    physics: PhysicsWorld,
    handles: Vec<RigidBodyHandle>,
    holds: Vec<Hold>,
    /// Of each body.
    patches: Vec<BodyPatches>,
    /// The solid of each body that touches between its samples.
    rounds: Vec<Option<Solid>>,
    /// No surface point of a body is farther from a sample, metres.
    covering_radius_m: f64,
    /// Bodies that came into surfaces in the step before the next.
    arrivals: Vec<Arrival>,
    /// Bodies so far: each has a mark of its own, which its patches carry too.
    marks: u128,
}

/// A body's state as the solver has it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct State {
    pub(crate) position_m: [f32; 3],
    pub(crate) rotation_xyzw: [f32; 4],
    pub(crate) velocity_m_s: [f32; 3],
    pub(crate) spin_rad_s: [f32; 3],
}

impl State {
    /// The pose, widened; `None` unless position, rotation and velocities are numbers.
    pub(crate) fn pose(&self) -> Option<Pose> {
        let finite = self.velocity_m_s.iter().chain(&self.spin_rad_s).all(|v| v.is_finite());
        let pose = Pose::new(self.position_m.map(f64::from), self.rotation_xyzw.map(f64::from));
        pose.ok().filter(|_| finite)
    }
}

impl Solver {
    /// A solver with the scene's gravity and floor, and the bodies in order, whose samples cover their surfaces so
    /// densely, metres. The error is the index of a body whose geometry rapier does not take.
    pub(crate) fn new(
        scene: &Scene,
        specs: &[BodySpec],
        dt_s: f64,
        covering_radius_m: f64,
    ) -> Result<Solver, usize> {
        let mut physics = PhysicsWorld { gravity: vector(scene.gravity_m_s2()), ..PhysicsWorld::default() };
        let parameters = &mut physics.integration_parameters;
        parameters.dt = dt_s as f32;
        parameters.num_solver_iterations = SOLVER_ITERATIONS;
        parameters.normalized_max_corrective_velocity = MAX_CORRECTIVE_SPEED_M_S;
        // Contacts that are kept while bodies move less than 5 cm would be wrong after a response.
        parameters.contact_recycling = false;
        physics.narrow_phase.set_query_dispatcher(Dispatcher);
        if let Some(floor) = scene.floor() {
            let up = vector(scene.up());
            let ground = ColliderBuilder::new(SharedShape::halfspace(up))
                .translation(up * floor.height_m as f32)
                .friction(floor.friction as f32)
                .restitution(floor.restitution as f32);
            physics.insert_collider(ground, None);
        }
        let mut solver = Solver {
            physics,
            handles: vec![],
            holds: vec![],
            patches: vec![],
            rounds: vec![],
            covering_radius_m,
            arrivals: vec![],
            marks: 0,
        };
        for (index, spec) in specs.iter().enumerate() {
            solver.add(spec).ok_or(index)?;
        }
        Ok(solver)
    }

    /// Puts another body last; `None` if rapier does not take its geometry.
    pub(crate) fn add(&mut self, spec: &BodySpec) -> Option<()> {
        self.marks += 1;
        let collider = collider(spec)?.collision_groups(groups_of_bodies()).user_data(self.marks);
        self.handles.push(self.physics.insert(body(spec), collider).0);
        self.patches.push(BodyPatches::default());
        self.rounds.push(spec.solid.rolls().then(|| spec.solid.clone()));
        Some(())
    }

    /// Takes a body away; those after it move up. Bodies that rested on it wake.
    pub(crate) fn remove(&mut self, index: usize) {
        self.let_go(index);
        self.remove_patches(index);
        self.rounds.remove(index);
        self.physics.remove_body(self.handles.remove(index));
    }

    /// Pushes a body, N s, at a point of the world, metres, or at its centre of mass.
    pub(crate) fn push(&mut self, index: usize, impulse_n_s: [f64; 3], at_m: Option<[f64; 3]>) {
        let body = &mut self.physics.bodies[self.handles[index]];
        let impulse = vector(impulse_n_s);
        body.apply_impulse(impulse, true);
        if let Some(at_m) = at_m {
            // Where it is now: a response may have moved it since the solver's last step.
            let centre_m = body.translation() + body.rotation() * body.local_center_of_mass();
            body.apply_torque_impulse((vector(at_m) - centre_m).cross(impulse), true);
        }
    }

    /// What a body weighs, kg.
    pub(crate) fn mass_kg(&self, index: usize) -> f64 {
        f64::from(self.physics.bodies[self.handles[index]].mass())
    }

    /// Sets another gravity, m/s², and wakes all bodies.
    pub(crate) fn set_gravity(&mut self, gravity_m_s2: [f64; 3]) {
        self.physics.gravity = vector(gravity_m_s2);
        self.handles.iter().for_each(|&handle| self.physics.bodies[handle].wake_up(true));
    }

    /// Advances all bodies by one step; what the solver itself switched off is switched on again, so
    /// that the caller decides.
    pub(crate) fn step(&mut self) {
        self.pull();
        self.physics.step_with_events(&OwnBody, &());
        self.catch_up();
        let switched_off: Vec<_> = self.physics.quarantine().bodies().to_vec();
        for handle in switched_off {
            self.physics.bodies[handle].set_enabled(true);
        }
    }

    /// Whether a body went out of the numbers in the last step: the solver has then stopped it.
    pub(crate) fn failed(&self, index: usize) -> bool {
        self.physics.quarantine().bodies().contains(&self.handles[index])
    }

    /// Whether a body sleeps: the solver leaves it where it is until something wakes it.
    pub(crate) fn sleeps(&self, index: usize) -> bool {
        self.physics.bodies[self.handles[index]].is_sleeping()
    }

    /// A body's state now.
    pub(crate) fn state(&self, index: usize) -> State {
        let body = &self.physics.bodies[self.handles[index]];
        let rotation = body.rotation();
        State {
            position_m: body.translation().to_array(),
            rotation_xyzw: [rotation.x, rotation.y, rotation.z, rotation.w],
            velocity_m_s: body.linvel().to_array(),
            spin_rad_s: body.angvel().to_array(),
        }
    }

    /// A solver in the same state, apart from this one: what happens to one does not to the other. The
    /// pipeline begins with empty buffers, which hold nothing from step to step.
    pub(crate) fn fork(&self) -> Solver {
        let from = &self.physics;
        let physics = PhysicsWorld {
            gravity: from.gravity,
            integration_parameters: from.integration_parameters,
            physics_pipeline: PhysicsPipeline::new(),
            collision_pipeline: CollisionPipeline::new(),
            islands: from.islands.clone(),
            broad_phase: from.broad_phase.clone(),
            narrow_phase: from.narrow_phase.clone(),
            bodies: from.bodies.clone(),
            colliders: from.colliders.clone(),
            impulse_joints: from.impulse_joints.clone(),
            multibody_joints: from.multibody_joints.clone(),
            soft_bodies: from.soft_bodies.clone(),
            ccd_solver: from.ccd_solver.clone(),
        };
        Solver {
            physics,
            handles: self.handles.clone(),
            holds: self.holds.clone(),
            patches: self.patches.clone(),
            rounds: self.rounds.clone(),
            covering_radius_m: self.covering_radius_m,
            arrivals: self.arrivals.clone(),
            marks: self.marks,
        }
    }

    /// Puts a body elsewhere, metres: the pose changes, no velocity does.
    pub(crate) fn set_position(&mut self, index: usize, position_m: [f32; 3]) {
        self.physics.bodies[self.handles[index]].set_translation(Vector::from_array(position_m), true);
    }

    /// Gives a body another velocity, m/s; its spin stays.
    pub(crate) fn set_velocity(&mut self, index: usize, velocity_m_s: [f64; 3]) {
        self.physics.bodies[self.handles[index]].set_linvel(vector(velocity_m_s), true);
    }

    /// Gives a body another spin, rad/s about axes of the world; its velocity stays.
    pub(crate) fn set_spin(&mut self, index: usize, spin_rad_s: [f64; 3]) {
        self.physics.bodies[self.handles[index]].set_angvel(vector(spin_rad_s), true);
    }

    /// A body's own collider.
    fn collider_of(&self, index: usize) -> &Collider {
        &self.physics.colliders[self.physics.bodies[self.handles[index]].colliders()[0]]
    }

    /// Wakes a body that sleeps.
    pub(crate) fn wake(&mut self, index: usize) {
        self.physics.bodies[self.handles[index]].wake_up(true);
    }

    /// Puts a body to rest in a pose.
    pub(crate) fn put_to_rest(&mut self, index: usize, pose: &Pose) {
        let body = &mut self.physics.bodies[self.handles[index]];
        body.set_position(rapier_pose(pose), true);
        body.set_linvel(Vector::ZERO, true);
        body.set_angvel(Vector::ZERO, true);
    }
}

fn body(spec: &BodySpec) -> RigidBodyBuilder {
    let builder = if spec.fixed { RigidBodyBuilder::fixed() } else { RigidBodyBuilder::dynamic() };
    let damping = if spec.solid.rolls() { ROLLING_DAMPING_PER_S } else { 0.0 };
    builder.pose(rapier_pose(&spec.pose)).linvel(vector(spec.velocity_m_s)).angular_damping(damping)
}

fn collider(spec: &BodySpec) -> Option<ColliderBuilder> {
    let builder = shape(&spec.solid)?;
    let builder = match spec.mass {
        MassSpec::MassKg(mass_kg) => builder.mass(mass_kg as f32),
        MassSpec::DensityKgM3(density) => builder.density(density as f32),
    };
    Some(builder.friction(spec.friction as f32).restitution(spec.restitution as f32))
}

/// A collider of a solid's shape; `None` if rapier does not take it.
fn shape(solid: &Solid) -> Option<ColliderBuilder> {
    Some(match solid {
        Solid::Box { size_m } => {
            let [x, y, z] = size_m.map(|edge| (0.5 * edge) as f32);
            ColliderBuilder::cuboid(x, y, z)
        }
        Solid::Ball { radius_m } => ColliderBuilder::ball(*radius_m as f32),
        Solid::Capsule { radius_m, length_m } => {
            ColliderBuilder::capsule_y((0.5 * length_m) as f32, *radius_m as f32)
        }
        Solid::Cylinder { radius_m, height_m } => {
            ColliderBuilder::cylinder((0.5 * height_m) as f32, *radius_m as f32)
        }
        Solid::Cone { radius_m, height_m } => {
            ColliderBuilder::cone((0.5 * height_m) as f32, *radius_m as f32)
        }
        Solid::Hull(hull) => {
            let corners: Vec<Vector> = hull.corners_m().iter().map(|corner| vector(*corner)).collect();
            ColliderBuilder::convex_hull(&corners)?
        }
    })
}

fn rapier_pose(pose: &Pose) -> rapier3d::math::Pose {
    let [x, y, z, w] = pose.rotation_xyzw().map(|q| q as f32);
    let rotation = Rotation::from_xyzw(x, y, z, w).normalize();
    rapier3d::math::Pose::from_parts(vector(pose.position_m()), rotation)
}

fn vector(components: [f64; 3]) -> Vector {
    Vector::from_array(components.map(|component| component as f32))
}

#[cfg(test)]
impl Solver {
    /// A body's kinetic and potential energy as the height of its weight, metres.
    pub(crate) fn energy_m(&self, index: usize) -> f64 {
        let body = &self.physics.bodies[self.handles[index]];
        let weight_n = f64::from(body.mass() * self.physics.gravity.length());
        let height_m = f64::from(-body.center_of_mass().dot(self.physics.gravity.normalize()));
        f64::from(body.kinetic_energy()) / weight_n + height_m
    }

    /// Gives a body a velocity that is no number, as a defect in the solver would.
    pub(crate) fn poison(&mut self, index: usize) {
        let velocity = Vector::new(f32::NAN, 0.0, 0.0);
        self.physics.bodies[self.handles[index]].set_linvel(velocity, true);
    }
}
