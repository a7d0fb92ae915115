//! Messages to our types; nothing that arrives is trusted.

use std::sync::Arc;

use hull::camera::Pixel;
use bytes::Bytes;
use hull::question::{Answer, Batch, Change, Edge, Kind, Points, Question, Standing};
use hull::silhouette::PixelRect;
use hull::{HullRule, NormalWindow, OutOfView, Pose, ProbeSettings, Reach, Shape};

use super::bulk::{Field, unpack, unpack_bits, unpack_f32x3, unpack_f64x3, unpack_indices};
use super::{ConvertError, RefusalReason};
use crate::{MAX_POINTS, v1};

/// A node's reply to a question.
#[derive(Clone, Debug, PartialEq)]
pub enum ProbeAnswer {
    /// It answered.
    Answer(Answer),
    /// It did not, and why.
    Refused(RefusalReason, String),
}

/// A shape to register; its samples must have the digest it claims.
pub fn shape_from_wire(shape: &v1::Shape) -> Result<Shape, ConvertError> {
    let v1::Shape { digest, samples } = shape;
    let samples = unpack_f32x3(samples, Field("Shape", "samples"))?;
    let shape = Shape::new(samples).map_err(|error| Field("Shape", "samples").value(error.to_string()))?;
    if shape.digest()[..] != digest[..] {
        return Err(Field("Shape", "digest").value("is not that of the samples"));
    }
    Ok(shape)
}

/// A rectangle of pixels, not empty.
pub fn pixel_rect_from_wire(rect: &v1::PixelRect) -> Result<PixelRect, ConvertError> {
    let &v1::PixelRect { left, top, right, bottom } = rect;
    if left >= right || top >= bottom {
        let what = format!("is {left}..{right} x {top}..{bottom}, expected pixels");
        return Err(Field("CameraFrame", "admitted").value(what));
    }
    Ok(PixelRect { left, top, right, bottom })
}

/// The settings of the probes.
pub fn settings_from_wire(settings: &v1::ProbeSettings) -> Result<ProbeSettings, ConvertError> {
    let &v1::ProbeSettings { abstain, min_views, normal_window, max_depth_m } = settings;
    let out_of_view = if abstain { OutOfView::Abstain } else { OutOfView::Outside };
    let window = if normal_window == 0 { NormalWindow::Auto } else { NormalWindow::Pixels(normal_window) };
    ProbeSettings::new(HullRule { out_of_view, min_views }, window, max_depth_m)
        .map_err(|error| Field("DescribeReply", "settings").value(error.to_string()))
}

/// A question; `shape` finds registered shapes by their key.
pub fn question_from_wire(
    request: v1::ProbeRequest,
    shape: impl Fn(u64) -> Option<Arc<Shape>>,
) -> Result<Question, ConvertError> {
    use v1::probe_request::Question as Wire;
    let v1::ProbeRequest { id: _, frame: _, question } = request;
    let missing = ConvertError::Missing { message: "ProbeRequest", field: "question" };
    let (kind, batches, within, directions) = match question.ok_or(missing)? {
        Wire::Classes(v1::Classes { batches }) => (Kind::Classes, batches, Bytes::new(), Bytes::new()),
        Wire::Edges(v1::Edges { batches, within }) => (Kind::Edges, batches, within, Bytes::new()),
        Wire::Exits(v1::Exits { batches, directions, shared, within }) => {
            (if shared { Kind::SharedExits } else { Kind::Exits }, batches, within, directions)
        }
    };
    let mut question = Question { kind, ..Question::default() };
    for batch in batches {
        add_batch(&mut question, batch, &shape)?;
    }
    let found = question.len();
    if found > MAX_POINTS {
        return Err(ConvertError::TooManyPoints { found, limit: MAX_POINTS });
    }
    if !within.is_empty() {
        Field("ProbeRequest", "within").check_length(within.len(), found)?;
        question.within.extend(within.iter().map(|&code| Reach::from_code(code)));
    }
    let expected = match kind {
        Kind::Classes | Kind::Edges => 0,
        Kind::Exits => found,
        Kind::SharedExits => question.batches.len(),
    };
    question.directions = directions_from_wire(&directions, expected)?;
    Ok(question)
}

fn directions_from_wire(directions: &[u8], expected: usize) -> Result<Vec<[f32; 3]>, ConvertError> {
    let field = Field("Exits", "directions");
    field.check_length(directions.len(), expected * 12)?;
    let directions = unpack_f32x3(directions, field)?;
    let unit = |d: &[f32; 3]| (d.iter().map(|c| c * c).sum::<f32>() - 1.0).abs() < 1e-3;
    match directions.iter().find(|direction| !unit(direction)) {
        Some(long) => Err(field.value(format!("holds {long:?}, expected unit vectors"))),
        None => Ok(directions),
    }
}

fn add_batch(
    question: &mut Question,
    batch: v1::Batch,
    shape: &impl Fn(u64) -> Option<Arc<Shape>>,
) -> Result<(), ConvertError> {
    let v1::Batch { points, picked } = batch;
    let points = match points.ok_or(ConvertError::Missing { message: "Batch", field: "points" })? {
        v1::batch::Points::Body(v1::Body { shape: key, pose }) => {
            let field = Field("Body", "pose");
            let p = unpack(&pose, 7, field, f64::from_le_bytes)?;
            let pose = Pose::new([p[0], p[1], p[2]], [p[3], p[4], p[5], p[6]])
                .map_err(|error| field.value(error.to_string()))?;
            Points::Body { shape: shape(key).ok_or(ConvertError::UnknownShape(key))?, pose }
        }
        v1::batch::Points::World(points) => {
            Points::World(unpack_f64x3(&points, Field("Batch", "world"))?.into())
        }
    };
    match picked {
        None => question.batches.push(Batch::all(points)),
        Some(picked) => {
            let picked = unpack_indices(&picked, points.len(), Field("Batch", "picked"))?;
            question.pick(&points, [0.0; 3], picked.into_iter());
        }
    }
    Ok(())
}

/// A node's reply: its id, the answer, and the milliseconds it took to compute.
pub fn answer_from_wire(reply: v1::ProbeReply) -> Result<(u64, ProbeAnswer, f64), ConvertError> {
    use v1::probe_reply::Answer as Wire;
    let v1::ProbeReply { id, answer, compute_ms } = reply;
    let missing = ConvertError::Missing { message: "ProbeReply", field: "answer" };
    let answer = match answer.ok_or(missing)? {
        Wire::Classes(classes) => {
            let standings = classes_from_wire(&classes)?;
            ProbeAnswer::Answer(Answer { kind: Kind::Classes, standings, ..Answer::default() })
        }
        Wire::Edges(edges) => {
            let edges = edges_from_wire(&edges)?;
            ProbeAnswer::Answer(Answer { kind: Kind::Edges, edges, ..Answer::default() })
        }
        Wire::Exits(exits) => ProbeAnswer::Answer(exits_from_wire(&exits)?),
        Wire::Refusal(refusal) => ProbeAnswer::Refused(reason_from_wire(&refusal), refusal.message),
    };
    Ok((id, answer, compute_ms))
}

/// A reason that this version does not know is the message's fault.
fn reason_from_wire(refusal: &v1::Refusal) -> RefusalReason {
    use v1::refusal::Reason;
    match refusal.reason() {
        Reason::Gone => RefusalReason::Gone,
        Reason::NotYet => RefusalReason::NotYet,
        Reason::UnknownShape => RefusalReason::UnknownShape,
        Reason::TooManyPoints => RefusalReason::TooManyPoints,
        Reason::Busy => RefusalReason::Busy,
        Reason::Malformed | Reason::Unspecified => RefusalReason::Malformed,
    }
}

fn classes_from_wire(answer: &v1::ClassesAnswer) -> Result<Vec<Standing>, ConvertError> {
    let v1::ClassesAnswer { count, not_outside, inside_counts, cameras } = answer;
    let bits = unpack_bits(not_outside, *count as usize, Field("ClassesAnswer", "not_outside"))?;
    let all = Standing::inside(*cameras as usize);
    if inside_counts.is_empty() {
        return Ok(bits.into_iter().map(|bit| if bit { all } else { Standing::OUTSIDE }).collect());
    }
    let set = bits.iter().filter(|&&bit| bit).count();
    Field("ClassesAnswer", "inside_counts").check_length(inside_counts.len(), set)?;
    let mut counts = inside_counts.iter();
    let standing = |bit: bool| match bit.then(|| counts.next()).flatten() {
        Some(&count) => Standing::inside(usize::from(count)),
        None => Standing::OUTSIDE,
    };
    Ok(bits.into_iter().map(standing).collect())
}

fn edges_from_wire(answer: &v1::EdgesAnswer) -> Result<Vec<Option<Edge>>, ConvertError> {
    let v1::EdgesAnswer { count, present, distances, normals, cameras, pixels } = answer;
    let field = |name| Field("EdgesAnswer", name);
    let bits = unpack_bits(present, *count as usize, field("present"))?;
    let set = bits.iter().filter(|&&bit| bit).count();
    let distances = unpack(distances, set, field("distances"), f32::from_le_bytes)?;
    if let Some(distance) = distances.iter().find(|distance| !distance.is_finite()) {
        return Err(field("distances").value(format!("holds {distance}, expected finite metres")));
    }
    let normals = unpack_f32x3(normals, field("normals"))?;
    field("normals").check_length(normals.len() * 12, set * 12)?;
    let cameras = unpack(cameras, set, field("cameras"), u16::from_le_bytes)?;
    let pixels = unpack(pixels, set * 2, field("pixels"), i16::from_le_bytes)?;
    let mut next = 0;
    let edge = |bit: bool| {
        bit.then(|| {
            let at = next;
            next += 1;
            let pixel = Pixel { column: i32::from(pixels[2 * at]), row: i32::from(pixels[2 * at + 1]) };
            Edge { distance_m: distances[at], camera: cameras[at], pixel, normal_world: normals[at] }
        })
    };
    Ok(bits.into_iter().map(edge).collect())
}

/// Whether they are shared is the question's matter: the answer is taken for either kind.
fn exits_from_wire(answer: &v1::ExitsAnswer) -> Result<Answer, ConvertError> {
    let v1::ExitsAnswer { outside, changes } = answer;
    let field = Field("ExitsAnswer", "outside");
    let exits_m = unpack(outside, outside.len() / 4, field, f32::from_le_bytes)?;
    if let Some(t) = exits_m.iter().find(|t| t.is_nan() || **t < 0.0) {
        return Err(field.value(format!("holds {t}, expected metres")));
    }
    let field = Field("ExitsAnswer", "changes");
    let change = |bytes: [u8; 12]| {
        let [a, b, c, d, e, f, g, h, i, j, k, l] = bytes;
        Change {
            point: u32::from_le_bytes([a, b, c, d]),
            t_m: f32::from_le_bytes([e, f, g, h]),
            by: i32::from_le_bytes([i, j, k, l]),
        }
    };
    let changes = unpack(changes, changes.len() / 12, field, change)?;
    let lies = |change: &Change| {
        change.point as usize >= exits_m.len() || !change.t_m.is_finite() || change.by.abs() > 1
    };
    if changes.iter().any(lies) || !changes.is_sorted_by_key(|change| change.point) {
        return Err(field.value("holds a change that is none"));
    }
    Ok(Answer { kind: Kind::Exits, exits_m, changes, ..Answer::default() })
}

#[cfg(test)]
mod tests {
    use super::super::to_wire::*;
    use super::*;
    use proptest::prelude::*;

    fn shape() -> Arc<Shape> {
        let samples = (0..40).map(|at| [at as f32 * 0.01, 0.5, -0.25]).collect();
        Arc::new(Shape::new(samples).expect("finite"))
    }

    fn find(key: u64) -> Option<Arc<Shape>> {
        Some(shape()).filter(|shape| shape_key(&shape.digest()) == key)
    }

    #[test]
    fn questions_survive_the_wire() {
        let pose = Pose::new([0.1, -2.0, 3.0], [0.0, 0.6, 0.0, 0.8]).expect("unit");
        let body = Points::Body { shape: shape(), pose };
        let mut some = Question { kind: Kind::Edges, ..Question::default() };
        some.pick(&body, [0.0; 3], [0, 3, 39].into_iter());
        let mut all = Question::default();
        all.batches = vec![Batch::all(body.clone()), Batch::all(Points::World([[1.0, 2.0, 3.0]].into()))];
        let near = Question { within: vec![Reach::covering(0.02); 3], ..some.clone() };
        let each = Question {
            kind: Kind::Exits,
            directions: vec![[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]],
            ..near.clone()
        };
        let shared =
            Question { kind: Kind::SharedExits, directions: vec![[0.6, 0.8, 0.0]], ..some.clone() };
        for question in [all, some, near, each, shared] {
            let wire = question_to_wire(7, 3, &question);
            assert_eq!((wire.id, wire.frame), (7, 3));
            assert_eq!(question_from_wire(wire, find), Ok(question));
        }
    }

    #[test]
    fn answers_survive_the_wire() {
        let edge = Edge {
            distance_m: 0.25,
            camera: 3,
            pixel: Pixel { column: -1, row: 479 },
            normal_world: [0.0, 1.0, 0.0],
        };
        let inside = Standing::inside;
        let of = |kind| Answer { kind, ..Answer::default() };
        let changes = vec![Change { point: 1, t_m: 0.1, by: -1 }, Change { point: 1, t_m: 0.11, by: 1 }];
        for answer in [
            Answer { standings: vec![Standing::OUTSIDE, inside(2), Standing::OUTSIDE], ..of(Kind::Classes) },
            Answer { standings: vec![Standing::OUTSIDE, inside(2), inside(1)], ..of(Kind::Classes) },
            Answer { edges: vec![None, Some(edge), None], ..of(Kind::Edges) },
            Answer { exits_m: vec![f32::INFINITY, 0.125], changes, ..of(Kind::Exits) },
        ] {
            let wire = answer_to_wire(9, &answer, 2, 0.5);
            assert_eq!(answer_from_wire(wire), Ok((9, ProbeAnswer::Answer(answer), 0.5)));
        }
    }

    #[test]
    fn lies_are_refused_by_field() {
        let mut wrong = shape_to_wire(&shape());
        wrong.digest = vec![0; 32].into();
        let error = shape_from_wire(&wrong).expect_err("another digest");
        assert_eq!(error.to_string(), "Shape.digest: is not that of the samples");
        let body = Points::Body { shape: shape(), pose: Pose::IDENTITY };
        let question = Question { batches: vec![Batch::all(body)], ..Question::default() };
        let error = question_from_wire(question_to_wire(1, 1, &question), |_| None).expect_err("unknown");
        assert!(matches!(error, ConvertError::UnknownShape(_)));
        let nan = Points::World([[f64::NAN, 0.0, 0.0]].into());
        let nan = Question { batches: vec![Batch::all(nan)], ..Question::default() };
        let error = question_from_wire(question_to_wire(1, 1, &nan), find).expect_err("NaN");
        assert_eq!(error.to_string(), "Batch.world: holds NaN, expected finite numbers");
    }

    proptest! {
        #[test]
        fn any_bytes_make_an_answer_or_an_error(
            count in 0u32..80, a in proptest::collection::vec(any::<u8>(), 0..40),
            b in proptest::collection::vec(any::<u8>(), 0..100), kind in 0..3,
        ) {
            use v1::probe_reply::Answer as Wire;
            let (a, b) = (Bytes::from(a), Bytes::from(b));
            let answer = match kind {
                0 => Wire::Classes(v1::ClassesAnswer {
                    count, not_outside: a, inside_counts: b, cameras: 3,
                }),
                1 => Wire::Edges(v1::EdgesAnswer {
                    count, present: a, distances: b.clone(), normals: b.clone(), cameras: b.clone(), pixels: b,
                }),
                _ => Wire::Exits(v1::ExitsAnswer {
                    outside: b, changes: a,
                }),
            };
            let _ = answer_from_wire(v1::ProbeReply { id: 0, answer: Some(answer), compute_ms: 0.0 });
        }
    }
}
