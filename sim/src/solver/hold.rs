//! Bodies that are held: a point of the body is drawn to a target as by a critically damped spring.
//!
//! The pull is worked out from the inertia that the grip feels, so that a rod held by its end follows like a
//! ball held at its centre, and weightlessly. It is bounded: a body that is dragged through others, or through
//! the floor, squeezes them with a few times its weight and no more. It is part of the solver's step, and so
//! of what a copy of the solver foresees.

use super::{Solver, vector};
use rapier3d::prelude::{RigidBody, RigidBodyHandle, Vector};

/// The spring's frequency, rad/s: 95 % of a jump of the target are made within a quarter of a second.
const FREQUENCY_PER_S: f32 = 20.0;
/// Targets farther away draw no harder than this one, metres: a held body follows with 5 m/s at most.
const FAR_M: f32 = 0.5;
/// The pull never changes a body's speed faster than this, m/s²: ten times its weight.
const MAX_PULL_M_S2: f32 = 100.0;
/// A held body loses its spin at this rate: a hand does not let it swing for long, and a thin rod held beside its
/// axis must not turn about it for ever.
const SPIN_DAMPING_PER_S: f32 = 10.0;

/// One hold.
#[derive(Clone, Copy, Debug)]
pub(super) struct Hold {
    pub handle: RigidBodyHandle,
    pub grip_body_m: Vector,
    pub target_m: Vector,
}

impl Solver {
    /// Holds a body by a point of it and draws that point to a target, both metres, until it is let go.
    pub(crate) fn hold(&mut self, index: usize, grip_body_m: [f64; 3], target_m: [f64; 3]) {
        let handle = self.handles[index];
        self.let_go(index);
        let (grip_body_m, target_m) = (vector(grip_body_m), vector(target_m));
        self.holds.push(Hold { handle, grip_body_m, target_m });
        self.wake(index);
    }

    /// Lets a body go; it keeps the velocity it has.
    pub(crate) fn let_go(&mut self, index: usize) {
        let handle = self.handles[index];
        self.holds.retain(|hold| hold.handle != handle);
    }

    /// Whether a body is held.
    pub(crate) fn is_held(&self, index: usize) -> bool {
        self.holds.iter().any(|hold| hold.handle == self.handles[index])
    }

    /// Draws all held bodies, for one step.
    pub(super) fn pull(&mut self) {
        let (dt_s, gravity_m_s2) = (self.physics.integration_parameters.dt, self.physics.gravity);
        for hold in &self.holds {
            hold.pull(&mut self.physics.bodies[hold.handle], gravity_m_s2, dt_s);
        }
    }
}

impl Hold {
    fn pull(&self, body: &mut RigidBody, gravity_m_s2: Vector, dt_s: f32) {
        let rotation = *body.rotation();
        let grip_m = body.translation() + rotation * self.grip_body_m;
        let arm_m = rotation * (self.grip_body_m - body.local_center_of_mass());
        body.set_angvel(body.angvel() / (1.0 + SPIN_DAMPING_PER_S * dt_s), true);
        let velocity_m_s = body.linvel() + body.angvel().cross(arm_m);
        let way_m = (self.target_m - grip_m).clamp_length_max(FAR_M);
        // The spring at the end of the step, so that no step is too long for it.
        let (stiffness, damping) = (FREQUENCY_PER_S * FREQUENCY_PER_S, 2.0 * FREQUENCY_PER_S);
        let slowed = 1.0 + damping * dt_s + stiffness * dt_s * dt_s;
        let drawn_m_s2 = (way_m * stiffness - velocity_m_s * (damping + stiffness * dt_s)) / slowed;
        let wanted_m_s = (drawn_m_s2 - gravity_m_s2) * dt_s;
        let Some(impulse_n_s) = impulse_that_moves(body, arm_m, wanted_m_s) else { return };
        let impulse_n_s = impulse_n_s.clamp_length_max(body.mass() * MAX_PULL_M_S2 * dt_s);
        body.apply_impulse(impulse_n_s, true);
        body.apply_torque_impulse(arm_m.cross(impulse_n_s), true);
    }
}

/// The impulse at the end of an arm (from the centre of mass, world) that changes the velocity there.
fn impulse_that_moves(body: &RigidBody, arm_m: Vector, change_m_s: Vector) -> Option<Vector> {
    let inertia = body.mass_properties();
    let moved = |impulse: Vector| {
        let turned = inertia.effective_world_inv_inertia * arm_m.cross(impulse);
        (impulse * inertia.effective_inv_mass + turned.cross(arm_m)).to_array().map(f64::from)
    };
    let columns = [Vector::X, Vector::Y, Vector::Z].map(|axis| nalgebra::Vector3::from(moved(axis)));
    let impulse = nalgebra::Matrix3::from_columns(&columns).try_inverse()?
        * nalgebra::Vector3::from(change_m_s.to_array().map(f64::from));
    impulse.iter().all(|component| component.is_finite()).then(|| vector(impulse.into()))
}
