//! Recordings of a run as MCAP files: writing them, and reading them back even if they were cut off.
//!
//! [`record`] makes a recorder for a coordinator and the file that it writes. [`Recording`] reads such a file:
//! its header, the steps as a schedule for a coordinator, the silhouettes as frames for it. The format is
//! described in `docs/recording.md` and in `recording.proto`, which every file carries.

mod channels;
mod convert;
mod fetch;
pub mod fuzz;
mod queue;
mod read;
mod recorder;
mod times;
mod writer;

pub use convert::RunHeader;
pub use fetch::{ColourCrop, ColourSource, Colours, FetchingColours};
pub use read::{
    Difference, ReadError, ReadProblem, RecordedFrames, RecordedPicture, RecordedPictures, RecordedSteps,
    Recording, StepCheck,
};
pub use recorder::{Recorded, RecordingFile, RunRecorder, record};
pub use world_encodings::recording::ConvertError;
pub use writer::{Overwrites, WriteError};
