//! A camera node: sources, segmentation, the ring of silhouettes, and the service that answers probes.
//!
//! One process serves one or more cameras. Film runs on a thread a camera ([`capture`]), finished frames
//! wait in a bounded ring ([`frames`]), pictures for people are made while asked for ([`pictures`]), probes are computed on threads of their own and only their
//! bytes pass through the async [`service`].

pub mod capture;
pub mod cores;
pub mod frames;
pub mod listen;
pub mod pictures;
pub mod service;
pub mod shapes;
pub mod source;

use std::sync::Arc;

use hull::{Camera, Observer, ProbeSettings, Silhouette};
use segment::SegmentSettings;

pub use source::SourceConfig;

/// One camera of a node, checked.
#[derive(Clone, Debug)]
pub struct NodeCamera {
    /// Its calibration.
    pub camera: Camera,
    /// Its place in the rig.
    pub rig_index: u16,
    /// Where its frames come from.
    pub source: SourceConfig,
    /// Where the empty room is seen; not needed for masks and chroma keys.
    pub background: Option<SourceConfig>,
    /// How frames become silhouettes.
    pub segmentation: SegmentSettings,
    /// Static occluders as foreground.
    pub ignored: Option<Silhouette>,
}

/// A node's configuration, checked.
#[derive(Clone, Debug)]
pub struct NodeConfig {
    /// Its cameras, at least one, in rig order.
    pub cameras: Vec<NodeCamera>,
    /// How it judges.
    pub settings: ProbeSettings,
    /// Frames of the cluster per second.
    pub fps: f64,
}

impl NodeConfig {
    /// The fixed side of every camera.
    pub fn observers(&self) -> Vec<Arc<Observer>> {
        let observer = |camera: &NodeCamera| {
            let ignored = camera.ignored.as_ref();
            Arc::new(Observer::new(camera.camera.clone(), camera.rig_index, self.settings, ignored))
        };
        self.cameras.iter().map(observer).collect()
    }
}
