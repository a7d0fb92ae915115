//! Which points are inside.

use hull::question::{Answer, QuestionKind, Standing};

use super::super::ConvertError;
use super::super::bulk::Field;
use super::super::choice::{choice, read_choice};
use super::super::packed::{pack, unpack_exactly};
use super::{ExpectedAnswer, chosen};
use crate::v1;

/// Of so many cameras a node says in one byte how many see a point, of more in two.
const ONE_BYTE: usize = 255;

pub(super) fn classes_to_wire(standings: &[Standing], camera_count: usize) -> v1::ClassesAnswer {
    let counts = standings.iter().filter_map(|standing| standing.inside_count());
    let all = counts.clone().all(|count| count == camera_count);
    let width = width_of(camera_count);
    let bytes = |count: usize| (count as u16).to_le_bytes().into_iter().take(width);
    let counts: Vec<u8> = if all { Vec::new() } else { counts.flat_map(bytes).collect() };
    v1::ClassesAnswer {
        count: standings.len() as u32,
        not_outside: choice(standings, |&standing| standing != Standing::OUTSIDE),
        inside_counts: pack(&counts),
        cameras: camera_count as u32,
    }
}

pub(super) fn classes_from_wire(
    answer: &v1::ClassesAnswer,
    expected: &ExpectedAnswer,
) -> Result<Answer, ConvertError> {
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
        read_choice(not_outside, count, field("not_outside"), |run| {
            // Most runs are short.
            run.for_each(|index| standings[index] = all);
        })?;
    } else {
        let set = chosen(not_outside, count, field("not_outside"))?;
        let width = width_of(most);
        let bytes = unpack_exactly(inside_counts, set.len() * width, field("inside_counts"))?;
        let count = |bytes: &[u8]| bytes.iter().rev().fold(0, |count, &byte| count << 8 | usize::from(byte));
        let counts: Vec<usize> = bytes.chunks_exact(width).map(count).collect();
        if let Some(count) = counts.iter().find(|count| **count > most) {
            return Err(field("inside_counts").value(format!("holds {count}, expected at most {most}")));
        }
        for (index, count) in set.into_iter().zip(counts) {
            standings[index as usize] = Standing::inside(count);
        }
    }
    Ok(Answer { kind: QuestionKind::Classes, standings, ..Answer::default() })
}

/// Bytes of a count.
fn width_of(camera_count: usize) -> usize {
    if camera_count <= ONE_BYTE { 1 } else { 2 }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::super::super::Precision;
    use super::super::ExpectedCamera;
    use super::super::tests::{of, refusal, there_and_back};
    use super::*;
    use v1::probe_reply::Answer as Wire;

    #[test]
    fn classes_survive_the_wire() {
        let inside = Standing::inside;
        for standings in [
            vec![Standing::OUTSIDE, inside(2), Standing::OUTSIDE],
            vec![Standing::OUTSIDE, inside(2), inside(1)],
        ] {
            let answer = Answer { standings, ..of(QuestionKind::Classes) };
            assert_eq!(there_and_back(&answer, Precision::Exact), answer);
        }
    }

    #[test]
    fn many_cameras_are_counted_to_the_last() {
        for cameras in [65, 128, 255, 256, 1024] {
            let inside = [Some(cameras), None, Some(cameras - 1), Some(1), Some(0)];
            let standings: Vec<Standing> =
                inside.map(|count| count.map_or(Standing::OUTSIDE, Standing::inside)).to_vec();
            let (kind, points) = (QuestionKind::Classes, standings.len());
            let camera = |rig_index| {
                let centre_world = nalgebra::Point3::origin();
                ExpectedCamera { rig_index, size: (160, 120), centre_world }
            };
            let all = (0..cameras as u16).map(camera).collect();
            let points_world = Arc::default();
            let expected = ExpectedAnswer { kind, points, cameras: all, points_world };
            let wire = classes_to_wire(&standings, cameras);
            let answer = classes_from_wire(&wire, &expected).expect("valid");
            assert_eq!(answer.standings, standings, "{cameras} cameras");
        }
    }

    #[test]
    fn a_claimed_count_sets_no_memory_aside() {
        let lie = v1::ClassesAnswer { count: u32::MAX, cameras: 2, ..v1::ClassesAnswer::default() };
        let message = "ClassesAnswer.count: is 4294967295, expected 7";
        assert_eq!(refusal(Wire::Classes(lie), QuestionKind::Classes, 7), message);
    }

    #[test]
    fn no_more_cameras_see_a_point_than_there_are() {
        let counts = v1::ClassesAnswer {
            count: 1,
            cameras: 2,
            not_outside: choice(&[true], |&set| set),
            inside_counts: pack(&[3]),
        };
        let message = "ClassesAnswer.inside_counts: holds 3, expected at most 2";
        assert_eq!(refusal(Wire::Classes(counts), QuestionKind::Classes, 1), message);
    }
}
