//! A node says where it is.

use std::io;
use std::net::{IpAddr, SocketAddr};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use thiserror::Error;

use super::Networks;
use super::message::{MessageKind, Service};
use super::schedule::AnnouncementSchedule;
use super::station::{Link, Speaker, Station, StationEvent, StopHandle};

/// Nodes answer the same query at different times, between these (RFC 6762, section 6).
const MIN_DELAY_MS: u32 = 20;
const MAX_DELAY_MS: u32 = 120;

/// A node cannot be announced.
#[derive(Debug, Error)]
#[error("cannot announce the node by DNS-SD: {0}")]
pub struct AnnounceError(#[from] io::Error);

/// A node is announced for as long as this lives. What other machines announce is not read.
pub struct Announcement {
    /// Both are there until the drop.
    stop: Option<StopHandle>,
    thread: Option<JoinHandle<()>>,
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
        let id = getrandom::u32().map_err(io::Error::other)?;
        let service = Service { room: room.to_owned(), node: node.to_owned(), port: listens.port(), id };
        let (station, stop) = Station::new(networks)?;
        let mut log = AnnouncementLog::new(format!("node {node} of {room}"));
        let announce = move || {
            let responder = |link: &Link, now| Responder::new(&service, listens.ip(), link, now);
            station.run(responder, |event| log.note(event));
        };
        let thread = std::thread::Builder::new().name("dns-sd".into()).spawn(announce)?;
        Ok(Announcement { stop: Some(stop), thread: Some(thread) })
    }
}

impl Drop for Announcement {
    /// Says that the node is gone.
    fn drop(&mut self) {
        drop(self.stop.take());
        // It never waits for another machine. One that panicked has said so.
        let _ = self.thread.take().map(JoinHandle::join);
    }
}

/// Announces a node on one network: by itself when it begins, and when it is asked.
struct Responder {
    service: Service,
    announcement: Vec<u8>,
    delay: Duration,
    schedule: AnnouncementSchedule,
}

impl Responder {
    /// `None` where the node does not listen.
    fn new(service: &Service, listens: IpAddr, link: &Link, now: Instant) -> Option<Responder> {
        let is_reached = |ip: &&IpAddr| {
            **ip == listens || (listens.is_unspecified() && (listens.is_ipv6() || ip.is_ipv4()))
        };
        let addresses: Vec<IpAddr> = link.addresses.iter().filter(is_reached).copied().collect();
        let announcement = service.announcement(&addresses, false);
        let delay_ms = MIN_DELAY_MS + service.id % (MAX_DELAY_MS - MIN_DELAY_MS);
        (!addresses.is_empty()).then(|| Responder {
            service: service.clone(),
            announcement,
            delay: Duration::from_millis(delay_ms.into()),
            schedule: AnnouncementSchedule::new(now),
        })
    }
}

impl Speaker for Responder {
    fn receive(&mut self, _: IpAddr, _: &Link, datagram: &[u8], now: Instant) {
        // One answer is enough for all that ask until then.
        let is_due = self.schedule.due().is_some_and(|due| due <= now + self.delay);
        let is_query = MessageKind::of(datagram) == Some(MessageKind::Query);
        if !is_due && is_query && self.service.is_asked_by(datagram) {
            self.schedule.ask(self.delay, now);
        }
    }

    fn due(&self) -> Option<Instant> {
        self.schedule.due()
    }

    fn send(&mut self, now: Instant) -> Vec<u8> {
        self.schedule.sent(now);
        self.announcement.clone()
    }

    fn goodbye(&self) -> Option<Vec<u8>> {
        Some(self.service.announcement(&[], true))
    }
}

/// Logs what becomes of an announcement: success once, and trouble once.
struct AnnouncementLog {
    node: String,
    is_announced: bool,
    has_warned: bool,
}

impl AnnouncementLog {
    fn new(node: String) -> AnnouncementLog {
        AnnouncementLog { node, is_announced: false, has_warned: false }
    }

    fn note(&mut self, event: StationEvent) {
        let node = &self.node;
        let problem = match event {
            StationEvent::Sent => {
                if !std::mem::replace(&mut self.is_announced, true) {
                    tracing::info!("{node} is announced by DNS-SD");
                }
                return;
            }
            StationEvent::Unheard(Some(error)) => error.to_string(),
            StationEvent::Unheard(None) => "no network that carries multicast".to_owned(),
        };
        if !std::mem::replace(&mut self.has_warned, true) {
            tracing::warn!(
                "{node}: it cannot be announced by DNS-SD: {problem}; with an address in the cluster file it need not be found"
            );
        }
    }
}
