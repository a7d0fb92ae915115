//! Where a camera's frames come from: the synthetic studio, numbered files, or a program's pipe.
//!
//! A source numbers its frames on the cluster's common count and never renumbers: in a file the
//! index is the number, a missing file is a missing frame, and a live pipe goes by arrival time.
//! Sources block; they belong on a thread of their own. They keep no time: whoever asks decides
//! when, and names the oldest frame that is still of use.

mod config;
mod files;
mod film;
mod mailbox;
mod pipe;
mod program;
mod raw;
mod stage_source;
pub mod y4m;

use std::path::PathBuf;
use std::sync::Arc;

use segment::Layout;
use thiserror::Error;

pub use config::{FileConfig, PipeConfig, SourceConfig, StageConfig};
pub use raw::RawLayout;

/// What an image's bytes are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Colours, in the layout that the camera, the film or the picture has.
    Colour(Layout),
    /// One byte a pixel: over 127 is foreground. The silhouette is taken as it is.
    Mask,
}

/// One frame's bytes, without padding. Made once, filled by many frames: a source reads into its buffer, or
/// takes it in exchange for one that is full.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Image {
    /// Pixels across.
    pub width: u32,
    /// Pixels down.
    pub height: u32,
    /// What the bytes are.
    pub kind: Kind,
    /// As many bytes as kind and size make.
    pub data: Vec<u8>,
}

impl Default for Image {
    fn default() -> Image {
        Image { width: 0, height: 0, kind: Kind::Colour(Layout::Rgb), data: Vec::new() }
    }
}

/// Which frame a source wrote.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Taken {
    /// The frame's number in the cluster's count.
    pub number: u64,
    /// When it was captured, seconds of film time on the common epoch.
    pub capture_time_s: f64,
    /// Frames that the source had and passed over since the one before: older than asked for, or
    /// come faster than they were taken.
    pub skipped: u64,
}

/// A camera's film.
pub trait Source: Send {
    /// Writes the next frame whose number is `at_least` or above into `image`, reusing its buffer;
    /// numbers only grow from call to call. Blocks until there is one. `None`: the film has ended.
    fn next(&mut self, at_least: u64, image: &mut Image) -> Result<Option<Taken>, SourceError>;
}

/// What every source of a cluster shares.
#[derive(Clone)]
pub struct OpenContext {
    /// Frames of the cluster per second; frame `n` is captured at `n / fps`.
    pub fps: f64,
    /// Seconds on the common epoch now; only live pipes look at it.
    pub clock: Clock,
}

/// Tells the time in seconds on the common epoch.
pub type Clock = Arc<dyn Fn() -> f64 + Send + Sync>;

/// Why there is no frame.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum SourceError {
    /// The images are not the camera's.
    #[error("{source_name} is {} x {} pixels, expected {} x {} as camera {camera:?} of the rig", found.0, found.1, expected.0, expected.1)]
    Size {
        /// The file or program.
        source_name: String,
        /// Its width and height.
        found: (u32, u32),
        /// The camera's name.
        camera: String,
        /// The camera's width and height.
        expected: (u32, u32),
    },
    /// A film runs at another speed than its cluster.
    #[error(
        "{source_name} says {found} frames/s, expected {expected} (fps times frame_step of the cluster file)"
    )]
    Rate {
        /// The file or program.
        source_name: String,
        /// Frames per second of its header.
        found: f64,
        /// What the cluster file makes it.
        expected: f64,
    },
    /// A file or folder is not what it should be.
    #[error("{}: {problem}", path.display())]
    File {
        /// Which.
        path: PathBuf,
        /// What was found and expected.
        problem: String,
    },
    /// A program could not be started.
    #[error("cannot start {command:?}: {problem}")]
    Start {
        /// The command line, shortened.
        command: String,
        /// The system's reason.
        problem: String,
    },
    /// A program failed, or wrote something else than film.
    #[error("{command:?} {problem} ({status}{})", if last_words.is_empty() { String::new() } else { format!("; its last words: {last_words}") })]
    Program {
        /// The command line, shortened.
        command: String,
        /// What was found and expected.
        problem: String,
        /// How it ended: its exit status, or that it had to be killed.
        status: String,
        /// The last lines of its standard error, in one line.
        last_words: String,
    },
}

#[cfg(test)]
pub(crate) mod tests {
    use nalgebra::{Matrix3, Vector3};

    use super::*;

    /// A camera called "cam" of some size.
    pub fn camera(width: u32, height: u32) -> hull::Camera {
        hull::Camera::new(
            "cam",
            (width, height),
            Matrix3::identity(),
            [0.0; 5],
            Vector3::zeros(),
            Vector3::zeros(),
        )
        .expect("a camera")
    }

    /// A cluster at the epoch, for ever.
    pub fn context(fps: f64) -> OpenContext {
        OpenContext { fps, clock: Arc::new(|| 0.0) }
    }

    /// The numbers of all frames that are left.
    pub fn numbers(source: &mut dyn Source) -> Vec<u64> {
        let mut image = Image::default();
        std::iter::from_fn(|| source.next(0, &mut image).expect("reads")).map(|taken| taken.number).collect()
    }
}
