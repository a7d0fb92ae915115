//! What a cluster file says about a source, and opening it.

use std::num::NonZeroU64;
use std::path::{Path, PathBuf};

use hull::Camera;
use serde::{Deserialize, Deserializer, de::Error as _};

use super::files::FileFrames;
use super::film::FileFilm;
use super::pipe::PipeSource;
use super::{Kind, OpenContext, Source, SourceError};

/// The largest span of time that a source may be told to wait or to lag, seconds. Any more is a
/// slip of units.
const MAX_SPAN_S: f64 = 3600.0;

/// One source, as `{ kind = "…", … }`.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum SourceConfig {
    /// Numbered colour images.
    Images(FileConfig),
    /// Numbered masks, 8 bits: over 127 is foreground.
    Masks(FileConfig),
    /// One YUV4MPEG2 file.
    Video(FileConfig),
    /// A program that writes YUV4MPEG2 to its standard output.
    Pipe(PipeConfig),
}

/// Frames in files.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FileConfig {
    /// The film's file; for images and masks a folder, a folder with a pattern like
    /// `frame_%06d.png`, or a single image, which is frame 0.
    pub path: PathBuf,
    /// The file's number (the index in a film) that is frame 0 of the cluster.
    #[serde(default)]
    pub start_frame: u64,
    /// Every how many-th file is a frame of the cluster.
    #[serde(default = "one")]
    pub frame_step: NonZeroU64,
}

/// A program's film.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PipeConfig {
    /// The program and its arguments; no shell is involved.
    #[serde(deserialize_with = "command")]
    pub command: Vec<String>,
    /// Where it runs. Not in the file: [`SourceConfig::resolve`] sets it.
    #[serde(skip, default = "here")]
    pub folder: PathBuf,
    /// A camera and not a film: frames are numbered by arrival, and what is not taken in time is
    /// dropped.
    #[serde(default)]
    pub live: bool,
    /// From exposure to arrival, seconds; for live sources.
    #[serde(default, deserialize_with = "span_s")]
    pub latency_s: f64,
    /// The index in the film that is frame 0 of the cluster.
    #[serde(default)]
    pub start_frame: u64,
    /// Every how many-th frame of the film is a frame of the cluster.
    #[serde(default = "one")]
    pub frame_step: NonZeroU64,
    /// The longest wait for one frame before the program is given up, seconds.
    #[serde(default = "ten_seconds", deserialize_with = "positive_span_s")]
    pub timeout_s: f64,
}

impl SourceConfig {
    /// Makes paths and commands usable: `path` turns the text of a path into a path, `text` expands
    /// what stands in a command, which will run in `folder`.
    pub fn resolve<E>(
        &mut self,
        folder: &Path,
        path: impl Fn(&str) -> Result<PathBuf, E>,
        text: impl Fn(&str) -> Result<String, E>,
    ) -> Result<(), E> {
        match self {
            SourceConfig::Images(files) | SourceConfig::Masks(files) | SourceConfig::Video(files) => {
                files.path = path(&files.path.to_string_lossy())?;
            }
            SourceConfig::Pipe(pipe) => {
                pipe.folder = folder.to_owned();
                for word in &mut pipe.command {
                    *word = text(word)?;
                }
            }
        }
        Ok(())
    }

    /// Opens the source for the camera at `camera_index` of its rig. Programs start here; a size
    /// that is not the camera's is refused, at the latest with the first frame.
    pub fn open(
        &self,
        camera: &Camera,
        camera_index: usize,
        context: &OpenContext,
    ) -> Result<Box<dyn Source>, SourceError> {
        let _ = camera_index;
        Ok(match self {
            SourceConfig::Images(files) => Box::new(FileFrames::open(files, Kind::Rgb, camera, context)?),
            SourceConfig::Masks(files) => Box::new(FileFrames::open(files, Kind::Mask, camera, context)?),
            SourceConfig::Video(file) => Box::new(FileFilm::open(file, camera, context)?),
            SourceConfig::Pipe(pipe) => Box::new(PipeSource::open(pipe, camera, context)?),
        })
    }

    /// Does it run at its own pace, so that frames which are not taken are lost?
    pub fn is_live(&self) -> bool {
        matches!(self, SourceConfig::Pipe(PipeConfig { live: true, .. }))
    }
}

fn one() -> NonZeroU64 {
    NonZeroU64::MIN
}

fn here() -> PathBuf {
    PathBuf::from(".")
}

fn ten_seconds() -> f64 {
    10.0
}

fn command<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<String>, D::Error> {
    let words = Vec::<String>::deserialize(deserializer)?;
    match words.first() {
        Some(program) if !program.is_empty() => Ok(words),
        _ => Err(D::Error::custom("invalid command: found no program, expected [\"ffmpeg\", …]")),
    }
}

fn span_s<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    checked_span(f64::deserialize(deserializer)?, 0.0)
}

fn positive_span_s<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    checked_span(f64::deserialize(deserializer)?, 0.001)
}

fn checked_span<E: serde::de::Error>(found: f64, least: f64) -> Result<f64, E> {
    if (least..=MAX_SPAN_S).contains(&found) {
        return Ok(found);
    }
    Err(E::custom(format_args!("found {found}, expected {least} to {MAX_SPAN_S} seconds")))
}
