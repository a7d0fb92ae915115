//! The coordinator: asks the nodes, merges their answers and steps the world.
//!
//! Three layouts share the pass and the loop: `cluster` (questions travel, nodes compute), `gather`
//! (silhouettes travel, one machine computes: the paper's layout) and `in process` (nothing travels).

mod answers;
mod bounds;
mod camera_client;
mod counting;
mod facts;
mod fanout;
mod figures;
pub mod live;
pub mod record;
mod run;
mod transport;
mod ways;

pub use answers::Asks;
pub use camera_client::{ExpectedCamera, ExpectedNode};
pub use counting::ByteCounts;
pub use facts::{CameraFacts, FilmState, FrameFacts, Pace};
pub use figures::{Figures, Percentiles, Progress, STAGES};
pub use run::{Coordinator, RunError, RunSettings, Snapshot, Watcher};
pub use transport::{LocalFrames, Transport};
