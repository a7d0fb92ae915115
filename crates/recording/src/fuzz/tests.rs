#[path = "../../../../tests/shared/corpora.rs"]
mod corpora;

use coordinator::AskEvery;
use coordinator::live::{Command, Parameters};
use hull::rule::ProbeSettings;
use hull::{Camera, Pose, Rig, Silhouette};
use nalgebra::{Matrix3, Vector3};
use prost::Message;
use proto::convert::{Precision, SilhouetteEncoding, silhouette_data};
use proto::recording as messages;
use sim::{BodySpec, HullContact, MassSpec, Scene, Solid, WorldSettings};
use world_encodings::recording::vector;

use super::{file_of, recorded_messages, recording};
use crate::convert::{RunHeader, command_to_message, contacts_to_bytes};

fn camera(name: &str, x_m: f64) -> Camera {
    let matrix = Matrix3::new(20.0, 0.0, 8.0, 0.0, 20.0, 6.0, 0.0, 0.0, 1.0);
    Camera::new(name, (16, 12), matrix, [0.0; 5], Vector3::zeros(), Vector3::new(x_m, 0.0, 2.0))
        .expect("a camera")
}

fn silhouette() -> Vec<u8> {
    let mask: Vec<u8> = (0..16 * 12).map(|at| u8::from(at % 16 > 4 && at / 16 > 3)).collect();
    let silhouette = Silhouette::from_mask(16, 12, &mask).expect("a mask");
    silhouette_data(&silhouette, SilhouetteEncoding::Runs).to_vec()
}

fn header(precision: Precision) -> RunHeader {
    let text = "[[bodies]]\nname = \"ball\"\nshape.ball.radius = 0.1\nplace.at = [0, 1, 0]\n";
    RunHeader {
        program: "0.0.0-test".into(),
        began_unix_s: 1_700_000_000.25,
        rig: Rig::new(vec![camera("left", -0.1), camera("right", 0.3)]).expect("a rig"),
        ignored: vec![None, Silhouette::from_mask(16, 12, &[1; 16 * 12]).ok()],
        fps: 30.0,
        latency_s: 0.06,
        hold_s: 1.0,
        probes: ProbeSettings::default(),
        scene: Scene::from_toml("one", text).expect("a scene"),
        world: WorldSettings::default(),
        precision,
        asks: AskEvery::Step,
        transport: "cluster".into(),
        lock_step: true,
    }
}

fn commands() -> Vec<messages::Command> {
    let spec = BodySpec {
        name: "can".into(),
        solid: Solid::Cylinder { radius_m: 0.1, height_m: 0.2 },
        pose: Pose::IDENTITY,
        velocity_m_s: [0.0; 3],
        mass: MassSpec::MassKg(2.0),
        friction: 0.5,
        restitution: 0.1,
        fixed: false,
        color: [0.5; 3],
    };
    let gravity_m_s2 = Some([0.0, -1.0, 0.0]);
    let commands = [
        Command::Spawn(Box::new(spec)),
        Command::Push { body: 0, impulse_n_s: [0.0, 1.0, 0.0], at_m: Some([0.0; 3]) },
        Command::Grab { body: 0, grip_body_m: [0.0; 3], target_m: [1.0; 3] },
        Command::Release { body: 0, velocity_m_s: None },
        Command::Set(Parameters { gravity_m_s2, ..Parameters::default() }),
        Command::TakeBackground { seconds: 2.0, allow_foreground: true },
        Command::Reset,
    ];
    commands.iter().map(command_to_message).collect()
}

/// A camera's part of a frame.
fn parts() -> (messages::Silhouette, messages::Colour) {
    let silhouette = messages::Silhouette {
        frame: 0,
        camera: 0,
        width: 16,
        height: 12,
        runs: silhouette(),
        captured_unix_s: 1.7e9,
        segment_ms: 0.5,
        cameras: 0,
    };
    let colour =
        messages::Colour { width: 16, height: 12, jpeg: vec![0xff, 0xd8], ..messages::Colour::default() };
    (silhouette, colour)
}

fn run(precision: Precision) -> Vec<u8> {
    let (silhouette, colour) = parts();
    run_of(precision, &silhouette, &colour)
}

/// A run of two frames of two cameras and two steps; these are parts of its first frame.
fn run_of(precision: Precision, silhouette: &messages::Silhouette, colour: &messages::Colour) -> Vec<u8> {
    let contact = HullContact {
        sample: 3,
        point_body_m: [0.1, 0.0, 0.0],
        normal_world: [0.6, 0.0, -0.8],
        depth_m: 0.01,
        speed_m_s: None,
        slide_m_s: [0.0; 3],
    };
    let response = messages::Response {
        response_m: Some(vector([0.1, 0.0, 0.0])),
        inside_samples: 3,
        contacts: contacts_to_bytes(&[contact]),
        spin_rad_s: None,
    };
    let step = |step: u64| messages::Step {
        step,
        film_s: step as f64 / 30.0,
        frame: Some(step - 1),
        commands: if step == 1 { commands() } else { vec![] },
        responses: vec![response.clone()],
        digest: "00ff".into(),
        ..messages::Step::default()
    };
    let other = |frame, camera| messages::Silhouette { frame, camera, ..parts().0 };
    let messages = [
        (0u8, header(precision).to_message().encode_to_vec()),
        (3, silhouette.encode_to_vec()),
        (4, other(0, 1).encode_to_vec()),
        (5, colour.encode_to_vec()),
        (1, step(1).encode_to_vec()),
        (3, other(1, 0).encode_to_vec()),
        (4, other(1, 1).encode_to_vec()),
        (1, step(2).encode_to_vec()),
        (2, messages::End { steps: 2, ..messages::End::default() }.encode_to_vec()),
    ];
    let framed = |(channel, message): (u8, Vec<u8>)| {
        let [a, b] = (message.len() as u16).to_le_bytes();
        [&[channel, a, b][..], &message].concat()
    };
    messages.into_iter().flat_map(framed).collect()
}

#[test]
fn messages_of_recordings() {
    corpora::run("recorded_messages", recorded_messages, &[run(Precision::Exact), run(Precision::Quantised)]);
}

#[test]
fn recordings() {
    let whole = file_of(&run(Precision::Exact)).expect("written");
    let cut = whole[..whole.len() / 2].to_vec();
    corpora::run("recording", recording, &[whole, cut, file_of(&[]).expect("written")]);
}

#[test]
fn what_cannot_be_in_a_recording_is_refused_in_one_line() {
    type Spoil = fn(&mut messages::Silhouette, &mut messages::Colour);
    let cases: [(Spoil, &str); 6] = [
        (
            |silhouette, _| silhouette.captured_unix_s = f64::NAN,
            "Silhouette: captured_unix_s is NaN, expected 0 to",
        ),
        (
            |silhouette, _| silhouette.segment_ms = -1.0,
            "Silhouette: segment_ms is -1, expected 0 to 10000000",
        ),
        (|silhouette, _| silhouette.frame = u64::MAX, "frame 18446744073709551615, expected at most 2^40"),
        (|_, colour| colour.left = 1, "Colour: ends at 17 x 12, expected within 16 x 12"),
        (|_, colour| colour.height = u32::MAX, "Colour: ends at 16 x 4294967295, expected within 16 x 12"),
        (|_, colour| colour.scale_log2 = 9, "Colour: scale_log2 is 9, expected at most 3"),
    ];
    let folder = tempfile::tempdir().expect("folder");
    let path = folder.path().join("run.mcap");
    for (spoil, expected) in cases {
        let (mut silhouette, mut colour) = parts();
        spoil(&mut silhouette, &mut colour);
        let file = file_of(&run_of(Precision::Exact, &silhouette, &colour)).expect("written");
        std::fs::write(&path, file).expect("written");
        let refused = crate::Recording::open(&path).expect_err(expected).to_string();
        assert!(refused.contains(expected) && !refused.contains('\n'), "{refused}");
    }
}
