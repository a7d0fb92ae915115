//! Certificates of nodes that are asked over TLS.

use std::fs;
use std::os::unix::fs::PermissionsExt as _;
use std::path::Path;
use std::sync::Arc;

use camera_node::scratch::ScratchFolder;
use net::{AUTHORITIES, Authority, CERTIFICATE, Credentials, Identity, KEY, Validity};
use node_client::Sockets;
use setup::cli::{Failure, Outcome, temporary_folder};

use super::film::ROOM;

/// Of the coordinator.
const COORDINATOR: &str = "coordinator";
/// No benchmark takes longer.
const DAYS: u32 = 2;

/// An authority's certificates of all nodes and of their coordinator, a folder each.
pub struct Certificates(ScratchFolder);

impl Certificates {
    /// Of so many nodes.
    pub fn make(nodes: usize) -> Outcome<Certificates> {
        let folder = temporary_folder()?;
        let authority = Authority::make(ROOM, Validity::days(DAYS)).map_err(Failure::run)?;
        let named = |node| format!("node{node}");
        let nodes = (0..nodes).map(|node| (named(node), Identity::node(ROOM, &named(node))));
        for (name, owner) in nodes.chain([(COORDINATOR.to_owned(), Identity::coordinator(ROOM))]) {
            let of_owner = folder.path().join(name);
            let issued = authority.issue(&owner, &[], Validity::days(DAYS), None).map_err(Failure::run)?;
            let written = fs::create_dir(&of_owner)
                .and_then(|()| fs::write(of_owner.join(AUTHORITIES), authority.certificate()))
                .and_then(|()| fs::write(of_owner.join(CERTIFICATE), &issued.certificate))
                .and_then(|()| fs::write(of_owner.join(KEY), &issued.key))
                .and_then(|()| fs::set_permissions(of_owner.join(KEY), fs::Permissions::from_mode(0o600)));
            written.map_err(|error| Failure::unwritable(&of_owner, error))?;
        }
        Ok(Certificates(folder))
    }

    /// Where they are.
    pub fn folder(&self) -> &Path {
        self.0.path()
    }

    /// The coordinator's sockets.
    pub fn dial(&self) -> Outcome<Arc<Sockets>> {
        let folder = self.folder().join(COORDINATOR);
        let own = Credentials::open(&folder, Identity::coordinator(ROOM)).map_err(Failure::run)?;
        Ok(Arc::new(Sockets::encrypted(Arc::new(own))))
    }
}
