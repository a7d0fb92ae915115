//! Nodes are announced and found on this machine's own network.

use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

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

/// Where a node is found, within some attempts; `None`, said aloud, where multicast does not reach this machine itself.
async fn found(search: &NodeSearch, node: &str) -> Option<Vec<String>> {
    for _ in 0..4 {
        let found = search.find(node).await;
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
    let group = std::net::Ipv4Addr::new(224, 0, 0, 251);
    let local = std::net::Ipv4Addr::LOCALHOST;
    let attempt = || -> std::io::Result<()> {
        let socket = socket2::Socket::new(socket2::Domain::IPV4, socket2::Type::DGRAM, None)?;
        socket.bind(&SocketAddr::from((std::net::Ipv4Addr::UNSPECIFIED, 0)).into())?;
        socket.join_multicast_v4(&group, &local)?;
        socket.set_multicast_if_v4(&local)?;
        let socket = std::net::UdpSocket::from(socket);
        socket.set_read_timeout(Some(Duration::from_secs(1)))?;
        let port = socket.local_addr()?.port();
        socket.send_to(b"hello", (group, port))?;
        socket.recv(&mut [0; 8]).map(|_| ())
    };
    attempt().is_ok()
}

#[tokio::test]
async fn a_node_is_found_where_it_is_announced_and_no_longer_when_it_is_gone() {
    let (room, other_room) = (room("found"), room("elsewhere"));
    let left = announced(&room, "left", ADDRESS);
    let _other = announced(&other_room, "right", "127.0.0.1:7124");
    let search = search(&room);
    let Some(at) = found(&search, "left").await else { return };
    assert_eq!(at, [ADDRESS]);
    assert!(search.find("right").await.is_empty(), "that is another room's");
    drop(left);
    assert!(search.find("left").await.is_empty(), "it has said that it is gone");
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
    let search = search(&room("silence"));
    let began = tokio::time::Instant::now();
    let (left, right) = tokio::join!(search.find("left"), search.find("right"));
    assert!(left.is_empty() && right.is_empty());
    assert!(began.elapsed() < Duration::from_secs(3), "took {:?}", began.elapsed());
}
