//! The cluster file, nodes found by their names, and clusters on one machine: node processes, or cameras in this
//! process. Beside them what command lines share ([`cli`]).

pub mod cli;
mod cluster_file;
mod dns_sd;
mod expand;
pub mod fuzz;
mod in_process;
mod local_cluster;
mod node_config;
mod ring_frames;
mod text_file;

pub use crate::cluster_file::{
    CameraEntry, ClusterFile, ClusterFileError, LatencyChange, NodeEntry, SceneChoice,
};
pub use crate::dns_sd::{AnnounceError, Announcement, NodeSearch};
pub use crate::in_process::{InProcess, LocalFilm, LocalPictures};
pub use crate::local_cluster::{LocalCluster, LocalClusterError, LocalNodes, Sockets};
pub use crate::node_config::{NodeConfigError, expected_node};
pub use crate::ring_frames::{RingFilm, RingFrames};
pub use crate::text_file::read_text;
