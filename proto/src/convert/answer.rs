//! Answers to messages and back.

use hull::camera::Pixel;
use hull::question::{Answer, Change, Edge, NO_EXIT_M, QuestionKind, Standing};
use hull::reach::Reach;

use super::bulk::{Field, pack_f32, unpack, unpack_f32x3};
use super::choice::{choice, push_number, read_choice, take_number};
use super::packed::{pack, unpack_at_most, unpack_exactly};
use super::rounded::{
    Precision, UnitBits, covering_code, from_octahedral, nearest_code, octahedral, on_scale, step_m,
};
use super::{ConvertError, RefusalReason};
use crate::text::{MAX_MESSAGE_CHARS, clean};
use crate::{MAX_MESSAGE_BYTES, v1};

/// Steps of the scale of rounded distances in three bytes, and in two.
const STEPS: u32 = 0xff_ffff;
const FEW_STEPS: u32 = 0xffff;
/// Up to here two bytes are enough for exits, in steps of at most two micrometres. With longer steps, one long exit
/// among short ones would turn mean directions by so much that responses are off by more than a tenth of a
/// millimetre.
const SHORT_M: f32 = 0.1;
/// Up to here 16 bits for each part of a normal are enough: ways of that length end a few micrometres off.
const SHORT_NORMALS_M: f32 = 0.12;

/// No plane moves farther in a frame, metres.
const MAX_MOVED_M: f32 = 1.0;
/// Unit vectors of single precision, or rounded, differ from length 1 by less.
const UNIT_TOLERANCE: f32 = 1e-3;
/// Stands for the pixel of an edge whose pixel was not sent.
const NO_PIXEL: Pixel = Pixel { column: 0, row: 0 };

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
        QuestionKind::Edges | QuestionKind::Planes => Wire::Edges(edges_to_wire(answer, precision)),
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
    /// The node's cameras: place in the rig, width and height in pixels.
    pub cameras: Vec<(u16, (u32, u32))>,
}

impl ExpectedAnswer {
    /// Refuses any other count, before memory is set aside for it.
    fn check_count(&self, count: u32, field: Field) -> Result<usize, ConvertError> {
        if count as usize != self.points {
            return Err(field.value(format!("is {count}, expected {}", self.points)));
        }
        Ok(self.points)
    }

    /// Refuses edges of cameras that the node has not, or beside their images. Those whose pixel was not sent
    /// pass.
    fn check_edge(&self, edge: &Edge, field: impl Fn(&'static str) -> Field) -> Result<(), ConvertError> {
        let Edge { camera, pixel, distance_m, normal_world, moved_m } = *edge;
        let size = self.cameras.iter().find(|(place, _)| *place == camera).map(|(_, size)| *size);
        let (width, height) = size.ok_or_else(|| {
            field("cameras").value(format!("holds camera {camera}, not one of the node's own"))
        })?;
        // Under "outside" the nearest background may be the first pixel off the image.
        let is_near = |at: i32, side: u32| (-1..=i64::from(side)).contains(&i64::from(at));
        if !is_near(pixel.column, width) || !is_near(pixel.row, height) {
            let Pixel { column, row } = pixel;
            return Err(field("pixels")
                .value(format!("holds pixel ({column}, {row}) of camera {camera}, {width} x {height}")));
        }
        if !distance_m.is_finite() || distance_m < 0.0 && self.kind != QuestionKind::Planes {
            return Err(
                field("distances").value(format!("holds a distance of {distance_m}, expected finite metres"))
            );
        }
        if let Some(moved_m) = moved_m.filter(|moved_m| !(-MAX_MOVED_M..=MAX_MOVED_M).contains(moved_m)) {
            return Err(field("moved")
                .value(format!("holds a way of {moved_m} a frame, expected at most {MAX_MOVED_M} metres")));
        }
        let length = normal_world.iter().map(|n| n * n).sum::<f32>().sqrt();
        if !(1.0 - UNIT_TOLERANCE..=1.0 + UNIT_TOLERANCE).contains(&length) {
            return Err(field("normals").value(format!("holds a normal of length {length}, expected 1")));
        }
        Ok(())
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
    let missing = ConvertError::Missing { message: "ProbeReply", field: "answer" };
    let answer = match answer.ok_or(missing)? {
        Wire::Classes(classes) => classes_from_wire(&classes, expected)?,
        Wire::Edges(edges) => edges_from_wire(&edges, expected)?,
        Wire::Exits(exits) => exits_from_wire(&exits, expected)?,
        Wire::Refusal(refusal) => {
            let message = clean(&refusal.message, MAX_MESSAGE_CHARS);
            let refused = ProbeAnswer::Refused(super::from_wire::reason_from_wire(&refusal), message);
            return Ok((refused, 0.0));
        }
    };
    if !answer.kind.answers(expected.kind) {
        return Err(field("answer").value("is of another kind than the question"));
    }
    let compute_ms = f64::from(compute_ms);
    if !compute_ms.is_finite() || compute_ms < 0.0 {
        return Err(field("compute_ms").value(format!("is {compute_ms}, expected milliseconds")));
    }
    Ok((ProbeAnswer::Answer(answer), compute_ms))
}

fn chosen(bytes: &[u8], count: usize, field: Field) -> Result<Vec<u32>, ConvertError> {
    let mut indices = Vec::new();
    read_choice(bytes, count, field, |index| indices.push(index as u32))?;
    Ok(indices)
}

fn classes_to_wire(standings: &[Standing], camera_count: usize) -> v1::ClassesAnswer {
    let counts = standings.iter().filter_map(|standing| standing.inside_count());
    let all = counts.clone().all(|count| count == camera_count);
    let counts: Vec<u8> = if all { Vec::new() } else { counts.map(|count| count as u8).collect() };
    v1::ClassesAnswer {
        count: standings.len() as u32,
        not_outside: choice(standings, |&standing| standing != Standing::OUTSIDE),
        inside_counts: pack(&counts),
        cameras: camera_count as u32,
    }
}

fn classes_from_wire(answer: &v1::ClassesAnswer, expected: &ExpectedAnswer) -> Result<Answer, ConvertError> {
    let v1::ClassesAnswer { count, not_outside, inside_counts, cameras } = answer;
    let field = |name| Field("ClassesAnswer", name);
    let count = expected.check_count(*count, field("count"))?;
    let most = expected.cameras.len();
    if *cameras as usize != most {
        return Err(field("cameras").value(format!("is {cameras}, expected {most}")));
    }
    let mut standings = vec![Standing::OUTSIDE; count];
    if inside_counts.is_empty() {
        let all = Standing::inside(*cameras as usize);
        read_choice(not_outside, count, field("not_outside"), |index| standings[index] = all)?;
    } else {
        let set = chosen(not_outside, count, field("not_outside"))?;
        let counts = unpack_exactly(inside_counts, set.len(), field("inside_counts"))?;
        if let Some(count) = counts.iter().find(|count| usize::from(**count) > most) {
            return Err(field("inside_counts").value(format!("holds {count}, expected at most {most}")));
        }
        for (index, count) in set.into_iter().zip(counts) {
            standings[index as usize] = Standing::inside(usize::from(count));
        }
    }
    Ok(Answer { kind: QuestionKind::Classes, standings, ..Answer::default() })
}

fn edges_to_wire(answer: &Answer, precision: Precision) -> v1::EdgesAnswer {
    let Answer { edges, exits_within, .. } = answer;
    let present = || edges.iter().flatten();
    let all_same = present().zip(present().skip(1)).all(|(a, b)| a.camera == b.camera);
    let mut cameras = Vec::new();
    let sent = present().take(if all_same { 1 } else { edges.len() });
    sent.for_each(|edge| cameras.extend_from_slice(&edge.camera.to_le_bytes()));
    let (mut pixels, mut before) = (Vec::new(), NO_PIXEL);
    // Where numbers are rounded nobody asks for the pixel.
    for Edge { pixel, .. } in present().filter(|_| precision == Precision::Exact) {
        for difference in [pixel.column - before.column, pixel.row - before.row] {
            push_number(&mut pixels, (difference << 1 ^ difference >> 31).cast_unsigned() as usize);
        }
        before = *pixel;
    }
    let of_present = edges.iter().zip(exits_within).filter(|(edge, _)| edge.is_some());
    let mut exits_within: Vec<u8> = of_present.map(|(_, &within)| within.code()).collect();
    if precision == Precision::Quantised {
        // A byte an edge would cost more than the rounds it spares are worth.
        exits_within.clear();
    }
    let mut wire = v1::EdgesAnswer {
        count: edges.len() as u32,
        present: choice(edges, Option::is_some),
        distances: bytes::Bytes::new(),
        normals: bytes::Bytes::new(),
        cameras: pack(&cameras),
        pixels: pack(&pixels),
        step_m: 0.0,
        exits_within: pack(&exits_within),
        least_m: 0.0,
        moved: bytes::Bytes::new(),
    };
    if present().any(|edge| edge.moved_m.is_some()) {
        wire.moved = pack_f32(present().map(|edge| edge.moved_m.unwrap_or(f32::INFINITY)));
    }
    if precision == Precision::Exact {
        wire.distances = pack_f32(present().map(|edge| edge.distance_m));
        wire.normals = pack_f32(present().flat_map(|edge| edge.normal_world));
        return wire;
    }
    let longest_m = present().map(|edge| edge.distance_m).fold(0.0, f32::max);
    let least_m = present().map(|edge| edge.distance_m).fold(0.0, f32::min);
    let step_m = step_m(longest_m - least_m, STEPS);
    let code =
        |edge: &Edge| nearest_code(edge.distance_m - least_m, step_m).to_le_bytes().into_iter().take(3);
    (wire.step_m, wire.least_m) = (step_m, least_m);
    wire.distances = present().flat_map(code).collect::<Vec<u8>>().into();
    let bits = if longest_m <= SHORT_NORMALS_M { UnitBits::Sixteen } else { UnitBits::Twenty };
    wire.normals = octahedral(present().map(|edge| edge.normal_world), bits);
    wire
}

fn edges_from_wire(answer: &v1::EdgesAnswer, expected: &ExpectedAnswer) -> Result<Answer, ConvertError> {
    let v1::EdgesAnswer {
        count,
        present,
        distances,
        normals,
        cameras,
        pixels,
        step_m,
        exits_within,
        least_m,
        moved,
    } = answer;
    let field = |name| Field("EdgesAnswer", name);
    let mut edges = vec![None; expected.check_count(*count, field("count"))?];
    let set = chosen(present, edges.len(), field("present"))?;
    check_step(*step_m, field("step_m"))?;
    check_step(-*least_m, field("least_m"))?;
    let rounded = *step_m > 0.0;
    let distances = if rounded {
        let mut above = on_scale_of(distances, set.len(), *step_m, field("distances"))?;
        above.iter_mut().for_each(|distance_m| *distance_m += least_m);
        above
    } else {
        unpack(distances, set.len(), field("distances"), f32::from_le_bytes)?
    };
    let normals = if rounded {
        from_octahedral(normals, set.len(), field("normals"))?
    } else {
        field("normals").check_length(normals.len(), set.len() * 12)?;
        unpack_f32x3(normals, field("normals"))?
    };
    let cameras = unpack_at_most(cameras, set.len() * 2, field("cameras"))?;
    let cameras = unpack(&cameras, cameras.len() / 2, field("cameras"), u16::from_le_bytes)?;
    if cameras.len() != set.len() && (cameras.len() != 1 || set.is_empty()) {
        return Err(field("cameras").value(format!(
            "holds {}, expected one or {}",
            cameras.len(),
            set.len()
        )));
    }
    let pixels = if rounded && pixels.is_empty() {
        vec![NO_PIXEL; set.len()]
    } else {
        pixels_from_wire(pixels, set.len(), field("pixels"))?
    };
    let moved = if moved.is_empty() {
        vec![f32::INFINITY; set.len()]
    } else {
        unpack(moved, set.len(), field("moved"), f32::from_le_bytes)?
    };
    let codes = unpack_at_most(exits_within, set.len(), field("exits_within"))?;
    let mut exits_within = Vec::new();
    if !codes.is_empty() {
        field("exits_within").check_length(codes.len(), set.len())?;
        exits_within.resize(edges.len(), Reach::UNBOUNDED);
        let places = set.iter().map(|&index| index as usize);
        places.zip(codes).for_each(|(index, code)| exits_within[index] = Reach::from_code(code));
    }
    for (at, index) in set.into_iter().enumerate() {
        let edge = Edge {
            distance_m: distances[at],
            camera: cameras[if cameras.len() == 1 { 0 } else { at }],
            pixel: pixels[at],
            normal_world: normals[at],
            moved_m: Some(moved[at]).filter(|&moved_m| moved_m != f32::INFINITY),
        };
        expected.check_edge(&edge, field)?;
        edges[index as usize] = Some(edge);
    }
    let is_of_planes = expected.kind == QuestionKind::Planes;
    let kind = if is_of_planes { QuestionKind::Planes } else { QuestionKind::Edges };
    Ok(Answer { kind, edges, exits_within, ..Answer::default() })
}

fn pixels_from_wire(bytes: &[u8], count: usize, field: Field) -> Result<Vec<Pixel>, ConvertError> {
    // A difference of two pixels within 16 bits has at most three bytes.
    let bytes = unpack_at_most(bytes, count * 6, field)?;
    let mut rest = &bytes[..];
    let mut next = |before: i32| {
        let code = take_number(&mut rest, field)? as u32;
        let place = i64::from(before) + i64::from((code >> 1).cast_signed() ^ -(code & 1).cast_signed());
        i16::try_from(place).map(i32::from).map_err(|_| field.value(format!("holds pixel {place}")))
    };
    let (mut pixels, mut pixel) = (Vec::with_capacity(count), NO_PIXEL);
    for _ in 0..count {
        pixel = Pixel { column: next(pixel.column)?, row: next(pixel.row)? };
        pixels.push(pixel);
    }
    field.check_length(bytes.len(), bytes.len() - rest.len())?;
    Ok(pixels)
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

fn exits_to_wire(answer: &Answer, precision: Precision) -> v1::ExitsAnswer {
    let change = |&Change { point, t_m, by }: &Change| {
        point.to_le_bytes().into_iter().chain(t_m.to_le_bytes()).chain(by.to_le_bytes())
    };
    let changes: Vec<u8> = answer.changes.iter().flat_map(change).collect();
    let present = || answer.exits_m.iter().copied().filter(|&exit_m| exit_m != NO_EXIT_M);
    let mut wire = v1::ExitsAnswer {
        count: answer.exits_m.len() as u32,
        present: choice(&answer.exits_m, |&exit_m| exit_m != NO_EXIT_M),
        outside: bytes::Bytes::new(),
        changes: pack(&changes),
        step_m: 0.0,
    };
    if precision == Precision::Exact {
        wire.outside = pack_f32(present());
        return wire;
    }
    let longest_m = present().fold(0.0, f32::max);
    let (steps, width) = if longest_m <= SHORT_M { (FEW_STEPS, 2) } else { (STEPS, 3) };
    wire.step_m = step_m(longest_m, steps);
    let code = |exit_m| covering_code(exit_m, wire.step_m).to_le_bytes().into_iter().take(width);
    wire.outside = present().flat_map(code).collect::<Vec<u8>>().into();
    wire
}

/// Whether they are shared is the question's matter: the answer is taken for either kind.
fn exits_from_wire(answer: &v1::ExitsAnswer, expected: &ExpectedAnswer) -> Result<Answer, ConvertError> {
    let v1::ExitsAnswer { count, present, outside, changes, step_m } = answer;
    let field = |name| Field("ExitsAnswer", name);
    let mut exits_m = vec![NO_EXIT_M; expected.check_count(*count, field("count"))?];
    let set = chosen(present, exits_m.len(), field("present"))?;
    check_step(*step_m, field("step_m"))?;
    let found = if *step_m > 0.0 {
        on_scale_of(outside, set.len(), *step_m, field("outside"))?
    } else {
        unpack(outside, set.len(), field("outside"), f32::from_le_bytes)?
    };
    if let Some(t) = found.iter().find(|t| !t.is_finite() || **t < 0.0) {
        return Err(field("outside").value(format!("holds {t}, expected metres")));
    }
    set.into_iter().zip(found).for_each(|(index, exit_m)| exits_m[index as usize] = exit_m);
    let cameras = expected.cameras.len();
    let changes = changes_from_wire(changes, exits_m.len(), cameras, field("changes"))?;
    Ok(Answer { kind: QuestionKind::Exits, exits_m, changes, ..Answer::default() })
}

fn changes_from_wire(
    bytes: &[u8],
    count: usize,
    cameras: usize,
    field: Field,
) -> Result<Vec<Change>, ConvertError> {
    /// A ray crosses the borders of an image, or of what is ignored in it, a few times a camera: a fence of
    /// fifty bars takes a hundred.
    const MOST_A_RAY: usize = 128;
    const CHANGE_BYTES: usize = 12;
    // What a message could hold unpacked is enough for whatever was asked.
    let most = count.saturating_mul(cameras * MOST_A_RAY * CHANGE_BYTES).min(MAX_MESSAGE_BYTES);
    let bytes = unpack_at_most(bytes, most, field)?;
    let change = |bytes: [u8; 12]| {
        let [a, b, c, d, e, f, g, h, i, j, k, l] = bytes;
        Change {
            point: u32::from_le_bytes([a, b, c, d]),
            t_m: f32::from_le_bytes([e, f, g, h]),
            by: i32::from_le_bytes([i, j, k, l]),
        }
    };
    let changes = unpack(&bytes, bytes.len() / 12, field, change)?;
    let lies = |change: &Change| {
        change.point as usize >= count
            || !(0.0..f32::INFINITY).contains(&change.t_m)
            || change.by.unsigned_abs() > 1
    };
    let follows = |a: &Change, b: &Change| (a.point, a.t_m) <= (b.point, b.t_m);
    if changes.iter().any(lies) || !changes.is_sorted_by(follows) {
        return Err(field.value("holds a change that cannot be"));
    }
    Ok(changes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytes::Bytes;
    use proptest::prelude::*;

    fn of(kind: QuestionKind) -> Answer {
        Answer { kind, ..Answer::default() }
    }

    /// Two cameras of the largest images there are.
    fn expected(kind: QuestionKind, points: usize) -> ExpectedAnswer {
        let size = (16_384, 16_384);
        ExpectedAnswer { kind, points, cameras: vec![(1, size), (3, size)] }
    }

    fn there_and_back(answer: &Answer, precision: Precision) -> Answer {
        let wire = answer_to_wire(9, answer, 2, precision, 0.5);
        match answer_from_wire(wire, &expected(answer.kind, answer.len())).expect("valid") {
            (ProbeAnswer::Answer(answer), 0.5) => answer,
            other => panic!("expected the answer, found {other:?}"),
        }
    }

    fn edge(distance_m: f32, camera: u16, column: i32, row: i32) -> Option<Edge> {
        let (pixel, normal_world) = (Pixel { column, row }, [0.6, 0.0, -0.8]);
        Some(Edge { distance_m, camera, pixel, normal_world, moved_m: None })
    }

    fn moved(distance_m: f32, moved_m: f32) -> Option<Edge> {
        edge(distance_m, 3, 7, 8).map(|edge| Edge { moved_m: Some(moved_m), ..edge })
    }

    #[test]
    fn answers_survive_the_wire() {
        let inside = Standing::inside;
        let changes = vec![Change { point: 1, t_m: 0.1, by: -1 }, Change { point: 1, t_m: 0.11, by: 1 }];
        for answer in [
            Answer {
                standings: vec![Standing::OUTSIDE, inside(2), Standing::OUTSIDE],
                ..of(QuestionKind::Classes)
            },
            Answer { standings: vec![Standing::OUTSIDE, inside(2), inside(1)], ..of(QuestionKind::Classes) },
            Answer { edges: vec![None, edge(0.25, 3, -1, 479), None], ..of(QuestionKind::Edges) },
            Answer {
                edges: vec![edge(0.1, 3, 0, -1), None, edge(0.3, 1, 16_384, 9), edge(0.2, 3, -1, 16_384)],
                ..of(QuestionKind::Edges)
            },
            Answer {
                edges: vec![None, edge(0.1, 3, 0, -1), edge(0.2, 3, 1, 1)],
                exits_within: vec![Reach::UNBOUNDED, Reach::from_code(7), Reach::UNBOUNDED],
                ..of(QuestionKind::Edges)
            },
            Answer { edges: vec![None], ..of(QuestionKind::Edges) },
            Answer { edges: vec![moved(-0.05, 0.01), None, edge(0.3, 1, 4, 9)], ..of(QuestionKind::Planes) },
            Answer { exits_m: vec![NO_EXIT_M, 0.125], changes, ..of(QuestionKind::Exits) },
            of(QuestionKind::Classes),
        ] {
            assert_eq!(there_and_back(&answer, Precision::Exact), answer);
        }
    }

    #[test]
    fn rounded_answers_are_near_and_exits_never_too_short() {
        for exits_m in [vec![0.031, NO_EXIT_M, 0.4], vec![NO_EXIT_M, 0.129, 0.0, 0.0101]] {
            let answer = Answer { exits_m, ..of(QuestionKind::Exits) };
            let back = there_and_back(&answer, Precision::Quantised);
            for (&exit_m, &back_m) in answer.exits_m.iter().zip(&back.exits_m) {
                assert!(back_m >= exit_m && (exit_m == NO_EXIT_M || back_m - exit_m < 2.1e-6), "{back_m}");
            }
        }
        let answer =
            Answer { edges: vec![edge(0.03, 3, 7, 8), None, edge(0.4, 3, 7, 9)], ..of(QuestionKind::Edges) };
        let planes = Answer { edges: vec![moved(-0.08, -0.02), moved(0.1, 0.0)], ..of(QuestionKind::Planes) };
        let back = there_and_back(&planes, Precision::Quantised);
        for (edge, back) in planes.edges.iter().flatten().zip(back.edges.iter().flatten()) {
            assert!((edge.distance_m - back.distance_m).abs() < 5e-8 && edge.moved_m == back.moved_m);
        }
        let back = there_and_back(&answer, Precision::Quantised);
        for (edge, back) in answer.edges.iter().zip(&back.edges) {
            assert_eq!(edge.map(|edge| (edge.camera, NO_PIXEL)), back.map(|edge| (edge.camera, edge.pixel)));
            let (Some(edge), Some(back)) = (edge, back) else { continue };
            assert!((edge.distance_m - back.distance_m).abs() < 5e-8);
            let off = edge.normal_world.iter().zip(back.normal_world).map(|(a, b)| (a - b).abs());
            assert!(off.fold(0.0, f32::max) < 3e-6);
        }
    }

    #[track_caller]
    fn refused(answer: v1::probe_reply::Answer, kind: QuestionKind, points: usize, message: &str) {
        let reply = v1::ProbeReply { id: 0, answer: Some(answer), compute_ms: 0.0 };
        let error = answer_from_wire(reply, &expected(kind, points)).expect_err(message);
        assert_eq!(error.to_string(), message);
    }

    #[test]
    fn a_claimed_count_sets_no_memory_aside() {
        use v1::probe_reply::Answer as Wire;
        let lie = v1::ClassesAnswer { count: u32::MAX, cameras: 2, ..v1::ClassesAnswer::default() };
        refused(
            Wire::Classes(lie),
            QuestionKind::Classes,
            7,
            "ClassesAnswer.count: is 4294967295, expected 7",
        );
        let bomb: Vec<u8> = [1].into_iter().chain(lz4_flex::block::compress(&vec![0; 64 << 20])).collect();
        let lie = v1::ExitsAnswer {
            count: 7,
            changes: bomb.into(),
            present: choice(&[false; 7], |_| false),
            ..v1::ExitsAnswer::default()
        };
        let reply = v1::ProbeReply { id: 0, answer: Some(Wire::Exits(lie)), compute_ms: 0.0 };
        let error =
            answer_from_wire(reply, &expected(QuestionKind::Exits, 7)).expect_err("a bomb").to_string();
        assert!(error.starts_with("ExitsAnswer.changes: does not decompress"), "{error}");
    }

    #[test]
    fn an_edge_that_cannot_be_is_the_nodes_own_fault() {
        use v1::probe_reply::Answer as Wire;
        type Lie = fn(&mut Edge);
        let lies: [(Lie, &str); 7] = [
            (|edge| edge.camera = 2, "EdgesAnswer.cameras: holds camera 2, not one of the node's own"),
            (
                |edge| edge.normal_world = [2.0, 0.0, 0.0],
                "EdgesAnswer.normals: holds a normal of length 2, expected 1",
            ),
            (
                |edge| edge.normal_world = [0.0; 3],
                "EdgesAnswer.normals: holds a normal of length 0, expected 1",
            ),
            (
                |edge| edge.moved_m = Some(f32::NAN),
                "EdgesAnswer.moved: holds a way of NaN a frame, expected at most 1 metres",
            ),
            (
                |edge| edge.normal_world[1] = f32::NAN,
                "EdgesAnswer.normals: holds NaN, expected finite numbers",
            ),
            (
                |edge| edge.distance_m = -1.0,
                "EdgesAnswer.distances: holds a distance of -1, expected finite metres",
            ),
            (
                |edge| edge.pixel.row = 16_385,
                "EdgesAnswer.pixels: holds pixel (5, 16385) of camera 3, 16384 x 16384",
            ),
        ];
        for (lie, message) in lies {
            let mut edge = edge(0.1, 3, 5, 7).expect("an edge");
            lie(&mut edge);
            let answer = Answer { edges: vec![Some(edge)], ..of(QuestionKind::Edges) };
            let wire = answer_to_wire(9, &answer, 2, Precision::Exact, 0.5).answer.expect("an answer");
            refused(wire, QuestionKind::Edges, 1, message);
        }
        let answer = Answer { edges: vec![None], ..of(QuestionKind::Edges) };
        let wire = answer_to_wire(9, &answer, 2, Precision::Exact, 0.5).answer.expect("an answer");
        refused(
            wire.clone(),
            QuestionKind::Exits,
            1,
            "ProbeReply.answer: is of another kind than the question",
        );
        let change = |point, t_m, by| Change { point, t_m, by };
        for changes in [
            vec![change(0, 0.1, i32::MIN)],
            vec![change(0, 0.1, 2)],
            vec![change(0, -0.1, 1)],
            vec![change(0, f32::NAN, 1)],
            vec![change(1, 0.1, 1)],
            vec![change(0, 0.2, 1), change(0, 0.1, -1)],
        ] {
            let answer = Answer { exits_m: vec![0.5], changes, ..of(QuestionKind::Exits) };
            let wire = answer_to_wire(9, &answer, 2, Precision::Exact, 0.5).answer.expect("an answer");
            refused(wire, QuestionKind::Exits, 1, "ExitsAnswer.changes: holds a change that cannot be");
        }
        let counts = v1::ClassesAnswer {
            count: 1,
            cameras: 2,
            not_outside: choice(&[true], |&set| set),
            inside_counts: pack(&[3]),
        };
        let message = "ClassesAnswer.inside_counts: holds 3, expected at most 2";
        refused(Wire::Classes(counts), QuestionKind::Classes, 1, message);
    }

    proptest! {
        #[test]
        fn any_bytes_make_an_answer_or_an_error(
            count in 0u32..80, a in proptest::collection::vec(any::<u8>(), 0..40),
            b in proptest::collection::vec(any::<u8>(), 0..100), c in proptest::collection::vec(any::<u8>(), 0..40),
            kind in 0usize..3, step_m in -0.1f32..0.2,
        ) {
            use v1::probe_reply::Answer as Wire;
            let (a, b, c) = (Bytes::from(a), Bytes::from(b), Bytes::from(c));
            let answer = match kind {
                0 => Wire::Classes(v1::ClassesAnswer { count, not_outside: a, inside_counts: b, cameras: 2 }),
                1 => Wire::Edges(v1::EdgesAnswer {
                    count, present: a, distances: b.clone(), normals: b.clone(), cameras: b.clone(), pixels: b,
                    step_m, exits_within: c.clone(), least_m: -step_m, moved: c,
                }),
                _ => Wire::Exits(v1::ExitsAnswer { count, present: a, outside: b.clone(), changes: b, step_m }),
            };
            let kind = [QuestionKind::Classes, QuestionKind::Planes, QuestionKind::Exits][kind];
            let expected = expected(kind, count as usize);
            drop(answer_from_wire(v1::ProbeReply { id: 0, answer: Some(answer), compute_ms: 0.0 }, &expected));
        }
    }
}
