//! One coordinator leads a room: others are refused, take over, or follow one that is gone.

#[path = "shared/room.rs"]
mod room;

use std::path::Path;
use std::process::Output;
use std::time::{Duration, Instant};

use proto::{Pace, v1};
use room::{Node, Running, cameras, cluster_file, coordinator, figures, program};

const NODES: usize = 2;

fn start(cluster: &Path, seconds: &str, json: &Path, more: &[&str]) -> Running {
    Running::start(coordinator(program(), cluster, seconds, json).args(more))
}

fn nodes(cluster: &Path) -> Vec<Node> {
    (0..NODES).map(|node| Node::start(program(), cluster, &cameras(node))).collect()
}

fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

#[test]
fn a_second_coordinator_ends_with_who_leads_and_the_first_goes_on() {
    let folder = tempfile::tempdir().expect("a folder");
    let (cluster, json) = (cluster_file(folder.path(), NODES), folder.path().join("out.json"));
    let _nodes = nodes(&cluster);
    let first = start(&cluster, "6", &json, &[]);
    std::thread::sleep(Duration::from_secs(2));
    let began = Instant::now();
    let second =
        start(&cluster, "6", &folder.path().join("second.json"), &[]).wait_with_output().expect("ends");
    assert_eq!(second.status.code(), Some(1), "{}", said(&second));
    assert!(said(&second).contains("held by the coordinator on "), "{}", said(&second));
    assert!(said(&second).contains("--take-over or --observe"), "{}", said(&second));
    assert!(began.elapsed() < Duration::from_secs(5), "it says so soon");
    let figures = figures(first, &json);
    assert_eq!(figures["missed"]["frames"], 0, "{figures}");
    assert_eq!(figures["missed"]["blind_steps"], 0, "{figures}");
}

#[test]
fn one_that_takes_over_ends_the_other() {
    let folder = tempfile::tempdir().expect("a folder");
    let (cluster, json) = (cluster_file(folder.path(), NODES), folder.path().join("out.json"));
    let _nodes = nodes(&cluster);
    let first = start(&cluster, "60", &folder.path().join("first.json"), &[]);
    std::thread::sleep(Duration::from_secs(2));
    let second = start(&cluster, "3", &json, &["--take-over"]);
    let first = first.wait_with_output().expect("ends");
    assert_eq!(first.status.code(), Some(1), "{}", said(&first));
    assert!(said(&first).contains("held by the coordinator on "), "{}", said(&first));
    let figures = figures(second, &json);
    assert!(figures["frames"].as_u64().is_some_and(|frames| frames > 20), "{figures}");
}

#[test]
fn one_that_was_killed_is_followed_at_once() {
    let folder = tempfile::tempdir().expect("a folder");
    let (cluster, json) = (cluster_file(folder.path(), NODES), folder.path().join("out.json"));
    let _nodes = nodes(&cluster);
    let first = start(&cluster, "60", &folder.path().join("first.json"), &[]);
    std::thread::sleep(Duration::from_secs(2));
    // Killed.
    drop(first);
    let began = Instant::now();
    let figures = figures(start(&cluster, "1", &json, &[]), &json);
    assert!(figures["frames"].as_u64().is_some_and(|frames| frames >= 9), "{figures}");
    assert!(began.elapsed() < Duration::from_secs(4), "a second of film took {:?}", began.elapsed());
}

#[test]
fn a_stranger_changes_nothing() {
    let folder = tempfile::tempdir().expect("a folder");
    let (cluster, json) = (cluster_file(folder.path(), NODES), folder.path().join("out.json"));
    let _nodes = nodes(&cluster);
    let run = start(&cluster, "5", &json, &[]);
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().expect("a runtime");
    runtime.block_on(strangers_start(&cluster));
    let figures = figures(run, &json);
    assert_eq!((&figures["missed"]["frames"], &figures["missed"]["blind_steps"]), (&0.into(), &0.into()));
}

/// A `Start` of somebody who claims nothing.
async fn strangers_start(cluster: &Path) {
    let folder = cluster.parent().expect("a folder");
    let socket = folder.join("0.sock");
    let connect = tower::service_fn(move |_: tonic::transport::Uri| {
        let socket = socket.clone();
        async move { tokio::net::UnixStream::connect(socket).await.map(hyper_util::rt::TokioIo::new) }
    });
    let endpoint = tonic::transport::Endpoint::from_static("http://node.invalid");
    let channel = endpoint.connect_with_connector(connect).await.expect("connects");
    let mut client = v1::camera_node_client::CameraNodeClient::new(channel);
    let deadline = Instant::now() + Duration::from_secs(20);
    while client.describe(v1::DescribeRequest {}).await.expect("anybody may ask").into_inner().term == 0 {
        assert!(Instant::now() < deadline, "nobody leads it");
        tokio::time::sleep(Duration::from_millis(50)).await;
    }
    for pace in [Pace::lock_step(1), Pace::live(2, 0.0)] {
        let start = proto::convert::start_to_wire(proto::RunStart::of_this_process(pace));
        let refused = client.start(start).await.expect_err("held");
        assert_eq!(refused.code(), tonic::Code::Aborted, "{refused}");
    }
}
