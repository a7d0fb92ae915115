//! The nearest edges of points.

use bytes::Bytes;
use hull::camera::Pixel;
use hull::question::{Answer, Edge, QuestionKind};
use hull::reach::Reach;

use super::super::ConvertError;
use super::super::bulk::{Field, pack_f32, unpack, unpack_f32x3};
use super::super::choice::{choice, push_number, take_number};
use super::super::packed::{pack, unpack_at_most};
use super::super::rounded::{Precision, UnitBits, from_octahedral, nearest_code, octahedral, step_m};
use super::{ExpectedAnswer, ExpectedCamera, STEPS, check_step, chosen, on_scale_of};
use crate::v1;

/// Up to here 16 bits for each part of a normal are enough: ways of that length end a few micrometres off.
const SHORT_NORMALS_M: f32 = 0.12;

/// Unit vectors of single precision, or rounded, differ from length 1 by less.
const UNIT_TOLERANCE: f32 = 1e-3;
/// Stands for the pixel of an edge whose pixel was not sent.
pub(super) const NO_PIXEL: Pixel = Pixel { column: 0, row: 0 };

pub(super) fn edges_to_wire(answer: &Answer, precision: Precision) -> v1::EdgesAnswer {
    let Answer { edges, exits_within, .. } = answer;
    let present = || edges.iter().flatten();
    let of_present = edges.iter().zip(exits_within).filter(|(edge, _)| edge.is_some());
    let mut exits_within: Vec<u8> = of_present.map(|(_, &within)| within.code()).collect();
    if precision == Precision::Quantised {
        // A byte an edge would cost more than the rounds it spares are worth.
        exits_within.clear();
    }
    let mut wire = v1::EdgesAnswer {
        count: edges.len() as u32,
        present: choice(edges, Option::is_some),
        distances: Bytes::new(),
        normals: Bytes::new(),
        cameras: cameras_to_wire(present()),
        pixels: pixels_to_wire(present(), precision),
        step_m: 0.0,
        exits_within: pack(&exits_within),
    };
    if precision == Precision::Exact {
        wire.distances = pack_f32(present().map(|edge| edge.distance_m));
        wire.normals = pack_f32(present().flat_map(|edge| edge.normal_world));
        return wire;
    }
    let longest_m = present().map(|edge| edge.distance_m).fold(0.0, f32::max);
    wire.step_m = step_m(longest_m, STEPS);
    wire.distances = to_scale(present().map(|edge| edge.distance_m), wire.step_m);
    let bits = if longest_m <= SHORT_NORMALS_M { UnitBits::Sixteen } else { UnitBits::Twenty };
    wire.normals = octahedral(present().map(|edge| edge.normal_world), bits);
    wire
}

/// The cameras of edges: one, if it is always the same.
pub(super) fn cameras_to_wire<'a>(edges: impl Iterator<Item = &'a Edge> + Clone) -> Bytes {
    let all_same = edges.clone().zip(edges.clone().skip(1)).all(|(a, b)| a.camera == b.camera);
    let sent = edges.take(if all_same { 1 } else { usize::MAX });
    pack(&sent.flat_map(|edge| edge.camera.to_le_bytes()).collect::<Vec<u8>>())
}

/// The pixels of edges as differences. Where numbers are rounded pixels are not used.
pub(super) fn pixels_to_wire<'a>(edges: impl Iterator<Item = &'a Edge>, precision: Precision) -> Bytes {
    let (mut pixels, mut before) = (Vec::new(), NO_PIXEL);
    if precision == Precision::Quantised {
        return Bytes::new();
    }
    for Edge { pixel, .. } in edges {
        for difference in [pixel.column - before.column, pixel.row - before.row] {
            push_number(&mut pixels, (difference << 1 ^ difference >> 31).cast_unsigned() as usize);
        }
        before = *pixel;
    }
    pack(&pixels)
}

/// Distances as three bytes each.
pub(super) fn to_scale(distances_m: impl Iterator<Item = f32>, step_m: f32) -> Bytes {
    let code = |distance_m| nearest_code(distance_m, step_m).to_le_bytes().into_iter().take(3);
    distances_m.flat_map(code).collect::<Vec<u8>>().into()
}

pub(super) fn edges_from_wire(
    answer: &v1::EdgesAnswer,
    expected: &ExpectedAnswer,
) -> Result<Answer, ConvertError> {
    let v1::EdgesAnswer { count, present, distances, normals, cameras, pixels, step_m, exits_within } =
        answer;
    let field = |name| Field("EdgesAnswer", name);
    let mut edges = vec![None; expected.check_count(*count, field("count"))?];
    let set = chosen(present, edges.len(), field("present"))?;
    check_step(*step_m, field("step_m"))?;
    let (is_rounded, count) = (*step_m > 0.0, set.len());
    let seen = SeenEdges::from_wire((cameras, pixels, normals), count, is_rounded, expected, field)?;
    let distances = distances_from_wire(distances, count, *step_m, field("distances"))?;
    let codes = unpack_at_most(exits_within, count, field("exits_within"))?;
    let mut exits_within = Vec::new();
    if !codes.is_empty() {
        field("exits_within").check_length(codes.len(), count)?;
        exits_within.resize(edges.len(), Reach::UNBOUNDED);
        let places = set.iter().map(|&index| index as usize);
        places.zip(codes).for_each(|(index, code)| exits_within[index] = Reach::from_code(code));
    }
    for (at, (index, distance_m)) in set.into_iter().zip(distances).enumerate() {
        edges[index as usize] = Some(Edge { distance_m, ..seen.edge(at) });
    }
    Ok(Answer { kind: QuestionKind::Edges, edges, exits_within, ..Answer::default() })
}

/// Finite distances that are no less than zero, metres; rounded if there is a step.
pub(super) fn distances_from_wire(
    bytes: &[u8],
    count: usize,
    step_m: f32,
    field: Field,
) -> Result<Vec<f32>, ConvertError> {
    let distances = if step_m > 0.0 {
        on_scale_of(bytes, count, step_m, field)?
    } else {
        unpack(bytes, count, field, f32::from_le_bytes)?
    };
    let is_distance = |m: f32| m.is_sign_positive() & (m <= f32::MAX);
    // All at once, without branches; which one it is matters only if there is one.
    if distances.iter().fold(true, |all, &m| all & is_distance(m)) {
        return Ok(distances);
    }
    let wrong = distances.into_iter().find(|&m| !is_distance(m)).unwrap_or_default();
    Err(field.value(format!("holds a distance of {wrong}, expected finite metres")))
}

/// Where cameras saw edges, or planes, and their normals: checked, each in an array.
pub(super) struct SeenEdges {
    normals: Vec<[f32; 3]>,
    /// One for each, or one for all.
    cameras: Vec<u16>,
    pixels: Vec<Pixel>,
}

impl SeenEdges {
    /// So many of cameras, pixels and normals.
    pub fn from_wire(
        (cameras, pixels, normals): (&[u8], &[u8], &[u8]),
        count: usize,
        is_rounded: bool,
        expected: &ExpectedAnswer,
        field: impl Fn(&'static str) -> Field,
    ) -> Result<SeenEdges, ConvertError> {
        let normals = if is_rounded {
            from_octahedral(normals, count, field("normals"))?
        } else {
            field("normals").check_length(normals.len(), count * 12)?;
            unpack_f32x3(normals, field("normals"))?
        };
        let cameras = unpack_at_most(cameras, count * 2, field("cameras"))?;
        let cameras = unpack(&cameras, cameras.len() / 2, field("cameras"), u16::from_le_bytes)?;
        if cameras.len() != count && (cameras.len() != 1 || count == 0) {
            let found = cameras.len();
            return Err(field("cameras").value(format!("holds {found}, expected one or {count}")));
        }
        let pixels = if is_rounded && pixels.is_empty() {
            vec![NO_PIXEL; count]
        } else {
            pixels_from_wire(pixels, count, field("pixels"))?
        };
        let seen = SeenEdges { normals, cameras, pixels };
        seen.check(expected, field)?;
        Ok(seen)
    }

    /// One of them, at no distance.
    #[inline]
    pub fn edge(&self, at: usize) -> Edge {
        let (camera, pixel, normal_world) = (self.camera(at), self.pixels[at], self.normals[at]);
        Edge { distance_m: 0.0, camera, pixel, normal_world, moved_m: None }
    }

    #[inline]
    pub fn camera(&self, at: usize) -> u16 {
        self.cameras[if self.cameras.len() == 1 { 0 } else { at }]
    }

    /// Refuses edges of cameras that the node has not, or beside their images, and normals that are none. Pixels that were
    /// not sent pass.
    fn check(
        &self,
        expected: &ExpectedAnswer,
        field: impl Fn(&'static str) -> Field,
    ) -> Result<(), ConvertError> {
        let mut known: Option<&ExpectedCamera> = None;
        for (at, pixel) in self.pixels.iter().enumerate() {
            let camera = self.camera(at);
            if known.is_none_or(|known| known.rig_index != camera) {
                known = expected.camera(camera);
            }
            let Some(&ExpectedCamera { size: (width, height), .. }) = known else {
                return Err(
                    field("cameras").value(format!("holds camera {camera}, not one of the node's own"))
                );
            };
            if !is_near(*pixel, (width, height)) {
                let Pixel { column, row } = pixel;
                return Err(field("pixels")
                    .value(format!("holds pixel ({column}, {row}) of camera {camera}, {width} x {height}")));
            }
        }
        // Without branches.
        if self.normals.iter().fold(true, |all, normal| all & is_unit(normal)) {
            return Ok(());
        }
        let wrong = self.normals.iter().find(|normal| !is_unit(normal)).copied().unwrap_or_default();
        let length = wrong.iter().map(|n| n * n).sum::<f32>().sqrt();
        Err(field("normals").value(format!("holds a normal of length {length}, expected 1")))
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
    use super::super::tests::{noise, of, refusal, there_and_back, wire_of};
    use super::*;

    fn edge(distance_m: f32, camera: u16, column: i32, row: i32) -> Option<Edge> {
        let (pixel, normal_world) = (Pixel { column, row }, [0.6, 0.0, -0.8]);
        Some(Edge { distance_m, camera, pixel, normal_world, moved_m: None })
    }

    #[test]
    fn edges_survive_the_wire() {
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
        ] {
            assert_eq!(there_and_back(&answer, Precision::Exact), answer);
        }
    }

    #[test]
    fn the_fullest_reply_is_no_longer_than_its_question_allows() {
        let mut noise = noise();
        let side = |noise: u32| (noise % 16_384) as i32;
        let full = (0..3000).map(|_| {
            let camera = if noise().is_multiple_of(2) { 1 } else { 3 };
            edge(noise() as f32 * 1e-8, camera, side(noise()), side(noise()))
        });
        let answer = Answer { edges: full.collect(), ..of(QuestionKind::Edges) };
        let exits_within = answer.edges.iter().map(|_| Reach::from_code(noise() as u8)).collect();
        there_and_back(&Answer { exits_within, ..answer }, Precision::Exact);
    }

    #[test]
    fn rounded_edges_are_near() {
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
        let lies: [(Lie, &str); 6] = [
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
