//! Nodes without an address are found by their names: they announce themselves in the local network (DNS-SD over
//! multicast DNS), and a coordinator looks for them. Whatever is found so is only somewhere to try: anybody in the
//! network may announce any name, and `node_client` checks who answers.

mod announcement;
mod search;
#[cfg(test)]
mod tests;

use mdns_sd::{IfKind, ServiceDaemon};

pub use announcement::{AnnounceError, Announcement};
pub use search::NodeSearch;

/// What nodes are announced as.
const SERVICE: &str = "_hulltouch._tcp.local.";
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
    /// What speaks multicast DNS there, on a thread of its own. Without a network it waits for one.
    fn daemon(self) -> mdns_sd::Result<ServiceDaemon> {
        let daemon = ServiceDaemon::new()?;
        match self {
            Networks::Others => daemon.disable_interface(vec![IfKind::LoopbackV4, IfKind::LoopbackV6])?,
            #[cfg(test)]
            Networks::Loopback => {
                daemon.disable_interface(IfKind::All)?;
                daemon.enable_interface(IfKind::LoopbackV4)?;
            }
        }
        Ok(daemon)
    }
}
