//! Where a camera's frames come from: the synthetic studio, numbered files, or a program's pipe.
//!
//! A source numbers its frames on the cluster's common count and never renumbers: in a file the
//! index is the number, a missing file is a missing frame, and a live pipe goes by what it knows: a count, capture
//! times, or when its frames arrive.
//! Sources block; they belong on a thread of their own. They keep no time: the caller decides when a
//! frame is due, and names the oldest that is still of use.

mod config;
mod files;
mod film;
mod film_numbers;
pub(crate) mod fuzz;
mod jpeg;
mod mailbox;
mod mark;
mod number;
mod numbered;
mod pipe;
mod program;
mod raw;
mod side_pipe;
mod stage_source;
mod y4m;

use std::fmt::Display;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use film_time::CameraPace;
use hull::Camera;
use proto::TroubleKind;
use segment::{Format, Layout, SizeError};
use thiserror::Error;

pub use config::{FileConfig, PipeConfig, SourceConfig, StageConfig};
pub use raw::RawLayout;

pub use files::{MaskFiles, read_silhouette};
pub use film_numbers::usual_distance;
pub use numbered::numbered_images;

use files::FileFrames;
use film::FileFilm;
use pipe::PipeSource;
use stage_source::StageSource;

/// What an image's bytes are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ImageKind {
    /// Colours, in the layout that the camera, the film or the picture has.
    Colour(Layout),
    /// One byte a pixel: 1 is foreground, 0 background. The silhouette is taken as it is.
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
    pub kind: ImageKind,
    /// As many bytes as kind and size make.
    pub data: Vec<u8>,
}

impl Default for Image {
    fn default() -> Image {
        Image { width: 0, height: 0, kind: ImageKind::Colour(Layout::Rgb), data: Vec::new() }
    }
}

/// Why an image is no frame in colours.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum ImageError {
    /// It is a mask.
    #[error("masks, expected colours")]
    Mask,
    /// No frame has such a size.
    #[error(transparent)]
    Size(#[from] SizeError),
}

impl Image {
    /// Size and layout of colours.
    pub fn format(&self) -> Result<Format, ImageError> {
        match self.kind {
            ImageKind::Colour(layout) => Ok(Format::new(layout, self.width, self.height)?),
            ImageKind::Mask => Err(ImageError::Mask),
        }
    }
}

/// Which frame a source wrote.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SourceFrame {
    /// The frame's number in the cluster's count.
    pub number: u64,
    /// When it was captured, seconds of film time on the common epoch.
    pub capture_time_s: f64,
}

impl SourceFrame {
    /// A frame of a film that was captured when its number says.
    fn of_film(number: u64, fps: f64) -> SourceFrame {
        SourceFrame { number, capture_time_s: number as f64 / fps }
    }
}

/// A camera's film.
pub trait Source: Send {
    /// Writes the next frame whose number is `at_least` or above into `image`, reusing its buffer;
    /// numbers only grow from call to call. Blocks until there is one. `None`: the film has ended, or the run
    /// is over.
    fn next(&mut self, at_least: u64, image: &mut Image) -> Result<Option<SourceFrame>, SourceError>;

    /// How a live camera films, once that is known.
    fn pace(&self) -> Option<CameraPace> {
        None
    }
}

/// What every source of a cluster shares.
#[derive(Clone)]
pub struct OpenContext {
    /// Frames of the cluster per second; frame `n` is captured at `n / fps`.
    pub fps: f64,
    /// Seconds on the common epoch now; only live pipes use it.
    pub clock: Clock,
    /// Where the cluster cuts film into frames; only live pipes use it.
    pub phase: Phase,
    /// Whether frames are of a run, which shows each at its film time. Outside runs their order alone counts.
    pub is_run: bool,
    /// Whether the run is over: a program that gives no frame is then waited for no longer.
    pub stopped: Stopped,
    /// The longest wait for a frame of a live source that has given one; the first may take as long as its
    /// `timeout_s`, and none longer.
    pub live_silence: Duration,
}

/// Tells the time in seconds on the common epoch.
pub type Clock = Arc<dyn Fn() -> f64 + Send + Sync>;

/// Tells by how many periods of film frames are captured after what their number says, once that is decided.
pub type Phase = Arc<dyn Fn() -> Option<f64> + Send + Sync>;

/// Tells whether a run is over.
pub type Stopped = Arc<dyn Fn() -> bool + Send + Sync>;

impl OpenContext {
    /// For a source that is read outside any run: its clock stands at the epoch, and nothing stops it.
    pub fn outside_runs(fps: f64) -> OpenContext {
        OpenContext {
            fps,
            is_run: false,
            clock: Arc::new(|| 0.0),
            phase: Arc::new(|| None),
            stopped: Arc::new(|| false),
            live_silence: Duration::MAX,
        }
    }
}

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
        /// Its path.
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
        /// Whether the system only lacks something for the moment.
        may_pass: bool,
    },
    /// A program failed, or wrote something else than film.
    #[error("{command:?} {problem} ({status}{})", if stderr_tail.is_empty() { String::new() } else { format!("; standard error: {stderr_tail}") })]
    Program {
        /// The command line, shortened.
        command: String,
        /// What was found and expected.
        problem: String,
        /// How it ended: its exit status, or that it had to be killed.
        status: String,
        /// The last lines of its standard error, in one line.
        stderr_tail: String,
    },
    /// A live camera's frames come at another rate, or with times or counts that cannot be.
    #[error("{error}")]
    Numbers {
        /// What the program did.
        error: Box<SourceError>,
        /// Which of the two.
        kind: TroubleKind,
    },
}

impl SourceError {
    /// What kind of thing is wrong, for who looks.
    pub fn kind(&self) -> TroubleKind {
        match self {
            SourceError::Rate { .. } => TroubleKind::Rate,
            SourceError::Numbers { kind, .. } => *kind,
            _ => TroubleKind::Source,
        }
    }

    /// Whether a source that cannot be opened for this reason may open later with nothing changed by hand. A
    /// program that is not there will not come by itself.
    pub fn may_pass(&self) -> bool {
        matches!(self, SourceError::Start { may_pass: true, .. })
    }

    fn file(path: &Path, problem: impl Display) -> SourceError {
        SourceError::File { path: path.to_owned(), problem: problem.to_string() }
    }
}

impl SourceConfig {
    /// The frames of numbered images, ascending, of a run at `fps`; `None` of other sources. Numbers that are no
    /// frames of film are refused.
    pub fn image_frames(&self, fps: f64) -> Option<Result<Vec<u64>, SourceError>> {
        let (SourceConfig::Images(config) | SourceConfig::Masks(config)) = self else { return None };
        let frames = numbered::frames(config);
        Some(frames.and_then(|frames| {
            numbered::check(config, &frames, fps)?;
            Ok(frames.into_iter().map(|frame| frame.0).collect())
        }))
    }

    /// Opens the source for the camera at `camera_index` of its rig. Programs start here; a size
    /// that is not the camera's is refused, at the latest with the first frame.
    pub fn open(
        &self,
        camera: &Camera,
        camera_index: usize,
        context: &OpenContext,
    ) -> Result<Box<dyn Source>, SourceError> {
        let files = |files, kind| FileFrames::open(files, kind, camera, context);
        Ok(match self {
            SourceConfig::Stage(stage) => Box::new(StageSource::new(stage, camera, camera_index, context)),
            SourceConfig::Images(config) => Box::new(files(config, files::COLOUR)?),
            SourceConfig::Masks(config) => Box::new(files(config, ImageKind::Mask)?),
            SourceConfig::Video(file) => Box::new(FileFilm::open(file, camera, context)?),
            SourceConfig::Pipe(pipe) => Box::new(PipeSource::open(pipe, camera, context)?),
        })
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use nalgebra::{Matrix3, Vector3};

    use super::*;

    /// A camera called "cam" of some size.
    pub fn camera(width: u32, height: u32) -> Camera {
        Camera::new("cam", (width, height), Matrix3::identity(), [0.0; 5], Vector3::zeros(), Vector3::zeros())
            .expect("a camera")
    }

    /// A cluster at the epoch, for ever.
    pub fn context(fps: f64) -> OpenContext {
        OpenContext::outside_runs(fps)
    }

    /// The numbers of all frames that are left.
    pub fn numbers(source: &mut dyn Source) -> Vec<u64> {
        let mut image = Image::default();
        std::iter::from_fn(|| source.next(0, &mut image).expect("reads")).map(|taken| taken.number).collect()
    }
}
