//! The time of contact (paper §7: very fast objects).
//!
//! A fast body is centimetres deep in a surface when it is first found there. If it were pushed out from there it would
//! gain potential energy, and a bounce would begin too deep. So the solver moves it back along the surface's normal to
//! where it touched, makes the step there, and moves it on by its new velocity for the time since the contact. A body that
//! touches anything else stays where it is: there might be no room.

use rapier3d::prelude::{RigidBodyHandle, Vector};

use super::Solver;
use super::patches::{Patch, is_patch};

/// A body whose relative velocity is smaller meets the surface where it is found, m/s.
const LEAST_SPEED_M_S: f32 = 0.5;
/// So does one that is less deep, metres.
const LEAST_DEPTH_M: f32 = 1e-3;

/// The longest time since a contact, seconds: a frame of slow film.
const MOST_SINCE_S: f32 = 0.05;

/// A body that came into a surface within the last frame.
#[derive(Clone, Copy, Debug)]
pub(super) struct Arrival {
    body: RigidBodyHandle,
    /// Time since it came into the surface, seconds.
    since_s: f32,
    /// The surface's outward normal, and how fast it moves along it, m/s.
    normal: Vector,
    surface_m_s: f32,
}

impl Solver {
    /// Whether a body came fast into a patch that it did not touch before.
    pub(super) fn arrival(&self, index: usize, patch: &Patch) -> Option<Arrival> {
        let handle = self.handles[index];
        let (body, surface) = (&self.physics.bodies[handle], &self.physics.bodies[patch.body]);
        let deepest = patch.points.iter().map(|point| {
            let at = *body.position() * point.point_body;
            let depth_m = (*surface.position() * point.surface - at).dot(patch.normal);
            (depth_m, at)
        });
        let (depth_m, at) = deepest.reduce(|a, b| if b.0 > a.0 { b } else { a })?;
        let normal = patch.normal;
        let surface_m_s = surface.velocity_at_point(at).dot(normal);
        let comes_m_s = surface_m_s - body.velocity_at_point(at).dot(normal);
        let comes = depth_m > LEAST_DEPTH_M && comes_m_s > LEAST_SPEED_M_S && !self.touches_solids(index);
        let since_s = (depth_m / comes_m_s).min(MOST_SINCE_S);
        comes.then_some(Arrival { body: handle, since_s, normal, surface_m_s })
    }

    /// Whether a body touches the floor or another body.
    fn touches_solids(&self, index: usize) -> bool {
        let own = self.physics.bodies[self.handles[index]].colliders()[0];
        self.physics.narrow_phase.contact_pairs_with(own).any(|pair| {
            let other = if pair.collider1 == own { pair.collider2 } else { pair.collider1 };
            pair.has_any_active_contact() && !is_patch(&self.physics.colliders[other])
        })
    }

    /// Puts a body back to where it came into the surface.
    pub(super) fn arrive(&mut self, arrival: Arrival) {
        let (gravity, since_s) = (self.physics.gravity, arrival.since_s);
        let body = &mut self.physics.bodies[arrival.body];
        let way_m = (body.linvel().dot(arrival.normal) - arrival.surface_m_s) * since_s;
        body.set_translation(body.translation() - arrival.normal * way_m, true);
        // It was slower there by what it fell since: otherwise it would have gained the height.
        body.set_linvel(body.linvel() - gravity * since_s, true);
        self.arrivals.push(arrival);
    }

    /// Moves bodies that came into surfaces on, by their new velocities for the time since. The solver has made its step.
    pub(super) fn catch_up(&mut self) {
        let gravity = self.physics.gravity;
        for Arrival { body, since_s, normal, surface_m_s } in std::mem::take(&mut self.arrivals) {
            let body = &mut self.physics.bodies[body];
            body.set_linvel(body.linvel() + gravity * since_s, true);
            let way_m = (body.linvel().dot(normal) - surface_m_s) * since_s;
            body.set_translation(body.translation() + normal * way_m, true);
        }
    }
}

impl Arrival {
    /// The earlier of two.
    pub fn earlier(self, other: Option<Arrival>) -> Arrival {
        other.filter(|other| other.since_s > self.since_s).unwrap_or(self)
    }
}
