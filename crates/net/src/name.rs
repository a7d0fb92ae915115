//! Names of those who take part in a room.

use std::fmt;

/// The last label of every name.
const SUFFIX: &str = "hulltouch";
/// The label before a node's room.
const NODE: &str = "node";
const COORDINATOR: &str = "coordinator";
const VIEWER: &str = "viewer";

/// A DNS name in a certificate, whatever the address.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Identity {
    /// The room.
    pub room: String,
    /// What it is there.
    pub role: Role,
}

/// The role of a certificate's owner.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Role {
    /// The node of that name.
    Node(String),
    /// Leads the nodes.
    Coordinator,
    /// Looks, and changes nothing.
    Viewer,
}

impl Identity {
    /// A node of a room.
    pub fn node(room: &str, name: &str) -> Identity {
        Identity { room: room.to_owned(), role: Role::Node(name.to_owned()) }
    }

    /// The coordinators of a room.
    pub fn coordinator(room: &str) -> Identity {
        Identity { room: room.to_owned(), role: Role::Coordinator }
    }

    /// The viewers of a room.
    pub fn viewer(room: &str) -> Identity {
        Identity { room: room.to_owned(), role: Role::Viewer }
    }

    /// What a certificate's name says; `None`: it is a name of something else.
    pub fn from_dns_name(name: &str) -> Option<Identity> {
        let labels: Vec<&str> = name.split('.').collect();
        if !labels.iter().all(|label| is_label(label)) {
            return None;
        }
        match labels[..] {
            [node, NODE, room, SUFFIX] => Some(Identity::node(room, node)),
            [COORDINATOR, room, SUFFIX] => Some(Identity::coordinator(room)),
            [VIEWER, room, SUFFIX] => Some(Identity::viewer(room)),
            _ => None,
        }
    }
}

/// 1 to 63 of `a` to `z`, digits and `-`: no wildcard.
fn is_label(label: &str) -> bool {
    let is_plain = |c: u8| c.is_ascii_lowercase() || c.is_ascii_digit() || c == b'-';
    (1..=63).contains(&label.len()) && label.bytes().all(is_plain)
}

impl fmt::Display for Identity {
    /// As certificates name it: `left.node.room-a.hulltouch`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let room = &self.room;
        match &self.role {
            Role::Node(name) => write!(f, "{name}.{NODE}.{room}.{SUFFIX}"),
            Role::Coordinator => write!(f, "{COORDINATOR}.{room}.{SUFFIX}"),
            Role::Viewer => write!(f, "{VIEWER}.{room}.{SUFFIX}"),
        }
    }
}

/// Whose certificate was shown at a connection.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Peer {
    identities: Vec<Identity>,
}

impl Peer {
    /// The owner of a certificate of these names.
    pub(crate) fn of<'a>(names: impl IntoIterator<Item = &'a str>) -> Peer {
        Peer { identities: names.into_iter().filter_map(Identity::from_dns_name).collect() }
    }

    /// Whether the certificate says so.
    pub fn is(&self, identity: &Identity) -> bool {
        self.identities.contains(identity)
    }
}

impl fmt::Display for Peer {
    /// All that it is, in words for a message.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.identities.is_empty() {
            return f.write_str("a peer of no room");
        }
        let names: Vec<String> = self.identities.iter().map(Identity::to_string).collect();
        f.write_str(&names.join(" and "))
    }
}
