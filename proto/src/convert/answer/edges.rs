//! Edges, and planes, which travel as edges do.

use hull::camera::Pixel;
use hull::question::{Answer, Edge, QuestionKind};
use hull::reach::Reach;

use super::super::ConvertError;
use super::super::bulk::{Field, pack_f32, unpack, unpack_f32x3};
use super::super::choice::{choice, push_number, take_number};
use super::super::packed::{pack, unpack_at_most};
use super::super::rounded::{Precision, UnitBits, from_octahedral, nearest_code, octahedral, step_m};
use super::{ExpectedAnswer, STEPS, check_step, chosen, on_scale_of};
use crate::v1;

/// Up to here 16 bits for each part of a normal are enough: ways of that length end a few micrometres off.
const SHORT_NORMALS_M: f32 = 0.12;

/// No point is farther below a plane, metres: bodies that fell beside the floor may be far.
const MAX_BELOW_M: f32 = 1e10;
/// No plane moves farther in a frame, metres.
const MAX_MOVED_M: f32 = 1.0;
/// Unit vectors of single precision, or rounded, differ from length 1 by less.
const UNIT_TOLERANCE: f32 = 1e-3;
/// Stands for the pixel of an edge whose pixel was not sent.
const NO_PIXEL: Pixel = Pixel { column: 0, row: 0 };

pub(super) fn edges_to_wire(answer: &Answer, precision: Precision) -> v1::EdgesAnswer {
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

pub(super) fn edges_from_wire(
    answer: &v1::EdgesAnswer,
    expected: &ExpectedAnswer,
) -> Result<Answer, ConvertError> {
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
    if !(-MAX_BELOW_M..=0.0).contains(least_m) {
        return Err(field("least_m").value(format!("is {least_m}, expected metres below a plane")));
    }
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
    let parts = EdgeParts { distances, normals, cameras, pixels, moved };
    let unchecked = if parts.fit(expected) { set.len() } else { 0 };
    for (at, index) in set.into_iter().enumerate() {
        let edge = parts.edge(at);
        if at >= unchecked {
            expected.check_edge(&edge, field)?;
        }
        edges[index as usize] = Some(edge);
    }
    let is_of_planes = expected.kind == QuestionKind::Planes;
    let kind = if is_of_planes { QuestionKind::Planes } else { QuestionKind::Edges };
    Ok(Answer { kind, edges, exits_within, ..Answer::default() })
}

/// The numbers of edges, each kind in an array.
struct EdgeParts {
    distances: Vec<f32>,
    normals: Vec<[f32; 3]>,
    /// One for each, or one for all.
    cameras: Vec<u16>,
    pixels: Vec<Pixel>,
    moved: Vec<f32>,
}

impl EdgeParts {
    #[inline]
    fn edge(&self, at: usize) -> Edge {
        Edge {
            distance_m: self.distances[at],
            camera: self.camera(at),
            pixel: self.pixels[at],
            normal_world: self.normals[at],
            moved_m: Some(self.moved[at]).filter(|&moved_m| moved_m != f32::INFINITY),
        }
    }

    /// Whether all is in order, array by array. False says nothing: each edge is to be looked at.
    fn fit(&self, expected: &ExpectedAnswer) -> bool {
        let EdgeParts { distances, normals, cameras: _, pixels: _, moved } = self;
        let least_m = if expected.kind == QuestionKind::Planes { f32::MIN } else { 0.0 };
        let is_way = |m: f32| (m.abs() <= MAX_MOVED_M) | (m == f32::INFINITY);
        // Without branches.
        distances.iter().fold(true, |all, &m| all & (m >= least_m) & (m <= f32::MAX))
            && moved.iter().fold(true, |all, &m| all & is_way(m))
            && normals.iter().fold(true, |all, normal| all & is_unit(normal))
            && self.pixels_fit(expected)
    }

    fn pixels_fit(&self, expected: &ExpectedAnswer) -> bool {
        let mut known: Option<(u16, (u32, u32))> = None;
        self.pixels.iter().enumerate().all(|(at, pixel)| {
            let camera = self.camera(at);
            if known.is_none_or(|(place, _)| place != camera) {
                known = expected.size_of(camera).map(|size| (camera, size));
            }
            known.is_some_and(|(_, size)| is_near(*pixel, size))
        })
    }

    #[inline]
    fn camera(&self, at: usize) -> u16 {
        self.cameras[if self.cameras.len() == 1 { 0 } else { at }]
    }
}

/// On the image or right beside it: under "outside" the nearest background may be the first pixel off it.
#[inline]
fn is_near(pixel: Pixel, (width, height): (u32, u32)) -> bool {
    let is_near = |at: i32, side: u32| (-1..=i64::from(side)).contains(&i64::from(at));
    is_near(pixel.column, width) && is_near(pixel.row, height)
}

/// Of length one, as exactly as unit vectors travel.
#[inline]
fn is_unit([x, y, z]: &[f32; 3]) -> bool {
    let length = (x * x + y * y + z * z).sqrt();
    (1.0 - UNIT_TOLERANCE..=1.0 + UNIT_TOLERANCE).contains(&length)
}

impl ExpectedAnswer {
    /// Width and height of one of the node's cameras, pixels.
    fn size_of(&self, camera: u16) -> Option<(u32, u32)> {
        self.cameras.iter().find(|(place, _)| *place == camera).map(|(_, size)| *size)
    }

    /// Refuses edges of cameras that the node has not, or beside their images. Those whose pixel was not sent
    /// pass.
    fn check_edge(&self, edge: &Edge, field: impl Fn(&'static str) -> Field) -> Result<(), ConvertError> {
        let Edge { camera, pixel, distance_m, normal_world, moved_m } = *edge;
        let (width, height) = self.size_of(camera).ok_or_else(|| {
            field("cameras").value(format!("holds camera {camera}, not one of the node's own"))
        })?;
        if !is_near(pixel, (width, height)) {
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
        if !is_unit(&normal_world) {
            let length = normal_world.iter().map(|n| n * n).sum::<f32>().sqrt();
            return Err(field("normals").value(format!("holds a normal of length {length}, expected 1")));
        }
        Ok(())
    }
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

#[cfg(test)]
mod tests {
    use super::super::tests::{of, refusal, there_and_back, wire_of};
    use super::*;

    fn edge(distance_m: f32, camera: u16, column: i32, row: i32) -> Option<Edge> {
        let (pixel, normal_world) = (Pixel { column, row }, [0.6, 0.0, -0.8]);
        Some(Edge { distance_m, camera, pixel, normal_world, moved_m: None })
    }

    fn moved(distance_m: f32, moved_m: f32) -> Option<Edge> {
        edge(distance_m, 3, 7, 8).map(|edge| Edge { moved_m: Some(moved_m), ..edge })
    }

    #[test]
    fn edges_and_planes_survive_the_wire() {
        for answer in [
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
        ] {
            assert_eq!(there_and_back(&answer, Precision::Exact), answer);
        }
    }

    #[test]
    fn the_fullest_reply_is_no_longer_than_its_question_allows() {
        // Nothing repeats, so nothing packs.
        let mut state = 1_u32;
        let mut noise = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            state >> 8
        };
        let side = |noise: u32| (noise % 16_384) as i32;
        let full = (0..3000).map(|_| {
            let camera = if noise() % 2 == 0 { 1 } else { 3 };
            let full = edge(noise() as f32 * 1e-8, camera, side(noise()), side(noise()))?;
            Some(Edge { moved_m: Some(noise() as f32 * 1e-8), ..full })
        });
        let answer = Answer { edges: full.collect(), ..of(QuestionKind::Planes) };
        let exits_within = answer.edges.iter().map(|_| Reach::from_code(noise() as u8)).collect();
        there_and_back(&Answer { exits_within, ..answer }, Precision::Exact);
    }

    #[test]
    fn rounded_edges_and_planes_are_near() {
        let planes = Answer { edges: vec![moved(-0.08, -0.02), moved(0.1, 0.0)], ..of(QuestionKind::Planes) };
        let back = there_and_back(&planes, Precision::Quantised);
        for (edge, back) in planes.edges.iter().flatten().zip(back.edges.iter().flatten()) {
            assert!((edge.distance_m - back.distance_m).abs() < 5e-8 && edge.moved_m == back.moved_m);
        }
        let answer =
            Answer { edges: vec![edge(0.03, 3, 7, 8), None, edge(0.4, 3, 7, 9)], ..of(QuestionKind::Edges) };
        let back = there_and_back(&answer, Precision::Quantised);
        for (edge, back) in answer.edges.iter().zip(&back.edges) {
            assert_eq!(edge.map(|edge| (edge.camera, NO_PIXEL)), back.map(|edge| (edge.camera, edge.pixel)));
            let (Some(edge), Some(back)) = (edge, back) else { continue };
            assert!((edge.distance_m - back.distance_m).abs() < 5e-8);
            let off = edge.normal_world.iter().zip(back.normal_world).map(|(a, b)| (a - b).abs());
            assert!(off.fold(0.0, f32::max) < 3e-6);
        }
    }

    #[test]
    fn an_edge_that_cannot_be_is_the_nodes_own_fault() {
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
            assert_eq!(refusal(wire_of(&answer), QuestionKind::Edges, 1), message);
        }
    }
}
