//! The nodes of a cluster file, asked how they are.

use std::sync::Arc;

use futures::future::join_all;
use node_client::{Dial, ExpectedNode, NodeError, NodeReport, StatusClient};
use setup::ClusterFile;
use setup::cli::Outcome;

/// Asks all nodes of a room, again and again.
pub struct Room {
    clients: Vec<StatusClient>,
}

/// What one node said.
pub struct NodeSample {
    /// The node that was asked.
    pub node: ExpectedNode,
    /// What it said, or why it did not.
    pub found: Result<NodeReport, NodeError>,
}

impl NodeSample {
    /// The node's name, or where it is.
    pub fn name(&self) -> String {
        self.node.name.clone().unwrap_or_else(|| self.node.place.to_string())
    }
}

impl Room {
    /// The nodes of a cluster file, over sockets of a viewer.
    pub fn of(file: &ClusterFile, dial: &Arc<dyn Dial>) -> Outcome<Room> {
        let nodes = file.expected_nodes()?;
        let client = |node| StatusClient::new(node, Arc::clone(dial));
        Ok(Room { clients: nodes.into_iter().map(client).collect() })
    }

    /// Asks all at once; done within a few seconds, whatever they do.
    pub async fn ask(&mut self) -> Vec<NodeSample> {
        join_all(self.clients.iter_mut().map(ask_one)).await
    }
}

async fn ask_one(client: &mut StatusClient) -> NodeSample {
    let node = client.node().clone();
    NodeSample { node, found: client.ask().await }
}
