//! Bytes counted where they cross the socket, protocol overhead and all.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use tokio::io::{AsyncRead, AsyncWrite};
use tokio_util::io::{InspectReader, InspectWriter};

/// Bytes since the beginning.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ByteCounts {
    /// Written to nodes.
    pub to_nodes: u64,
    /// Read from nodes.
    pub from_nodes: u64,
}

impl ByteCounts {
    /// Both ways together.
    pub fn total(self) -> u64 {
        self.to_nodes + self.from_nodes
    }

    /// What was counted since `before`.
    pub fn since(self, before: ByteCounts) -> ByteCounts {
        ByteCounts {
            to_nodes: self.to_nodes - before.to_nodes,
            from_nodes: self.from_nodes - before.from_nodes,
        }
    }
}

/// Shared by all connections of a run.
#[derive(Debug, Default)]
pub(crate) struct ByteCounters {
    to_nodes: AtomicU64,
    from_nodes: AtomicU64,
}

impl ByteCounters {
    pub fn read(&self) -> ByteCounts {
        ByteCounts {
            to_nodes: self.to_nodes.load(Ordering::Relaxed),
            from_nodes: self.from_nodes.load(Ordering::Relaxed),
        }
    }
}

/// A socket with every byte counted that crosses it.
pub(crate) fn counted(
    socket: impl AsyncRead + AsyncWrite + Send + Unpin,
    counters: Arc<ByteCounters>,
) -> impl AsyncRead + AsyncWrite + Send + Unpin {
    let (outgoing, incoming) = (Arc::clone(&counters), counters);
    let add =
        |counter: &AtomicU64, bytes: &[u8]| _ = counter.fetch_add(bytes.len() as u64, Ordering::Relaxed);
    let socket = InspectWriter::new(socket, move |bytes: &[u8]| add(&outgoing.to_nodes, bytes));
    InspectReader::new(socket, move |bytes: &[u8]| add(&incoming.from_nodes, bytes))
}
