//! Exits, and the changes of rays that a camera cannot judge everywhere.

use hull::question::{Answer, Change, NO_EXIT_M, QuestionKind};

use super::super::ConvertError;
use super::super::bulk::{Field, pack_f32, unpack};
use super::super::choice::choice;
use super::super::packed::{pack, unpack_at_most};
use super::super::rounded::{Precision, covering_code, step_m};
use super::{CHANGE_BYTES, ExpectedAnswer, MOST_CHANGES_A_CAMERA, STEPS, check_step, chosen, on_scale_of};
use crate::{MAX_MESSAGE_BYTES, v1};

const FEW_STEPS: u32 = 0xffff;
/// Up to here two bytes are enough for exits, in steps of at most two micrometres. With longer steps, one long exit
/// among short ones would turn mean directions by so much that responses are off by more than a tenth of a
/// millimetre.
const SHORT_M: f32 = 0.1;

pub(super) fn exits_to_wire(answer: &Answer, precision: Precision) -> v1::ExitsAnswer {
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
pub(super) fn exits_from_wire(
    answer: &v1::ExitsAnswer,
    expected: &ExpectedAnswer,
) -> Result<Answer, ConvertError> {
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
    // What a message could hold unpacked is enough for whatever was asked.
    let most = count.saturating_mul(cameras * MOST_CHANGES_A_CAMERA * CHANGE_BYTES).min(MAX_MESSAGE_BYTES);
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
    use super::super::tests::{of, refusal, there_and_back, wire_of};
    use super::*;
    use v1::probe_reply::Answer as Wire;

    #[test]
    fn exits_survive_the_wire() {
        let changes = vec![Change { point: 1, t_m: 0.1, by: -1 }, Change { point: 1, t_m: 0.11, by: 1 }];
        let answer = Answer { exits_m: vec![NO_EXIT_M, 0.125], changes, ..of(QuestionKind::Exits) };
        assert_eq!(there_and_back(&answer, Precision::Exact), answer);
    }

    #[test]
    fn rounded_exits_are_near_and_never_too_short() {
        for exits_m in [vec![0.031, NO_EXIT_M, 0.4], vec![NO_EXIT_M, 0.129, 0.0, 0.0101]] {
            let answer = Answer { exits_m, ..of(QuestionKind::Exits) };
            let back = there_and_back(&answer, Precision::Quantised);
            for (&exit_m, &back_m) in answer.exits_m.iter().zip(&back.exits_m) {
                assert!(back_m >= exit_m && (exit_m == NO_EXIT_M || back_m - exit_m < 2.1e-6), "{back_m}");
            }
        }
    }

    #[test]
    fn changes_that_unpack_to_more_than_was_asked_are_refused() {
        let bomb: Vec<u8> = [1].into_iter().chain(lz4_flex::block::compress(&vec![0; 64 << 20])).collect();
        let lie = v1::ExitsAnswer {
            count: 7,
            changes: bomb.into(),
            present: choice(&[false; 7], |_| false),
            ..v1::ExitsAnswer::default()
        };
        let error = refusal(Wire::Exits(lie), QuestionKind::Exits, 7);
        assert!(error.starts_with("ExitsAnswer.changes: does not decompress"), "{error}");
    }

    #[test]
    fn a_change_that_cannot_be_is_the_nodes_own_fault() {
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
            let error = refusal(wire_of(&answer), QuestionKind::Exits, 1);
            assert_eq!(error, "ExitsAnswer.changes: holds a change that cannot be");
        }
    }
}
