//! From a cluster file to what a node films, and to what a coordinator expects of it.

use std::path::PathBuf;

use camera_node::source::{SourceError, read_silhouette};
use camera_node::{NodeCamera, NodeConfig, SourceConfig};
use hull::{Camera, Rig, Silhouette};
use node_client::{ExpectedNode, NodePlace};
use proto::CameraDescription;
use proto::convert::ExpectedCamera;
use thiserror::Error;

use crate::cluster_file::{CameraEntry, ClusterFile, NodeEntry};
use crate::dns_sd::NodeSearch;

/// Why cameras of a cluster file cannot be set up.
#[derive(Debug, Error)]
pub enum NodeConfigError {
    /// An ignore mask is no mask of the camera's size.
    #[error("camera {camera:?}, ignore_mask: {error}")]
    IgnoreMask {
        /// Its name.
        camera: String,
        /// What is wrong with the mask.
        error: SourceError,
    },
    /// An ignore mask is all black or all white.
    #[error(
        "camera {camera:?}, ignore_mask: {}: found {found}, expected white only where something stands before the room",
        path.display()
    )]
    NoIgnoreMask {
        /// Its name.
        camera: String,
        /// The mask.
        path: PathBuf,
        /// What it is.
        found: &'static str,
    },
    /// A coordinator cannot reach a camera.
    #[error("{}, camera {camera:?}: no node, expected a name, \"host:port\" or \"unix:/path\"", path.display())]
    NoPlace {
        /// The cluster file.
        path: PathBuf,
        /// Its name.
        camera: String,
    },
    /// A camera cannot film the room without the person.
    #[error("--empty: camera {camera:?} has no background to film instead")]
    NoBackground {
        /// Its name.
        camera: String,
    },
}

impl ClusterFile {
    /// The configuration of a node that serves the cameras at `indices` of the rig, ascending. Reads their
    /// ignore masks. `empty`: the scene without the person.
    pub fn node_config(&self, indices: &[usize], empty: bool) -> Result<NodeConfig, NodeConfigError> {
        let cameras =
            indices.iter().map(|&index| self.node_camera(index, empty)).collect::<Result<_, _>>()?;
        Ok(NodeConfig { cameras, settings: self.probes, fps: self.fps })
    }

    /// The configuration of all cameras, in rig order.
    pub fn rig_config(&self, empty: bool) -> Result<NodeConfig, NodeConfigError> {
        let indices: Vec<usize> = (0..self.cameras.len()).collect();
        self.node_config(&indices, empty)
    }

    /// What a coordinator must find at each node, in their order; an error if one has neither name nor address. Nodes without an address are looked for by their names.
    pub fn expected_nodes(&self) -> Result<Vec<ExpectedNode>, NodeConfigError> {
        let names = self.nodes.iter().filter_map(|node| node.name.clone());
        let search = NodeSearch::new(&self.name, names);
        let expected = |node: &NodeEntry| {
            let place = match (&node.address, &node.name) {
                (Some(address), _) => NodePlace::At(address.clone()),
                (None, Some(name)) => search.place(name),
                (None, None) => return Err(self.no_place(node)),
            };
            let expected = expected_node(&self.rig, place, &node.cameras);
            let is_endless = node.cameras.iter().all(|&index| self.cameras[index].source.is_endless());
            Ok(ExpectedNode { name: node.name.clone(), is_endless, ..expected })
        };
        self.nodes.iter().map(expected).collect()
    }

    fn no_place(&self, node: &NodeEntry) -> NodeConfigError {
        let camera = self.cameras[node.cameras[0]].name.clone();
        NodeConfigError::NoPlace { path: self.path.clone(), camera }
    }

    fn node_camera(&self, index: usize, empty: bool) -> Result<NodeCamera, NodeConfigError> {
        let entry = &self.cameras[index];
        let camera = self.rig.cameras()[index].clone();
        Ok(NodeCamera {
            ignored: ignored(entry, &camera)?,
            camera,
            rig_index: index as u16,
            source: if empty { empty_room(entry)? } else { entry.source.clone() },
            background: entry.background.clone(),
            segmentation: entry.segmentation.clone(),
        })
    }
}

/// The scene without the person.
fn empty_room(entry: &CameraEntry) -> Result<SourceConfig, NodeConfigError> {
    if let SourceConfig::Stage(stage) = &entry.source {
        let mut stage = stage.clone();
        stage.person = false;
        return Ok(SourceConfig::Stage(stage));
    }
    entry.background.clone().ok_or_else(|| NodeConfigError::NoBackground { camera: entry.name.clone() })
}

fn ignored(entry: &CameraEntry, camera: &Camera) -> Result<Option<Silhouette>, NodeConfigError> {
    let Some(path) = &entry.ignore_mask else { return Ok(None) };
    let name = || entry.name.clone();
    let mask = read_silhouette(path, camera)
        .map_err(|error| NodeConfigError::IgnoreMask { camera: name(), error })?;
    let wrong = |found| Err(NodeConfigError::NoIgnoreMask { camera: name(), path: path.clone(), found });
    match mask.area() {
        0 => wrong("no foreground"),
        all if all == u64::from(camera.width()) * u64::from(camera.height()) => wrong("foreground alone"),
        _ => Ok(Some(mask)),
    }
}

/// What a coordinator must find at a place: the cameras at `indices` of the rig, whose film may end.
pub fn expected_node(rig: &Rig, place: impl Into<NodePlace>, indices: &[usize]) -> ExpectedNode {
    let camera = |&index: &usize| CameraDescription::new(&rig.cameras()[index], index as u16);
    let cameras = indices.iter().map(camera).collect();
    let expected = |&index: &usize| ExpectedCamera::new(&rig.cameras()[index], index as u16);
    let expected_cameras = indices.iter().map(expected).collect();
    ExpectedNode { name: None, place: place.into(), cameras, expected_cameras, is_endless: false }
}
