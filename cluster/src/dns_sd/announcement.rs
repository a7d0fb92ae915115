//! A node says where it is.

use std::net::SocketAddr;
use std::time::{Duration, Instant};

use mdns_sd::{DaemonEvent, IfKind, IfPredicate, Receiver, ServiceDaemon, ServiceInfo};
use thiserror::Error;

use super::{NODE, Networks, ROOM, SERVICE};

/// An announcement is made within a second of a network's being there.
const ANNOUNCE_TIMEOUT: Duration = Duration::from_secs(5);
/// The word that a node is gone is on its way within this.
const GOODBYE_TIMEOUT: Duration = Duration::from_millis(250);
/// An instance's name is a label of 63 bytes at most, and a number may be added to it.
const MAX_INSTANCE_CHARS: usize = 56;

/// A node cannot be announced.
#[derive(Debug, Error)]
#[error("cannot announce the node by DNS-SD: {0}")]
pub struct AnnounceError(#[from] mdns_sd::Error);

/// A node is announced for as long as this lives.
pub struct Announcement {
    daemon: ServiceDaemon,
    full_name: String,
}

impl Announcement {
    /// Announces a node of a room, which listens at this address, wherever machines reach it. What goes wrong later
    /// is logged once.
    pub fn begin(room: &str, node: &str, listens: SocketAddr) -> Result<Announcement, AnnounceError> {
        Announcement::begin_in(Networks::Others, room, node, listens)
    }

    pub(super) fn begin_in(
        networks: Networks,
        room: &str,
        node: &str,
        listens: SocketAddr,
    ) -> Result<Announcement, AnnounceError> {
        let service = service(room, node, listens)?;
        let full_name = service.get_fullname().to_owned();
        let daemon = networks.daemon()?;
        let events = daemon.monitor()?;
        daemon.register(service)?;
        let node = format!("node {node} of {room}");
        let watched = std::thread::Builder::new().name("dns-sd".into()).spawn(move || watch(&node, &events));
        watched.map_err(|error| mdns_sd::Error::Msg(error.to_string()))?;
        Ok(Announcement { daemon, full_name })
    }
}

impl Drop for Announcement {
    /// Says that the node is gone.
    fn drop(&mut self) {
        if let Ok(said) = self.daemon.unregister(&self.full_name) {
            let _ = said.recv_timeout(GOODBYE_TIMEOUT);
        }
        let _ = self.daemon.shutdown();
    }
}

/// What is said of a node. The instance's name is for people who look: the texts say which node it is.
fn service(room: &str, node: &str, listens: SocketAddr) -> Result<ServiceInfo, mdns_sd::Error> {
    let instance: String = format!("{node}@{room}").chars().take(MAX_INSTANCE_CHARS).collect();
    // Not the machine's own name, for which its own responder answers.
    let host = format!("{node}.node.{room}.hulltouch.local.");
    let texts = [(ROOM, room), (NODE, node)];
    let ip = listens.ip();
    if !ip.is_unspecified() {
        let mut service = ServiceInfo::new(SERVICE, &instance, &host, ip, listens.port(), &texts[..])?;
        service.set_interfaces(vec![IfKind::Addr(ip)]);
        return Ok(service);
    }
    let service = ServiceInfo::new(SERVICE, &instance, &host, "", listens.port(), &texts[..])?;
    let mut service = service.enable_addr_auto();
    let listens_there = IfPredicate::new(move |interface| {
        !interface.is_loopback() && (ip.is_ipv6() || interface.ip().is_ipv4())
    });
    service.set_interfaces(vec![IfKind::Predicate(listens_there)]);
    Ok(service)
}

/// Logs what becomes of an announcement, until it ends.
fn watch(node: &str, events: &Receiver<DaemonEvent>) {
    let deadline = Instant::now() + ANNOUNCE_TIMEOUT;
    let (mut is_announced, mut has_warned) = (false, false);
    loop {
        let left = deadline.saturating_duration_since(Instant::now());
        let is_late = left.is_zero();
        let problem = match if is_late { events.recv().ok() } else { events.recv_timeout(left).ok() } {
            Some(DaemonEvent::Announce(..)) => {
                if !is_announced {
                    tracing::info!("{node} is announced by DNS-SD");
                }
                is_announced = true;
                continue;
            }
            Some(DaemonEvent::NameChange(_)) => "another says by DNS-SD that it is this node".to_owned(),
            Some(DaemonEvent::Error(error)) => format!("DNS-SD: {error}"),
            Some(_) => continue,
            None if events.is_disconnected() => return,
            None if is_announced => continue,
            None => "it cannot be announced by DNS-SD: no network that carries multicast".to_owned(),
        };
        if !has_warned {
            tracing::warn!("{node}: {problem}; with an address in the cluster file it need not be found");
        }
        has_warned = true;
    }
}
