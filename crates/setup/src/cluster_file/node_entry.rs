//! A process of the cluster and its cameras.

use proto::Address;

/// A process that serves cameras.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NodeEntry {
    /// Its name, a DNS label; `None` in a file that gives cameras addresses, or nothing.
    pub name: Option<String>,
    /// Where it listens. A node with a name alone is found by it; one with neither is for local runs.
    pub address: Option<Address>,
    /// The places of its cameras in the rig, ascending.
    pub cameras: Vec<usize>,
}

impl NodeEntry {
    /// Can a coordinator on another machine reach it?
    pub fn has_place(&self) -> bool {
        self.name.is_some() || self.address.is_some()
    }
}
