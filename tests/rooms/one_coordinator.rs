//! One coordinator leads a room: others are refused, take over, or follow one that is gone.

use std::path::Path;
use std::process::{Command, Output};
use std::time::{Duration, Instant};

use film_time::Pace;

use crate::room::{
    Node, Running, ask_to_end, await_leader, blind_steps, cameras, cluster_file, coordinator, ended, missed,
    program,
};
use proto::v1;
use testkit::{Watch, timely};

const NODES: usize = 2;

fn start(cluster: &Path, seconds: &str, json: &Path, more: &[&str]) -> Running {
    Running::start(coordinator(program(), cluster, seconds, json).args(more))
}

fn nodes(cluster: &Path) -> Vec<Node> {
    (0..NODES).map(|node| Node::start(program(), cluster, &cameras(node))).collect()
}

fn status(cluster: &Path) -> Command {
    let mut command = program();
    command.arg("status").arg(cluster);
    command
}

fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

#[test]
fn a_second_coordinator_ends_with_who_leads_and_the_first_goes_on() {
    let watch = Watch::start();
    let folder = tempfile::tempdir().expect("a folder");
    let (cluster, json) = (cluster_file(folder.path(), NODES), folder.path().join("out.json"));
    let _nodes = nodes(&cluster);
    let first = start(&cluster, "600", &json, &[]);
    await_leader(|| status(&cluster));
    let began = Instant::now();
    let second =
        start(&cluster, "6", &folder.path().join("second.json"), &[]).wait_with_output().expect("ends");
    assert_eq!(second.status.code(), Some(1), "{}", said(&second));
    assert!(said(&second).contains("held by the coordinator on "), "{}", said(&second));
    assert!(said(&second).contains("--take-over or --observe"), "{}", said(&second));
    let took = began.elapsed();
    // Film in which a first one that was disturbed would miss something.
    std::thread::sleep(Duration::from_secs(3));
    ask_to_end(&first);
    let Some(figures) = watch.judge(ended(first, &json)) else { return };
    timely!(watch, took < Duration::from_secs(5), "it said so after {took:?}");
    timely!(watch, figures["missed"]["frames"] == 0, "{}", missed(&figures));
    timely!(watch, blind_steps(&figures) == 0, "{}", missed(&figures));
}

#[test]
fn one_that_takes_over_ends_the_other() {
    let watch = Watch::start();
    let folder = tempfile::tempdir().expect("a folder");
    let (cluster, json) = (cluster_file(folder.path(), NODES), folder.path().join("out.json"));
    let _nodes = nodes(&cluster);
    let first = start(&cluster, "600", &folder.path().join("first.json"), &[]);
    await_leader(|| status(&cluster));
    let second = start(&cluster, "3", &json, &["--take-over"]);
    let first = first.wait_with_output().expect("ends");
    assert_eq!(first.status.code(), Some(1), "{}", said(&first));
    assert!(said(&first).contains("held by the coordinator on "), "{}", said(&first));
    let Some(figures) = watch.judge(ended(second, &json)) else { return };
    timely!(
        watch,
        figures["frames"].as_u64().is_some_and(|frames| frames > 20),
        "{} frames, missed {}",
        figures["frames"],
        figures["missed"]
    );
}

#[test]
fn one_that_was_killed_is_followed_at_once() {
    let watch = Watch::start();
    let folder = tempfile::tempdir().expect("a folder");
    let (cluster, json) = (cluster_file(folder.path(), NODES), folder.path().join("out.json"));
    let _nodes = nodes(&cluster);
    let first = start(&cluster, "600", &folder.path().join("first.json"), &[]);
    await_leader(|| status(&cluster));
    // Killed.
    drop(first);
    let began = Instant::now();
    let Some(figures) = watch.judge(ended(start(&cluster, "1", &json, &[]), &json)) else { return };
    let took = began.elapsed();
    timely!(
        watch,
        figures["frames"].as_u64().is_some_and(|frames| frames >= 9),
        "{} frames, missed {}",
        figures["frames"],
        figures["missed"]
    );
    timely!(watch, took < Duration::from_secs(4), "a second of film took {took:?}");
}

#[test]
fn an_untrusted_peer_changes_nothing() {
    let watch = Watch::start();
    let folder = tempfile::tempdir().expect("a folder");
    let (cluster, json) = (cluster_file(folder.path(), NODES), folder.path().join("out.json"));
    let _nodes = nodes(&cluster);
    // Film in lock-step gives the same bits every time, unless something changes the run.
    let lock_step = |seconds: &str| start(&cluster, seconds, &json, &["--unpaced"]);
    let run = lock_step("100000");
    await_leader(|| status(&cluster));
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().expect("a runtime");
    runtime.block_on(untrusted_start(&cluster));
    ask_to_end(&run);
    let Some(disturbed) = watch.judge(ended(run, &json)) else { return };
    let steps = disturbed["steps"].as_f64().expect("a count");
    let undisturbed = lock_step(&format!("{:.6}", (steps + 0.5) / 120.0));
    let Some(undisturbed) = watch.judge(ended(undisturbed, &json)) else { return };
    // The interrupted one may have taken a frame for the step after its last.
    assert_eq!(disturbed["steps"], undisturbed["steps"]);
    assert_eq!(disturbed["trajectory_digest"], undisturbed["trajectory_digest"]);
    assert_eq!(disturbed["missed"]["blind_steps"], 0, "{disturbed}");
}

/// A `Start` of a peer that claims nothing.
async fn untrusted_start(cluster: &Path) {
    let folder = cluster.parent().expect("a folder");
    let socket = folder.join("0.sock");
    let connect = tower::service_fn(move |_: tonic::transport::Uri| {
        let socket = socket.clone();
        async move { tokio::net::UnixStream::connect(socket).await.map(hyper_util::rt::TokioIo::new) }
    });
    let endpoint = tonic::transport::Endpoint::from_static("http://node.invalid");
    let channel = endpoint.connect_with_connector(connect).await.expect("connects");
    let mut client = v1::camera_node_client::CameraNodeClient::new(channel);
    let deadline = Instant::now() + Duration::from_secs(120);
    while client.describe(v1::DescribeRequest {}).await.expect("every peer may ask").into_inner().term == 0 {
        assert!(Instant::now() < deadline, "no coordinator leads it");
        tokio::time::sleep(Duration::from_millis(50)).await;
    }
    for pace in [Pace::lock_step(1), Pace::live(2, 0.0)] {
        let start = proto::convert::start_to_wire(film_time::RunStart::of_this_process(pace));
        let refused = client.start(start).await.expect_err("held");
        assert_eq!(refused.code(), tonic::Code::Aborted, "{refused}");
    }
}
