//! A coordinator looks for nodes.

use std::collections::BTreeMap;
use std::net::{IpAddr, SocketAddr, SocketAddrV6};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError, Weak};
use std::time::Duration;

use mdns_sd::{Receiver, ResolvedService, ScopedIp, ServiceDaemon, ServiceEvent};
use node_client::NodePlace;
use proto::Address;
use tokio::sync::watch;

use super::{NODE, Networks, ROOM, SERVICE};

/// So long a node is waited for; one that does not answer is looked for again with the next connection.
const FIND_TIMEOUT: Duration = Duration::from_secs(2);
/// After the first answer: another network, or another who says to be the node, may answer too.
const MORE_ANSWERS: Duration = Duration::from_millis(150);
/// Answers about one node that are kept.
const MAX_ANSWERS: usize = 8;
/// Addresses of one answer that are kept.
const MAX_ADDRESSES: usize = 8;

/// Looks for the nodes of a room by their names.
pub struct NodeSearch {
    room: String,
    /// The names that are looked for: answers about others are not kept.
    nodes: Vec<String>,
    networks: Networks,
    /// What is under way. It ends with the last node that is looked for, and all that was heard with it.
    running: Mutex<Weak<Search>>,
    has_warned: AtomicBool,
}

/// By names of nodes, then of answers.
type Found = BTreeMap<String, BTreeMap<String, Vec<SocketAddr>>>;

/// A question that is out.
struct Search {
    daemon: ServiceDaemon,
    found: watch::Receiver<Found>,
}

impl NodeSearch {
    /// Will look for these nodes of a room.
    pub fn new(room: &str, nodes: impl IntoIterator<Item = String>) -> Arc<NodeSearch> {
        NodeSearch::within(Networks::Others, room, nodes)
    }

    pub(super) fn within(
        networks: Networks,
        room: &str,
        nodes: impl IntoIterator<Item = String>,
    ) -> Arc<NodeSearch> {
        Arc::new(NodeSearch {
            room: room.to_owned(),
            nodes: nodes.into_iter().collect(),
            networks,
            running: Mutex::default(),
            has_warned: AtomicBool::new(false),
        })
    }

    /// Where one of them is: looked for with every connection.
    pub fn place(self: &Arc<NodeSearch>, node: &str) -> NodePlace {
        let (search, node) = (Arc::clone(self), node.to_owned());
        NodePlace::sought(move || {
            let (search, node) = (Arc::clone(&search), node.clone());
            Box::pin(async move { search.find(&node).await })
        })
    }

    /// Where a node is said to be; within [`FIND_TIMEOUT`].
    pub(super) async fn find(&self, node: &str) -> Vec<Address> {
        let Some(search) = self.running() else { return Vec::new() };
        let mut found = search.found.clone();
        let answered = found.wait_for(|found| found.contains_key(node));
        if tokio::time::timeout(FIND_TIMEOUT, answered).await.is_err() {
            return Vec::new();
        }
        tokio::time::sleep(MORE_ANSWERS).await;
        found.borrow().get(node).map(in_turn).unwrap_or_default()
    }

    /// The search that is under way, or a new one; none where there cannot be one.
    fn running(&self) -> Option<Arc<Search>> {
        let mut running = self.running.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(search) = running.upgrade() {
            return Some(search);
        }
        match Search::begin(self.networks, self.room.clone(), self.nodes.clone()) {
            Ok(search) => {
                let search = Arc::new(search);
                *running = Arc::downgrade(&search);
                Some(search)
            }
            Err(error) => {
                if !self.has_warned.swap(true, Ordering::Relaxed) {
                    tracing::warn!("nodes cannot be looked for by DNS-SD: {error}");
                }
                None
            }
        }
    }
}

impl Search {
    fn begin(networks: Networks, room: String, nodes: Vec<String>) -> mdns_sd::Result<Search> {
        let daemon = networks.daemon()?;
        let events = daemon.browse(SERVICE)?;
        let (keep, found) = watch::channel(Found::new());
        let listener = move || listen(&room, &nodes, &events, &keep);
        let spawned = std::thread::Builder::new().name("dns-sd".into()).spawn(listener);
        spawned.map_err(|error| mdns_sd::Error::Msg(error.to_string()))?;
        Ok(Search { daemon, found })
    }
}

impl Drop for Search {
    fn drop(&mut self) {
        // Its threads end with it.
        let _ = self.daemon.shutdown();
    }
}

/// Keeps what is said of these nodes of the room, until the search ends.
fn listen(room: &str, nodes: &[String], events: &Receiver<ServiceEvent>, keep: &watch::Sender<Found>) {
    while let Ok(event) = events.recv() {
        match event {
            ServiceEvent::ServiceResolved(service) => {
                let of_this_room = service.get_property_val_str(ROOM) == Some(room);
                let said = service.get_property_val_str(NODE).filter(|_| of_this_room);
                let Some(node) = said.and_then(|said| nodes.iter().find(|node| **node == said)) else {
                    continue;
                };
                let addresses = addresses(&service);
                keep.send_if_modified(|found| insert(found, node, service.get_fullname(), addresses));
            }
            ServiceEvent::ServiceRemoved(_, answer) => keep.send_modify(|found| {
                found.values_mut().for_each(|answers| drop(answers.remove(&answer)));
                found.retain(|_, answers| !answers.is_empty());
            }),
            _ => {}
        }
    }
}

/// Whether there is something new.
fn insert(found: &mut Found, node: &str, answer: &str, addresses: Vec<SocketAddr>) -> bool {
    let known = found.get(node);
    let is_full = known.is_some_and(|answers| answers.len() == MAX_ANSWERS && !answers.contains_key(answer));
    if addresses.is_empty() || is_full {
        return false;
    }
    found.entry(node.to_owned()).or_default().insert(answer.to_owned(), addresses);
    true
}

/// Where a service says it is, IPv4 first.
fn addresses(service: &ResolvedService) -> Vec<SocketAddr> {
    let port = service.get_port();
    let of_one = |ip: &ScopedIp| match ip {
        ScopedIp::V6(v6) if v6.addr().is_unicast_link_local() => {
            SocketAddrV6::new(*v6.addr(), port, 0, v6.scope_id().index).into()
        }
        other => SocketAddr::new(other.to_ip_addr(), port),
    };
    let is_somewhere = |ip: IpAddr| !ip.is_unspecified() && !ip.is_multicast();
    let all = service.get_addresses().iter().map(of_one);
    let mut addresses: Vec<SocketAddr> = all.filter(|at| port > 0 && is_somewhere(at.ip())).collect();
    addresses.sort_unstable();
    addresses.truncate(MAX_ADDRESSES);
    addresses
}

/// The first address of each answer, then the second of each: no answer keeps the others out.
fn in_turn(answers: &BTreeMap<String, Vec<SocketAddr>>) -> Vec<Address> {
    let mut found: Vec<SocketAddr> = Vec::new();
    for turn in 0..MAX_ADDRESSES {
        for address in answers.values().filter_map(|addresses| addresses.get(turn)) {
            if !found.contains(address) {
                found.push(*address);
            }
        }
    }
    found.into_iter().map(|address| Address::Tcp(address.to_string())).collect()
}
