//! The hull in the solver: contacts whose normals agree are a patch of its surface, and each patch a kinematic
//! collider of its own that touches one body.
//!
//! Nothing that did not change is touched: what rests on a still hull falls asleep. Only patches in use are enabled,
//! for idle ones would cost more than all contacts.

mod choice;
mod shape;
mod view;

use nalgebra::Vector3;
use rapier3d::math::Pose;
use rapier3d::prelude::{
    ActiveHooks, Collider, ColliderBuilder, ColliderHandle, Group, InteractionGroups, InteractionTestMode,
    RigidBodyBuilder, RigidBodyHandle, Vector,
};

use super::Solver;
use crate::response::HullContact;
use crate::solid::Solid;
use choice::{MAX_POINTS, agree, cluster, spread};
use shape::{PatchPoint, PatchShape};

pub(super) use shape::{Dispatcher, OwnBody};

/// Patches of one body at most: a ball between two hands has two, a box in a corner three.
pub const MAX_PATCHES: usize = 4;
/// A patch keeps its normal while the contacts' is no farther from it: cosine of 2 degrees.
const SAME_NORMAL: f32 = 0.999_39;
/// A surface that moved less than this has not moved, metres.
const STILL_M: f32 = 2e-4;
/// A patch reaches this much beyond its body: how far a body may move before it is asked about again, metres.
const BEYOND_M: f32 = 0.05;

/// Bodies are of this group, patches of the other.
const BODIES: Group = Group::GROUP_1;
const PATCHES: Group = Group::GROUP_2;

/// The friction and the restitution of the hull's surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Surface {
    pub(crate) friction: f64,
    pub(crate) restitution: f64,
}

/// What the hull's surface is to one body.
#[derive(Clone, Debug, Default)]
pub(super) struct BodyPatches(Vec<Patch>);

#[derive(Clone, Debug)]
pub(super) struct Patch {
    pub body: RigidBodyHandle,
    collider: ColliderHandle,
    /// What touches; empty while it is not in use.
    pub points: Vec<PatchPoint>,
    /// How many contacts it was made of.
    samples: usize,
    pub normal: Vector,
    /// How fast it moves out along the normal, m/s.
    speed_m_s: f32,
    /// Whether it moves at all, or turns.
    moves: bool,
    surface: Surface,
}

/// Whether a collider is a patch.
pub(super) fn is_patch(collider: &Collider) -> bool {
    collider.shape().as_shape::<PatchShape>().is_some()
}

/// The groups of a body's own collider.
pub(super) fn groups_of_bodies() -> InteractionGroups {
    InteractionGroups::new(BODIES, Group::ALL, InteractionTestMode::And)
}

impl Solver {
    /// Puts the hull's surface where these contacts of a body say, from the next step on. A body whose surface moved
    /// wakes. The surface turns as fast as `spin_rad_s` says, world.
    pub(crate) fn set_contacts(
        &mut self,
        index: usize,
        contacts: &[HullContact],
        spin_rad_s: [f32; 3],
        surface: Surface,
    ) {
        let mut patches = std::mem::take(&mut self.patches[index]);
        let mut is_taken = vec![false; patches.0.len()];
        let mut moved = false;
        let motion = (surface, Vector::from_array(spin_rad_s));
        // A body that touches already does not arrive.
        let is_free = !patches.0.iter().any(Patch::is_in_use);
        let mut arrival = None;
        for members in cluster(contacts, MAX_PATCHES) {
            let normal = choice::mean_normal(contacts, &members);
            let found = patches
                .0
                .iter()
                .zip(&is_taken)
                .position(|(patch, &taken)| !taken && patch.is_in_use() && agree(patch.normal, normal));
            let place = found.unwrap_or_else(|| {
                let idle =
                    patches.0.iter().zip(&is_taken).position(|(patch, &taken)| !taken && !patch.is_in_use());
                idle.unwrap_or_else(|| {
                    patches.0.push(self.new_patch(index, surface));
                    is_taken.push(false);
                    patches.0.len() - 1
                })
            });
            is_taken[place] = true;
            moved |= self.place_patch(index, &mut patches.0[place], normal, contacts, &members, motion);
            if is_free && let Some(found) = self.arrival(index, &patches.0[place]) {
                arrival = Some(found.earlier(arrival));
            }
        }
        for (patch, _) in
            patches.0.iter_mut().zip(is_taken).filter(|(patch, taken)| !taken && patch.is_in_use())
        {
            patch.points.clear();
            self.physics.colliders[patch.collider].set_enabled(false);
            moved = true;
        }
        self.patches[index] = patches;
        if moved {
            self.wake(index);
        }
        if let Some(arrival) = arrival {
            self.arrive(arrival);
        }
    }

    /// Takes a body's patches away.
    pub(super) fn remove_patches(&mut self, index: usize) {
        for patch in self.patches.remove(index).0 {
            self.physics.remove_body(patch.body);
        }
    }

    fn new_patch(&mut self, index: usize, surface: Surface) -> Patch {
        let mark = self.collider_of(index).user_data;
        let empty = PatchShape { normal: Vector::ZERO, points: Vec::new(), reach_m: BEYOND_M };
        let collider = ColliderBuilder::new(empty.shared())
            .density(0.0)
            .friction(surface.friction as f32)
            .restitution(surface.restitution as f32)
            .collision_groups(InteractionGroups::new(PATCHES, BODIES, InteractionTestMode::And))
            .active_hooks(ActiveHooks::FILTER_CONTACT_PAIRS)
            .user_data(mark)
            .enabled(false);
        let (body, collider) = self.physics.insert(RigidBodyBuilder::kinematic_velocity_based(), collider);
        Patch {
            body,
            collider,
            points: Vec::new(),
            samples: 0,
            normal: Vector::ZERO,
            speed_m_s: 0.0,
            moves: false,
            surface,
        }
    }

    /// Where a round solid touches a surface of that normal: members whose support point is near their sample, and the
    /// contacts with these at that point, each as deep there as its own plane says. One always touches.
    fn at_supports(
        &self,
        solid: &Solid,
        normal: Vector,
        pose: &Pose,
        contacts: &[HullContact],
        members: &[usize],
    ) -> (Vec<HullContact>, Vec<usize>) {
        let into_body = (pose.rotation.inverse() * -normal).to_array().map(f64::from).into();
        let mut moved = contacts.to_vec();
        let (mut touching, mut nearest) = (Vec::with_capacity(members.len()), (f64::INFINITY, members[0]));
        for &member in members {
            let contact = &mut moved[member];
            let sample = Vector3::from(contact.point_body_m.map(f64::from));
            let way = solid.support_of(sample, &into_body) - sample;
            let way_m = way.norm();
            if way_m < nearest.0 {
                nearest = (way_m, member);
            }
            if way_m <= self.covering_radius_m {
                touching.push(member);
            }
            let support: [f32; 3] = (sample + way).map(|part| part as f32).into();
            let way =
                pose.rotation * (Vector::from_array(support) - Vector::from_array(contact.point_body_m));
            contact.depth_m -= way.dot(Vector::from_array(contact.normal_world));
            contact.point_body_m = support;
        }
        if touching.is_empty() {
            touching.push(nearest.1);
        }
        (moved, touching)
    }

    /// Puts a patch where its contacts say; false if it is there already.
    fn place_patch(
        &mut self,
        index: usize,
        patch: &mut Patch,
        mean: Vector,
        contacts: &[HullContact],
        members: &[usize],
        (surface, spin): (Surface, Vector),
    ) -> bool {
        let pose = *self.physics.bodies[self.handles[index]].position();
        let normal =
            if patch.is_in_use() && patch.normal.dot(mean) > SAME_NORMAL { patch.normal } else { mean };
        let at_supports = self.rounds[index]
            .as_ref()
            .map(|solid| self.at_supports(solid, normal, &pose, contacts, members));
        let (contacts, touching) =
            at_supports.as_ref().map_or((contacts, members), |(moved, touching)| (&moved[..], &touching[..]));
        let world = |member: usize| pose * Vector::from_array(contacts[member].point_body_m);
        let is_kept =
            |member: usize| patch.points.iter().any(|point| point.sample == contacts[member].sample);
        let chosen = spread(contacts, touching, normal, world, is_kept);
        patch.samples = members.len();
        let origin = pose.translation;
        let points: Vec<PatchPoint> = chosen
            .into_iter()
            .map(|member| PatchPoint {
                sample: contacts[member].sample,
                point_body: Vector::from_array(contacts[member].point_body_m),
                surface: world(member) + normal * contacts[member].depth_m - origin,
            })
            .collect();
        if patch.surface != surface {
            patch.surface = surface;
            let collider = &mut self.physics.colliders[patch.collider];
            collider.set_friction(surface.friction as f32);
            collider.set_restitution(surface.restitution as f32);
        }
        // The mean of what the members say is of their middle.
        let sum = members.iter().fold(Vector::ZERO, |sum, &member| sum + world(member) - origin);
        let middle = sum / members.len() as f32;
        let moved_m = self.physics.bodies[patch.body].translation() - origin;
        let known = if patch.is_in_use() { patch.speed_m_s } else { 0.0 };
        let speed_m_s = choice::mean_speed_m_s(contacts, members).unwrap_or(known);
        let velocity = normal * speed_m_s + choice::mean_slide_m_s(contacts, members, normal);
        let moves = velocity != Vector::ZERO || spin != Vector::ZERO;
        if !moves && !patch.moves && patch.is_where(&points, normal, moved_m) {
            return false;
        }
        let reach_m = self.collider_of(index).shape().compute_local_bounding_sphere();
        let reach_m = reach_m.center.length() + reach_m.radius + BEYOND_M;
        let was_in_use = patch.is_in_use();
        (patch.normal, patch.speed_m_s, patch.moves) = (normal, speed_m_s, moves);
        patch.points.clone_from(&points);
        let collider = &mut self.physics.colliders[patch.collider];
        collider.set_shape(PatchShape { normal, points, reach_m }.shared());
        if !was_in_use {
            collider.set_enabled(true);
        }
        let body = &mut self.physics.bodies[patch.body];
        body.set_position(Pose::from_translation(origin), false);
        body.set_linvel(velocity - spin.cross(middle), false);
        body.set_angvel(spin, false);
        true
    }
}

impl Patch {
    fn is_in_use(&self) -> bool {
        !self.points.is_empty()
    }

    /// Whether the same samples touch the same surface; the patch's origin lies so far from theirs.
    fn is_where(&self, points: &[PatchPoint], normal: Vector, origin_m: Vector) -> bool {
        debug_assert!(points.len() <= MAX_POINTS);
        self.normal == normal
            && self.points.len() == points.len()
            && points.iter().all(|point| {
                let same = self.points.iter().find(|before| before.sample == point.sample);
                same.is_some_and(|before| {
                    (before.surface + origin_m - point.surface).dot(normal).abs() < STILL_M
                })
            })
    }
}
