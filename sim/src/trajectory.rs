//! A hash over every pose of a run.

use hull::Pose;

/// A hash over every body's pose at the start and after every step, and over bodies that come and go: equal
/// digests, equal runs. Displayed in hexadecimal.
pub type TrajectoryDigest = blake3::Hash;

/// The digest as it grows.
#[derive(Clone, Default)]
pub(crate) struct Trajectory(blake3::Hasher);

impl Trajectory {
    /// Takes in the poses of one step, in body order.
    pub(crate) fn add<'a>(&mut self, poses: impl Iterator<Item = &'a Pose>) {
        let mut bytes = vec![];
        for pose in poses {
            for number in pose.position_m().into_iter().chain(pose.rotation_xyzw()) {
                bytes.extend_from_slice(&number.to_bits().to_le_bytes());
            }
        }
        self.0.update(&bytes);
    }

    /// Takes in a body that comes while the world runs.
    pub(crate) fn add_body(&mut self, id: u32, pose: &Pose) {
        self.0.update(b"body comes");
        self.0.update(&id.to_le_bytes());
        self.add([pose].into_iter());
    }

    /// Takes in a body that goes.
    pub(crate) fn remove_body(&mut self, id: u32) {
        self.0.update(b"body goes");
        self.0.update(&id.to_le_bytes());
    }

    /// The digest so far.
    pub(crate) fn digest(&self) -> TrajectoryDigest {
        self.0.finalize()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pose(position_m: [f64; 3], turn: nalgebra::UnitQuaternion<f64>) -> Pose {
        let q = turn.quaternion();
        Pose::new(position_m, [q.i, q.j, q.k, q.w]).expect("a pose")
    }

    #[test]
    fn the_digest_knows_every_step() {
        let still = nalgebra::UnitQuaternion::identity();
        let (a, b) = (pose([0.0; 3], still), pose([1.0, 0.0, 0.0], still));
        let digest = |steps: &[Pose]| {
            let mut trajectory = Trajectory::default();
            steps.iter().for_each(|step| trajectory.add([step].into_iter()));
            trajectory.digest()
        };
        assert_eq!(digest(&[a, b]), digest(&[a, b]));
        assert_ne!(digest(&[a, b]), digest(&[b, a]));
        assert_ne!(digest(&[a]), digest(&[a, a]));
        assert_eq!(digest(&[a]).to_string().len(), 64);
    }
}
