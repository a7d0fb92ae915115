//! Nodes are announced and found on this machine's own network.

use std::net::{Ipv4Addr, SocketAddr, UdpSocket};
use std::sync::Arc;
use std::time::{Duration, Instant};

use futures::StreamExt as _;
use mdns_sd::{IfKind, ServiceDaemon, ServiceEvent, ServiceInfo};
use proto::Address;

use super::message::Service;
use super::*;

const ADDRESS: &str = "127.0.0.1:7123";

fn announced(room: &str, node: &str, at: &str) -> Announcement {
    let address: SocketAddr = at.parse().expect("an address");
    Announcement::begin_in(Networks::Loopback, room, node, address).expect("announced")
}

/// A room of this test alone: tests of other processes may use the same network.
fn room(test: &str) -> String {
    format!("{test}-{}", std::process::id())
}

fn search(room: &str) -> Arc<NodeSearch> {
    NodeSearch::within(Networks::Loopback, room, ["left".to_owned(), "right".to_owned()])
}

/// Where a node is said to be at first; nowhere if it is not announced.
async fn look(search: &NodeSearch, node: &str) -> Vec<Address> {
    std::pin::pin!(search.find(node)).next().await.unwrap_or_default()
}

/// Where a node is found, within some attempts; `None`, said aloud, where multicast does not reach this machine itself.
async fn found(search: &NodeSearch, node: &str) -> Option<Vec<String>> {
    for _ in 0..4 {
        let found = look(search, node).await;
        if !found.is_empty() {
            return Some(found.iter().map(ToString::to_string).collect());
        }
    }
    if loopback_carries_multicast() {
        return Some(Vec::new());
    }
    testkit::skip("loopback carries no multicast");
    None
}

/// Sends a datagram to a multicast group on loopback, and waits for it.
fn loopback_carries_multicast() -> bool {
    let group = Ipv4Addr::new(224, 0, 0, 251);
    let local = Ipv4Addr::LOCALHOST;
    let attempt = || -> std::io::Result<()> {
        let socket = socket2::Socket::new(socket2::Domain::IPV4, socket2::Type::DGRAM, None)?;
        socket.bind(&SocketAddr::from((Ipv4Addr::UNSPECIFIED, 0)).into())?;
        socket.join_multicast_v4(&group, &local)?;
        socket.set_multicast_if_v4(&local)?;
        let socket = UdpSocket::from(socket);
        socket.set_read_timeout(Some(Duration::from_secs(1)))?;
        let port = socket.local_addr()?.port();
        socket.send_to(b"hello", (group, port))?;
        socket.recv(&mut [0; 8]).map(|_| ())
    };
    attempt().is_ok()
}

#[tokio::test]
async fn a_search_ends_however_much_is_announced() {
    let room = room("endless");
    let _left = announced(&room, "left", ADDRESS);
    let search = search(&room);
    if found(&search, "left").await.is_none() {
        return;
    }
    // What is announced now is announced in all of the next looks.
    let looks: Vec<_> = search.find("left").take(1000).collect().await;
    assert!(!looks.is_empty() && looks.len() < 100, "{} looks", looks.len());
}

#[tokio::test]
async fn a_node_is_found_where_it_is_announced_and_no_longer_when_it_is_gone() {
    let (room, other_room) = (room("found"), room("elsewhere"));
    let left = announced(&room, "left", ADDRESS);
    let _other = announced(&other_room, "right", "127.0.0.1:7124");
    let search = search(&room);
    let Some(at) = found(&search, "left").await else { return };
    assert_eq!(at, [ADDRESS]);
    assert!(look(&search, "right").await.is_empty(), "that is another room's");
    drop(left);
    assert!(look(&search, "left").await.is_empty(), "it has said that it is gone");
}

#[tokio::test]
async fn two_that_say_to_be_the_same_node_are_both_found() {
    let room = room("twice");
    let _left = announced(&room, "left", ADDRESS);
    let search = search(&room);
    if found(&search, "left").await.is_none() {
        return;
    }
    let _false_left = announced(&room, "left", "127.0.0.1:7125");
    let mut at = Vec::new();
    for _ in 0..4 {
        at = found(&search, "left").await.unwrap_or_default();
        if at.len() == 2 {
            break;
        }
    }
    at.sort_unstable();
    assert_eq!(at, [ADDRESS, "127.0.0.1:7125"]);
}

#[tokio::test]
async fn nodes_are_looked_for_together_and_silence_takes_no_longer_than_one() {
    let watch = testkit::Watch::start();
    let search = search(&room("silence"));
    let began = tokio::time::Instant::now();
    let (left, right) = tokio::join!(look(&search, "left"), look(&search, "right"));
    assert!(left.is_empty() && right.is_empty());
    testkit::timely!(watch, began.elapsed() < Duration::from_secs(3), "took {:?}", began.elapsed());
}

/// Sends messages to all on this machine's own network.
struct Liar(UdpSocket);

impl Liar {
    fn new() -> Liar {
        let socket =
            socket2::Socket::new(socket2::Domain::IPV4, socket2::Type::DGRAM, None).expect("a socket");
        socket.set_multicast_if_v4(&Ipv4Addr::LOCALHOST).expect("loopback");
        Liar(socket.into())
    }

    fn send(&self, message: &[u8]) {
        self.0.send_to(message, (Ipv4Addr::new(224, 0, 0, 251), 5353)).expect("sent");
    }

    /// Announces instances of a node, each at a port of its own from 1 on.
    fn invent(&self, room: &str, node: &str, count: u16) {
        for port in 1..=count {
            let service = Service { room: room.into(), node: node.into(), port, id: port.into() };
            self.send(&service.announcement(&[Ipv4Addr::LOCALHOST.into()], false));
            // The system drops what comes faster than it is read.
            if port % 50 == 0 {
                std::thread::sleep(Duration::from_millis(20));
            }
        }
    }
}

#[tokio::test]
async fn invented_instances_of_the_same_machine_delay_the_node_by_one_search() {
    let room = room("invented");
    let _left = announced(&room, "left", ADDRESS);
    let search = search(&room);
    if found(&search, "left").await.is_none() {
        return;
    }
    let liar = Liar::new();
    let mut times_missing = 0;
    for _ in 0..4 {
        // Keeps the search alive while it is flooded.
        let (_, at) = tokio::join!(look(&search, "right"), async {
            liar.invent(&room, "left", 200);
            look(&search, "left").await
        });
        times_missing += u32::from(!at.iter().any(|at| at.to_string() == ADDRESS));
    }
    assert!(times_missing <= 2, "it was missing {times_missing} times of 4");
}

/// Another implementation of multicast DNS on this machine's own network.
fn other_daemon() -> ServiceDaemon {
    let daemon = ServiceDaemon::new().expect("a daemon");
    daemon.disable_interface(IfKind::All).expect("asked");
    daemon.enable_interface(IfKind::LoopbackV4).expect("asked");
    daemon
}

#[test]
fn another_browser_finds_our_announcement() {
    let room = room("browsed");
    let daemon = other_daemon();
    let events = daemon.browse("_hulltouch._tcp.local.").expect("browses");
    let left = announced(&room, "left", ADDRESS);
    let of_this_room = |wanted: fn(&ServiceEvent, &str) -> bool| {
        let until = Instant::now() + Duration::from_secs(10);
        std::iter::from_fn(|| events.recv_deadline(until).ok()).find(|event| wanted(event, &room))
    };
    let resolved = of_this_room(
        |event, room| matches!(event, ServiceEvent::ServiceResolved(found) if found.get_property_val_str("room") == Some(room)),
    );
    let Some(ServiceEvent::ServiceResolved(resolved)) = resolved else {
        assert!(!loopback_carries_multicast(), "it is not found");
        return testkit::skip("loopback carries no multicast");
    };
    assert_eq!((resolved.get_port(), resolved.get_property_val_str("node")), (7123, Some("left")));
    let addresses = resolved.get_addresses_v4();
    assert!(addresses.contains(&Ipv4Addr::LOCALHOST) && addresses.len() == 1, "{addresses:?}");
    drop(left);
    let removed = of_this_room(
        |event, room| matches!(event, ServiceEvent::ServiceRemoved(_, instance) if instance.contains(room)),
    );
    assert!(removed.is_some(), "it has said that it is gone");
    let _ = daemon.shutdown();
}

#[tokio::test]
async fn the_announcement_of_another_program_is_found() {
    let room = room("foreign");
    let daemon = other_daemon();
    let texts = [("room", &room[..]), ("node", "left")];
    let (service, host) = ("_hulltouch._tcp.local.", format!("left.{room}.local."));
    let service = ServiceInfo::new(service, &format!("left@{room}"), &host, "127.0.0.1", 7126, &texts[..]);
    let mut service = service.expect("valid");
    service.set_interfaces(vec![IfKind::LoopbackV4]);
    daemon.register(service).expect("registered");
    let search = search(&room);
    let Some(at) = found(&search, "left").await else { return };
    assert_eq!(at, ["127.0.0.1:7126"]);
    let _ = daemon.shutdown();
}
