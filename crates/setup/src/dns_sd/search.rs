//! A coordinator looks for nodes.

use std::collections::BTreeMap;
use std::io;
use std::net::{IpAddr, SocketAddr, SocketAddrV6};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Weak};
use std::time::{Duration, Instant};

use futures::stream::{self, Stream, StreamExt as _};
use node_client::NodePlace;
use parking_lot::{Mutex, MutexGuard};
use proto::Address;
use tokio::sync::watch;

use super::Networks;
use super::candidates::Candidates;
use super::message::{Announced, MessageKind, announcements, query};
use super::station::{Link, Speaker, Station, StopHandle};

/// So long a node is looked for; one that does not answer is looked for again with the next connection.
const FIND_TIMEOUT: Duration = Duration::from_secs(2);
/// After the first answer: another network, or another machine that claims to be the node, may answer too.
const MORE_ANSWERS: Duration = Duration::from_millis(150);
/// Nodes answer once a second at most, so there is no use in more queries.
const ASK_EVERY: Duration = Duration::from_secs(1);

/// A node answers a query within a second and 120 ms: it sends one announcement a second at most.
const RECENT: Duration = Duration::from_millis(1500);

/// Looks for the nodes of a room by their names.
pub struct NodeSearch {
    networks: Networks,
    /// What is under way. It ends with the last node that is looked for.
    running: Mutex<Weak<Search>>,
    found: Arc<Found>,
    has_warned: AtomicBool,
}

/// What is known of the nodes of a room.
struct Found {
    room: String,
    /// By the names that are looked for: announcements of others are not kept.
    nodes: Mutex<BTreeMap<String, SoughtNode>>,
    /// Counts announcements of these nodes.
    news: watch::Sender<u64>,
}

#[derive(Default)]
struct SoughtNode {
    candidates: Candidates,
    /// That several claim its name was logged.
    is_ambiguous: bool,
}

/// Queries are sent for as long as this lives.
struct Search {
    #[allow(dead_code, reason = "its drop ends the search")]
    stop: StopHandle,
    began: Instant,
}

/// One node is looked for.
struct Look {
    search: Arc<Search>,
    found: Arc<Found>,
    news: watch::Receiver<u64>,
    node: String,
    until: tokio::time::Instant,
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
        let nodes = nodes.into_iter().map(|node| (node, SoughtNode::default())).collect();
        let found = Found { room: room.to_owned(), nodes: Mutex::new(nodes), news: watch::Sender::new(0) };
        let has_warned = AtomicBool::new(false);
        Arc::new(NodeSearch { networks, running: Mutex::default(), found: Arc::new(found), has_warned })
    }

    /// Where one of them is: looked for with every connection.
    pub fn place(self: &Arc<NodeSearch>, node: &str) -> NodePlace {
        let (search, node) = (Arc::clone(self), node.to_owned());
        NodePlace::sought(move || search.find(&node).boxed())
    }

    /// Looks for a node for [`FIND_TIMEOUT`]: where it is said to be, in the order in which to try. While that is tried the
    /// search goes on: the node answers once a second at most, and others may claim its name before.
    pub(super) fn find(&self, node: &str) -> impl Stream<Item = Vec<Address>> + Send + use<> {
        let looks = self.running().map(|search| {
            let found = Arc::clone(&self.found);
            let (news, node, until) =
                (found.news.subscribe(), node.to_owned(), tokio::time::Instant::now() + FIND_TIMEOUT);
            stream::unfold(Look { search, found, news, node, until }, Look::next)
        });
        stream::iter(looks).flatten()
    }

    /// The search that is under way, or a new one; none where there cannot be one.
    fn running(&self) -> Option<Arc<Search>> {
        let mut running = self.running.lock();
        if let Some(search) = running.upgrade() {
            return Some(search);
        }
        match Search::begin(self.networks, &self.found) {
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

impl Look {
    /// Where the node is said to be, soon after it is announced.
    async fn next(mut self) -> Option<(Vec<Address>, Look)> {
        // What was announced before, the search has not heard to be gone. One that goes on for long asks each second.
        let began = self.search.began;
        let since = || Instant::now().checked_sub(RECENT).map_or(began, |recent| recent.max(began));
        if tokio::time::Instant::now() >= self.until {
            return None;
        }
        let announced = self.news.wait_for(|_| self.found.is_announced(&self.node, since()));
        tokio::time::timeout_at(self.until, announced).await.ok()?.ok()?;
        tokio::time::sleep(MORE_ANSWERS).await;
        let next = self.found.next(&self.node, since()).into_iter();
        Some((next.map(|address| Address::Tcp(address.to_string())).collect(), self))
    }
}

impl Search {
    fn begin(networks: Networks, found: &Arc<Found>) -> io::Result<Search> {
        let (station, stop) = Station::new(networks)?;
        let (found, began) = (Arc::clone(found), Instant::now());
        let search = move || {
            let speaker = |_: &Link, now| Some(Seeker { found: Arc::clone(&found), due: now });
            station.run(speaker, |event| tracing::debug!("looking for nodes by DNS-SD: {event:?}"));
        };
        std::thread::Builder::new().name("dns-sd".into()).spawn(search)?;
        Ok(Search { stop, began })
    }
}

/// Looks for nodes on one network.
struct Seeker {
    found: Arc<Found>,
    due: Instant,
}

impl Speaker for Seeker {
    fn receive(&mut self, from: IpAddr, link: &Link, datagram: &[u8], now: Instant) {
        if MessageKind::of(datagram) == Some(MessageKind::Response) {
            for announced in announcements(datagram) {
                self.found.note(from, link, &announced, now);
            }
        }
    }

    fn due(&self) -> Option<Instant> {
        Some(self.due)
    }

    fn send(&mut self, now: Instant) -> Vec<u8> {
        self.due = now + ASK_EVERY;
        query()
    }

    fn goodbye(&self) -> Option<Vec<u8>> {
        None
    }
}

impl Found {
    fn nodes(&self) -> MutexGuard<'_, BTreeMap<String, SoughtNode>> {
        self.nodes.lock()
    }

    /// Keeps an announcement, if it is of a node that is looked for.
    fn note(&self, from: IpAddr, link: &Link, announced: &Announced, now: Instant) {
        if announced.room != self.room {
            return;
        }
        if let Some(node) = self.nodes().get_mut(&announced.node) {
            if announced.is_goodbye {
                node.candidates.withdraw(from, announced.instance);
            } else {
                node.candidates.announce(from, announced.instance, &addresses(announced, link), now);
            }
        } else {
            return;
        }
        self.news.send_modify(|count| *count += 1);
    }

    fn is_announced(&self, node: &str, since: Instant) -> bool {
        self.nodes().get(node).is_some_and(|node| node.candidates.are_announced(since))
    }

    /// What to try next. Logs once if several claimed to be the node since then.
    fn next(&self, name: &str, since: Instant) -> Vec<SocketAddr> {
        let mut nodes = self.nodes();
        let Some(node) = nodes.get_mut(name) else { return Vec::new() };
        let (machines, instances) = node.candidates.announcers(since);
        if instances > 1 && !std::mem::replace(&mut node.is_ambiguous, true) {
            let machines: Vec<String> = machines.iter().map(ToString::to_string).collect();
            tracing::warn!(
                "node {name} of {}: {instances} programs announce it by DNS-SD, from {}, expected one. Certificates tell \
                 which is the node; with --insecure the first that has its cameras is used: give the node its address in \
                 the cluster file",
                self.room,
                machines.join(", "),
            );
        }
        node.candidates.next(Instant::now())
    }
}

/// Where an announcement says that the node is.
fn addresses(announced: &Announced, link: &Link) -> Vec<SocketAddr> {
    let of_one = |ip: &IpAddr| match ip {
        IpAddr::V6(v6) if v6.is_unicast_link_local() => {
            SocketAddrV6::new(*v6, announced.port, 0, link.index).into()
        }
        ip => SocketAddr::new(*ip, announced.port),
    };
    if announced.port == 0 { Vec::new() } else { announced.addresses.iter().map(of_one).collect() }
}
