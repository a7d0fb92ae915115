//! Where the answers to a pass come from.

/// The process that answers the questions of a pass, and the silhouettes it uses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Answering {
    /// This process, of its own cameras.
    InProcess,
    /// This process, of silhouettes that nodes send.
    Gathered,
    /// So many nodes, so that a question takes a trip.
    Nodes(usize),
}

impl Answering {
    /// How many groups of cameras a pass asks.
    pub fn group_count(self) -> usize {
        if let Answering::Nodes(count) = self { count } else { 1 }
    }

    /// Whether nodes answer.
    pub fn asks_nodes(self) -> bool {
        matches!(self, Answering::Nodes(_))
    }
}
