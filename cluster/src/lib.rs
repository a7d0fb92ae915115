//! The cluster file, and clusters on one machine: node processes, or cameras in this process.

mod cluster_file;
mod expand;
mod local;
mod node_config;

pub use crate::cluster_file::{CameraEntry, ClusterFile, ClusterFileError, SceneChoice};
pub use crate::local::{InProcess, LocalCluster, LocalPictures, Sockets, expected_node};
pub use crate::node_config::{ignored_pixels, node_config, read_cluster_file};
