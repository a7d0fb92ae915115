//! Containers for real: Docker's engine, an image of the Dockerfile, and the room of compose.yaml on film, in which nodes
//! are paused, killed, cut off and renewed.

#![allow(clippy::disallowed_macros, reason = "a test says what it measured")]

mod engine;
mod film;
mod room;

use std::fs;
use std::path::{Path, PathBuf};
use std::thread;
use std::time::Duration;

use engine::{Engine, debian};
use room::{NODES, Room};

fn deployed() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../deploy/containers")
}

#[test]
fn the_room_that_is_deployed_is_the_studio() {
    let rig = fs::read_to_string(deployed().join("room/rig.toml")).expect("a file");
    assert_eq!(rig.trim(), stage::studio_rig(4, (320, 240)).expect("a rig").to_toml().trim());
}

#[test]
fn a_room_in_containers_goes_on_whatever_becomes_of_its_nodes() {
    let engine = match Engine::start() {
        Ok(engine) => engine,
        Err(why) => return testkit::skip(format_args!("no containers: {why}")),
    };
    let base = match debian() {
        Ok(base) => base,
        Err(why) => return testkit::skip(format_args!("no base for the image: {why}")),
    };
    let room = Room::start(&engine, &base, &deployed());
    room.is_ready();
    room.is_closed();

    let began = room.began("coordinator");
    engine.says(&["pause", &room.container("west")]);
    room.goes_on_without("west");
    thread::sleep(Duration::from_secs(5));
    engine.says(&["unpause", &room.container("west")]);
    room.is_ready();

    let (east, restarts) = (room.container("east"), "{{.RestartCount}}");
    engine.kill(&engine.says(&["inspect", "--format", "{{.State.Pid}}", &east]));
    room.is_ready();
    room.until("east was started again", || engine.says(&["inspect", "--format", restarts, &east]) == "1");
    room.is_ready();

    let network = room.network();
    engine.says(&["network", "disconnect", &network, &room.container("south")]);
    room.goes_on_without("south");
    engine.says(&["network", "connect", "--alias", "south", &network, &room.container("south")]);
    room.is_ready();

    for node in NODES {
        room.renew(node);
        room.is_ready();
    }
    assert_eq!(room.began("coordinator"), began, "the coordinator was restarted: {}", room.log());
    room.renew("coordinator");
    room.is_ready();
    assert!(room.log().contains("going on from the world that the nodes remember"), "{}", room.log());
}
