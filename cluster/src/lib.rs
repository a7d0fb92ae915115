//! The cluster file, and clusters on one machine: node processes, or cameras in this process.

mod cluster_file;
mod expand;
mod in_process;
mod local_cluster;
mod node_config;

pub use crate::cluster_file::{CameraEntry, ClusterFile, ClusterFileError, LatencyChange, SceneChoice};
pub use crate::in_process::{InProcess, LocalPictures};
pub use crate::local_cluster::{LocalCluster, LocalClusterError, Sockets};
pub use crate::node_config::{NodeConfigError, expected_node};
