//! What a node reports of itself to coordinators and viewers.

use film_time::{CameraPace, Stamps};

use crate::description::NodeDescription;

/// What a node says of itself.
#[derive(Clone, Debug, PartialEq)]
pub struct NodeStatus {
    /// Who it is; the term is that of who holds it.
    pub node: NodeDescription,
    /// A reading of its [`monotonic_s`](film_time::monotonic_s).
    pub node_s: f64,
    /// A reading of its wall clock at the same moment, unix seconds.
    pub unix_s: f64,
    /// The lease holder, if there is one.
    pub holder: Option<HolderStatus>,
    /// When the certificate ends that it shows, unix seconds.
    pub certificate_ends_unix_s: Option<f64>,
    /// Why its film has failed for good.
    pub failure: Option<String>,
    /// Its cameras, in the description's order.
    pub cameras: Vec<CameraStatus>,
}

/// Who holds a node.
#[derive(Clone, Debug, PartialEq)]
pub struct HolderStatus {
    /// Its name, as it says.
    pub name: String,
    /// Its term.
    pub term: u64,
    /// For how long, seconds.
    pub held_s: f64,
    /// Whether it reads frames now; otherwise it may be gone.
    pub is_there: bool,
}

/// How a camera films.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraStatus {
    /// Place in the rig.
    pub rig_index: u16,
    /// Frames of the run so far.
    pub frames: u64,
    /// The newest of them.
    pub newest: Option<NewestFrame>,
    /// Frames per second, measured over about a second; 0: none come.
    pub frames_per_s: f64,
    /// The standard deviation of capture times from a steady pace, seconds.
    pub jitter_s: f64,
    /// What was last wrong with its film in this run.
    pub trouble: Option<CameraTrouble>,
}

/// A camera's newest frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NewestFrame {
    /// Its number.
    pub frame: u64,
    /// Since it was captured, seconds; of film that is made as fast as it can be, since it was there.
    pub age_s: f64,
    /// Foreground, a share of the image's pixels.
    pub foreground: f64,
    /// By what the source knows which frame is which.
    pub stamps: Stamps,
    /// Of live cameras, once it is known.
    pub pace: Option<CameraPace>,
}

/// What was wrong with a camera's film.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraTrouble {
    /// What kind of thing.
    pub kind: TroubleKind,
    /// In words.
    pub message: String,
    /// How long ago, seconds.
    pub age_s: f64,
}

/// What kind of thing is wrong with a camera's film.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TroubleKind {
    /// Its source does not open, ends, or gives something else than film.
    Source,
    /// It films at another rate than the cluster.
    Rate,
    /// Its times or counts cannot be.
    Stamps,
}
