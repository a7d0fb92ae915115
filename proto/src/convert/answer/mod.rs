//! Answers to messages and back.

mod classes;
mod edges;
mod exits;
mod planes;

use std::sync::Arc;

use hull::Camera;
use hull::coordinates::Coordinates;
use hull::question::{Answer, Question, QuestionKind};
use nalgebra::Point3;

use super::bulk::{Field, unpack};
use super::choice::read_choice;
use super::rounded::{Precision, on_scale};
use super::{ConvertError, RefusalReason};
use crate::text::{MAX_MESSAGE_CHARS, clean};
use crate::{MAX_MESSAGE_BYTES, v1};
use classes::{classes_from_wire, classes_to_wire};
use edges::{edges_from_wire, edges_to_wire};
use exits::{exits_from_wire, exits_to_wire};
use planes::{planes_from_wire, planes_to_wire};

/// Steps of the scale of rounded distances in three bytes.
const STEPS: u32 = 0xff_ffff;

/// A ray crosses the borders of an image, or of what is ignored in it, a few times a camera: a fence of fifty bars takes a
/// hundred.
const MOST_CHANGES_A_CAMERA: usize = 128;
const CHANGE_BYTES: usize = 12;
/// Beside what is told of points: a refusal's words, tables of packed fields.
const MOST_BESIDE_BYTES: usize = 4096;

/// A node's reply to a question.
#[derive(Clone, Debug, PartialEq)]
pub enum ProbeAnswer {
    /// It answered.
    Answer(Answer),
    /// It did not, and why.
    Refused(RefusalReason, String),
}

/// An answer of a node with `camera_count` cameras.
pub fn answer_to_wire(
    id: u64,
    answer: &Answer,
    camera_count: usize,
    precision: Precision,
    compute_ms: f64,
) -> v1::ProbeReply {
    use v1::probe_reply::Answer as Wire;
    let answer = match answer.kind {
        QuestionKind::Classes => Wire::Classes(classes_to_wire(&answer.standings, camera_count)),
        QuestionKind::Edges => Wire::Edges(edges_to_wire(answer, precision)),
        QuestionKind::Planes => Wire::Planes(planes_to_wire(answer, precision)),
        QuestionKind::Exits | QuestionKind::SharedExits => Wire::Exits(exits_to_wire(answer, precision)),
    };
    v1::ProbeReply { id, answer: Some(answer), compute_ms: compute_ms as f32 }
}

/// What an answer must be to fit its question.
#[derive(Clone, Debug, PartialEq)]
pub struct ExpectedAnswer {
    /// What was asked.
    pub kind: QuestionKind,
    /// Of how many points.
    pub points: usize,
    /// The node's cameras.
    pub cameras: Vec<ExpectedCamera>,
    /// To [`QuestionKind::Planes`], the points, as [`asked_world`] gives them; empty otherwise.
    pub points_world: Arc<Coordinates>,
}

/// A camera of the node that answers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ExpectedCamera {
    /// Its place in the rig.
    pub rig_index: u16,
    /// Width and height, pixels.
    pub size: (u32, u32),
    /// Where it stands, metres, world.
    pub centre_world: Point3<f64>,
}

impl ExpectedCamera {
    /// A camera of a rig at its place there.
    pub fn new(camera: &Camera, rig_index: u16) -> ExpectedCamera {
        let size = (camera.width(), camera.height());
        ExpectedCamera { rig_index, size, centre_world: camera.centre_world() }
    }
}

/// The points of a question to whose answer they are needed, in its order, metres, world.
pub fn asked_world(question: &Question) -> Arc<Coordinates> {
    let mut points_world = Coordinates::default();
    if question.kind == QuestionKind::Planes {
        question.batches.iter().for_each(|batch| question.append_world(batch, &mut points_world));
    }
    Arc::new(points_world)
}

impl ExpectedAnswer {
    /// What cameras must answer to a question whose points are these.
    pub fn new(
        question: &Question,
        points_world: &Arc<Coordinates>,
        cameras: Vec<ExpectedCamera>,
    ) -> ExpectedAnswer {
        let points_world = Arc::clone(points_world);
        ExpectedAnswer { kind: question.kind, points: question.len(), cameras, points_world }
    }

    /// One of the node's cameras.
    fn camera(&self, rig_index: u16) -> Option<&ExpectedCamera> {
        self.cameras.iter().find(|camera| camera.rig_index == rig_index)
    }

    /// Refuses any other count, before memory is set aside for it.
    fn check_count(&self, count: u32, field: Field) -> Result<usize, ConvertError> {
        if count as usize != self.points {
            return Err(field.value(format!("is {count}, expected {}", self.points)));
        }
        Ok(self.points)
    }

    /// No reply to the question is longer, bytes.
    pub fn most_bytes(&self) -> usize {
        let bytes_a_point = match self.kind {
            // A bit, and a count of cameras.
            QuestionKind::Classes => 3,
            // Distance, normal, camera, pixel and the exit.
            QuestionKind::Edges => 1 + 4 + 12 + 2 + 8 + 1,
            // The same but for the exit, and which plane it is, and how far it moved.
            QuestionKind::Planes => 1 + 4 + 12 + 2 + 8 + 3 + 4,
            QuestionKind::Exits | QuestionKind::SharedExits => {
                1 + 4 + self.cameras.len() * MOST_CHANGES_A_CAMERA * CHANGE_BYTES
            }
        };
        MOST_BESIDE_BYTES.saturating_add(self.points.saturating_mul(bytes_a_point)).min(MAX_MESSAGE_BYTES)
    }
}

/// A node's reply: the answer to the question that was asked, or its refusal, and the milliseconds that it took
/// to compute.
pub fn answer_from_wire(
    reply: v1::ProbeReply,
    expected: &ExpectedAnswer,
) -> Result<(ProbeAnswer, f64), ConvertError> {
    use v1::probe_reply::Answer as Wire;
    let v1::ProbeReply { id: _, answer, compute_ms } = reply;
    let field = |name| Field("ProbeReply", name);
    let other_kind = field("answer").value("is of another kind than the question");
    let missing = ConvertError::Missing { message: "ProbeReply", field: "answer" };
    let answer = match answer.ok_or(missing)? {
        Wire::Classes(classes) => classes_from_wire(&classes, expected)?,
        Wire::Edges(edges) => edges_from_wire(&edges, expected)?,
        Wire::Planes(planes) if expected.kind == QuestionKind::Planes => planes_from_wire(&planes, expected)?,
        Wire::Planes(_) => return Err(other_kind),
        Wire::Exits(exits) => exits_from_wire(&exits, expected)?,
        Wire::Refusal(refusal) => {
            let message = clean(&refusal.message, MAX_MESSAGE_CHARS);
            let refused = ProbeAnswer::Refused(super::from_wire::reason_from_wire(&refusal), message);
            return Ok((refused, 0.0));
        }
    };
    if !answer.kind.answers(expected.kind) {
        return Err(other_kind);
    }
    let compute_ms = f64::from(compute_ms);
    if !compute_ms.is_finite() || compute_ms < 0.0 {
        return Err(field("compute_ms").value(format!("is {compute_ms}, expected milliseconds")));
    }
    Ok((ProbeAnswer::Answer(answer), compute_ms))
}
fn chosen(bytes: &[u8], count: usize, field: Field) -> Result<Vec<u32>, ConvertError> {
    let mut indices = Vec::new();
    read_choice(bytes, count, field, |run| indices.extend(run.start as u32..run.end as u32))?;
    Ok(indices)
}

/// Distances of three bytes each, or two, on a scale, metres.
fn on_scale_of(bytes: &[u8], count: usize, step_m: f32, field: Field) -> Result<Vec<f32>, ConvertError> {
    if bytes.len() == count * 2 {
        let codes = unpack(bytes, count, field, u16::from_le_bytes)?;
        return Ok(codes.into_iter().map(|code| on_scale(code.into(), step_m)).collect());
    }
    let codes = unpack(bytes, count, field, |[a, b, c]| u32::from_le_bytes([a, b, c, 0]))?;
    Ok(codes.into_iter().map(|code| on_scale(code, step_m)).collect())
}

fn check_step(step_m: f32, field: Field) -> Result<(), ConvertError> {
    if (0.0..1e3).contains(&step_m) {
        return Ok(());
    }
    Err(field.value(format!("is {step_m}, expected metres")))
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytes::Bytes;
    use proptest::prelude::*;
    use prost::Message as _;
    use v1::probe_reply::Answer as Wire;

    pub fn of(kind: QuestionKind) -> Answer {
        Answer { kind, ..Answer::default() }
    }

    /// Two cameras of the largest images there are.
    fn expected(kind: QuestionKind, points: usize) -> ExpectedAnswer {
        let size = (16_384, 16_384);
        let camera = |rig_index| ExpectedCamera { rig_index, size, centre_world: Point3::origin() };
        let mut points_world = Coordinates::default();
        (0..points).for_each(|at| points_world.push(point_at(at)));
        let cameras = vec![camera(1), camera(3)];
        ExpectedAnswer { kind, points, cameras, points_world: Arc::new(points_world) }
    }

    /// Numbers of 24 bits that do not repeat, so that nothing packs.
    pub fn noise() -> impl FnMut() -> u32 {
        let mut state = 1_u32;
        move || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            state >> 8
        }
    }

    /// Where the points of questions are.
    pub fn point_at(at: usize) -> Point3<f64> {
        Point3::new(1.0 + at as f64 * 1e-3, 0.0, -1.0)
    }

    /// As a node of those two cameras sends it.
    pub fn wire_of(answer: &Answer) -> Wire {
        answer_to_wire(9, answer, 2, Precision::Exact, 0.5).answer.expect("an answer")
    }

    pub fn there_and_back(answer: &Answer, precision: Precision) -> Answer {
        let wire = answer_to_wire(9, answer, 2, precision, 0.5);
        let (length, most) = (wire.encoded_len(), expected(answer.kind, answer.len()).most_bytes());
        assert!(length <= most, "a reply of {length} bytes, expected at most {most}");
        match answer_from_wire(wire, &expected(answer.kind, answer.len())).expect("valid") {
            (ProbeAnswer::Answer(answer), 0.5) => answer,
            other => panic!("expected the answer, found {other:?}"),
        }
    }

    /// Why an answer is none to a question about so many points.
    #[track_caller]
    pub fn refusal(answer: Wire, kind: QuestionKind, points: usize) -> String {
        let reply = v1::ProbeReply { id: 0, answer: Some(answer), compute_ms: 0.0 };
        answer_from_wire(reply, &expected(kind, points)).expect_err("a refusal").to_string()
    }

    #[test]
    fn an_answer_to_nothing_survives_the_wire_and_one_of_another_kind_is_refused() {
        let nothing = of(QuestionKind::Classes);
        assert_eq!(there_and_back(&nothing, Precision::Exact), nothing);
        let edges = wire_of(&Answer { edges: vec![None], ..of(QuestionKind::Edges) });
        let message = "ProbeReply.answer: is of another kind than the question";
        assert_eq!(refusal(edges, QuestionKind::Exits, 1), message);
    }

    proptest! {
        #[test]
        fn any_bytes_make_an_answer_or_an_error(
            count in 0u32..80, a in proptest::collection::vec(any::<u8>(), 0..40),
            b in proptest::collection::vec(any::<u8>(), 0..100), c in proptest::collection::vec(any::<u8>(), 0..40),
            kind in 0usize..4, step_m in -0.1f32..0.2,
        ) {
            let (a, b, c) = (Bytes::from(a), Bytes::from(b), Bytes::from(c));
            let answer = match kind {
                0 => Wire::Classes(v1::ClassesAnswer { count, not_outside: a, inside_counts: b, cameras: 2 }),
                1 => Wire::Edges(v1::EdgesAnswer {
                    count, present: a, distances: b.clone(), normals: b.clone(), cameras: b.clone(), pixels: b,
                    step_m, exits_within: c.clone(),
                }),
                2 => Wire::Planes(v1::PlanesAnswer {
                    count, present: a.clone(), which: c.clone(), inside: a, distances: b.clone(), moved: c,
                    normals: b.clone(), cameras: b.clone(), pixels: b, step_m,
                }),
                _ => Wire::Exits(v1::ExitsAnswer { count, present: a, outside: b.clone(), changes: b, step_m }),
            };
            let kinds = [QuestionKind::Classes, QuestionKind::Edges, QuestionKind::Planes, QuestionKind::Exits];
            let kind = kinds[kind];
            let expected = expected(kind, count as usize);
            drop(answer_from_wire(v1::ProbeReply { id: 0, answer: Some(answer), compute_ms: 0.0 }, &expected));
        }
    }
}
