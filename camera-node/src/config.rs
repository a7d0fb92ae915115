//! A node's configuration.

use std::sync::Arc;

use hull::{Camera, Observer, ProbeSettings, Silhouette};
use segment::SegmentSettings;

use crate::source::SourceConfig;

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
    /// Hull rule and settings of the probes.
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

    /// The place in the rig of each camera.
    pub fn rig_indices(&self) -> Vec<u16> {
        self.cameras.iter().map(|camera| camera.rig_index).collect()
    }
}
