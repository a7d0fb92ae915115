//! Who a node is: its cameras and how it decides.

use hull::{Camera, ProbeSettings};

/// A camera of a node.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraDescription {
    /// Its name in the rig.
    pub name: String,
    /// Its place in the rig.
    pub rig_index: u16,
    /// Width and height, pixels.
    pub size: (u32, u32),
    /// The digest of all numbers of its calibration that change an answer.
    pub calibration_digest: [u8; 32],
}

impl CameraDescription {
    /// A camera at its place in the rig.
    pub fn new(camera: &Camera, rig_index: u16) -> CameraDescription {
        CameraDescription {
            name: camera.name().to_owned(),
            rig_index,
            size: (camera.width(), camera.height()),
            calibration_digest: camera.digest(),
        }
    }
}

/// How a node describes itself.
#[derive(Clone, Debug, PartialEq)]
pub struct NodeDescription {
    /// The program's version.
    pub version: String,
    /// Its cameras in rig order.
    pub cameras: Vec<CameraDescription>,
    /// The hull rule and the probes' settings.
    pub settings: ProbeSettings,
    /// Frames per second.
    pub fps: f64,
    /// The term of the lease; 0 without a holder.
    pub term: u64,
}
