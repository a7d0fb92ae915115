//! What checks look at: plain data, gathered before.

use std::path::PathBuf;

use net::{CertificateError, Identity};
use node_client::{Mismatch, NodeError, NodeReport};
use proto::CameraStatus;

/// Everything that is known of a room, as seen from this machine.
pub struct Facts {
    /// Frames of the cluster per second.
    pub fps: f64,
    /// This program's version.
    pub version: String,
    /// The wall clock, unix seconds.
    pub now_unix_s: f64,
    /// The only node that is looked at, if it is this machine's own.
    pub host: Option<String>,
    /// The nodes that are looked at.
    pub nodes: Vec<NodeFacts>,
    /// The certificates of this machine.
    pub certificates: Certificates,
    /// What the cameras did while they were looked at, or why nothing is known.
    pub film: Result<Vec<CameraFacts>, NoFilm>,
    /// Devices of this machine's cameras.
    pub devices: Vec<DeviceFacts>,
    /// Films of empty rooms that are not there: of which camera, and where they should be.
    pub missing_backgrounds: Vec<(String, PathBuf)>,
    /// Folders that film is written to.
    pub disks: Vec<DiskFacts>,
    /// How many files a process may have open; none: any number.
    pub open_files: Option<u64>,
}

/// A node, as seen from here.
pub struct NodeFacts {
    /// Its name, or its address.
    pub name: String,
    /// Where it may be.
    pub place: Place,
    /// Whether a connection is made there; of the last place that was tried.
    pub reach: Reach,
    /// What it said; none if it was not asked.
    pub found: Option<Result<NodeReport, NodeError>>,
    /// Whether it is what the cluster file says; none if that is not known.
    pub agrees: Option<Result<(), Mismatch>>,
}

impl NodeFacts {
    /// What it said, if it did.
    pub fn report(&self) -> Option<&NodeReport> {
        self.found.as_ref()?.as_ref().ok()
    }
}

/// Where a node may be.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Place {
    /// At these addresses, which its own address in the cluster file means or which it announces.
    At(Vec<String>),
    /// The host of its address is not known: which, and the system's reason.
    UnknownHost(String, String),
    /// It is looked for by DNS-SD, and is not announced.
    NotAnnounced,
}

/// Whether a connection is made.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Reach {
    /// There was nowhere to try.
    NotTried,
    /// A program listens there.
    Open,
    /// No program listens there.
    Refused(String),
    /// Nothing came back.
    Timeout(String),
    /// Another reason of the system's.
    Failed(String, String),
}

/// Certificates of this machine.
pub enum Certificates {
    /// None are given, and none are needed: all stays on this machine.
    NotNeeded,
    /// None are given: what is sent to this node may be read and forged by others.
    Missing {
        /// A node of another machine.
        node: String,
        /// Whether that was asked for with `--insecure`.
        is_wanted: bool,
    },
    /// A folder of them.
    Folder {
        /// The folder's path.
        folder: PathBuf,
        /// Whose they are and when they end, unix seconds; or what is wrong with them.
        found: Result<(Identity, f64), CertificateError>,
    },
}

/// Why nothing is known of what cameras film.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum NoFilm {
    /// It was not tried: not asked for, or what it needs is missing, which other checks name.
    NotTried(String),
    /// It was tried, and failed.
    Failed(String),
}

/// A camera, looked at several times while it filmed.
pub struct CameraFacts {
    /// Its name.
    pub name: String,
    /// What its node said of it each time, oldest first; at least one.
    pub looks: Vec<CameraStatus>,
}

impl CameraFacts {
    /// The last look.
    pub fn last(&self) -> Option<&CameraStatus> {
        self.looks.last()
    }
}

/// A device that a camera's source names.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DeviceFacts {
    /// The camera.
    pub camera: String,
    /// As its command names it.
    pub path: String,
    /// What is there.
    pub found: Device,
}

/// What is there at a device's path.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Device {
    /// There is no such file.
    Missing,
    /// This user may not open it.
    Denied,
    /// A device, and the USB that it hangs on, if it does.
    There(Option<Usb>),
}

/// Where on a USB a device hangs.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Usb {
    /// The bus's number.
    pub bus: u32,
    /// The device's speed there, Mbit/s.
    pub speed_mbit_s: u32,
}

/// A folder that film is written to.
pub struct DiskFacts {
    /// Its path.
    pub folder: PathBuf,
    /// What is written there.
    pub what: &'static str,
    /// How many bytes are free; or why nothing can be written.
    pub free: Result<u64, String>,
}
