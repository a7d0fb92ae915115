//! Our types to messages.

use hull::Shape;
use hull::body::ShapeDigest;
use hull::question::{Answer, Batch, Change, Edge, Kind, Points, Question, Standing};
use hull::silhouette::PixelRect;
use hull::{NormalWindow, OutOfView, ProbeSettings};

use super::bulk::{pack_bits, pack_f32, pack_f64, pack_indices};
use super::{ConvertError, RefusalReason};
use crate::v1;

/// What a question names a registered shape by: the first eight bytes of its digest.
pub fn shape_key(digest: &ShapeDigest) -> u64 {
    let [a, b, c, d, e, f, g, h, ..] = *digest;
    u64::from_le_bytes([a, b, c, d, e, f, g, h])
}

/// A shape to register.
pub fn shape_to_wire(shape: &Shape) -> v1::Shape {
    v1::Shape {
        digest: shape.digest().to_vec().into(),
        samples: pack_f32(shape.samples_body().iter().flatten().copied()),
    }
}

/// A rectangle of pixels.
pub fn pixel_rect_to_wire(rect: PixelRect) -> v1::PixelRect {
    let PixelRect { left, top, right, bottom } = rect;
    v1::PixelRect { left, top, right, bottom }
}

/// The settings of the probes.
pub fn settings_to_wire(settings: &ProbeSettings) -> v1::ProbeSettings {
    v1::ProbeSettings {
        abstain: settings.rule().out_of_view == OutOfView::Abstain,
        min_views: settings.rule().min_views,
        normal_window: match settings.normal_window() {
            NormalWindow::Auto => 0,
            NormalWindow::Pixels(k) => k,
        },
        max_depth_m: settings.max_depth_m(),
    }
}

/// A question about a frame.
pub fn question_to_wire(id: u64, frame: u64, question: &Question) -> v1::ProbeRequest {
    use v1::probe_request::Question as Wire;
    let batches = question.batches.iter().map(|batch| batch_to_wire(question, batch)).collect();
    let within = question.within.iter().map(|reach| reach.code()).collect::<Vec<u8>>().into();
    let wire = match question.kind {
        Kind::Classes => Wire::Classes(v1::Classes { batches }),
        Kind::Edges => Wire::Edges(v1::Edges { batches, within }),
        Kind::Exits | Kind::SharedExits => Wire::Exits(v1::Exits {
            batches,
            directions: pack_f32(question.directions.iter().flatten().copied()),
            shared: question.kind == Kind::SharedExits,
            within,
        }),
    };
    v1::ProbeRequest { id, frame, question: Some(wire) }
}

fn batch_to_wire(question: &Question, batch: &Batch) -> v1::Batch {
    let offset = batch.offset_m;
    let points = match &batch.points {
        Points::Body { shape, pose } => {
            let pose = pose.moved(offset);
            v1::batch::Points::Body(v1::Body {
                shape: shape_key(&shape.digest()),
                pose: pack_f64(pose.position_m().into_iter().chain(pose.rotation_xyzw())),
            })
        }
        Points::World(points) => v1::batch::Points::World(pack_f64(
            points.iter().flat_map(|p| std::array::from_fn::<f64, 3, _>(|axis| p[axis] + offset[axis])),
        )),
    };
    let picked = batch.picked.clone().map(|range| pack_indices(&question.picked[range]));
    v1::Batch { points: Some(points), picked }
}

/// An answer of a node with `camera_count` cameras.
pub fn answer_to_wire(id: u64, answer: &Answer, camera_count: usize, compute_ms: f64) -> v1::ProbeReply {
    use v1::probe_reply::Answer as Wire;
    let answer = match answer.kind {
        Kind::Classes => Wire::Classes(classes_to_wire(&answer.standings, camera_count)),
        Kind::Edges => Wire::Edges(edges_to_wire(&answer.edges)),
        Kind::Exits | Kind::SharedExits => Wire::Exits(exits_to_wire(answer)),
    };
    v1::ProbeReply { id, answer: Some(answer), compute_ms }
}

fn classes_to_wire(standings: &[Standing], camera_count: usize) -> v1::ClassesAnswer {
    let counts = standings.iter().filter_map(|standing| standing.inside_count());
    let all = counts.clone().all(|count| count == camera_count);
    v1::ClassesAnswer {
        count: standings.len() as u32,
        not_outside: pack_bits(standings.iter().map(|&standing| standing != Standing::OUTSIDE)),
        inside_counts: if all {
            bytes::Bytes::new()
        } else {
            counts.map(|count| count as u8).collect::<Vec<u8>>().into()
        },
        cameras: camera_count as u32,
    }
}

fn edges_to_wire(edges: &[Option<Edge>]) -> v1::EdgesAnswer {
    let present = || edges.iter().flatten();
    let pixel = |edge: &Edge| [edge.pixel.column as i16, edge.pixel.row as i16];
    v1::EdgesAnswer {
        count: edges.len() as u32,
        present: pack_bits(edges.iter().map(Option::is_some)),
        distances: pack_f32(present().map(|edge| edge.distance_m)),
        normals: pack_f32(present().flat_map(|edge| edge.normal_world)),
        cameras: present().flat_map(|edge| edge.camera.to_le_bytes()).collect::<Vec<u8>>().into(),
        pixels: present().flat_map(pixel).flat_map(i16::to_le_bytes).collect::<Vec<u8>>().into(),
    }
}

fn exits_to_wire(answer: &Answer) -> v1::ExitsAnswer {
    let change = |&Change { point, t_m, by }: &Change| {
        point.to_le_bytes().into_iter().chain(t_m.to_le_bytes()).chain(by.to_le_bytes())
    };
    v1::ExitsAnswer {
        outside: pack_f32(answer.exits_m.iter().copied()),
        changes: answer.changes.iter().flat_map(change).collect::<Vec<u8>>().into(),
    }
}

/// A question that is not answered, and why.
pub fn refusal(id: u64, reason: RefusalReason, message: impl Into<String>) -> v1::ProbeReply {
    use v1::refusal::Reason;
    let reason = match reason {
        RefusalReason::Gone => Reason::Gone,
        RefusalReason::NotYet => Reason::NotYet,
        RefusalReason::UnknownShape => Reason::UnknownShape,
        RefusalReason::TooManyPoints => Reason::TooManyPoints,
        RefusalReason::Malformed => Reason::Malformed,
        RefusalReason::Busy => Reason::Busy,
    };
    let refusal = v1::Refusal { reason: reason.into(), message: message.into() };
    v1::ProbeReply { id, answer: Some(v1::probe_reply::Answer::Refusal(refusal)), compute_ms: 0.0 }
}

impl From<&ConvertError> for RefusalReason {
    fn from(error: &ConvertError) -> RefusalReason {
        match error {
            ConvertError::UnknownShape(_) => RefusalReason::UnknownShape,
            ConvertError::TooManyPoints { .. } => RefusalReason::TooManyPoints,
            ConvertError::Missing { .. } | ConvertError::Length { .. } | ConvertError::Value { .. } => {
                RefusalReason::Malformed
            }
        }
    }
}
