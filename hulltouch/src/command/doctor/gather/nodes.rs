//! Where nodes are, whether they can be reached, and what they say.

use std::io;
use std::sync::Arc;
use std::time::Duration;

use futures::future::join_all;
use node_client::{Agreement, Dial, ExpectedNode, NodeError, StatusClient};
use proto::Address;
use setup::ClusterFile;
use setup::cli::Outcome;
use tokio::net::{TcpStream, UnixStream};

use super::super::facts::{NodeFacts, Place, Reach};
use crate::command::node::part::Part;

/// A connection is made within this, or something keeps it from being made.
const CONNECT_TIMEOUT: Duration = Duration::from_millis(1500);
/// Addresses of a node that are looked at one by one; any machine may announce more.
const MAX_LOOKED_AT: usize = 8;
/// Looking a name up may take this long.
const LOOKUP_TIMEOUT: Duration = Duration::from_secs(5);

/// The nodes that are looked at: all that have a place, or a machine's own where it listens.
pub fn expected(file: &ClusterFile, host: Option<&str>) -> Outcome<Vec<ExpectedNode>> {
    let Some(host) = host else {
        return if file.is_deployed() { Ok(file.expected_nodes()?) } else { Ok(Vec::new()) };
    };
    let listens = Part::of_host(file, Some(host))?.listen(file)?;
    let here = listens.to_string().replacen("0.0.0.0:", "127.0.0.1:", 1).replacen("[::]:", "[::1]:", 1);
    let address: Address = here.parse().map_err(setup::cli::Failure::input)?;
    let mut nodes = file.expected_nodes()?;
    nodes.retain(|node| node.name.as_deref() == Some(host));
    nodes.iter_mut().for_each(|node| node.place = address.clone().into());
    Ok(nodes)
}

/// Looks at all of them at once.
pub async fn look(
    nodes: &[ExpectedNode],
    dial: Option<&Arc<dyn Dial>>,
    agreement: &Agreement,
) -> Vec<NodeFacts> {
    join_all(nodes.iter().map(|node| look_at(node, dial, agreement))).await
}

/// A node tells other nodes nothing, and itself neither: one that refuses its own certificate is there and runs.
pub fn forget_refusals(nodes: &mut [NodeFacts]) {
    for node in nodes {
        node.found.take_if(|found| matches!(found, Err(NodeError::Refused(_))));
    }
}

async fn look_at(node: &ExpectedNode, dial: Option<&Arc<dyn Dial>>, agreement: &Agreement) -> NodeFacts {
    let (place, addresses) = find(node).await;
    let name = node.name.clone().unwrap_or_else(|| node.place.to_string());
    let found = match (dial, &place) {
        (Some(dial), Place::At(_)) => Some(StatusClient::new(node.clone(), Arc::clone(dial)).ask().await),
        _ => None,
    };
    let reach = match &found {
        Some(Ok(_)) => Reach::Open,
        _ => try_all(&addresses).await,
    };
    let agrees = found.as_ref().and_then(|found| found.as_ref().ok());
    let agrees = agrees.map(|report| agreement.check(node, &report.status.node));
    NodeFacts { name, place, reach, found, agrees }
}

/// Where a node may be: for the check, and to be tried.
async fn find(node: &ExpectedNode) -> (Place, Vec<Address>) {
    let addresses = node.place.addresses(MAX_LOOKED_AT).await;
    if node.place.is_sought() && addresses.is_empty() {
        return (Place::NotAnnounced, addresses);
    }
    for address in &addresses {
        let Address::Tcp(host_port) = address else { continue };
        let looked_up = tokio::time::timeout(LOOKUP_TIMEOUT, tokio::net::lookup_host(host_port)).await;
        let problem = match looked_up.map(|found| found.map(Iterator::count)) {
            Ok(Ok(1..)) => continue,
            Ok(Ok(0)) => "no address".to_owned(),
            Ok(Err(error)) => error.to_string(),
            Err(_) => format!("no answer within {} s", LOOKUP_TIMEOUT.as_secs()),
        };
        let host = host_port.rsplit_once(':').map_or(&host_port[..], |(host, _)| host);
        return (Place::UnknownHost(host.to_owned(), problem), Vec::new());
    }
    (Place::At(addresses.iter().map(ToString::to_string).collect()), addresses)
}

/// Whether a connection is made to one of these.
async fn try_all(addresses: &[Address]) -> Reach {
    let mut reach = Reach::NotTried;
    for address in addresses {
        let connecting = async {
            match address {
                Address::Tcp(host_port) => TcpStream::connect(host_port).await.map(drop),
                Address::Unix(path) => UnixStream::connect(path).await.map(drop),
            }
        };
        let at = address.to_string();
        reach = match tokio::time::timeout(CONNECT_TIMEOUT, connecting).await {
            Ok(Ok(())) => return Reach::Open,
            Err(_) => Reach::Timeout(at),
            Ok(Err(error)) => match error.kind() {
                io::ErrorKind::ConnectionRefused | io::ErrorKind::NotFound => Reach::Refused(at),
                io::ErrorKind::TimedOut => Reach::Timeout(at),
                _ => Reach::Failed(at, error.to_string()),
            },
        };
    }
    reach
}
