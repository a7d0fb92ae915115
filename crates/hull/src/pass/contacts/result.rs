//! What contacts need of a pass: the planes of the hull's surface near a body.

use crate::question::Edge;

/// What was found for one sample inside the hull, or for one point around a body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SamplePlane {
    /// The sample's index in its body, or the point's.
    pub sample: u32,
    /// The plane of the surface nearest to it, an edge of one camera's silhouette; `None` if no camera has one.
    pub plane: Option<Edge>,
}

/// What was found for one body.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BodyPlanes {
    /// Of its samples and offset samples inside the hull, ascending.
    pub samples: Vec<SamplePlane>,
    /// Of points around it that have a plane near, if it touches and they were asked about.
    pub around: Vec<SamplePlane>,
}
