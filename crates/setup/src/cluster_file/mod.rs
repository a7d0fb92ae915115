//! The cluster file: everything about a set-up that is not calibration. Read, checked and turned
//! into types before any port opens.
//!
//! ```toml
//! name = "room-a"                      # the room's, a DNS label; left out, "room"
//! folder = "${STUDIO:-../studio}"      # rig, sources and masks are relative to it; commands run in it
//! rig = "rig.toml"                     # aniposelib's format
//! scene = "topple"                     # a name, or a file beside this one
//! fps = 30                             # frames of the cluster per second
//! latency_s = "auto"                   # from capture to use: as little as frames need, or seconds
//! hold_s = 1.0                         # how long the last frame of a film is held
//! seed = 1
//! gravity = [0.0, 0.0, -9.81]          # m/s²; left out, the scene's
//! out_of_view = "outside"              # or "abstain"
//! min_views = 2
//! min_cameras = 3                      # a missing camera is left out while so many remain; below it there is no hull
//! push_m_s = 1.5                       # for a second after a camera has gone or come back, bodies are moved no faster
//! normal_window = "auto"               # or k, pixels
//! max_depth_m = 1.0
//! unused_cameras = ["cam4"]            # cameras of the rig that take no part
//! [wire]
//! precision = "exact"                  # or "quantised": about half the bytes, responses to about 0.1 mm
//! max_connection_age_s = 3600          # with certificates: both sides show them again this often
//! [segmentation]                       # for all cameras; each may override single keys
//! high = 110
//! [[node]]                             # a process that serves cameras: `hulltouch node FILE --host left`
//! name = "left"                        # a DNS label, by default that of the host; no other node has it
//! address = "left-pc.local:7001"       # "host:port", the host a name or an IP address, or "unix:/path"; left
//!                                      # out, the node is found by its name (DNS-SD)
//! [[camera]]
//! name = "cam1"                        # as in the rig
//! node = "left"                        # its node's name. In a file without [[node]]: an address, cameras of one
//!                                      # share a process; or nothing, for runs on one machine
//! source = { kind = "pipe", command = ["ffmpeg", "-i", "cam1.mp4", "-f", "yuv4mpegpipe", "-"] }
//! background = { kind = "images", path = "empty/cam1.png" }
//! segmentation = { low = 20 }
//! ignore_mask = "pillar/cam1.png"
//! ```
//!
//! `${NAME}` and `${NAME:-default}` in any text stand for variables of the environment; `$${` is a
//! plain `${`. A DNS label is 1 to 63 of a to z, 0 to 9 and `-`, which stands at neither end. A path that is not absolute starts at `folder`, and that at this file; one that
//! begins with a variable's value starts where the program was started, as in a shell.

mod check;
mod latency;
mod node_entry;
#[cfg(test)]
mod tests;

use std::path::{Path, PathBuf};

use camera_node::source::SourceConfig;
use coordinator::GoingOn;
use hull::Rig;
use hull::rule::ProbeSettings;
use proto::convert::Precision;
use segment::SegmentSettings;
use serde::Deserialize;
use sim::Scene;
use thiserror::Error;
use toml::{Table, Value};

use crate::expand::Variables;
use crate::text_file::read_text;

pub use latency::LatencyChange;
pub use node_entry::NodeEntry;

/// A checked cluster file.
#[derive(Clone, Debug)]
pub struct ClusterFile {
    /// The file, absolute.
    pub path: PathBuf,
    /// The room's name, a DNS label.
    pub name: String,
    /// The cameras that take part, in the order of the rig file.
    pub rig: Rig,
    /// What happens in the room.
    pub scene: SceneChoice,
    /// Frames of the cluster per second.
    pub fps: f64,
    /// From capture to use, seconds; `None`: as little as frames need, measured as the run goes.
    pub latency_s: Option<f64>,
    /// How long the last frame is held when film ends, seconds.
    pub hold_s: f64,
    /// How a run goes on without a camera.
    pub going_on: GoingOn,
    /// Decides what a run leaves to chance, if set.
    pub seed: Option<u64>,
    /// Gravity in the rig's world, m/s², if not the scene's.
    pub gravity_m_s2: Option<[f64; 3]>,
    /// The hull rule and the probes' settings.
    pub probes: ProbeSettings,
    /// How numbers travel between coordinator and nodes.
    pub precision: Precision,
    /// Connections that show certificates show them again after so long, seconds.
    pub max_connection_age_s: f64,
    /// The processes that serve the cameras, in the order of their first ones in the rig.
    pub nodes: Vec<NodeEntry>,
    /// One entry per camera of `rig`, in its order.
    pub cameras: Vec<CameraEntry>,
}

/// A scene by name or by file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum SceneChoice {
    /// One that comes with the program.
    Named(String),
    /// A scene file, absolute; it existed when the cluster file was read.
    File(PathBuf),
}

/// The cluster file's entry of one camera.
#[derive(Clone, Debug)]
pub struct CameraEntry {
    /// Its name in the rig.
    pub name: String,
    /// Its place in [`ClusterFile::rig`].
    pub rig_index: usize,
    /// Its film.
    pub source: SourceConfig,
    /// The empty room; `None` only if segmentation needs none.
    pub background: Option<SourceConfig>,
    /// How foreground is found.
    pub segmentation: SegmentSettings,
    /// A mask image of static occluders, its foreground is ignored; it existed when the file was read.
    pub ignore_mask: Option<PathBuf>,
}

/// Why a cluster file is refused; one line each.
#[derive(Debug, Error)]
pub enum ClusterFileError {
    /// It cannot be read.
    #[error("{}: {problem}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        problem: String,
    },
    /// Not TOML, or keys and types that a cluster file has not.
    #[error("{}, line {line} (`{text}`): {problem}", path.display())]
    Text {
        /// The file.
        path: PathBuf,
        /// Where, counted from 1.
        line: usize,
        /// That line.
        text: String,
        /// What was found and expected.
        problem: String,
    },
    /// A value that cannot be.
    #[error("{}, {key}: {problem}", path.display())]
    Value {
        /// The file.
        path: PathBuf,
        /// Which key, of which camera.
        key: String,
        /// What was found and expected.
        problem: String,
    },
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    name: Option<String>,
    folder: Option<String>,
    rig: String,
    scene: String,
    fps: f64,
    latency_s: Option<Value>,
    #[serde(default = "one_second")]
    hold_s: f64,
    seed: Option<u64>,
    gravity: Option<[f64; 3]>,
    #[serde(default)]
    out_of_view: OutOfViewKey,
    min_views: Option<u32>,
    min_cameras: Option<usize>,
    push_m_s: Option<f64>,
    normal_window: Option<Value>,
    max_depth_m: Option<f64>,
    #[serde(default)]
    unused_cameras: Vec<String>,
    #[serde(default)]
    wire: WireKeys,
    #[serde(default)]
    segmentation: Table,
    #[serde(default)]
    node: Vec<NodeKeys>,
    #[serde(default)]
    camera: Vec<CameraKeys>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct NodeKeys {
    name: String,
    address: Option<String>,
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct WireKeys {
    #[serde(default)]
    precision: PrecisionKey,
    max_connection_age_s: Option<f64>,
}

#[derive(Clone, Copy, Default, Deserialize)]
#[serde(rename_all = "lowercase")]
enum PrecisionKey {
    #[default]
    Exact,
    Quantised,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct CameraKeys {
    name: String,
    node: Option<String>,
    source: SourceConfig,
    stamps: Option<String>,
    background: Option<SourceConfig>,
    #[serde(default)]
    segmentation: Table,
    ignore_mask: Option<String>,
}

#[derive(Default, Deserialize)]
#[serde(rename_all = "lowercase")]
enum OutOfViewKey {
    #[default]
    Outside,
    Abstain,
}

fn one_second() -> f64 {
    1.0
}

impl ClusterFile {
    /// Reads a cluster file and the rig it names; `variables` is the environment.
    pub fn read(path: &Path, variables: Variables<'_>) -> Result<ClusterFile, ClusterFileError> {
        let refused = |error: std::io::Error| ClusterFileError::Read {
            path: path.to_owned(),
            problem: error.to_string(),
        };
        let absolute = std::path::absolute(path).map_err(refused)?;
        let text = read_text(path).map_err(refused)?;
        ClusterFile::from_text(path, &absolute, &text, variables)
    }

    /// The same of a file's text; `path` is its name in messages.
    pub(crate) fn from_text(
        path: &Path,
        absolute: &Path,
        text: &str,
        variables: Variables<'_>,
    ) -> Result<ClusterFile, ClusterFileError> {
        let file: File = toml::from_str(text).map_err(|error| text_error(path, text, &error))?;
        check::Checker { path, absolute, variables }.cluster(&file)
    }

    /// The same with the variables of this process's environment.
    pub fn open(path: &Path) -> Result<ClusterFile, ClusterFileError> {
        ClusterFile::read(path, &|name| std::env::var(name).ok())
    }

    /// Reads the scene, under the gravity of this file if it has one.
    pub fn load_scene(&self) -> Result<Scene, ClusterFileError> {
        let refused =
            |path: &Path, problem: String| ClusterFileError::Read { path: path.to_owned(), problem };
        let (path, scene) = match &self.scene {
            SceneChoice::Named(name) => (&self.path, Scene::named(name)),
            SceneChoice::File(path) => {
                let text = read_text(path).map_err(|error| refused(path, error.to_string()))?;
                let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
                (path, Scene::from_toml(&name, &text))
            }
        };
        let turned = scene.and_then(|scene| match self.gravity_m_s2 {
            Some(gravity_m_s2) => scene.with_gravity(gravity_m_s2),
            None => Ok(scene),
        });
        turned.map_err(|error| refused(path, error.to_string()))
    }

    /// Whether a coordinator on another machine can reach all nodes.
    pub fn is_deployed(&self) -> bool {
        self.nodes.iter().all(NodeEntry::has_place)
    }
}

fn text_error(path: &Path, text: &str, error: &toml::de::Error) -> ClusterFileError {
    let start = error.span().map_or(0, |span| span.start.min(text.len()));
    let line = text.as_bytes()[..start].iter().filter(|byte| **byte == b'\n').count();
    ClusterFileError::Text {
        path: path.to_owned(),
        line: line + 1,
        text: text.lines().nth(line).unwrap_or_default().trim().chars().take(80).collect(),
        problem: error.message().lines().collect::<Vec<_>>().join(", "),
    }
}
