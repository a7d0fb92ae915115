//! The very bytes that other programs' parsers are tested on: `web/page/tests/vectors/`. Run with
//! `HULLTOUCH_WRITE_VECTORS=1` to write them again after the format has changed.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use bytes::Bytes;
use coordinator::Progress;
use coordinator::live::{
    BodyLook, BodyState, CameraStatus, HullPatch, Outcome, Parameters, RunStatus, SceneState, TouchPoint,
    WorldState,
};
use hull::{Pose, Silhouette};
use proto::convert::{SilhouetteEncoding, silhouette_data};
use proto::{CameraPicture, FramePictures};
use sim::Solid;
use sim::solid::ConvexHull;
use web_server::message::{self, WorldParts};
use web_server::text::{self, FeedStatus};

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../page/tests/vectors")
}

#[track_caller]
fn is_golden(name: &str, found: &[u8]) {
    let path = folder().join(name);
    if std::env::var_os("HULLTOUCH_WRITE_VECTORS").is_some() {
        std::fs::create_dir_all(folder()).expect("a folder");
        std::fs::write(&path, found).expect("written");
    }
    let expected = std::fs::read(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    assert_eq!(found, expected, "{name} differs: is the format's version to change?");
}

/// Eight by six pixels, drawn as text.
fn runs() -> Bytes {
    let rows = ["........", "..##.#..", ".######.", ".######.", "...##...", "........"];
    let mask: Vec<u8> =
        rows.iter().flat_map(|row| row.bytes()).map(|pixel| u8::from(pixel == b'#')).collect();
    let silhouette = Silhouette::from_mask(8, 6, &mask).expect("a mask");
    silhouette_data(&silhouette, SilhouetteEncoding::Runs)
}

fn pictures(frame: u64, cameras: Vec<CameraPicture>) -> FramePictures {
    FramePictures { frame, captured_unix_s: 1_700_000_000.125, cameras }
}

#[test]
fn a_frame_set() {
    let both = CameraPicture {
        rig_index: 0,
        runs: runs(),
        scale_log2: 1,
        crop: [16, 32, 48, 64],
        jpeg: Bytes::from_static(&[0xff, 0xd8, 1, 2, 3, 0xff, 0xd9]),
    };
    let runs_alone = CameraPicture { rig_index: 2, runs: runs(), ..CameraPicture::default() };
    let nothing = CameraPicture { rig_index: 5, ..CameraPicture::default() };
    let set = pictures(90, vec![both, runs_alone, nothing]);
    is_golden("frame_set.bin", &message::frame_set(41, 30.0, &set));
    is_golden("frame_set_empty.bin", &message::frame_set(42, 30.0, &pictures(91, vec![])));
}

#[test]
fn images() {
    let image = |camera: u16| CameraPicture {
        rig_index: camera,
        runs: Bytes::new(),
        scale_log2: 2,
        crop: [0, 0, 640, 480],
        jpeg: Bytes::from(vec![0xff, 0xd8, camera as u8, 0xff, 0xd9]),
    };
    let all = pictures(90, vec![image(0), image(1)]);
    is_golden("images_thumbnails.bin", &message::images(43, 30.0, true, &all));
    is_golden("images_one.bin", &message::images(44, 30.0, false, &pictures(90, vec![image(1)])));
}

fn a_world() -> WorldState {
    let body = |id: u32, touching: bool| BodyState {
        id,
        pose: Pose::new([f64::from(id) / 4.0, 0.5, -0.25], [0.0, 0.6, 0.0, 0.8]).expect("a pose"),
        velocity_m_s: [0.0; 3],
        spin_rad_s: [0.0; 3],
        inside_samples: if touching { 3 } else { 0 },
        response_m: touching.then_some([0.0, 0.125, 0.0625]),
        grabbed: touching,
        asleep: !touching,
    };
    let touch = |height_m: f32| TouchPoint {
        body: 1,
        point_m: [1.25, height_m, -0.25],
        response_m: [0.0, 0.125, 0.0],
    };
    let patch = |slides_m_s: f32| HullPatch {
        body: 1,
        point_m: [1.25, 0.5, -0.25],
        normal_world: [0.0, 1.0, 0.0],
        velocity_m_s: [slides_m_s, 0.25, 0.0],
        depth_m: 0.03125,
        radius_m: 0.125,
        samples: 25,
    };
    WorldState {
        generation: 2,
        step: 360,
        film_s: 3.0,
        frame: Some(90),
        paused: true,
        bodies: vec![body(4, false), body(5, true)],
        touches: vec![touch(0.5), touch(0.75)],
        patches: vec![patch(0.0), patch(-0.5)],
    }
}

#[test]
fn worlds() {
    let touches = WorldParts { touches: true, patches: false };
    is_golden("world.bin", &message::world(45, &a_world(), touches));
    let all = WorldParts { touches: true, patches: true };
    is_golden("world_patches.bin", &message::world(47, &a_world(), all));
    let (bodies, touches) = (vec![], vec![]);
    let blind = WorldState { frame: None, paused: false, bodies, touches, patches: vec![], ..a_world() };
    is_golden("world_blind.bin", &message::world(46, &blind, all));
}

#[test]
fn texts() {
    let looks = [
        Solid::Box { size_m: [0.25, 0.5, 0.75] },
        Solid::Ball { radius_m: 0.125 },
        Solid::Capsule { radius_m: 0.125, length_m: 0.5 },
        Solid::Cylinder { radius_m: 0.25, height_m: 0.5 },
        Solid::Cone { radius_m: 0.25, height_m: 0.5 },
        Solid::Hull(Arc::new(
            ConvexHull::new(&[[0.0; 3], [0.5, 0.0, 0.0], [0.0, 0.5, 0.0], [0.0, 0.0, 0.5]]).expect("a hull"),
        )),
    ];
    let bodies = (1..).zip(looks).map(|(id, solid)| BodyLook {
        id,
        name: format!("{}_{id}", solid.kind()),
        solid,
        color: [1.0, 0.5, 0.25],
        fixed: id == 1,
    });
    let scene = SceneState {
        generation: 2,
        version: 7,
        scene: "topple".into(),
        bodies: bodies.collect(),
        parameters: Parameters {
            answers_hull: Some(true),
            hull_restitution: Some(0.25),
            hull_friction: Some(0.5),
            gravity_m_s2: Some([0.0, -9.75, 0.0]),
        },
        up: [0.0, 1.0, 0.0],
        floor_m: Some(0.0),
    };
    is_golden("scene.json", text::scene(&scene).as_bytes());
    let camera = CameraStatus {
        name: "cam_0".into(),
        problem: None,
        newest_frame: Some(92),
        age_ms: 41.5,
        sync_ms: 0.25,
        stamps: "capture",
        phase: Some(0.25),
        frames_per_s: Some(29.5),
        clock_bound_ms: 0.125,
        foreground: 0.0625,
        silhouette_bytes: 701,
        segment_ms: 1.5,
        late_ms: Some(21.5),
        costs_ms: 4.5,
        left_out: false,
    };
    let gone = CameraStatus {
        name: "cam_1".into(),
        problem: Some("connection refused".into()),
        newest_frame: None,
        ..camera.clone()
    };
    let progress = Progress {
        film_s: 3.0,
        frame: Some(90),
        steps_per_s: 120.0,
        passes_per_s: 30.0,
        p50_ms: 1.25,
        p99_ms: 4.5,
        samples: 5000,
        contacts: 2,
        hull_age_ms: Some(66.5),
        latency_ms: 23.5,
        bytes_per_s: 65536.0,
        hull_unavailable: None,
    };
    let status = RunStatus {
        progress,
        cameras: vec![camera, gone],
        frames_missed: 1,
        frames_expected: 93,
        late_steps: 2,
        blind_steps: 0,
        reduced_steps: 0,
        replay: None,
    };
    let feed = FeedStatus { bytes_per_s: 1_500_000.0, sent: 88, dropped: 2, tier: "full", pages: 3 };
    is_golden("status.json", text::status(Some(&status), false, &feed).as_bytes());
    is_golden("done.json", text::done(7, &Outcome::Spawned(12)).as_bytes());
    is_golden("refused.json", text::refused(Some(8), "no body has number 99").as_bytes());
    is_golden("bye.json", text::bye("the run has ended").as_bytes());
}
