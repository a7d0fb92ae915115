//! Which points are inside.

use hull::question::{Answer, QuestionKind, Standing};

use super::super::ConvertError;
use super::super::bulk::Field;
use super::super::choice::{choice, read_choice};
use super::super::packed::{pack, unpack_exactly};
use super::{ExpectedAnswer, chosen};
use crate::v1;

pub(super) fn classes_to_wire(standings: &[Standing], camera_count: usize) -> v1::ClassesAnswer {
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
        read_choice(not_outside, count, field("not_outside"), |run| standings[run].fill(all))?;
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

#[cfg(test)]
mod tests {
    use super::super::Precision;
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
