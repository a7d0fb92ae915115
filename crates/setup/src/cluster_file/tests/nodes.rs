//! Nodes by name and by address.

use super::*;

/// Cameras "a" and "b" at `left`, which is found by its name; "c" at `right`, a host's name and port.
const NAMED: &str = r#"
name = "room-a"
rig = "rig.toml"
scene = "topple"
fps = 50

[[node]]
name = "right"
address = "right-pc.local:7001"

[[node]]
name = "left"

[[camera]]
name = "c"
node = "right"
source = { kind = "stage" }

[[camera]]
name = "a"
node = "left"
source = { kind = "stage" }

[[camera]]
name = "b"
node = "${LEFT:-left}"
source = { kind = "stage" }
"#;

/// Where a node listens, as text.
pub fn address(node: &NodeEntry) -> String {
    node.address.as_ref().map(ToString::to_string).unwrap_or_default()
}

/// The names, addresses and cameras of the nodes.
fn told(cluster: &ClusterFile) -> Vec<(Option<&str>, String, Vec<usize>)> {
    let nodes = cluster.nodes.iter();
    nodes.map(|node| (node.name.as_deref(), address(node), node.cameras.clone())).collect()
}

#[test]
fn named_nodes_have_their_cameras_and_an_address_or_none() {
    let cluster = Folder::new().read(NAMED).expect("valid");
    assert_eq!(cluster.name, "room-a");
    let expected = [
        (Some("left"), String::new(), vec![0, 1]),
        (Some("right"), "right-pc.local:7001".to_owned(), vec![2]),
    ];
    assert_eq!(told(&cluster), expected, "in the order of their first cameras in the rig");
    assert!(cluster.is_deployed());
}

#[test]
fn a_named_node_may_listen_on_a_socket_beside_the_file() {
    let folder = Folder::new();
    let cluster = folder.read(&NAMED.replace("right-pc.local:7001", "unix:run/right.sock")).expect("valid");
    assert_eq!(address(&cluster.nodes[1]), format!("unix:{}", folder.path("run/right.sock").display()));
}

#[test]
fn addresses_alone_make_nodes_without_names() {
    let cluster = Folder::new().read(TEXT).expect("valid");
    let expected =
        [(None, "192.0.2.2:7001".to_owned(), vec![0]), (None, "192.0.2.1:7001".to_owned(), vec![1, 2])];
    assert_eq!(told(&cluster), expected);
    assert_eq!(cluster.name, "room", "a file need not name its room");
}

#[test]
fn cameras_of_no_node_have_processes_of_their_own_on_this_machine() {
    let text = TEXT.replace("node = \"192.0.2.1:7001\"", "");
    let cluster = Folder::new().read(&text).expect("valid");
    let expected = [
        (None, "192.0.2.2:7001".to_owned(), vec![0]),
        (None, String::new(), vec![1]),
        (None, String::new(), vec![2]),
    ];
    assert_eq!(told(&cluster), expected);
    assert!(!cluster.is_deployed());
}

#[test]
fn each_mistake_about_nodes_is_one_line() {
    let folder = Folder::new();
    let long = format!("name = \"{}\"", "x".repeat(64));
    let no_label =
        |found: &str| format!("found {found:?}, expected a DNS label: 1 to 63 of a to z, 0 to 9 and -");
    let second_at_one_address = "name = \"left\"\naddress = \"right-pc.local:7001\"";
    let idle = "[[node]]\nname = \"idle\"\n\n[[camera]]\nname = \"c\"";
    for (from, to, part) in [
        ("name = \"left\"", "name = \"right\"", "node: found \"right\" twice, expected every name once".to_owned()),
        ("name = \"left\"", second_at_one_address, "node \"left\", address: found that of node \"right\" too".to_owned()),
        ("node = \"right\"", "node = \"rihgt\"", "camera \"c\", node: found \"rihgt\", expected one of right, left".to_owned()),
        ("node = \"right\"", "", "camera \"c\", node: found nothing, expected one of right, left".to_owned()),
        ("[[camera]]\nname = \"c\"", idle, "node \"idle\": found no camera of it".to_owned()),
        ("name = \"left\"", "name = \"Left\"", no_label("Left")),
        ("name = \"left\"", "name = \"-left\"", no_label("-left")),
        ("name = \"left\"", "name = \"left-\"", no_label("left-")),
        ("name = \"left\"", "name = \"left.pc\"", no_label("left.pc")),
        ("name = \"left\"", "name = \"\"", no_label("")),
        ("name = \"left\"", &long, "node name: found \"xxx".to_owned()),
        ("name = \"room-a\"", "name = \"Room A\"", format!("name: {}", no_label("Room A"))),
        (
            "node = \"right\"",
            "node = \"192.0.2.1:7001\"",
            "camera \"c\", node: found the address \"192.0.2.1:7001\" in a file with [[node]] entries, expected one of \
             their names: right, left"
                .to_owned(),
        ),
        (
            "\"right-pc.local:7001\"",
            "\"right-pc.local\"",
            "node \"right\", address: found \"right-pc.local\", expected \"host:port\" or \"unix:/path\"".to_owned(),
        ),
        ("address =", "adress =", "unknown field `adress`, expected `name` or `address`".to_owned()),
    ] {
        let text = NAMED.replacen(from, to, 1);
        assert_ne!(text, NAMED, "{from}");
        let error = folder.read(&text).expect_err(to).to_string();
        assert_eq!(error.lines().count(), 1, "{error}");
        assert!(error.contains("cluster.toml") && error.contains(&part), "{error:?} lacks {part:?}");
    }
}

#[test]
fn the_longest_name_is_a_label_of_63() {
    let name = "x".repeat(63);
    let text = NAMED.replace("name = \"left\"", &format!("name = {name:?}"));
    let text = text.replace("node = \"left\"", &format!("node = {name:?}")).replace("${LEFT:-left}", &name);
    let cluster = Folder::new().read(&text).expect("valid");
    assert_eq!(cluster.nodes[0].name, Some(name));
}
