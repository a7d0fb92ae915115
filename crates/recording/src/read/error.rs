//! What can be wrong with a recording.

use std::path::PathBuf;

use mcap::McapError;
use proto::codec::TooManyEntries;
use proto::convert::ConvertError as SilhouetteError;
use thiserror::Error;
use world_encodings::recording::ConvertError;

/// Why a file is no recording that can be replayed.
#[derive(Debug, Error)]
#[error("{}: {problem}", path.display())]
pub struct ReadError {
    /// The file.
    pub path: PathBuf,
    /// What was found and expected.
    pub problem: ReadProblem,
}

/// What is wrong with a file.
#[derive(Debug, Error)]
pub enum ReadProblem {
    /// The system does not give it.
    #[error(transparent)]
    Io(#[from] std::io::Error),
    /// A pipe, a device or a folder.
    #[error("no file, expected an MCAP file on a disk: it is read in any order")]
    NoFile,
    /// It does not begin like an MCAP file.
    #[error("no MCAP file")]
    NotMcap,
    /// It was cut off.
    #[error("it ends too early")]
    CutOff,
    /// A record that claims to be too large to be read.
    #[error("a record claims {found} bytes, expected at most {most}")]
    RecordSize {
        /// The size that the record claims, bytes.
        found: u64,
        /// The largest size that is read, bytes.
        most: u64,
    },
    /// A chunk or record that MCAP does not allow.
    #[error(transparent)]
    Mcap(#[from] McapError),
    /// A chunk is compressed in a way that is not known.
    #[error("chunks compressed with {0:?}, expected lz4, zstd or none: repack it with --compression lz4")]
    Compression(String),
    /// It has no header, perhaps because it cannot be read so far.
    #[error("no recording of this program{}", because(.0))]
    NoHeader(Option<Box<ReadProblem>>),
    /// It has no step, perhaps because it cannot be read so far.
    #[error("it holds no step{}", because(.0))]
    NoStep(Option<Box<ReadProblem>>),
    /// A step at a film time that no run reaches, seconds.
    #[error("a step at {0} s, expected 0 to 1e9 s")]
    FilmTime(f64),
    /// A frame that no run reaches.
    #[error("frame {0}, expected at most 2^40")]
    FrameNumber(u64),
    /// More frames than can be looked through.
    #[error("more frames than a recording can have: {0}, and it goes on")]
    TooManyFrames(usize),
    /// A step that does not follow the one before it.
    #[error("steps are out of order at {0:.3} s")]
    Order(f64),
    /// Bytes that are no message of this kind.
    #[error("a message {message} cannot be read: {error}")]
    Decode {
        /// The message's name.
        message: &'static str,
        /// What the decoder says.
        error: prost::DecodeError,
    },
    /// A message that would take far more memory than file.
    #[error(transparent)]
    TooManyEntries(#[from] TooManyEntries),
    /// A message that cannot be.
    #[error(transparent)]
    Message(#[from] ConvertError),
    /// Runs that are no silhouette.
    #[error(transparent)]
    Silhouette(#[from] SilhouetteError),
    /// The file has changed since it was looked through.
    #[error("frame {frame} of camera {camera} is not where it was")]
    Moved {
        /// Of which frame.
        frame: u64,
        /// The camera's place in the rig.
        camera: usize,
    },
}

fn because(problem: &Option<Box<ReadProblem>>) -> String {
    problem.as_ref().map_or_else(String::new, |problem| format!(" ({problem})"))
}
