//! Nodes without an address are found by their names: they announce themselves in the local network (DNS-SD over
//! multicast DNS), and a coordinator looks for them. Whatever is found so is only somewhere to try: any machine of the
//! network may announce any name, and `node_client` checks who answers.
//!
//! Any machine may also send any number of messages. A node reads queries alone; a coordinator keeps a bounded number of
//! candidates for each node (`candidates`); both read a bounded number of messages a second (`schedule`).

mod announcement;
mod candidates;
mod message;
mod schedule;
mod search;
mod station;
#[cfg(test)]
mod tests;

use std::net::IpAddr;

pub(crate) use message::check_message;
#[cfg(test)]
pub(crate) use message::example_messages;

pub use announcement::{AnnounceError, Announcement};
pub use search::NodeSearch;

/// The key of the text that says which room a node belongs to.
const ROOM: &str = "room";
/// The key of the text that says which node it is.
const NODE: &str = "node";

/// Where announcements are made and looked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Networks {
    /// All but this machine's own.
    Others,
    /// This machine's own, IPv4.
    #[cfg(test)]
    Loopback,
}

impl Networks {
    fn includes(self, ip: IpAddr) -> bool {
        match self {
            Networks::Others => !ip.is_loopback(),
            #[cfg(test)]
            Networks::Loopback => ip == IpAddr::V4(std::net::Ipv4Addr::LOCALHOST),
        }
    }
}
