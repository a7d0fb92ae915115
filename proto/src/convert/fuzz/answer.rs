//! Answers of nodes.

use std::sync::Arc;

use hull::coordinates::Coordinates;
use hull::question::QuestionKind;
use nalgebra::Point3;
use prost::Message;

use super::super::{
    ExpectedAnswer, ExpectedCamera, Precision, ProbeAnswer, answer_from_wire, answer_to_wire,
};
use crate::v1;

/// A reply, after what was asked (a byte) and of how many points (two bytes): one that is accepted is of that kind and has an
/// answer a point, and written again it is the same.
pub fn answer(bytes: &[u8]) {
    let Some((&[kind, a, b], message)) = bytes.split_first_chunk() else { return };
    let Ok(reply) = v1::ProbeReply::decode(message) else { return };
    let kind = [
        QuestionKind::Classes,
        QuestionKind::Edges,
        QuestionKind::Planes,
        QuestionKind::Exits,
        QuestionKind::SharedExits,
    ][usize::from(kind % 5)];
    let points = usize::from(u16::from_le_bytes([a, b]));
    let cameras = [(0, (64, 48)), (1, (64, 48)), (7, (16_384, 16_384))];
    let camera = |(rig_index, size)| ExpectedCamera { rig_index, size, centre_world: Point3::origin() };
    let mut points_world = Coordinates::default();
    (0..points).for_each(|at| points_world.push(Point3::new(at as f64, 1.0, -1.0)));
    let cameras = cameras.map(camera).into();
    let expected = ExpectedAnswer { kind, points, cameras, points_world: Arc::new(points_world) };
    let Ok((ProbeAnswer::Answer(answer), compute_ms)) = answer_from_wire(reply, &expected) else { return };
    assert_eq!(answer.len(), points, "an answer a point");
    assert!(answer.kind.answers(kind));
    let reply = answer_to_wire(0, &answer, expected.cameras.len(), Precision::Exact, compute_ms);
    let again = answer_from_wire(reply, &expected);
    assert_eq!(again, Ok((ProbeAnswer::Answer(answer), compute_ms)), "what was written again");
}
