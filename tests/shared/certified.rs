//! A room of two nodes with certificates, for tests.

use std::fs;
use std::os::unix::fs::PermissionsExt as _;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Arc;
use std::time::Duration;

use net::{AUTHORITIES, Authority, CERTIFICATE, Credentials, Identity, KEY, Validity};
use node_client::{Agreement, ExpectedNode, NodeClient, NodeEvent, Sockets};
use setup::{ClusterFile, expected_node};
use tokio::sync::mpsc;

use crate::room::{Node, coordinator, named_room, program};

/// The name of every test's room.
pub const ROOM: &str = "room";

/// Writes the certificates of an owner into a folder.
pub fn issue(folder: &Path, authority: &Authority, owner: &Identity, validity: Validity) {
    let issued = authority.issue(owner, &[], validity, None).expect("issued");
    fs::create_dir_all(folder).expect("a folder");
    fs::write(folder.join(AUTHORITIES), authority.certificate()).expect("written");
    fs::write(folder.join(CERTIFICATE), &issued.certificate).expect("written");
    fs::write(folder.join(KEY), &issued.key).expect("written");
    fs::set_permissions(folder.join(KEY), fs::Permissions::from_mode(0o600)).expect("set");
}

/// Two nodes with certificates of one authority.
#[allow(dead_code, reason = "not every test needs it all")]
pub struct Room {
    /// Where everything is.
    pub folder: tempfile::TempDir,
    /// The authority that signs the certificates.
    pub authority: Authority,
    /// With the addresses at which they listen.
    pub cluster: PathBuf,
    /// Left and right.
    pub nodes: [Node; 2],
}

#[allow(dead_code, reason = "not every test needs it all")]
impl Room {
    /// A room whose certificates are made here.
    pub fn new() -> Room {
        let folder = tempfile::tempdir().expect("a folder");
        let authority = Authority::make(ROOM, Validity::days(30)).expect("an authority");
        for name in ["left", "right"] {
            issue(&folder.path().join(name), &authority, &Identity::node(ROOM, name), Validity::days(30));
        }
        let coordinators = Identity::coordinator(ROOM);
        issue(&folder.path().join("coordinator"), &authority, &coordinators, Validity::days(30));
        Room::of(folder, authority, "")
    }

    /// With certificates that are there, and more in the cluster file.
    pub fn of(folder: tempfile::TempDir, authority: Authority, more: &str) -> Room {
        let with_more = |left: &str, right: &str| {
            let file = named_room(folder.path(), left, right);
            let text = fs::read_to_string(&file).expect("written");
            fs::write(&file, text.replacen("[[node]]", &format!("{more}[[node]]"), 1)).expect("written");
            file
        };
        let cluster = with_more("", "");
        let nodes = ["left", "right"].map(|name| node(folder.path(), &cluster, name, &["--certs", name]));
        let [left, right] = [&nodes[0], &nodes[1]].map(|node| format!("address = {:?}", node.address()));
        let cluster = with_more(&left, &right);
        Room { folder, authority, cluster, nodes }
    }

    /// Where its coordinator writes figures.
    pub fn json(&self) -> PathBuf {
        self.folder.path().join("out.json")
    }

    /// Its coordinator.
    pub fn coordinator(&self, seconds: &str) -> Command {
        let mut command = coordinator(program(), &self.cluster, seconds, &self.json());
        command.args(["--certs", "coordinator"]).current_dir(self.folder.path());
        command
    }

    /// What a client of the node "left" hears first, with the certificates of a folder.
    pub async fn first_event(&self, credentials: Credentials) -> NodeEvent {
        let file = ClusterFile::open(&self.cluster).expect("valid");
        let address = self.nodes[0].address().parse::<proto::Address>().expect("an address");
        let left = ExpectedNode { name: Some("left".into()), ..expected_node(&file.rig, address, &[0, 1]) };
        let agreement = Agreement::new(file.probes, file.fps, Vec::new());
        let agreement = agreement.dialling(Arc::new(Sockets::encrypted(Arc::new(credentials))));
        let (sender, mut events) = mpsc::channel(64);
        let _client = NodeClient::spawn(left, 0, Arc::new(agreement), sender);
        let event = tokio::time::timeout(Duration::from_secs(120), events.recv()).await;
        event.expect("in time").expect("an event").1
    }

    /// What a coordinator hears whose certificates are of this authority, and who believes no other.
    pub async fn first_event_of(&self, authority: &Authority) -> NodeEvent {
        let (folder, owner) = (self.folder.path().join("believer"), Identity::coordinator(ROOM));
        issue(&folder, authority, &owner, Validity::days(30));
        self.first_event(Credentials::open(&folder, owner).expect("its own")).await
    }

    /// What a peer with another certificate is told.
    pub async fn refusal(&self, authority: &Authority, owner: Identity) -> String {
        let folder = self.folder.path().join("untrusted");
        issue(&folder, authority, &owner, Validity::days(30));
        // It knows the room's authority: it must be the node that refuses.
        let both = format!("{}{}", authority.certificate(), self.authority.certificate());
        fs::write(folder.join(AUTHORITIES), both).expect("written");
        let credentials = Credentials::open(&folder, owner.clone()).expect("its own");
        match self.first_event(credentials).await {
            NodeEvent::Down(error) => error.to_string(),
            event => panic!("{owner} got in: {event:?}"),
        }
    }
}

/// The node of that name, with more arguments.
pub fn node(folder: &Path, cluster: &Path, name: &str, security: &[&str]) -> Node {
    let mut command = program();
    command.current_dir(folder).args(["node", "--listen", "127.0.0.1:0", "--host", name]).args(security);
    Node::start_at(command, cluster, &[])
}
