//! Speaks multicast DNS on all networks of this machine, on a thread: a socket for each network and address family, and
//! nothing kept of what is received.

use std::io;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr, SocketAddrV6, UdpSocket};
use std::os::fd::AsFd as _;
use std::os::unix::net::UnixStream;
use std::time::{Duration, Instant};

use if_addrs::get_if_addrs;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use socket2::{Domain, InterfaceIndexOrAddress, Protocol, Socket, Type};

use super::Networks;
use super::message::{MAX_ADDRESSES, MAX_MESSAGE_BYTES};
use super::schedule::ReadBudget;

const PORT: u16 = 5353;
const GROUP_V4: Ipv4Addr = Ipv4Addr::new(224, 0, 0, 251);
const GROUP_V6: Ipv6Addr = Ipv6Addr::new(0xff02, 0, 0, 0, 0, 0, 0, 0xfb);
/// Hops of every message (RFC 6762, section 11).
const HOPS: u32 = 255;
/// Networks that come and go are seen within this.
const LOOK_EVERY: Duration = Duration::from_secs(5);
/// Networks that are used; a machine with containers has many.
const MAX_LINKS: usize = 64;

/// A network, as one address family sees it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Link {
    /// Of the interface.
    pub index: u32,
    /// This machine's addresses there, of one family.
    pub addresses: Vec<IpAddr>,
}

/// What a station says and hears on one network.
pub(super) trait Speaker {
    /// A datagram came.
    fn receive(&mut self, from: IpAddr, link: &Link, datagram: &[u8], now: Instant);

    /// When something is to be sent next.
    fn due(&self) -> Option<Instant>;

    /// What is due now.
    fn send(&mut self, now: Instant) -> Vec<u8>;

    /// What is sent at the end.
    fn goodbye(&self) -> Option<Vec<u8>>;
}

/// Whether a station is heard.
#[derive(Debug)]
pub(super) enum StationEvent {
    /// A message was sent.
    Sent,
    /// No message could be sent so far, and why: without an error, there is no network that carries multicast.
    Unheard(Option<io::Error>),
}

/// Ends a station, when it is dropped.
pub(super) struct StopHandle(#[allow(dead_code, reason = "its end is seen at the other end")] UnixStream);

/// The networks that are used, each with its speaker.
pub(super) struct Station<S> {
    networks: Networks,
    links: Vec<(Link, UdpSocket, S)>,
    stop: UnixStream,
    budget: ReadBudget,
    /// Networks that could not be used, which are not tried again.
    failed: Vec<Link>,
    /// The last failure, until a message was sent: some network may carry no multicast, and another does.
    failure: Option<io::Error>,
    has_sent: bool,
}

impl<S: Speaker> Station<S> {
    pub(super) fn new(networks: Networks) -> io::Result<(Station<S>, StopHandle)> {
        let (stop, handle) = UnixStream::pair()?;
        let budget = ReadBudget::new(Instant::now());
        let (links, failed) = (Vec::new(), Vec::new());
        let station = Station { networks, links, stop, budget, failed, failure: None, has_sent: false };
        Ok((station, StopHandle(handle)))
    }

    /// Speaks until the [`StopHandle`] is dropped; `speaker` makes the speaker of a network that is there.
    pub(super) fn run(
        mut self,
        speaker: impl Fn(&Link, Instant) -> Option<S>,
        mut on: impl FnMut(StationEvent),
    ) {
        let mut looks = 0_u64;
        let mut look_at = Instant::now();
        loop {
            let now = Instant::now();
            if now >= look_at {
                // A network may come up while the first look is made.
                if looks > 0 && !self.has_sent {
                    on(StationEvent::Unheard(self.failure.take()));
                }
                self.look(&speaker, now);
                looks += 1;
                look_at = now + LOOK_EVERY;
            }
            self.send_due(&mut on, now);
            if self.is_stopped_within(look_at) {
                break;
            }
            self.receive();
        }
        for (link, socket, speaker) in &self.links {
            // The network may be gone.
            let _ = speaker.goodbye().map(|goodbye| socket.send_to(&goodbye, group(link)));
        }
    }

    /// Uses the networks that are there now.
    fn look(&mut self, speaker: impl Fn(&Link, Instant) -> Option<S>, now: Instant) {
        let found = match self.networks.links() {
            Ok(found) => found,
            Err(error) => {
                self.failure = Some(error);
                return;
            }
        };
        self.links.retain(|(link, ..)| found.contains(link));
        self.failed.retain(|link| found.contains(link));
        for link in found.into_iter().take(MAX_LINKS) {
            if self.failed.contains(&link) || self.links.iter().any(|(known, ..)| *known == link) {
                continue;
            }
            let Some(speaker) = speaker(&link, now) else { continue };
            match open(&link) {
                Ok(socket) => self.links.push((link, socket, speaker)),
                Err(error) => {
                    self.failed.push(link);
                    self.failure = Some(error);
                }
            }
        }
    }

    fn send_due(&mut self, on: &mut impl FnMut(StationEvent), now: Instant) {
        for (link, socket, speaker) in &mut self.links {
            if speaker.due().is_none_or(|due| due > now) {
                continue;
            }
            match socket.send_to(&speaker.send(now), group(link)) {
                Ok(_) => {
                    self.has_sent = true;
                    on(StationEvent::Sent);
                }
                Err(error) => self.failure = Some(error),
            }
        }
    }

    /// Waits until something comes, is due, or it is time to look; true at the end.
    fn is_stopped_within(&self, look_at: Instant) -> bool {
        let now = Instant::now();
        let paused_until = self.budget.paused_until(now);
        let due = self.links.iter().filter_map(|(.., speaker)| speaker.due());
        let until = due.chain([look_at]).chain(paused_until).min().unwrap_or(look_at);
        let sockets: &[(Link, UdpSocket, S)] = if paused_until.is_some() { &[] } else { &self.links };
        let mut waits = vec![PollFd::new(&self.stop, PollFlags::IN)];
        waits.extend(
            sockets.iter().map(|(_, socket, _)| PollFd::from_borrowed_fd(socket.as_fd(), PollFlags::IN)),
        );
        // A little later, so that what is due is due then.
        let timeout = until.saturating_duration_since(now) + Duration::from_micros(100);
        let timeout = Timespec::try_from(timeout).ok();
        // A signal ends the wait early, which is harmless.
        let _ = poll(&mut waits, timeout.as_ref());
        !waits[0].revents().is_empty()
    }

    /// Reads what has come, within the budget. Networks take turns, so that a flood on one leaves room for the others.
    fn receive(&mut self) {
        let mut datagram = [0; MAX_MESSAGE_BYTES + 1];
        let mut has_more = true;
        while has_more {
            has_more = false;
            for (link, socket, speaker) in &mut self.links {
                let now = Instant::now();
                if !self.budget.may_read(now) {
                    return;
                }
                let Ok((bytes, from)) = socket.recv_from(&mut datagram) else { continue };
                self.budget.spend();
                has_more = true;
                speaker.receive(from.ip(), link, &datagram[..bytes], now);
            }
        }
    }
}

impl Networks {
    /// The networks that there are, each with this machine's addresses.
    fn links(self) -> io::Result<Vec<Link>> {
        let mut links: Vec<Link> = Vec::new();
        for interface in get_if_addrs()? {
            let (ip, Some(index)) = (interface.ip(), interface.index) else { continue };
            if !self.includes(ip) || !interface.is_oper_up() {
                continue;
            }
            let same = |link: &&mut Link| link.index == index && link.addresses[0].is_ipv4() == ip.is_ipv4();
            match links.iter_mut().find(same) {
                Some(link) => link.addresses.push(ip),
                None => links.push(Link { index, addresses: vec![ip] }),
            }
        }
        for link in &mut links {
            link.addresses.sort_unstable();
            link.addresses.truncate(MAX_ADDRESSES);
        }
        Ok(links)
    }
}

fn group(link: &Link) -> SocketAddr {
    match link.addresses[0] {
        IpAddr::V4(_) => (GROUP_V4, PORT).into(),
        IpAddr::V6(_) => SocketAddrV6::new(GROUP_V6, PORT, 0, link.index).into(),
    }
}

/// A socket that sends to the group on one network, and receives only what was sent to the group there.
fn open(link: &Link) -> io::Result<UdpSocket> {
    let socket = match link.addresses[0] {
        IpAddr::V4(address) => {
            let socket = Socket::new(Domain::IPV4, Type::DGRAM, Some(Protocol::UDP))?;
            socket.join_multicast_v4_n(&GROUP_V4, &InterfaceIndexOrAddress::Index(link.index))?;
            socket.set_multicast_all_v4(false)?;
            socket.set_multicast_if_v4(&address)?;
            socket.set_multicast_ttl_v4(HOPS)?;
            socket
        }
        IpAddr::V6(_) => {
            let socket = Socket::new(Domain::IPV6, Type::DGRAM, Some(Protocol::UDP))?;
            socket.set_only_v6(true)?;
            socket.join_multicast_v6(&GROUP_V6, link.index)?;
            socket.set_multicast_all_v6(false)?;
            socket.set_multicast_if_v6(link.index)?;
            socket.set_multicast_hops_v6(HOPS)?;
            socket
        }
    };
    // Other programs of this machine speak multicast DNS too.
    socket.set_reuse_address(true)?;
    socket.set_reuse_port(true)?;
    socket.bind(&group(link).into())?;
    socket.set_nonblocking(true)?;
    Ok(socket.into())
}
