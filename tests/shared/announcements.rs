//! Messages of multicast DNS that are not true, and the machine that sends them, for tests.

use std::net::{Ipv4Addr, UdpSocket};
use std::time::{Duration, Instant};

use crate::namespace::Host;

/// A machine at this end of a host's cable, which multicasts.
pub struct Announcer {
    pub address: Ipv4Addr,
    socket: UdpSocket,
}

impl Announcer {
    /// At this host's cable.
    pub fn beside(host: &Host) -> Announcer {
        let address = Ipv4Addr::from_bits(host.address.to_bits() - 1);
        let socket =
            socket2::Socket::new(socket2::Domain::IPV4, socket2::Type::DGRAM, None).expect("a socket");
        socket.set_multicast_if_v4(&address).expect("a network");
        Announcer { address, socket: socket.into() }
    }

    /// Multicasts one message.
    pub fn send(&self, message: &[u8]) {
        self.socket.send_to(message, (Ipv4Addr::new(224, 0, 0, 251), 5353)).expect("sent");
    }

    /// Sends so many bytes at this rate, each message made from its number.
    pub fn flood(&self, bytes: usize, bytes_per_s: usize, message: impl Fn(u32) -> Vec<u8>) {
        let (began, mut sent) = (Instant::now(), 0);
        for number in 0.. {
            if sent >= bytes {
                return;
            }
            let message = message(number);
            self.send(&message);
            sent += message.len();
            let due = began + Duration::from_secs_f64(sent as f64 / bytes_per_s as f64);
            std::thread::sleep(due.saturating_duration_since(Instant::now()));
        }
    }
}

fn name(labels: &[&str]) -> Vec<u8> {
    let labels = labels.iter().flat_map(|label| [&[label.len() as u8], label.as_bytes()].concat());
    labels.chain([0]).collect()
}

fn record(name: &[u8], kind: u16, data: &[u8]) -> Vec<u8> {
    let fixed = [&kind.to_be_bytes()[..], &1_u16.to_be_bytes(), &4500_u32.to_be_bytes()].concat();
    [name, &fixed, &(data.len() as u16).to_be_bytes(), data].concat()
}

fn response(records: &[Vec<u8>]) -> Vec<u8> {
    let count = (records.len() as u16).to_be_bytes();
    [&[0, 0, 0x84, 0, 0, 0][..], &count, &[0; 4], &records.concat()].concat()
}

/// Addresses of forty hosts that no message named before.
pub fn new_hosts(number: u32) -> Vec<u8> {
    let host = |at: u32| {
        let number = 40 * number + at;
        record(&name(&[&format!("host{number}"), "local"]), 1, &number.to_be_bytes())
    };
    response(&(0..40).map(host).collect::<Vec<_>>())
}

/// An instance of a node, of a number of its own.
pub fn instance(node: &str, number: u32, address: Ipv4Addr, port: u16) -> Vec<u8> {
    let service = name(&["_hulltouch", "_tcp", "local"]);
    let instance = name(&[&format!("{node} {number}"), "_hulltouch", "_tcp", "local"]);
    let host = name(&[&format!("host{number}"), "local"]);
    let port = [&[0; 4][..], &port.to_be_bytes(), &host].concat();
    let text = |text: String| [&[text.len() as u8], text.as_bytes()].concat();
    let texts = [text("room=room".into()), text(format!("node={node}"))].concat();
    let records = [
        record(&service, 12, &instance),
        record(&instance, 33, &port),
        record(&instance, 16, &texts),
        record(&host, 1, &address.octets()),
    ];
    response(&records)
}
