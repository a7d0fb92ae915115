//! Planes near points. Most are of points around bodies, and many points share an edge pixel: a plane is sent once, and not
//! how far points outside are from it, which follows.

use bytes::Bytes;
use hull::question::{Answer, Edge, QuestionKind};

use super::super::ConvertError;
use super::super::bulk::{Field, pack_f32};
use super::super::choice::{choice, push_number, take_number};
use super::super::packed::{pack, unpack_at_most};
use super::super::rounded::{Precision, UnitBits, octahedral, step_m};
use super::edges::{SeenEdges, cameras_to_wire, distances_from_wire, pixels_to_wire, to_scale};
use super::{ExpectedAnswer, STEPS, check_step, chosen};
use crate::v1;

/// No plane moves farther in a frame, metres.
const MAX_MOVED_M: f32 = 1.0;
/// Rounded, a way is a multiple of [`MAX_MOVED_M`] over this: 15 micrometres a frame off at most.
const MOVED_STEPS: f32 = 32_767.0;
/// Rounded, of a plane whose frame before tells nothing.
const NOT_MOVED: i16 = i16::MIN;
/// A plane's number has at most so many bytes: there are fewer than two million points.
const MAX_WHICH_BYTES: usize = 3;
/// Planes that are remembered while an answer is written: a power of two.
const SLOTS: usize = 1 << 12;

pub(super) fn planes_to_wire(answer: &Answer, precision: Precision) -> v1::PlanesAnswer {
    let edges = &answer.edges;
    let present: Vec<&Edge> = edges.iter().flatten().collect();
    let (distinct, which) = distinct(&present);
    let (planes, plane_count) = (|| distinct.iter().copied(), distinct.len());
    let inside = || present.iter().filter(|edge| !edge.is_from_outside()).map(|edge| edge.distance_m);
    let is_exact = precision == Precision::Exact;
    let step_m = if is_exact { 0.0 } else { step_m(inside().fold(0.0, f32::max), STEPS) };
    let normals = || planes().map(|edge| edge.normal_world);
    v1::PlanesAnswer {
        count: edges.len() as u32,
        present: choice(edges, Option::is_some),
        which: which_to_wire(&which),
        inside: choice(&present, |edge| !edge.is_from_outside()),
        distances: if is_exact { pack_f32(inside()) } else { to_scale(inside(), step_m) },
        moved: moved_to_wire(&present, &which, plane_count, precision),
        normals: if is_exact {
            pack_f32(normals().flatten())
        } else {
            // Distances follow from normals: 16 bits would be a tenth of a millimetre off, three metres away.
            octahedral(normals(), UnitBits::Twenty)
        },
        cameras: cameras_to_wire(planes()),
        pixels: pixels_to_wire(planes(), precision),
        step_m,
    }
}

/// The planes that differ, in the order in which they come first, and for each edge which of them it has. One that has left
/// its slot to another comes again.
fn distinct<'a>(present: &[&'a Edge]) -> (Vec<&'a Edge>, Vec<u32>) {
    let mut slots = vec![0_u32; SLOTS];
    let mut planes: Vec<&Edge> = Vec::new();
    let mut which = Vec::with_capacity(present.len());
    for &edge in present {
        let Edge { camera, pixel, .. } = edge;
        // Neighbours along an edge, and cameras, have slots of their own.
        let place = (pixel.column as u32)
            .wrapping_add((pixel.row as u32).wrapping_mul(57))
            .wrapping_add(u32::from(*camera).wrapping_mul(1021));
        let slot = &mut slots[place as usize % SLOTS];
        let is_same = |plane: &&&Edge| {
            (plane.camera, plane.pixel, plane.normal_world.map(f32::to_bits))
                == (*camera, *pixel, edge.normal_world.map(f32::to_bits))
        };
        if planes.get(*slot as usize).filter(is_same).is_none() {
            *slot = planes.len() as u32;
            planes.push(edge);
        }
        which.push(*slot);
    }
    (planes, which)
}

/// How many planes came before, less the one that is meant: 0 is a new one.
fn which_to_wire(which: &[u32]) -> Bytes {
    let (mut bytes, mut planes) = (Vec::with_capacity(which.len()), 0);
    for &plane in which {
        push_number(&mut bytes, (planes - plane) as usize);
        planes = planes.max(plane + 1);
    }
    pack(&bytes)
}

/// Points of one plane move alike: each way is sent as it differs from the way of the plane's point before.
fn moved_to_wire(present: &[&Edge], which: &[u32], plane_count: usize, precision: Precision) -> Bytes {
    if present.iter().all(|edge| edge.moved_m.is_none()) {
        return Bytes::new();
    }
    let moved = present.iter().zip(which).map(|(edge, &plane)| (edge.moved_m, plane as usize));
    let bytes = match precision {
        Precision::Exact => {
            let mut before = vec![0; plane_count];
            let differences = moved.map(|(m, plane)| {
                let bits = m.unwrap_or(f32::INFINITY).to_bits();
                std::mem::replace(&mut before[plane], bits) ^ bits
            });
            in_columns(&differences.collect::<Vec<u32>>())
        }
        Precision::Quantised => {
            let (mut before, mut bytes) = (vec![0; plane_count], Vec::with_capacity(present.len()));
            let code = |m: f32| (m / MAX_MOVED_M * MOVED_STEPS).round() as i16;
            for (m, plane) in moved {
                let code = m.map_or(NOT_MOVED, code);
                let difference = code.wrapping_sub(std::mem::replace(&mut before[plane], code));
                push_number(&mut bytes, usize::from((difference << 1 ^ difference >> 15).cast_unsigned()));
            }
            bytes
        }
    };
    pack(&bytes)
}

/// All highest bytes first, then all next ones: of numbers that are small, or alike, these are the same.
fn in_columns(numbers: &[u32]) -> Vec<u8> {
    let column = |shift: u32| numbers.iter().map(move |number| (number >> shift) as u8);
    [24, 16, 8, 0].into_iter().flat_map(column).collect()
}

/// What [`in_columns`] made of so many numbers.
fn from_columns(bytes: &[u8], count: usize, field: Field) -> Result<Vec<u32>, ConvertError> {
    field.check_length(bytes.len(), 4 * count)?;
    let mut numbers = vec![0; count];
    for column in bytes.chunks_exact(count.max(1)) {
        numbers.iter_mut().zip(column).for_each(|(number, &byte)| *number = *number << 8 | u32::from(byte));
    }
    Ok(numbers)
}

pub(super) fn planes_from_wire(
    answer: &v1::PlanesAnswer,
    expected: &ExpectedAnswer,
) -> Result<Answer, ConvertError> {
    let v1::PlanesAnswer {
        count,
        present,
        which,
        inside,
        distances,
        moved,
        normals,
        cameras,
        pixels,
        step_m,
    } = answer;
    let field = |name| Field("PlanesAnswer", name);
    let mut edges = vec![None; expected.check_count(*count, field("count"))?];
    let set = chosen(present, edges.len(), field("present"))?;
    check_step(*step_m, field("step_m"))?;
    let is_rounded = *step_m > 0.0;
    let (which, plane_count) = which_from_wire(which, set.len(), field("which"))?;
    let seen = SeenEdges::from_wire((cameras, pixels, normals), plane_count, is_rounded, expected, field)?;
    let inside = chosen(inside, set.len(), field("inside"))?;
    let distances = distances_from_wire(distances, inside.len(), *step_m, field("distances"))?;
    let moved = moved_from_wire(moved, &which, plane_count, is_rounded, field("moved"))?;
    let mut inside = inside.into_iter().zip(distances).peekable();
    let mut camera = None;
    for (at, (index, plane)) in set.into_iter().zip(which).enumerate() {
        let mut edge = Edge { moved_m: moved.get(at).copied().flatten(), ..seen.edge(plane as usize) };
        edge.distance_m = match inside.next_if(|(inside, _)| *inside == at as u32) {
            Some((_, distance_m)) => distance_m,
            None => {
                if camera.is_none_or(|(known, _)| known != edge.camera) {
                    camera = expected.camera(edge.camera).map(|known| (edge.camera, known.centre_world));
                }
                // Checked: the camera is one of the node's.
                let Some((_, centre_world)) = camera else { continue };
                let point_world = expected.points_world.point(index as usize);
                Edge::distance_from_outside_m(edge.normal_world, &centre_world, &point_world)
            }
        };
        edges[index as usize] = Some(edge);
    }
    Ok(Answer { kind: QuestionKind::Planes, edges, ..Answer::default() })
}

/// For each point which of the planes it has, and how many planes there are.
fn which_from_wire(bytes: &[u8], count: usize, field: Field) -> Result<(Vec<u32>, usize), ConvertError> {
    let bytes = unpack_at_most(bytes, count * MAX_WHICH_BYTES, field)?;
    let (mut rest, mut planes) = (&bytes[..], 0);
    let mut which = Vec::with_capacity(count);
    for _ in 0..count {
        let before = take_number(&mut rest, field)?;
        if before > planes {
            return Err(field.value(format!("holds {before}, expected one of {planes} planes before")));
        }
        which.push((planes - before) as u32);
        planes += usize::from(before == 0);
    }
    field.check_length(bytes.len(), bytes.len() - rest.len())?;
    Ok((which, planes))
}

/// How far planes move; nothing if no frame before tells.
fn moved_from_wire(
    bytes: &[u8],
    which: &[u32],
    plane_count: usize,
    is_rounded: bool,
    field: Field,
) -> Result<Vec<Option<f32>>, ConvertError> {
    let bytes = unpack_at_most(bytes, which.len() * 4, field)?;
    if bytes.is_empty() {
        return Ok(Vec::new());
    }
    if is_rounded {
        return rounded_moved_from_wire(&bytes, which, plane_count, field);
    }
    let (mut before, mut ways) = (vec![0; plane_count], Vec::with_capacity(which.len()));
    for (difference, &plane) in from_columns(&bytes, which.len(), field)?.into_iter().zip(which) {
        let bits = &mut before[plane as usize];
        *bits ^= difference;
        ways.push(f32::from_bits(*bits));
    }
    let is_way = |m: f32| (m.abs() <= MAX_MOVED_M) | (m == f32::INFINITY);
    // Without branches.
    if ways.iter().fold(true, |all, &m| all & is_way(m)) {
        return Ok(ways.into_iter().map(|m| Some(m).filter(|&m| m != f32::INFINITY)).collect());
    }
    let wrong = ways.into_iter().find(|&m| !is_way(m)).unwrap_or_default();
    Err(field.value(format!("holds a way of {wrong} a frame, expected at most {MAX_MOVED_M} metres")))
}

fn rounded_moved_from_wire(
    bytes: &[u8],
    which: &[u32],
    plane_count: usize,
    field: Field,
) -> Result<Vec<Option<f32>>, ConvertError> {
    let (mut rest, mut before) = (bytes, vec![0_i16; plane_count]);
    let mut ways = Vec::with_capacity(which.len());
    for &plane in which {
        let number = take_number(&mut rest, field)?;
        let number =
            u16::try_from(number).map_err(|_| field.value(format!("holds {number}, expected 16 bits")))?;
        let code = &mut before[plane as usize];
        *code = code.wrapping_add((number >> 1).cast_signed() ^ -(number & 1).cast_signed());
        ways.push((*code != NOT_MOVED).then(|| f32::from(*code) / MOVED_STEPS * MAX_MOVED_M));
    }
    field.check_length(bytes.len(), bytes.len() - rest.len())?;
    Ok(ways)
}

#[cfg(test)]
mod tests {
    use hull::camera::Pixel;

    use super::super::super::Precision::{Exact, Quantised};
    use super::super::tests::{noise, of, point_at, refusal, there_and_back, wire_of};
    use super::*;
    use v1::probe_reply::Answer as Wire;

    fn plane(distance_m: f32, camera: u16, column: i32, moved_m: Option<f32>) -> Edge {
        let (pixel, normal_world) = (Pixel { column, row: 9 }, [0.6, 0.0, -0.8]);
        Edge { distance_m, camera, pixel, normal_world, moved_m }
    }

    /// As a camera at the origin sees it from outside, at a place of the question.
    fn outside(at: usize, camera: u16, column: i32, moved_m: Option<f32>) -> Edge {
        let plane = plane(0.0, camera, column, moved_m);
        let distance_m =
            Edge::distance_from_outside_m(plane.normal_world, &nalgebra::Point3::origin(), &point_at(at));
        assert!(plane.distance_m == 0.0 && distance_m.is_sign_negative());
        Edge { distance_m, ..plane }
    }

    fn answer(edges: Vec<Option<Edge>>) -> Answer {
        Answer { edges, ..of(QuestionKind::Planes) }
    }

    #[test]
    fn planes_survive_the_wire_bit_for_bit() {
        let of_one_pixel = |at| Some(outside(at, 3, 7, Some(0.01 * at as f32)));
        for edges in [
            vec![None],
            vec![None, Some(plane(0.25, 3, -1, None)), None],
            vec![Some(plane(0.0, 1, 4, None)), None, Some(outside(2, 3, 4, None))],
            vec![of_one_pixel(0), None, of_one_pixel(2), Some(outside(3, 1, 7, None)), of_one_pixel(4)],
        ] {
            let answer = answer(edges);
            let back = there_and_back(&answer, Exact);
            assert_eq!(back, answer);
            let bits = |answer: &Answer| {
                answer.edges.iter().flatten().map(|edge| edge.distance_m.to_bits()).collect::<Vec<_>>()
            };
            assert_eq!(bits(&back), bits(&answer), "zeros keep their sign");
        }
    }

    #[test]
    fn a_plane_that_many_points_share_is_sent_once() {
        let shared = answer((0..1000).map(|at| Some(outside(at, 3, (at % 10) as i32, None))).collect());
        let Wire::Planes(wire) = wire_of(&shared) else { panic!("of planes") };
        assert_eq!(wire.normals.len(), 10 * 12);
        assert_eq!(wire.distances.len(), 0);
        // Far fewer than a byte a point: the numbers repeat.
        assert!(wire.which.len() < 100, "{}", wire.which.len());
        assert_eq!(there_and_back(&shared, Exact), shared);
        // More planes than are remembered: some come again, all arrive.
        let many = (0..20_000).map(|at| Some(outside(at, 3, ((at * 7919) % 9001) as i32, None)));
        let many = answer(many.collect());
        assert_eq!(there_and_back(&many, Exact), many);
    }

    #[test]
    fn the_fullest_reply_is_no_longer_than_its_question_allows() {
        let mut noise = noise();
        let full = (0..3000).map(|_| {
            let camera = if noise().is_multiple_of(2) { 1 } else { 3 };
            let (column, row) = ((noise() % 16_384) as i32, (noise() % 16_384) as i32);
            let edge = plane(noise() as f32 * 1e-8, camera, column, Some(noise() as f32 * 1e-8));
            Some(Edge { pixel: Pixel { column, row }, ..edge })
        });
        there_and_back(&answer(full.collect()), Exact);
    }

    #[test]
    fn rounded_planes_are_near() {
        let planes = answer(vec![
            Some(outside(0, 3, 7, Some(-0.02))),
            Some(plane(0.1, 3, 7, Some(0.0))),
            None,
            Some(outside(3, 1, 9, None)),
        ]);
        let back = there_and_back(&planes, Quantised);
        for (edge, back) in planes.edges.iter().zip(&back.edges) {
            assert_eq!(edge.map(|edge| edge.camera), back.map(|edge| edge.camera));
            let (Some(edge), Some(back)) = (edge, back) else { continue };
            // 30 micrometres at ten metres.
            let away_m = (point_at(3).coords.norm() as f32).max(1.0);
            assert!((edge.distance_m - back.distance_m).abs() < 3e-6 * away_m, "{edge:?} {back:?}");
            let off = edge.normal_world.iter().zip(back.normal_world).map(|(a, b)| (a - b).abs());
            assert!(off.fold(0.0, f32::max) < 3e-6);
            let off_m = edge.moved_m.zip(back.moved_m).map(|(a, b)| (a - b).abs());
            assert_eq!(edge.moved_m.is_some(), back.moved_m.is_some());
            assert!(off_m.unwrap_or_default() <= 0.5 / MOVED_STEPS + 1e-7);
        }
    }

    #[test]
    fn a_plane_that_cannot_be_is_the_nodes_own_fault() {
        let of_plane = |plane: Edge| refusal(wire_of(&answer(vec![Some(plane)])), QuestionKind::Planes, 1);
        assert_eq!(
            of_plane(plane(0.1, 2, 5, None)),
            "PlanesAnswer.cameras: holds camera 2, not one of the node's own"
        );
        assert_eq!(
            of_plane(Edge { normal_world: [2.0, 0.0, 0.0], ..plane(0.1, 3, 5, None) }),
            "PlanesAnswer.normals: holds a normal of length 2, expected 1"
        );
        assert_eq!(
            of_plane(plane(0.1, 3, 5, Some(f32::NAN))),
            "PlanesAnswer.moved: holds a way of NaN a frame, expected at most 1 metres"
        );
        assert_eq!(
            of_plane(plane(f32::INFINITY, 3, 5, None)),
            "PlanesAnswer.distances: holds a distance of inf, expected finite metres"
        );
        let Wire::Planes(wire) = wire_of(&answer(vec![Some(plane(0.1, 3, 5, None))])) else { panic!() };
        let of_moved = |moved: &[u8], step_m: f32| {
            let (distances, normals) = match step_m > 0.0 {
                true => (
                    to_scale([0.1].into_iter(), step_m),
                    octahedral([[0.6, 0.0, -0.8]].into_iter(), UnitBits::Twenty),
                ),
                false => (wire.distances.clone(), wire.normals.clone()),
            };
            let pixels = if step_m > 0.0 { Bytes::new() } else { wire.pixels.clone() };
            let moved = pack(moved);
            let lied = v1::PlanesAnswer { moved, step_m, distances, normals, pixels, ..wire.clone() };
            refusal(Wire::Planes(lied), QuestionKind::Planes, 1)
        };
        assert_eq!(of_moved(&[0, 0, 0], 0.0), "PlanesAnswer.moved holds 3 bytes, expected 4");
        assert_eq!(of_moved(&[0x80, 0x80, 4], 1e-5), "PlanesAnswer.moved: holds 65536, expected 16 bits");
        assert_eq!(of_moved(&[2, 2], 1e-5), "PlanesAnswer.moved holds 2 bytes, expected 1");
        let lied = v1::PlanesAnswer { which: pack(&[1]), ..wire };
        assert_eq!(
            refusal(Wire::Planes(lied), QuestionKind::Planes, 1),
            "PlanesAnswer.which: holds 1, expected one of 0 planes before"
        );
    }
}
