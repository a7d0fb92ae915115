//! Each fault is named by its check, and by no other.

use film_time::{CameraPace, Stamps};
use net::{CertificateError, Identity};
use node_client::{Mismatch, NodeError, NodeReport};
use proto::{
    Address, CameraDescription, CameraStatus, CameraTrouble, NewestFrame, NodeDescription, NodeStatus,
    TroubleKind,
};

use super::super::facts::{
    Certificates, Device, DeviceFacts, DiskFacts, Facts, NoFilm, NodeFacts, Place, Reach, Usb,
};
use super::super::finding::Level;
use super::*;

const FPS: f64 = 20.0;
const NOW_S: f64 = 1.8e9;

fn camera(place: u16) -> CameraFacts {
    let newest = NewestFrame {
        frame: 90,
        age_s: 0.05,
        foreground: 0.06,
        stamps: Stamps::Counter,
        pace: Some(CameraPace { phase: 0.98 + 0.01 * f64::from(place), frames_per_s: FPS }),
    };
    let look = CameraStatus {
        rig_index: place,
        frames: 91,
        newest: Some(newest),
        frames_per_s: FPS,
        jitter_s: 0.001,
        trouble: None,
    };
    CameraFacts { name: format!("cam_{place}"), looks: vec![look.clone(), look] }
}

fn node(place: u16) -> NodeFacts {
    let name = format!("cam_{place}");
    let described = CameraDescription { name, rig_index: place, size: (96, 72), calibration_digest: [1; 32] };
    let status = NodeStatus {
        node: NodeDescription {
            version: "0.1.0".into(),
            cameras: vec![described],
            settings: hull::ProbeSettings::default(),
            fps: FPS,
            term: 0,
        },
        node_s: 5.0,
        unix_s: NOW_S,
        holder: None,
        certificate_ends_unix_s: Some(NOW_S + 90.0 * 86_400.0),
        failure: None,
        cameras: camera(place).looks[..1].to_vec(),
    };
    let address = Address::Tcp("192.0.2.1:7001".into());
    NodeFacts {
        name: format!("node{place}"),
        place: Place::At(vec![address.to_string()]),
        reach: Reach::Open,
        found: Some(Ok(NodeReport { address, status, clock_offset_s: 0.002, clock_bound_s: 0.0003 })),
        agrees: Some(Ok(())),
    }
}

fn device(camera: &str, bus: u32) -> DeviceFacts {
    let found = Device::There(Some(Usb { bus, speed_mbit_s: 480 }));
    DeviceFacts { camera: camera.into(), path: "/dev/video0".into(), found }
}

fn healthy() -> Facts {
    let own = (Identity::coordinator("room"), NOW_S + 90.0 * 86_400.0);
    Facts {
        fps: FPS,
        version: "0.1.0".into(),
        now_unix_s: NOW_S,
        host: None,
        nodes: vec![node(0), node(1), node(2)],
        certificates: Certificates::Folder { folder: "certs".into(), found: Ok(own) },
        film: Ok(vec![camera(0), camera(1), camera(2)]),
        devices: vec![device("cam_0", 1), device("cam_1", 2)],
        missing_backgrounds: Vec::new(),
        disks: vec![DiskFacts { folder: ".".into(), what: "recordings", free: Ok(1 << 40) }],
        open_files: Some(4096),
    }
}

fn refused(facts: &mut Facts, error: NodeError) {
    facts.nodes[1].found = Some(Err(error));
    facts.nodes[1].agrees = None;
    facts.film = Err(NoFilm::NotTried("a node does not answer".into()));
}

fn looks(facts: &mut Facts, change: impl Fn(&mut CameraStatus)) {
    if let Ok(cameras) = &mut facts.film {
        cameras[1].looks.iter_mut().for_each(change);
    }
}

fn newest(facts: &mut Facts, change: impl Fn(&mut NewestFrame)) {
    looks(facts, |look| look.newest.iter_mut().for_each(&change));
}

fn trouble(facts: &mut Facts, kind: TroubleKind) {
    let trouble = CameraTrouble { kind, message: "camera \"cam_1\": it does so".into(), age_s: 1.0 };
    looks(facts, |look| {
        look.trouble = Some(trouble.clone());
        look.frames_per_s = 0.0;
    });
}

fn report(facts: &mut Facts, change: impl Fn(&mut NodeReport)) {
    if let Some(Ok(report)) = &mut facts.nodes[1].found {
        change(report);
    }
}

fn nowhere(facts: &mut Facts, place: Option<Place>, reach: Reach) {
    let node = &mut facts.nodes[1];
    (node.found, node.agrees, node.reach) = (None, None, reach);
    node.place = place.unwrap_or(Place::At(vec!["192.0.2.2:7001".into()]));
    facts.film = Err(NoFilm::NotTried("a node does not answer".into()));
}

fn own(facts: &mut Facts, error: CertificateError) {
    facts.certificates = Certificates::Folder { folder: "certs".into(), found: Err(error) };
    facts.nodes.iter_mut().for_each(|node| (node.found, node.agrees) = (None, None));
    facts.film = Err(NoFilm::NotTried("nodes cannot be asked".into()));
}

type Plant = fn(&mut Facts);

const FAULTS: [(&str, Level, Plant, &str); 32] = [
    (
        "names",
        Level::Fail,
        |facts| {
            nowhere(
                facts,
                Some(Place::UnknownHost("left-pc".into(), "no such host".into())),
                Reach::NotTried,
            );
        },
        "node node1: the host \"left-pc\" of its address is not known here (no such host)",
    ),
    (
        "names",
        Level::Fail,
        |facts| nowhere(facts, Some(Place::NotAnnounced), Reach::NotTried),
        "node node1: it is not announced",
    ),
    (
        "ports",
        Level::Fail,
        |facts| nowhere(facts, None, Reach::Refused("192.0.2.2:7001".into())),
        "node node1: nothing listens at 192.0.2.2:7001",
    ),
    (
        "ports",
        Level::Fail,
        |facts| nowhere(facts, None, Reach::Timeout("192.0.2.2:7001".into())),
        "node node1: nothing comes back from 192.0.2.2:7001",
    ),
    (
        "ports",
        Level::Fail,
        |facts| nowhere(facts, None, Reach::Failed("192.0.2.2:7001".into(), "no route".into())),
        "node node1: no connection to 192.0.2.2:7001: no route",
    ),
    (
        "ports",
        Level::Fail,
        |facts| refused(facts, NodeError::Lost("h2 protocol error".into())),
        "node node1: another program",
    ),
    (
        "certificates",
        Level::Fail,
        |facts| refused(facts, NodeError::Unreachable("its certificate has ended on 2026-01-01".into())),
        "node node1: cannot connect: its certificate has ended",
    ),
    (
        "certificates",
        Level::Fail,
        |facts| {
            refused(facts, NodeError::Refused("this is for coordinator.room.hulltouch or viewer.room.hulltouch, and was asked by a peer of no room".into()));
        },
        "node node1: this is for coordinator.room.hulltouch",
    ),
    (
        "certificates",
        Level::Warn,
        |facts| report(facts, |report| report.status.certificate_ends_unix_s = Some(NOW_S + 3.0 * 86_400.0)),
        "that of node node1 ends in 3.0 days",
    ),
    (
        "certificates",
        Level::Warn,
        |facts| {
            facts.certificates = Certificates::Folder {
                folder: "certs".into(),
                found: Ok((Identity::viewer("room"), NOW_S + 13.0 * 86_400.0)),
            };
        },
        "that of viewer.room.hulltouch in certs ends in 13.0 days",
    ),
    (
        "certificates",
        Level::Fail,
        |facts| own(facts, CertificateError::KeyOpen { path: "certs/tls.key".into(), mode: 0o644 }),
        "certs/tls.key has mode 0644: others may read it",
    ),
    (
        "certificates",
        Level::Fail,
        |facts| {
            own(facts, CertificateError::Mismatch { key: "tls.key".into(), certificate: "tls.crt".into() });
        },
        "tls.key does not fit tls.crt",
    ),
    (
        "certificates",
        Level::Fail,
        |facts| facts.certificates = Certificates::Missing { node: "node left".into(), is_wanted: false },
        "what is sent to node left is not encrypted",
    ),
    (
        "certificates",
        Level::Warn,
        |facts| facts.certificates = Certificates::Missing { node: "node left".into(), is_wanted: true },
        "what is sent to node left is not encrypted",
    ),
    (
        "versions",
        Level::Fail,
        |facts| report(facts, |report| report.status.node.version = "0.3.1".into()),
        "node node1 is version 0.3.1, this is 0.1.0",
    ),
    (
        "versions",
        Level::Fail,
        |facts| refused(facts, NodeError::NoStatus),
        "node node1: an older version than this one",
    ),
    (
        "digests",
        Level::Fail,
        |facts| facts.nodes[1].agrees = Some(Err(Mismatch::Calibration("cam_1".into()))),
        "node node1: its calibration of camera \"cam_1\" is not the rig's",
    ),
    (
        "clocks",
        Level::Fail,
        |facts| report(facts, |report| report.clock_bound_s = 0.03),
        "node node1: its clock is known to 30.0 ms, expected 12.5",
    ),
    (
        "clocks",
        Level::Warn,
        |facts| report(facts, |report| report.clock_offset_s = -7200.0),
        "node node1: its wall clock is -7200 s",
    ),
    ("rates", Level::Fail, |facts| trouble(facts, TroubleKind::Rate), "camera \"cam_1\": it does so"),
    ("rates", Level::Fail, |facts| trouble(facts, TroubleKind::Source), "camera \"cam_1\": it does so"),
    (
        "rates",
        Level::Fail,
        |facts| looks(facts, |look| look.frames_per_s = 9.0),
        "camera cam_1 films 9.0 frames/s, expected 20",
    ),
    (
        "rates",
        Level::Fail,
        |facts| facts.film = Err(NoFilm::Failed("node node1: the connection broke".into())),
        "cameras could not be filmed: node node1: the connection broke",
    ),
    ("stamps", Level::Fail, |facts| trouble(facts, TroubleKind::Stamps), "camera \"cam_1\": it does so"),
    (
        "stamps",
        Level::Warn,
        |facts| {
            looks(facts, |look| look.jitter_s = 0.008);
            newest(facts, |newest| newest.stamps = Stamps::Capture);
        },
        "camera cam_1: the times that it says are uneven by 8.0 ms",
    ),
    (
        "phases",
        Level::Fail,
        |facts| newest(facts, |newest| newest.pace = Some(CameraPace { phase: 0.5, frames_per_s: FPS })),
        "camera cam_1 counts a trigger and captures 24.0 ms away",
    ),
    (
        "backgrounds",
        Level::Fail,
        |facts| newest(facts, |newest| newest.foreground = 0.93),
        "camera cam_1: 93 % of its image is foreground",
    ),
    (
        "backgrounds",
        Level::Warn,
        |facts| newest(facts, |newest| newest.foreground = 0.0),
        "camera cam_1 never has foreground",
    ),
    (
        "disk",
        Level::Fail,
        |facts| facts.disks[0].free = Ok(5 << 20),
        "., where recordings go, has 5 MiB free",
    ),
    (
        "devices",
        Level::Fail,
        |facts| facts.devices[1].found = Device::Denied,
        "camera cam_1: this user may not open /dev/video0",
    ),
    (
        "usb",
        Level::Warn,
        |facts| facts.devices[1] = device("cam_1", 1),
        "cameras cam_0, cam_1 share USB bus 1",
    ),
    ("limits", Level::Warn, |facts| facts.open_files = Some(256), "a process may have 256 files open"),
];

/// What is wrong, by check.
fn wrong(facts: &Facts) -> Vec<(&'static str, Finding)> {
    let found =
        ALL.iter().flat_map(|(check, find)| find(facts).into_iter().map(move |finding| (*check, finding)));
    found.filter(|(_, finding)| finding.level > Level::Skip).collect()
}

#[test]
fn a_room_in_which_all_is_well_gets_a_line_a_check() {
    let facts = healthy();
    assert_eq!(wrong(&facts), []);
    for (check, find) in ALL {
        assert_eq!(find(&facts).len(), 1, "{check}");
    }
}

#[test]
fn each_fault_is_named_by_its_check_and_by_no_other() {
    for (check, level, plant, expected) in FAULTS {
        let mut facts = healthy();
        plant(&mut facts);
        let found = wrong(&facts);
        assert_eq!(found.len(), 1, "{expected}: {found:?}");
        assert_eq!((found[0].0, found[0].1.level), (check, level), "{found:?}");
        assert!(found[0].1.what.starts_with(expected), "{found:?}");
        assert!(found[0].1.cure.as_ref().is_some_and(|cure| cure.len() > 10), "{found:?}");
    }
}

#[test]
fn nothing_runs_yet_and_nothing_panics() {
    let facts = Facts {
        nodes: vec![],
        film: Err(NoFilm::NotTried("no camera films".into())),
        devices: vec![],
        disks: vec![],
        ..healthy()
    };
    assert_eq!(wrong(&facts), []);
    let facts = Facts { film: Ok(vec![]), ..healthy() };
    assert_eq!(wrong(&facts), []);
}

#[test]
fn what_a_camera_has_long_got_over_is_no_fault() {
    for kind in [TroubleKind::Rate, TroubleKind::Stamps, TroubleKind::Source] {
        let mut facts = healthy();
        trouble(&mut facts, kind);
        looks(&mut facts, |look| {
            look.frames_per_s = FPS;
            look.trouble.iter_mut().for_each(|trouble| trouble.age_s = 3600.0);
        });
        assert_eq!(wrong(&facts), []);
    }
}
