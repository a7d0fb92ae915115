//! What others see of patches: where the surface is at a body now, and how it moves there.

use rapier3d::prelude::Vector;

use super::{Patch, Solver};
use crate::response::HullPatch;

impl Solver {
    /// The patches of a body in use; what is no number is left out.
    pub(crate) fn patches_of(&self, index: usize) -> impl Iterator<Item = HullPatch> {
        let in_use = self.patches[index].0.iter().filter(|patch| patch.is_in_use());
        in_use.map(move |patch| self.view(index, patch)).filter(HullPatch::is_finite)
    }

    fn view(&self, index: usize, patch: &Patch) -> HullPatch {
        let world_from_body = *self.physics.bodies[self.handles[index]].position();
        let surface = &self.physics.bodies[patch.body];
        let world_from_patch = *surface.position();
        let normal = world_from_patch.rotation * patch.normal;
        let held = patch.points.iter().map(|point| {
            let at = world_from_body * point.point_body;
            let depth_m = (world_from_patch * point.surface - at).dot(normal);
            (at + normal * depth_m, depth_m)
        });
        let sum = held.clone().fold(Vector::ZERO, |sum, (foot, _)| sum + foot);
        let middle = sum / patch.points.len() as f32;
        let depth_m = held.clone().map(|(_, depth_m)| depth_m).fold(f32::NEG_INFINITY, f32::max);
        let radius_m = held.map(|(foot, _)| (foot - middle).length()).fold(0.0, f32::max);
        let velocity = surface.linvel() + surface.angvel().cross(middle - world_from_patch.translation);
        HullPatch {
            body: index as u32,
            point_m: middle.to_array(),
            normal_world: normal.to_array(),
            velocity_m_s: velocity.to_array(),
            depth_m,
            radius_m,
            samples: patch.samples as u32,
        }
    }
}
