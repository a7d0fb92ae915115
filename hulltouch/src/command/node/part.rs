//! Which part of the cluster file a node process serves, and where it listens.

use std::net::{Ipv4Addr, SocketAddr};

use camera_node::listen::Listen;
use proto::Address;
use setup::cli::{Failure, Outcome};
use setup::{ClusterFile, NodeEntry};

/// Where a named node listens that has no address: firewalls want a port that stays.
const PORT: u16 = 7001;

/// What a node process serves.
pub struct Part<'a> {
    /// The node whose cameras these are; none if they are of several.
    node: Option<&'a NodeEntry>,
    /// The node's name, if all of it is served under that name.
    pub name: Option<&'a str>,
    /// Places in the rig, ascending.
    pub cameras: Vec<usize>,
}

impl Part<'_> {
    /// The cameras of these names.
    pub fn of_cameras<'a>(file: &'a ClusterFile, names: &[String]) -> Outcome<Part<'a>> {
        let mut cameras = Vec::new();
        for name in names {
            let index = file.rig.index_of(name).ok_or_else(|| {
                let known: Vec<&str> = file.cameras.iter().map(|entry| &entry.name[..]).collect();
                let path = file.path.display();
                Failure::input(format_args!("--camera {name:?}: {path} has {}", known.join(", ")))
            })?;
            if cameras.contains(&index) {
                return Err(Failure::input(format_args!("--camera {name:?} is given twice")));
            }
            cameras.push(index);
        }
        cameras.sort_unstable();
        let is_of = |node: &&NodeEntry| cameras.iter().all(|camera| node.cameras.contains(camera));
        Ok(Part { node: file.nodes.iter().find(is_of), name: None, cameras })
    }

    /// The cameras of the node that has the name, by default this host's.
    pub fn of_host<'a>(file: &'a ClusterFile, name: Option<&str>) -> Outcome<Part<'a>> {
        let path = file.path.display();
        let names: Vec<&str> = file.nodes.iter().filter_map(|node| node.name.as_deref()).collect();
        if names.is_empty() {
            return Err(Failure::input(format_args!(
                "{path} has no [[node]] with a name, expected --camera NAME"
            )));
        }
        let host = name.map_or_else(name_of_this_host, ToOwned::to_owned);
        let Some(node) = file.nodes.iter().find(|node| node.name.as_ref() == Some(&host)) else {
            let names = names.join(", ");
            return Err(Failure::input(match name {
                Some(_) => format!("--host {host:?}: {path} has the nodes {names}"),
                None => {
                    format!("this host is {host:?}, and {path} has the nodes {names}: expected --host NAME")
                }
            }));
        };
        Ok(Part { node: Some(node), name: node.name.as_deref(), cameras: node.cameras.clone() })
    }

    /// The names of its cameras.
    pub fn camera_names<'a>(&self, file: &'a ClusterFile) -> Vec<&'a str> {
        self.cameras.iter().map(|&camera| &file.cameras[camera].name[..]).collect()
    }

    /// Whether it must be found by its name.
    pub fn is_sought(&self) -> bool {
        self.name.is_some() && self.node.is_some_and(|node| node.address.is_none())
    }

    /// Where the cluster file says that it listens: at its address; where that is a host's name, and where there is none,
    /// wherever machines reach this one.
    pub fn listen(&self, file: &ClusterFile) -> Outcome<Listen> {
        let node = self.node.ok_or_else(|| {
            Failure::input("the cameras have different nodes in the cluster file, expected --listen")
        })?;
        match &node.address {
            Some(Address::Unix(path)) => Ok(Listen::Unix(path.clone())),
            Some(Address::Tcp(address)) => Ok(Listen::Tcp(listen_address(address))),
            None if self.is_sought() => Ok(Listen::Tcp((Ipv4Addr::UNSPECIFIED, PORT).into())),
            None => {
                let (path, name) = (file.path.display(), &file.cameras[self.cameras[0]].name);
                Err(Failure::input(format_args!(
                    "{path}, camera {name:?} has no node with an address, expected one or --listen"
                )))
            }
        }
    }
}

/// An IP address with port as it is; of a host's name its port, on all IPv4 addresses, or on loopback.
fn listen_address(address: &str) -> SocketAddr {
    address.parse().unwrap_or_else(|_| {
        // It was read as a host with a port.
        let (host, port) = address.rsplit_once(':').unwrap_or_default();
        let ip = if host == "localhost" { Ipv4Addr::LOCALHOST } else { Ipv4Addr::UNSPECIFIED };
        (ip, port.parse().unwrap_or(PORT)).into()
    })
}

/// Up to its first dot, in lower case.
pub fn name_of_this_host() -> String {
    let host = rustix::system::uname();
    let name = host.nodename().to_string_lossy().to_lowercase();
    name.split('.').next().unwrap_or_default().to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_host_with_a_name_listens_wherever_machines_reach_it() {
        for (address, expected) in [
            ("192.0.2.1:7005", "192.0.2.1:7005"),
            ("[::1]:7005", "[::1]:7005"),
            ("left-pc.local:7005", "0.0.0.0:7005"),
            ("localhost:7005", "127.0.0.1:7005"),
        ] {
            assert_eq!(listen_address(address).to_string(), expected);
        }
    }
}
