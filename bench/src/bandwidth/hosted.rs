//! Many nodes in one process: real sockets and the real service, without a process for each camera.

use std::net::SocketAddr;

use camera_node::NodeConfig;
use camera_node::service::{Access, Node};
use node_client::ExpectedNode;
use proto::Address;
use setup::cli::{Failure, Outcome};
use setup::expected_node;
use tokio::runtime::Runtime;
use tokio::task::JoinHandle as Task;

use crate::cluster::film::Film;

/// Nodes on a thread of their own, one a camera; they end with it.
pub struct HostedNodes {
    nodes: Vec<ExpectedNode>,
    _runtime: Runtime,
}

impl HostedNodes {
    /// Serves every camera of a film on a loopback port of its own.
    pub fn start(film: &Film) -> Outcome<HostedNodes> {
        let file = &film.file;
        let configs = (0..file.cameras.len()).map(|index| file.node_config(&[index], false));
        let configs = configs.collect::<Result<Vec<_>, _>>()?;
        let mut builder = tokio::runtime::Builder::new_multi_thread();
        let runtime = builder.worker_threads(1).enable_all().build().map_err(Failure::run)?;
        let addresses = runtime.block_on(serve(configs))?.into_iter().enumerate();
        let nodes = addresses.map(|(index, address)| expected_node(&file.rig, address, &[index]));
        Ok(HostedNodes { nodes: nodes.collect(), _runtime: runtime })
    }

    /// Where they listen.
    pub fn nodes(&self) -> &[ExpectedNode] {
        &self.nodes
    }
}

/// Opens all at once, each on a free loopback port, and has them serve for as long as the runtime runs.
async fn serve(configs: Vec<NodeConfig>) -> Outcome<Vec<Address>> {
    let loopback = SocketAddr::from(([127, 0, 0, 1], 0));
    let opening: Vec<Task<_>> = configs
        .into_iter()
        .map(|config| tokio::spawn(Node::open(config, loopback, Access::default())))
        .collect();
    let mut addresses = Vec::new();
    for opened in opening {
        let node = opened.await.map_err(Failure::run)?.map_err(Failure::run)?;
        let address = node.address().map_err(Failure::run)?.to_string();
        addresses.push(address.parse().map_err(Failure::run)?);
        tokio::spawn(async {
            if let Err(error) = node.serve(std::future::pending()).await {
                tracing::error!("a node of the bench: {error}");
            }
        });
    }
    Ok(addresses)
}
