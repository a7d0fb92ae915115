//! Many nodes in one process: real sockets and the real service, without a process for each camera.

use std::net::SocketAddr;
use std::sync::mpsc::channel;
use std::thread::JoinHandle;

use camera_node::NodeConfig;
use camera_node::service::Node;
use node_client::ExpectedNode;
use proto::Address;
use tokio::sync::watch;
use tokio::task::JoinHandle as Task;

use crate::cluster::film::Film;
use cli::{Failure, Outcome};
use cluster::expected_node;

/// Nodes on a thread of their own, one a camera; they end with it.
pub struct HostedNodes {
    nodes: Vec<ExpectedNode>,
    stop: Option<watch::Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl HostedNodes {
    /// Serves every camera of a film on a loopback port of its own.
    pub fn start(film: &Film) -> Outcome<HostedNodes> {
        let file = film.file.clone();
        let configs = (0..file.cameras.len()).map(|index| file.node_config(&[index], false));
        let configs = configs.collect::<Result<Vec<_>, _>>()?;
        let (stop, stopped) = watch::channel(());
        let (tell, told) = channel();
        let runtime =
            tokio::runtime::Builder::new_current_thread().enable_all().build().map_err(Failure::run)?;
        let thread = std::thread::spawn(move || {
            runtime.block_on(async {
                match open(configs).await {
                    Ok((nodes, addresses)) => {
                        // The starter waits for it.
                        drop(tell.send(Ok(addresses)));
                        serve(nodes, &stopped).await;
                    }
                    Err(error) => drop(tell.send(Err(error))),
                }
            });
        });
        let addresses = told.recv().map_err(|_| Failure::run("the nodes of the bench panicked"))??;
        let nodes = addresses.into_iter().enumerate();
        let nodes = nodes.map(|(index, address)| expected_node(&file.rig, address, &[index])).collect();
        Ok(HostedNodes { nodes, stop: Some(stop), thread: Some(thread) })
    }

    /// Where they listen.
    pub fn nodes(&self) -> &[ExpectedNode] {
        &self.nodes
    }
}

/// Opens all at once, each on a free loopback port.
async fn open(configs: Vec<NodeConfig>) -> Outcome<(Vec<Node>, Vec<Address>)> {
    let loopback = SocketAddr::from(([127, 0, 0, 1], 0));
    let opening: Vec<Task<_>> =
        configs.into_iter().map(|config| tokio::spawn(Node::open(config, loopback, false))).collect();
    let (mut nodes, mut addresses) = (Vec::new(), Vec::new());
    for opened in opening {
        let node = opened.await.map_err(Failure::run)?.map_err(Failure::run)?;
        let address = node.address().map_err(Failure::run)?.to_string();
        addresses.push(address.parse().map_err(Failure::run)?);
        nodes.push(node);
    }
    Ok((nodes, addresses))
}

async fn serve(nodes: Vec<Node>, stopped: &watch::Receiver<()>) {
    let serving = nodes.into_iter().map(|node| {
        let mut stopped = stopped.clone();
        tokio::spawn(node.serve(async move { drop(stopped.changed().await) }))
    });
    for served in serving.collect::<Vec<Task<_>>>() {
        if let Ok(Err(error)) = served.await {
            tracing::error!("a node of the bench: {error}");
        }
    }
}

impl Drop for HostedNodes {
    fn drop(&mut self) {
        // Without its sender the channel tells every node to end.
        drop(self.stop.take());
        if let Some(thread) = self.thread.take() {
            // A panic in there was printed; the figures are what counts.
            let _ = thread.join();
        }
    }
}
