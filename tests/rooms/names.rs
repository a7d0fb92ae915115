//! Nodes of a room by their names: at addresses, and found.

use std::net::{TcpListener, ToSocketAddrs as _};
use std::path::Path;
use std::process::Command;
use std::sync::Arc;
use std::time::Duration;

use camera_node::service::{Access, Node as Service};
use futures::stream::{self, StreamExt as _};
use setup::{ClusterFile, expected_node};

use crate::namespace::Host;
use crate::room::{Node, Running, blind_steps, coordinator, ended, frames, missed, named_room, program};
use node_client::{Agreement, ExpectedNode, NodeClient, NodeEvent, NodePlace};
use proto::Address;
use testkit::{Watch, timely};
use tokio::sync::mpsc;

/// A port of this process's own, below those that systems hand out.
fn own_port() -> u16 {
    10_000 + (std::process::id() % 20_000) as u16
}

/// Runs a coordinator, which must get frames of all nodes.
fn run(program: Command, cluster: &Path, folder: &Path) {
    let watch = Watch::start();
    let json = folder.join("out.json");
    let mut command = coordinator(program, cluster, "2", &json);
    let run = Running::start(command.arg("--insecure"));
    let Some(figures) = watch.judge(ended(run, &json)) else { return };
    timely!(watch, frames(&figures) > 10, "{}", missed(&figures));
    timely!(watch, blind_steps(&figures) == 0, "{}", missed(&figures));
}

#[test]
fn a_node_serves_what_is_its_own_at_the_address_of_its_name() {
    if let Err(error) = ("localhost", 0).to_socket_addrs() {
        return testkit::skip(format_args!(
            "localhost cannot be looked up: {error} (is there no /etc/hosts?)"
        ));
    }
    let folder = tempfile::tempdir().expect("a folder");
    let port = own_port();
    let right = format!("address = \"localhost:{port}\"");
    let cluster = named_room(folder.path(), "address = \"unix:left.sock\"", &right);
    let nodes = ["left", "right"].map(|name| Node::start_named(program(), &cluster, name));
    assert_eq!(nodes[0].address(), format!("unix:{}", folder.path().join("left.sock").display()));
    assert_eq!(
        nodes[1].address(),
        format!("127.0.0.1:{port}"),
        "the host's name decides where, and its port"
    );
    run(program(), &cluster, folder.path());
}

#[test]
fn the_same_file_runs_on_one_machine() {
    let folder = tempfile::tempdir().expect("a folder");
    let cluster = named_room(folder.path(), "", "");
    let mut demo = program();
    demo.arg("demo").arg("--recording").arg(&cluster).args([
        "--headless",
        "--seconds",
        "1",
        "--transport",
        "cluster",
    ]);
    let output = demo.output().expect("runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

#[test]
fn a_node_that_is_missing_is_called_by_its_name() {
    let folder = tempfile::tempdir().expect("a folder");
    let cluster = named_room(folder.path(), "address = \"unix:left.sock\"", "address = \"unix:right.sock\"");
    let _left = Node::start_named(program(), &cluster, "left");
    let json = folder.path().join("out.json");
    let mut command = coordinator(program(), &cluster, "1", &json);
    let output = command.args(["--patience", "5"]).output().expect("ends");
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(said.contains("node right (cam_2, cam_3): cannot connect"), "{said}");
}

#[test]
fn nodes_without_addresses_are_found_in_the_network() {
    let host = match Host::new(100) {
        Ok(host) => host,
        Err(why) => {
            testkit::skip(format_args!("no network namespaces: {why}"));
            return;
        }
    };
    let folder = tempfile::tempdir().expect("a folder");
    let cluster = named_room(folder.path(), "", "");
    let there = || host.command(&program());
    let started = |(name, port): (&str, u16)| {
        let mut command = there();
        command.args(["node", "--insecure", "--host", name, "--listen", &format!("0.0.0.0:{port}")]);
        Node::start_at(command, &cluster, &[])
    };
    let nodes = [("left", 7001), ("right", 7002)].map(started);
    assert!(nodes[1].address().ends_with(":7002"));
    run(there(), &cluster, folder.path());
}

/// A service of some cameras of the rig on a free port of loopback, which ends with its runtime.
async fn service(file: &ClusterFile, cameras: &[usize]) -> Address {
    let config = file.node_config(cameras, false).expect("cameras");
    let loopback = std::net::SocketAddr::from(([127, 0, 0, 1], 0));
    let node = Service::open(config, loopback, Access::default()).await.expect("opens");
    let address = node.address().expect("bound").to_string().parse().expect("an address");
    tokio::spawn(node.serve(std::future::pending()));
    address
}

/// What the client of the node "left" reports first, which looks for it at these addresses.
async fn first_event(file: &ClusterFile, found: Vec<Address>) -> NodeEvent {
    let place = NodePlace::sought(move || stream::iter([found.clone()]).boxed());
    let left = ExpectedNode { name: Some("left".into()), ..expected_node(&file.rig, place, &[0, 1]) };
    let (sender, mut events) = mpsc::channel(64);
    let agreement = Arc::new(Agreement::new(file.probes, file.fps, Vec::new()));
    let _client = NodeClient::spawn(left, 0, agreement, sender);
    let event = tokio::time::timeout(Duration::from_secs(120), events.recv()).await;
    event.expect("in time").expect("an event").1
}

#[tokio::test]
async fn who_is_found_is_not_trusted() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = ClusterFile::open(&named_room(folder.path(), "", "")).expect("valid");
    // Says to be the node, and never says a word.
    let silent = TcpListener::bind("127.0.0.1:0").expect("a port");
    let silent = Address::Tcp(silent.local_addr().expect("bound").to_string());
    let (left, right) = (service(&file, &[0, 1]).await, service(&file, &[2, 3]).await);
    let event = first_event(&file, vec![silent, right.clone(), left]).await;
    assert!(matches!(event, NodeEvent::Up), "the one that is the node is found among others: {event:?}");
    let NodeEvent::Down(error) = first_event(&file, vec![right.clone()]).await else {
        panic!("another node was taken for it")
    };
    assert_eq!(error.to_string(), format!("at {right}: it has no camera \"cam_0\""));
    let NodeEvent::Down(error) = first_event(&file, vec![]).await else { panic!("no node is there") };
    assert!(error.to_string().starts_with("not found by its name"), "{error}");
}
