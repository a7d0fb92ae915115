#[path = "../../../../tests/shared/corpora.rs"]
mod corpora;

use std::sync::Arc;

use hull::question::{Answer, Batch, Points, Question, QuestionKind};
use hull::view_set::Scratch;
use hull::{Pose, Reach, Silhouette};
use prost::Message;

use super::super::choice::choice as choice_of;
use super::super::{Precision, QuestionWriter, StreamKnows, answer_to_wire};
use super::*;
use crate::v1;

const KINDS: [QuestionKind; 5] = [
    QuestionKind::Classes,
    QuestionKind::Edges,
    QuestionKind::Planes,
    QuestionKind::Exits,
    QuestionKind::SharedExits,
];

/// Bytes after numbers of two bytes each.
fn after(numbers: &[u16], bytes: &[u8]) -> Vec<u8> {
    numbers.iter().flat_map(|number| number.to_le_bytes()).chain(bytes.iter().copied()).collect()
}

#[test]
fn packed_fields() {
    let noise: Vec<u8> = (0..200u32).map(|at| ((at * at * 7) >> 3) as u8).collect();
    let few: Vec<u8> = (0..200u32).map(|at| ((at * at) >> 2) as u8 % 5 * 40).collect();
    let plain = [&[][..], &[7], &noise, &few, &[9; 3000]];
    let seeds = plain.map(|plain| after(&[plain.len() as u16], &pack(plain)));
    corpora::run("packed", packed, &seeds);
}

#[test]
fn choices() {
    let of = |count: usize, is_taken: fn(usize) -> bool| {
        let things: Vec<usize> = (0..count).collect();
        after(&[count as u16], &choice_of(&things, |&thing| is_taken(thing)))
    };
    let seeds = [
        of(0, |_| true),
        of(11, |at| at % 3 == 1),
        of(700, |at| (100..140).contains(&at) || at > 690),
        of(700, |at| at * at % 7 < 3),
        of(9000, |at| at % 50 == 1),
    ];
    corpora::run("choice", choice, &seeds);
}

#[test]
fn silhouettes() {
    let mask: Vec<u8> = (0..40 * 20u32).map(|at| u8::from(at % 40 * (at / 40) % 17 < 6)).collect();
    let silhouettes = [
        Silhouette::from_mask(40, 20, &mask).expect("a mask"),
        Silhouette::from_mask(3, 2, &[0; 6]).expect("a mask"),
        Silhouette::from_mask(300, 1, &[1; 300]).expect("a mask"),
    ];
    let encodings = [
        SilhouetteEncoding::RunsLz4,
        SilhouetteEncoding::Runs,
        SilhouetteEncoding::Mask,
        SilhouetteEncoding::Grey,
    ];
    let seed = |silhouette: &Silhouette, at: usize| {
        let data = silhouette_data(silhouette, encodings[at]);
        let size = [silhouette.width() as u16, silhouette.height() as u16];
        after(&size, &[&[at as u8][..], &data].concat())
    };
    let seeds: Vec<Vec<u8>> =
        silhouettes.iter().flat_map(|silhouette| (0..4).map(|at| seed(silhouette, at))).collect();
    corpora::run("runs", runs, &seeds);
}

#[test]
fn checkpoints() {
    let sealed = |contents: &[u8]| seal_checkpoint(contents).expect("short");
    let mut other = sealed(b"a world");
    other[8] = 2;
    corpora::run("checkpoint", checkpoint, &[sealed(b""), sealed(b"a world"), other]);
}

/// A question about two bodies and a few points of the world.
fn asked(kind: QuestionKind, picks: bool) -> Question {
    let pose = |x: f64| Pose::new([x, 0.1, -0.05], [0.0, 0.6, 0.0, 0.8]).expect("unit");
    let body = |at: usize, x| Points::Body { shape: Arc::clone(&question::shapes()[at]), pose: pose(x) };
    let bodies = [body(1, 0.0), body(0, 0.2), Points::World([[0.0, 0.0, 0.1], [5.0, 0.0, 1e9]].into())];
    let mut asked = Question { kind, ..Question::default() };
    for points in &bodies {
        if picks {
            asked.pick(points, [0.0, 0.01, 0.0], (0..points.len() as u32).step_by(2));
        } else {
            asked.batches.push(Batch::all(points.clone()));
        }
    }
    let count = match kind {
        QuestionKind::Exits => asked.len(),
        QuestionKind::SharedExits => asked.batches.len(),
        _ => 0,
    };
    asked.directions = vec![[0.6, 0.0, -0.8]; count];
    if picks {
        asked.within = (0..asked.len()).map(|at| Reach::from_code(at as u8)).collect();
        asked.hints = vec![1; asked.len()];
    }
    asked
}

#[test]
fn questions() {
    let seed = |precision: Precision, questions: &[Question]| {
        let (mut writer, mut knows, mut bytes) =
            (QuestionWriter::new(precision), StreamKnows::default(), vec![]);
        for asked in questions {
            let written = writer.write(asked);
            let mut message = written.message(&knows, 7, 3);
            knows.learn(&written);
            if let Some(bodies) = &mut message.bodies {
                // The keys that the target registers its shapes under.
                bodies.shapes = pack(&[2u64, 1, 0].map(u64::to_le_bytes).concat());
            }
            let message = message.encode_to_vec();
            bytes.extend(after(&[message.len() as u16], &message));
        }
        bytes
    };
    let mut seeds = vec![];
    for precision in [Precision::Exact, Precision::Quantised] {
        for kind in KINDS {
            seeds.push(seed(precision, &[asked(kind, false)]));
            seeds.push(seed(
                precision,
                &[asked(QuestionKind::Classes, false), asked(kind, true), asked(kind, true)],
            ));
        }
    }
    corpora::run("question", question, &seeds);
}

#[test]
fn answers() {
    let mut seeds = vec![];
    for (at, kind) in KINDS.into_iter().enumerate() {
        for precision in [Precision::Exact, Precision::Quantised] {
            let (asked, mut found) = (asked(kind, false), Answer::default());
            // The target knows the cameras 0 and 1.
            let views = question::rooms()[0].only(|place| place < 2);
            views.answer(&asked, &mut Scratch::default(), &mut found);
            let message = answer_to_wire(1, &found, 3, precision, 0.5).encode_to_vec();
            let [a, b] = (asked.len() as u16).to_le_bytes();
            seeds.push([&[at as u8, a, b][..], &message].concat());
        }
    }
    corpora::run("answer", answer, &seeds);
}

#[test]
fn messages() {
    let camera = v1::CameraDescription {
        name: "left".into(),
        rig_index: 2,
        width: 64,
        height: 48,
        calibration_digest: vec![7; 32].into(),
    };
    let settings = v1::ProbeSettings { abstain: true, min_views: 2, normal_window: 3, max_depth_m: 1.0 };
    let description = v1::DescribeReply {
        version: "0.1.0".into(),
        cameras: vec![camera.clone(), v1::CameraDescription { rig_index: 5, ..camera }],
        settings: Some(settings),
        frames_per_s: 30.0,
        term: 3,
    };
    let frame = v1::CameraFrame {
        rig_index: 2,
        admitted: Some(v1::PixelRect { left: 1, top: 2, right: 30, bottom: 40 }),
        area: 17,
        silhouette_bytes: 90,
        segment_ms: 0.5,
        late_s: 0.01,
        stamps: v1::Stamps::Capture.into(),
        pace: Some(v1::CameraPace { phase: 0.25, frames_per_s: 29.97 }),
    };
    let film =
        v1::FrameInfo { frame: 7, captured_unix_s: 1.7e9, cameras: vec![frame], ..v1::FrameInfo::default() };
    let failed = v1::FrameInfo { ended: true, failure: "no\ndisk".into(), ..v1::FrameInfo::default() };
    let request =
        v1::FetchPicturesRequest { frame: 7, scale_log2: 2, jpeg_quality: 80, kind: 1, cameras: vec![0, 5] };
    let picture = v1::Picture {
        rig_index: 5,
        runs: vec![0, 1, 3, 2].into(),
        left: 1,
        top: 2,
        width: 30,
        height: 40,
        jpeg: vec![0xff, 0xd8].into(),
        frame: 7,
        captured_unix_s: 1.7e9,
        scale_log2: 1,
    };
    let clock = v1::ClockLine { node_s: 12.5, film_s: 3.25, rate: 1.000_01, bound_s: 0.001 };
    let start =
        v1::StartRequest { run: 9, clock: Some(clock), epoch_unix_s: 1.7e9, lock_step: true, holder: 4 };
    let shape = super::super::shape_to_wire(&question::shapes()[1]);
    let claim = v1::HoldRequest { holder: 4, term: 2, name: "desk\u{1b}[31m".into() };
    let messages = [
        (0, description.encode_to_vec()),
        (1, film.encode_to_vec()),
        (1, failed.encode_to_vec()),
        (2, request.encode_to_vec()),
        (3, picture.encode_to_vec()),
        (4, start.encode_to_vec()),
        (5, clock.encode_to_vec()),
        (6, shape.encode_to_vec()),
        (7, settings.encode_to_vec()),
        (8, claim.encode_to_vec()),
    ];
    let seeds = messages.map(|(kind, message)| [&[kind][..], &message].concat());
    corpora::run("node_messages", node_messages, &seeds);
}
