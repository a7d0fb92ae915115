//! Convex solids that move as they are told and that nothing pushes: what stands there in truth, for experiments
//! that compare bodies on the hull with bodies on that.

use hull::Pose;
use rapier3d::prelude::{RigidBodyBuilder, RigidBodyHandle};

use super::{Solver, Surface, groups_of_bodies, rapier_pose, shape};
use crate::solid::Solid;

/// The solids that are there, in their order.
#[derive(Clone, Debug, Default)]
pub(crate) struct TrueSolids(Vec<(RigidBodyHandle, Solid)>);

impl Solver {
    /// Puts solids there by the end of the next step; they move there evenly. Those not known, and those of
    /// another form than before, are put there at once. The error is the index of one whose geometry rapier does not take.
    pub(crate) fn place_true_solids(
        &mut self,
        known: &mut TrueSolids,
        solids: &[(Solid, Pose)],
        surface: Surface,
    ) -> Result<(), usize> {
        for (body, _) in known.0.drain(solids.len().min(known.0.len())..) {
            self.physics.remove_body(body);
        }
        for (index, (solid, pose)) in solids.iter().enumerate() {
            let pose = rapier_pose(pose);
            if let Some((body, _)) = known.0.get(index).filter(|(_, before)| before == solid) {
                self.physics.bodies[*body].set_next_kinematic_position(pose);
                continue;
            }
            let collider = shape(solid)
                .ok_or(index)?
                .density(0.0)
                .friction(surface.friction as f32)
                .restitution(surface.restitution as f32)
                .collision_groups(groups_of_bodies());
            let body = RigidBodyBuilder::kinematic_position_based().pose(pose);
            let placed = (self.physics.insert(body, collider).0, solid.clone());
            match known.0.get_mut(index) {
                Some(known) => {
                    self.physics.remove_body(std::mem::replace(known, placed).0);
                }
                None => known.0.push(placed),
            }
        }
        Ok(())
    }
}
