//! Which way the faces of a body look, and which surface faces them.

use nalgebra::Vector3;

use crate::body::Pose;

/// A surface faces a sample if its normal has at least this part against one of the sample's.
const FACING: f64 = 0.3;

/// Which way a body's faces look at its samples: on edges and at corners every face counts.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FaceNormals {
    normals_body: Vec<Vector3<f64>>,
    /// Where the normals of each sample end.
    ends: Vec<usize>,
    /// The samples within a flat face, ascending.
    flat: Vec<usize>,
}

impl FaceNormals {
    /// Adds the outward unit normals of the faces at the next sample, body frame.
    pub fn push(&mut self, normals_body: impl IntoIterator<Item = Vector3<f64>>) {
        self.normals_body.extend(normals_body);
        self.ends.push(self.normals_body.len());
    }

    /// Adds the outward unit normal of the flat face within which the next sample lies, body frame.
    pub fn push_flat(&mut self, normal_body: Vector3<f64>) {
        self.flat.push(self.ends.len());
        self.push([normal_body]);
    }

    /// Of how many samples they are.
    pub(crate) fn sample_count(&self) -> usize {
        self.ends.len()
    }

    /// The normals at one sample; none beyond the last.
    pub fn at(&self, sample: usize) -> &[Vector3<f64>] {
        let first = sample.checked_sub(1).map_or(0, |before| self.ends.get(before).copied().unwrap_or(0));
        self.ends.get(sample).map_or(&[], |&end| &self.normals_body[first..end])
    }

    /// Which way the flat face looks within which a sample lies, world; `None` on edges and on what is curved.
    pub(crate) fn flat_at(&self, sample: usize, pose: &Pose) -> Option<Vector3<f64>> {
        self.flat.binary_search(&sample).ok()?;
        Some(pose.rotation() * self.at(sample).first()?)
    }

    /// Whether a surface with that normal, world, faces one of the faces at a sample.
    pub(crate) fn is_faced(&self, sample: usize, pose: &Pose, normal_world: &Vector3<f64>) -> bool {
        let rotation = pose.rotation();
        self.at(sample).iter().any(|face| (rotation * face).dot(normal_world) < -FACING)
    }
}
