//! Which process serves which cameras: `[[node]]` names them, or cameras give addresses.

use std::path::Path;

use proto::Address;

use super::Checker;
use crate::cluster_file::{CameraKeys, ClusterFileError, File, NodeEntry, NodeKeys};

/// The longest label of a domain name, characters.
const MAX_LABEL_CHARS: usize = 63;

/// By what a camera knows its node.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum NodeKey {
    /// The place of its `[[node]]` in the file.
    Named(usize),
    /// All cameras of one address share a process.
    At(Address),
    /// A process of its own.
    Own,
}

/// A checked `[[node]]`.
pub(super) struct NamedNode {
    name: String,
    address: Option<Address>,
}

/// 1 to 63 of `a` to `z`, digits and `-`, which stands at neither end: certificates and DNS-SD carry it.
fn is_label(text: &str) -> bool {
    let is_right = |byte: u8| byte.is_ascii_lowercase() || byte.is_ascii_digit() || byte == b'-';
    (1..=MAX_LABEL_CHARS).contains(&text.len())
        && text.bytes().all(is_right)
        && !text.starts_with('-')
        && !text.ends_with('-')
}

impl Checker<'_> {
    /// A name as certificates and DNS-SD can carry it.
    pub(super) fn label(&self, key: &str, text: &str) -> Result<String, ClusterFileError> {
        let name = self.text(key, text)?;
        if is_label(&name) {
            return Ok(name);
        }
        let expected = "1 to 63 of a to z, 0 to 9 and -, which stands at neither end";
        Err(self.wrong(key, format!("found {name:?}, expected a DNS label: {expected}")))
    }

    /// The file's `[[node]]` entries, each of another name and another address.
    pub(super) fn named_nodes(&self, folder: &Path, file: &File) -> Result<Vec<NamedNode>, ClusterFileError> {
        let mut nodes: Vec<NamedNode> = Vec::new();
        for NodeKeys { name, address } in &file.node {
            let name = self.label("node name", name)?;
            let key = format!("node {name:?}, address");
            let address =
                address.as_deref().map(|address| self.address(&key, folder, address)).transpose()?;
            if nodes.iter().any(|other| other.name == name) {
                return Err(self.wrong("node", format!("found {name:?} twice, expected every name once")));
            }
            if let Some(other) = nodes.iter().find(|other| address.is_some() && other.address == address) {
                let problem = format!("found that of node {:?} too, expected one node at each", other.name);
                return Err(self.wrong(&key, problem));
            }
            nodes.push(NamedNode { name, address });
        }
        Ok(nodes)
    }

    /// The node of a camera: a name where the file has `[[node]]` entries, else an address, or none.
    pub(super) fn node_key(
        &self,
        key: &str,
        folder: &Path,
        named: &[NamedNode],
        keys: &CameraKeys,
    ) -> Result<NodeKey, ClusterFileError> {
        let Some(node) = &keys.node else {
            if named.is_empty() {
                return Ok(NodeKey::Own);
            }
            return Err(self.wrong(key, format!("found nothing, expected one of {}", names(named))));
        };
        let text = self.text(key, node)?;
        match named.iter().position(|node| node.name == text) {
            Some(place) => Ok(NodeKey::Named(place)),
            None if named.is_empty() && !text.contains(':') => {
                let expected =
                    "\"host:port\", \"unix:/path\", or the name of a [[node]], of which there is none";
                Err(self.wrong(key, format!("found {text:?}, expected {expected}")))
            }
            None if named.is_empty() => self.address(key, folder, node).map(NodeKey::At),
            None if text.contains(':') => {
                let problem = format!(
                    "found the address {text:?} in a file with [[node]] entries, expected one of their names: {}",
                    names(named)
                );
                Err(self.wrong(key, problem))
            }
            None => Err(self.wrong(key, format!("found {text:?}, expected one of {}", names(named)))),
        }
    }

    /// Every node with its cameras, in the order of their first ones in the rig. `keys`: one a camera of the rig.
    pub(super) fn nodes(
        &self,
        named: &[NamedNode],
        keys: &[NodeKey],
    ) -> Result<Vec<NodeEntry>, ClusterFileError> {
        let mut nodes: Vec<(&NodeKey, NodeEntry)> = Vec::new();
        for (camera, key) in keys.iter().enumerate() {
            if let Some((_, node)) = nodes.iter_mut().find(|(known, _)| *known == key && *key != NodeKey::Own)
            {
                node.cameras.push(camera);
                continue;
            }
            let (name, address) = match key {
                NodeKey::Named(place) => (Some(named[*place].name.clone()), named[*place].address.clone()),
                NodeKey::At(address) => (None, Some(address.clone())),
                NodeKey::Own => (None, None),
            };
            nodes.push((key, NodeEntry { name, address, cameras: vec![camera] }));
        }
        let serves = |place: &usize| keys.contains(&NodeKey::Named(*place));
        if let Some(idle) = (0..named.len()).find(|place| !serves(place)) {
            let key = format!("node {:?}", named[idle].name);
            return Err(self.wrong(&key, "found no camera of it, expected one with its name as node"));
        }
        Ok(nodes.into_iter().map(|(_, node)| node).collect())
    }

    /// An address; the path of a socket starts where other paths of the file do, unless a variable says where.
    fn address(&self, key: &str, folder: &Path, text: &str) -> Result<Address, ClusterFileError> {
        let expanded = self.text(key, text)?;
        let refused = |error: proto::AddressError| self.wrong(key, error.to_string());
        match expanded.parse().map_err(refused)? {
            Address::Unix(path) => {
                let path = match text.strip_prefix("unix:") {
                    Some(text) => self.resolved(key, folder, text)?,
                    None => std::path::absolute(path).map_err(|error| self.wrong(key, error.to_string()))?,
                };
                Address::unix(path).map_err(refused)
            }
            tcp @ Address::Tcp(_) => Ok(tcp),
        }
    }
}

fn names(nodes: &[NamedNode]) -> String {
    let names: Vec<&str> = nodes.iter().map(|node| &node.name[..]).collect();
    names.join(", ")
}
