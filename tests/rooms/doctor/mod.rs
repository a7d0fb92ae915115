//! The doctor names what is wrong with a room, and nothing else: real nodes, one planted fault at a time.

mod replacing;
mod room;

use std::os::unix::fs::symlink;

use net::{Authority, Identity, Validity};

use crate::link::{Delay, Link};
use crate::room::{Running, await_leader, coordinator, ended, program};
use replacing::Replacing;
use room::{Line, Plan, Room, finds, is_well_and_films, issue, wrong};
use testkit::{Watch, timely};

const STEADY: (f64, u32, &str) = (0.0, 20, "counts");

/// What lives as long as the doctor looks.
type Guard = Box<dyn std::any::Any>;

/// A fault: which check names it, with which words; the room that has it.
type Fault = (&'static str, &'static str, fn() -> (Room, Guard));

const FAULTS: [Fault; 15] = [
    ("names", "node right: the host \"nowhere.invalid\" of its address is not known here", unknown_host),
    ("ports", "node right: nothing listens at 127.0.0.1:", closed_port),
    ("certificates", "that of node right ends in 5.0 days", ending_certificate),
    (
        "certificates",
        "node right: cannot connect: its certificate is of no authority in ca.crt",
        other_authority,
    ),
    ("certificates", "coordinator/tls.key has mode 0604: others may read it", open_key),
    ("versions", "node right is version 0.9.0, this is 0.1.0", other_version),
    ("digests", "node right: its calibration of camera \"cam_2\" is not the rig's", other_rig),
    ("clocks", "node right: its clock is known to ", slow_way),
    ("rates", "films 15.", other_rate),
    ("stamps", "expected more", times_set_back),
    ("phases", "camera cam_3 counts a trigger and captures ", untriggered),
    ("backgrounds", "camera cam_3: ", wrong_background),
    ("disk", "/proc, where recordings go", full_disk),
    ("devices", "camera cam_1: /dev/video1 is not there", unplugged),
    ("usb", "cameras cam_0, cam_1 share USB bus 3", shared_bus),
];

fn nothing() -> Guard {
    Box::new(())
}

fn unknown_host() -> (Room, Guard) {
    let room = Plan::of_stage().run();
    room.write([room.nodes[0].address(), "nowhere.invalid:7001"]);
    (room, nothing())
}

fn closed_port() -> (Room, Guard) {
    let mut room = Plan::of_stage().run();
    drop(room.nodes.pop());
    (room, nothing())
}

fn ending_certificate() -> (Room, Guard) {
    let room = Plan::of_stage().run();
    // All are new: the old authority's key is not kept.
    let authority = Authority::make("room", Validity::days(30)).expect("an authority");
    for (name, owner, days) in [
        ("left", Identity::node("room", "left"), 30),
        ("right", Identity::node("room", "right"), 5),
        ("coordinator", Identity::coordinator("room"), 30),
    ] {
        issue(&room.folder.path().join(name), &authority, &owner, Validity::days(days));
    }
    await_reading();
    (room, nothing())
}

fn other_authority() -> (Room, Guard) {
    let room = Plan::of_stage().run();
    let other = Authority::make("room", Validity::days(30)).expect("an authority");
    issue(&room.folder.path().join("right"), &other, &Identity::node("room", "right"), Validity::days(30));
    await_reading();
    (room, nothing())
}

/// Nodes read their folders once a second at most.
fn await_reading() {
    std::thread::sleep(std::time::Duration::from_millis(1100));
}

fn open_key() -> (Room, Guard) {
    use std::os::unix::fs::PermissionsExt as _;
    let room = Plan::of_stage().run();
    let key = room.folder.path().join("coordinator/tls.key");
    std::fs::set_permissions(key, std::fs::Permissions::from_mode(0o604)).expect("set");
    (room, nothing())
}

/// A node that says another version: the same bytes but for that, in clear text.
fn other_version() -> (Room, Guard) {
    let room = Plan { is_certified: false, ..Plan::of_stage() }.run();
    let own = env!("CARGO_PKG_VERSION");
    let to = room.nodes[1].address().parse().expect("an address");
    let way = Replacing::to(to, own.as_bytes(), own.replacen(".1.", ".9.", 1).as_bytes());
    room.write([room.nodes[0].address(), &way.address.to_string()]);
    (room, Box::new(way))
}

fn other_rig() -> (Room, Guard) {
    let mut room = Plan::of_stage().run();
    let rig = room.folder.path().join("rig.toml");
    let ours = std::fs::read_to_string(&rig).expect("a rig");
    let theirs = stage::studio_rig(4, (128, 96)).expect("a rig");
    std::fs::write(&rig, theirs.to_toml()).expect("written");
    room.nodes[1] = room.start("right");
    std::fs::write(&rig, ours).expect("written");
    room.set_addresses();
    (room, nothing())
}

fn slow_way() -> (Room, Guard) {
    let room = Plan::of_stage().run();
    let to = room.nodes[1].address().parse().expect("an address");
    let link = Link::to(to, Delay { ms: 60.0, jitter_ms: 0.0 }, 1);
    room.write([room.nodes[0].address(), &link.address.to_string()]);
    (room, Box::new(link))
}

fn other_rate() -> (Room, Guard) {
    let plan = Plan::of_live([STEADY, STEADY, STEADY, (0.0, 15, "arrival")], [""; 4]);
    (plan.run(), nothing())
}

fn times_set_back() -> (Room, Guard) {
    let times = (0.0, 20, "times");
    (Plan::of_live([times, times, times, (0.0, 20, "back")], [""; 4]).run(), nothing())
}

fn untriggered() -> (Room, Guard) {
    (Plan::of_live([STEADY, STEADY, STEADY, (0.45, 20, "counts")], [""; 4]).run(), nothing())
}

fn wrong_background() -> (Room, Guard) {
    let mut plan = Plan::of_stage();
    let white = image::RgbImage::from_pixel(96, 72, image::Rgb([255, 255, 255]));
    white.save(plan.folder.path().join("white.png")).expect("written");
    plan.text.push_str("background = { kind = \"images\", path = \"white.png\" }\n");
    (plan.run(), nothing())
}

fn full_disk() -> (Room, Guard) {
    let mut room = Plan::of_stage().run();
    room.more.extend(["--recordings".to_owned(), "/proc".to_owned()]);
    (room, nothing())
}

fn of_devices() -> Room {
    Plan::of_live([STEADY; 4], ["/dev/video0", "/dev/video1", "", ""]).run()
}

fn unplugged() -> (Room, Guard) {
    let mut room = of_devices();
    room.plant(&[("dev/video0", "")]);
    (room, nothing())
}

/// Two cameras on the ports of one bus, as the system shows them.
fn shared_bus() -> (Room, Guard) {
    let mut room = of_devices();
    let root = room.plant(&[
        ("dev/video0", ""),
        ("dev/video1", ""),
        ("sys/devices/pci/usb3/3-1/busnum", "3\n"),
        ("sys/devices/pci/usb3/3-1/speed", "480\n"),
        ("sys/devices/pci/usb3/3-1/3-1:1.0/video4linux/video0/dev", "81:0\n"),
        ("sys/devices/pci/usb3/3-2/busnum", "3\n"),
        ("sys/devices/pci/usb3/3-2/speed", "480\n"),
        ("sys/devices/pci/usb3/3-2/3-2:1.0/video4linux/video1/dev", "81:1\n"),
    ]);
    for (video, port) in [("video0", "3-1"), ("video1", "3-2")] {
        let folder = root.join("sys/class/video4linux").join(video);
        std::fs::create_dir_all(&folder).expect("made");
        let device = root.join(format!("sys/devices/pci/usb3/{port}/{port}:1.0"));
        symlink(device, folder.join("device")).expect("linked");
    }
    (room, nothing())
}

#[test]
fn a_room_in_which_all_is_well_gets_no_complaint() {
    let watch = Watch::start();
    for plan in [Plan::of_stage(), Plan::of_live([STEADY; 4], [""; 4])] {
        if !is_well_and_films(&watch, &plan.run().doctor()) {
            return;
        }
    }
}

/// Every so many-th fault: several tests share them, and run at once.
#[track_caller]
fn faults_are_named(part: usize, of: usize) {
    for (check, expected, plant) in FAULTS.iter().skip(part).step_by(of) {
        let watch = Watch::start();
        let (room, _guard) = plant();
        let output = room.doctor();
        let is_named = |(named, _, what): &Line| named == check && what.contains(expected);
        if !finds(&watch, &output, &format!("{check}: {expected}"), is_named) {
            continue;
        }
        let (found, said) = (wrong(&output), String::from_utf8_lossy(&output.stdout));
        assert!(!found.is_empty(), "{check}: {expected}: {said}");
        let fails = found.iter().any(|(_, level, _)| level == "fail");
        assert_eq!(output.status.code(), Some(i32::from(fails)), "{said}");
    }
}

#[test]
fn each_planted_fault_is_named_and_no_other_1() {
    faults_are_named(0, 3);
}

#[test]
fn each_planted_fault_is_named_and_no_other_2() {
    faults_are_named(1, 3);
}

#[test]
fn each_planted_fault_is_named_and_no_other_3() {
    faults_are_named(2, 3);
}

#[test]
fn a_run_that_is_on_goes_on() {
    let watch = Watch::start();
    let room = Plan::of_stage().run();
    let json = room.folder.path().join("out.json");
    let mut command = coordinator(program(), &room.cluster, "12", &json);
    let run = Running::start(command.current_dir(room.folder.path()).args(["--certs", "coordinator"]));
    await_leader(|| {
        let mut status = program();
        status
            .current_dir(room.folder.path())
            .arg("status")
            .arg(&room.cluster)
            .args(["--certs", "coordinator"]);
        status
    });
    if !is_well_and_films(&watch, &room.doctor()) {
        return;
    }
    let Some(figures) = watch.judge(ended(run, &json)) else { return };
    timely!(watch, figures["missed"]["reduced_steps"] == 0, "a node was left out: {}", figures["missed"]);
    timely!(
        watch,
        figures["frames"].as_u64().is_some_and(|frames| frames > 70),
        "{} frames, missed {}",
        figures["frames"],
        figures["missed"]
    );
}

#[test]
fn a_camera_pc_is_checked_before_its_node_runs_and_after() {
    let watch = Watch::start();
    let mut room = Plan::of_stage().run();
    // Its own port is the one of the address.
    room.set_addresses();
    room.more.extend(["--host", "right", "--certs", "right"].map(str::to_owned));
    let runs = room.doctor();
    if !finds(&watch, &runs, "nothing wrong", |_| false) {
        return;
    }
    assert!(String::from_utf8_lossy(&runs.stdout).contains("node right listens"));
    let address = room.nodes[1].address().to_owned();
    drop(room.nodes.pop());
    let free = room.doctor();
    if !finds(&watch, &free, "nothing wrong", |_| false) {
        return;
    }
    assert!(String::from_utf8_lossy(&free.stdout).contains("the port of node right is free"));
    let _other = std::net::TcpListener::bind(address).expect("free");
    let taken = room.doctor();
    let is_taken = |(check, level, _): &Line| check == "ports" && level == "fail";
    if finds(&watch, &taken, "a port that is taken", is_taken) {
        assert_eq!(wrong(&taken).len(), 1, "{}", String::from_utf8_lossy(&taken.stdout));
    }
}
