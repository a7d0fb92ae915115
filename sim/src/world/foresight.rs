//! Where bodies will be if the hull touches none of them: the solver run ahead on a copy of itself.

use super::World;
use super::limits::{Placed, check_pairs};
use hull::Pose;

impl World {
    /// The poses of the moving bodies (in the order of [`World::moving_bodies`]) after each of the next
    /// `steps` steps, if the hull touches no body in them: bit for bit what [`World::step`] will make of
    /// the same responses. Touches change that for the bodies they push and for those that these run into;
    /// the world itself stays as it is. Ends early where the solver runs out of the numbers or too many bodies overlap.
    pub fn poses_ahead(&self, steps: usize) -> Vec<Vec<Pose>> {
        let present = || self.moving.iter().map(|&index| self.bodies[index].pose).collect();
        if self.moving.iter().all(|&index| self.solver.sleeps(index)) {
            return vec![present(); steps];
        }
        let mut solver = self.solver.fork();
        let mut poses_ahead = Vec::with_capacity(steps);
        let mut placed: Vec<Pose> = self.bodies.iter().map(|body| body.pose).collect();
        for _ in 0..steps {
            let bodies = self.bodies.iter().zip(&placed);
            if check_pairs(bodies.map(|(body, pose)| Placed { pose, ..body.into() })).is_err() {
                break;
            }
            solver.step();
            let poses = self.moving.iter().map(|&index| {
                let pose = solver.state(index).pose();
                pose.filter(|_| !solver.failed(index))
            });
            let Some(poses) = poses.collect::<Option<Vec<Pose>>>() else { break };
            self.moving.iter().zip(&poses).for_each(|(&index, &pose)| placed[index] = pose);
            poses_ahead.push(poses);
        }
        poses_ahead
    }
}
