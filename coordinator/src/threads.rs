//! On which threads a run waits, reads and writes.

use std::io;
use std::num::NonZero;
use std::thread::available_parallelism;

use tokio::runtime::{Builder, Runtime};

/// The name of threads that serve connections.
pub const SERVING_THREADS: &str = "connections";

/// So many nodes are served by the thread that steps: handing their answers to another one costs more than it spares.
const FEW_NODES: usize = 12;

/// How many threads serve the connections to so many nodes: they write questions, and read and check answers. None:
/// the thread that steps does.
pub fn threads_for(node_count: usize) -> usize {
    let cores = available_parallelism().map_or(1, NonZero::get);
    if node_count <= FEW_NODES || cores == 1 { 0 } else { cores.min(node_count.div_ceil(FEW_NODES)) }
}

/// A runtime that serves connections on so many threads beside the one that runs it, or on that one.
pub fn runtime(threads: usize) -> io::Result<Runtime> {
    let mut builder = match threads {
        0 => Builder::new_current_thread(),
        _ => Builder::new_multi_thread(),
    };
    if threads > 0 {
        builder.worker_threads(threads).thread_name(SERVING_THREADS);
    }
    builder.enable_all().build()
}
