//! What systemd hears of nodes and coordinators, and the units that start them.

mod manager;
mod units;

use std::fs;
use std::net::TcpStream;
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};

use crate::room::{Node, named_room, program};
use futures::{SinkExt as _, StreamExt as _};
use manager::Service;
use rustix::fs::{CWD, FileType, Mode, mknodat};
use serde_json::{Value, json};
use tokio_tungstenite::tungstenite::Message;

const TOKEN: &str = "a-token-for-tests";

/// A room of two nodes at sockets in a folder.
fn room_in(folder: &Path) -> PathBuf {
    named_room(folder, "address = \"unix:left.sock\"", "address = \"unix:right.sock\"")
}

/// A node that tells how it is, its socket for that in a folder of its own.
fn node(cluster: &Path, name: &str) -> Service {
    let folder = cluster.with_file_name(format!("{name}.d"));
    fs::create_dir(&folder).expect("a folder");
    let mut command = program();
    command.arg("node").arg(cluster).args(["--host", name]);
    Service::start(command, &folder)
}

fn coordinator(cluster: &Path) -> Command {
    let mut command = program();
    command.arg("coordinator").arg(cluster).args(["--listen", "127.0.0.1:0"]).env("HULLTOUCH_TOKEN", TOKEN);
    command
}

#[test]
fn a_node_says_when_it_serves_that_it_works_and_that_it_ends() {
    let folder = tempfile::tempdir().expect("a folder");
    let node = node(&room_in(folder.path()), "left");
    let ready = node.await_word("READY=1");
    assert!(ready.contains("STATUS=serves cam_0, cam_1 at unix:"), "{ready}");
    UnixStream::connect(folder.path().join("left.sock")).expect("its port is open");
    // No coordinator leads it, and it is well.
    node.is_fed();
    let (status, said) = node.end();
    assert!(status.success(), "{status}: {said}");
}

/// A film whose tenth image and all after it are never read to their end, as on a network drive that has gone.
fn film_that_hangs(folder: &Path) {
    let film = folder.join("film");
    fs::create_dir(&film).expect("a folder");
    for number in 0..600 {
        let path = film.join(format!("{number:06}.png"));
        match number {
            0..10 => image::GrayImage::new(96, 72).save(&path).expect("written"),
            _ => mknodat(CWD, &path, FileType::Fifo, Mode::RUSR | Mode::WUSR, 0).expect("a pipe"),
        }
    }
}

#[test]
fn a_node_whose_film_hangs_feeds_no_watchdog_and_the_other_does() {
    let folder = tempfile::tempdir().expect("a folder");
    let cluster = room_in(folder.path());
    film_that_hangs(folder.path());
    let text = fs::read_to_string(&cluster).expect("written");
    let stage = "source = { kind = \"stage\", motion = \"sweep\" }";
    fs::write(&cluster, text.replacen(stage, "source = { kind = \"masks\", path = \"film\" }", 1))
        .expect("written");
    let (mut left, right) = (node(&cluster, "left"), node(&cluster, "right"));
    left.await_word("READY=1");
    right.await_word("READY=1");
    left.is_fed();
    let own = folder.path().join("coordinator.d");
    fs::create_dir(&own).expect("a folder");
    let run = Service::start(coordinator(&cluster), &own);
    left.starves();
    UnixStream::connect(folder.path().join("left.sock")).expect("it is there, and answers");
    right.is_fed();
    run.is_fed();
    let line = left.await_line("camera \"cam_0\" has not got on for ");
    assert!(line.ends_with(": systemd's watchdog is not fed"), "{line}");
}

#[test]
fn a_camera_that_films_nothing_and_is_opened_again_is_no_hang() {
    let folder = tempfile::tempdir().expect("a folder");
    let cluster = room_in(folder.path());
    let text = fs::read_to_string(&cluster).expect("written");
    let stage = "source = { kind = \"stage\", motion = \"sweep\" }";
    image::RgbImage::new(96, 72).save(folder.path().join("empty.png")).expect("written");
    let silent = "source = { kind = \"pipe\", live = true, timeout_s = 3, command = [\"sleep\", \"60\"] }\n\
                  background = { kind = \"images\", path = \"empty.png\" }";
    fs::write(&cluster, text.replacen(stage, silent, 1)).expect("written");
    let (mut left, _right) = (node(&cluster, "left"), Node::start_named(program(), &cluster, "right"));
    left.await_word("READY=1");
    let own = folder.path().join("coordinator.d");
    fs::create_dir(&own).expect("a folder");
    let run = Service::start(coordinator(&cluster), &own);
    left.await_line("it is opened again until it films");
    left.is_fed();
    run.is_fed();
    // It ends the camera's program, too.
    left.end();
}

/// Sends a command to the run on this page, which does it.
async fn steer(page: &str, command: &str) {
    let url = format!("ws://{page}/state?rate=1&token={TOKEN}");
    let (mut socket, _) = tokio_tungstenite::connect_async(url).await.expect("connects");
    let order = json!({ "op": "command", "id": 1, "command": command }).to_string();
    socket.send(Message::text(order)).await.expect("sent");
    while let Some(message) = socket.next().await {
        let answer: Value = serde_json::from_slice(&message.expect("a message").into_data()).expect("JSON");
        if answer["op"] != "state" {
            assert_eq!(answer["op"], "done", "{answer}");
            return;
        }
    }
    panic!("no answer");
}

#[tokio::test]
async fn a_run_feeds_the_watchdog_paused_or_blind_until_its_loop_hangs() {
    let folder = tempfile::tempdir().expect("a folder");
    let cluster = room_in(folder.path());
    let mut run = Service::start(coordinator(&cluster), folder.path());
    run.await_word("READY=1");
    let page = run.await_line("viewers: http://").trim_end_matches('/').to_owned();
    TcpStream::connect(&page).expect("its port is open");
    // It waits for its nodes, and is well.
    run.is_fed();
    let left = Node::start_named(program(), &cluster, "left");
    let right = Node::start_named(program(), &cluster, "right");
    run.await_word("STATUS=runs\n");
    steer(&page, "pause").await;
    run.is_fed();
    steer(&page, "resume").await;
    drop(left);
    run.await_word("STATUS=runs without a hull: ");
    run.is_fed();
    let _left = Node::start_named(program(), &cluster, "left");
    run.await_word("STATUS=runs\n");
    run.clog();
    // Of this it would log a line.
    drop(right);
    run.starves();
    assert!(Path::new(&format!("/proc/{}", run.id())).exists(), "it hangs, and has not ended");
}

#[test]
fn a_coordinator_ends_at_once_however_long_it_would_wait_for_its_nodes() {
    let folder = tempfile::tempdir().expect("a folder");
    let mut command = coordinator(&room_in(folder.path()));
    command.args(["--patience", "600"]);
    let run = Service::start(command, folder.path());
    run.await_word("READY=1");
    run.is_fed();
    let asked = Instant::now();
    let (status, said) = run.end();
    assert!(status.success(), "{status}: {said}");
    assert!(asked.elapsed() < Duration::from_secs(30), "{:?}", asked.elapsed());
}
