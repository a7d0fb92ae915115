//! The coordinator: asks the nodes, merges their answers and steps the world.
//!
//! What is decided stands in `core`, in plain structs: the run itself, [`roster`] (who is there, which frame all have) and
//! [`query`] (what to ask the hull, what the answers make of it) among them. What waits is thin: [`Transport`] (three
//! layouts) and [`Coordinator`] (the loop).

mod client;
mod core;
mod figures;
pub mod hooks;
pub mod live;
mod memory;
pub mod metrics;
mod run;
mod threads;
mod transport;

pub use crate::core::playback::PlaybackSettings;
pub use crate::core::query::{self, AskEvery};
pub use crate::core::roster;
pub use figures::{
    AnswerCounts, Figures, MissedSteps, NodeBytes, PassCounts, Percentiles, Progress, RunCounts, Stage,
    Timings,
};
pub use memory::MemoryUse;
pub use run::{Coordinator, FRAMES_AHEAD, GoingOn, GoneOn, RunError, RunSettings, Snapshot, Watcher};
pub use threads::{SERVING_THREADS, runtime, threads_for};
pub use transport::{BoxError, Fetching, LocalFrames, Placement, Silhouettes, Transport, TransportError};
