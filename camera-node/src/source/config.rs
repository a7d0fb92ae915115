//! Sources as a cluster file describes them.

use std::fmt::Display;
use std::num::NonZeroU64;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use film_time::Stamps;
use serde::{Deserialize, Deserializer, de::Error as _};
use stage::{Motion, Prop, StageSettings};

use super::raw::RawLayout;

/// The longest wait or latency of a source, seconds. Any more is a slip of units.
const MAX_SPAN_S: f64 = 3600.0;

/// The length of the studio's background clip: the deviation of a pixel is then good to an eighth.
const EMPTY_ROOM_FRAMES: u64 = 32;

/// One source, as `{ kind = "…", … }`.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum SourceConfig {
    /// The synthetic studio.
    Stage(StageConfig),
    /// Numbered colour images.
    Images(FileConfig),
    /// Numbered masks, read by [`segment::mask`].
    Masks(FileConfig),
    /// One YUV4MPEG2 file.
    Video(FileConfig),
    /// A program that writes film to its standard output: YUV4MPEG2, or raw frames.
    Pipe(PipeConfig),
}

/// A film of the synthetic studio.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct StageConfig {
    /// What the person does.
    #[serde(deserialize_with = "named")]
    pub motion: Motion,
    /// What stands there beside the person.
    #[serde(deserialize_with = "all_named")]
    pub props: Vec<Prop>,
    /// Chooses the sensor noise.
    pub seed: u64,
    /// False for the same scene without the person.
    pub person: bool,
    /// True for the room alone, neither person nor props: a background clip.
    pub empty: bool,
    /// The film's length; left out, it has no end.
    pub frames: Option<u64>,
}

impl Default for StageConfig {
    fn default() -> StageConfig {
        let stage = StageSettings::default();
        StageConfig {
            motion: stage.motion,
            props: stage.props,
            seed: stage.seed,
            person: stage.person,
            empty: false,
            frames: None,
        }
    }
}

/// Frames in files.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FileConfig {
    /// The film's file; for images and masks a folder, a folder with a pattern like
    /// `frame_%06d.png`, or a single image, which is frame 0.
    pub path: PathBuf,
    /// The file's number (the index in a film) that is frame 0 of the cluster; left out, 0.
    #[serde(default)]
    pub start_frame: Option<u64>,
    /// Every how many-th file is a frame of the cluster.
    #[serde(default = "one")]
    pub frame_step: NonZeroU64,
}

/// A program's film.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PipeConfig {
    /// The program and its arguments; no shell is involved. For a live one `{times}` stands for a pipe on which it
    /// writes a line of milliseconds a frame, `{counts}` for one of a trigger's counts.
    #[serde(deserialize_with = "command")]
    pub command: Vec<String>,
    /// Frames without headers, of the camera's size, instead of YUV4MPEG2: what a camera's driver gives, not
    /// converted on the way.
    #[serde(default)]
    pub raw: Option<RawLayout>,
    /// Raw YUV frames whose black and white are 0 and 255, instead of 16 and 235.
    #[serde(default)]
    pub full_range: bool,
    /// Where it runs. Not in the file: [`SourceConfig::resolve`] sets it.
    #[serde(skip, default = "here")]
    pub folder: PathBuf,
    /// A camera and not a film: frames are numbered by when they were captured, as far as that is known, and what is
    /// not taken in time is dropped.
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
    /// The longest wait for one frame before the program is given up, seconds. A live one that has begun may be
    /// silent for a second or 30 frames at most, unless it runs in lock-step.
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
            SourceConfig::Stage(_) => {}
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

    /// Whether two sources on one machine read the same files, or run the same command. The studio films each camera apart.
    pub fn is_film_of(&self, other: &SourceConfig) -> bool {
        match (self, other) {
            (SourceConfig::Pipe(one), SourceConfig::Pipe(other)) => {
                (&one.command, &one.folder) == (&other.command, &other.folder)
            }
            (one, other) => one.path().is_some_and(|path| other.path() == Some(path)),
        }
    }

    /// Where its file, its folder or the pattern of its folder is once links are followed, as far as it is on this
    /// machine.
    pub fn place(&self) -> Option<PathBuf> {
        let path = self.path()?;
        let of_folder = || Some(path.parent()?.canonicalize().ok()?.join(path.file_name()?));
        path.canonicalize().ok().or_else(of_folder)
    }

    /// Where its files are.
    fn path(&self) -> Option<&Path> {
        match self {
            SourceConfig::Images(files) | SourceConfig::Masks(files) | SourceConfig::Video(files) => {
                Some(&files.path)
            }
            SourceConfig::Stage(_) | SourceConfig::Pipe(_) => None,
        }
    }

    /// Whether its images are silhouettes already: nothing is learnt or segmented, and there are no colours.
    pub fn gives_masks(&self) -> bool {
        matches!(self, SourceConfig::Masks(_))
    }

    /// The empty room of a source that knows its own: a clip of the studio, long enough to tell its
    /// noise. Any other source needs a background of its own, or none.
    pub fn empty_room(&self) -> Option<SourceConfig> {
        let SourceConfig::Stage(stage) = self else { return None };
        let frames = Some(EMPTY_ROOM_FRAMES);
        Some(SourceConfig::Stage(StageConfig { empty: true, frames, ..stage.clone() }))
    }

    /// Whether it gives frames without end.
    pub fn is_endless(&self) -> bool {
        match self {
            SourceConfig::Stage(stage) => stage.frames.is_none(),
            other => other.is_live(),
        }
    }

    /// By what its frames are numbered.
    pub fn stamps(&self) -> Stamps {
        match self {
            SourceConfig::Pipe(pipe) if pipe.live => match pipe.side() {
                Some(Side::Times) => Stamps::Capture,
                Some(Side::Counts) => Stamps::Counter,
                None => Stamps::Arrival,
            },
            _ => Stamps::Index,
        }
    }

    /// Why a command's `{times}` or `{counts}` cannot be, if so.
    pub fn misplaced_side(&self) -> Option<&'static str> {
        let SourceConfig::Pipe(pipe) = self else { return None };
        let has = |side: Side| pipe.command.iter().any(|word| word.contains(side.placeholder()));
        match (has(Side::Times), has(Side::Counts)) {
            (false, false) => None,
            (true, true) => Some("found {times} and {counts} in a command, expected one of the two"),
            _ if !pipe.live => {
                Some("found {times} or {counts} in a film's command, expected live = true too")
            }
            _ => None,
        }
    }

    /// Whether it runs at its own pace, so that frames which are not taken are lost.
    pub fn is_live(&self) -> bool {
        matches!(self, SourceConfig::Pipe(PipeConfig { live: true, .. }))
    }
}

/// What a program says of each frame beside its film.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// When it was captured, milliseconds.
    Times,
    /// Which of a trigger's it is.
    Counts,
}

impl Side {
    /// The word of a command that stands for the pipe.
    pub fn placeholder(self) -> &'static str {
        match self {
            Side::Times => "{times}",
            Side::Counts => "{counts}",
        }
    }

    /// What comes on it.
    pub fn what(self) -> &'static str {
        match self {
            Side::Times => "time",
            Side::Counts => "count",
        }
    }
}

impl PipeConfig {
    /// What the program says beside its film.
    pub fn side(&self) -> Option<Side> {
        let has = |side: &Side| self.command.iter().any(|word| word.contains(side.placeholder()));
        [Side::Times, Side::Counts].into_iter().find(has)
    }
}

impl FileConfig {
    /// All frames under `path`, numbered as they are.
    pub fn new(path: impl Into<PathBuf>) -> FileConfig {
        FileConfig { path: path.into(), start_frame: None, frame_step: one() }
    }
}

fn named<'de, D: Deserializer<'de>, T: FromStr<Err: Display>>(deserializer: D) -> Result<T, D::Error> {
    String::deserialize(deserializer)?.parse().map_err(D::Error::custom)
}

fn all_named<'de, D: Deserializer<'de>, T: FromStr<Err: Display>>(
    deserializer: D,
) -> Result<Vec<T>, D::Error> {
    let names = Vec::<String>::deserialize(deserializer)?;
    names.iter().map(|name| name.parse().map_err(D::Error::custom)).collect()
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
