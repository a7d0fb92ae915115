//! Answers of large questions computed on several cores: contiguous parts of the question, each with about
//! the same number of points, appended in their order. What is answered does not depend on it.

use std::ops::Range;

use hull::ViewSet;
use hull::question::{Answer, Question, QuestionKind};
use hull::view_set::Scratch;

/// A thread is worth starting for so much work, nanoseconds: starting and joining it takes some 30 µs, and on
/// a machine that does other things as well more.
const GRAIN_NS: usize = 400_000;

/// Buffers of every core, kept from question to question.
#[derive(Debug)]
pub struct Cores {
    parts: Vec<Part>,
}

#[derive(Debug, Default)]
struct Part {
    scratch: Scratch,
    answer: Answer,
}

impl Cores {
    /// Computes on at most so many cores.
    pub fn new(count: usize) -> Cores {
        Cores { parts: (0..count.max(1)).map(|_| Part::default()).collect() }
    }

    /// Computes on the cores that this process may use.
    pub fn of_this_machine() -> Cores {
        Cores::new(std::thread::available_parallelism().map_or(1, usize::from))
    }

    /// Answers a question.
    pub fn answer(&mut self, views: &ViewSet, question: &Question) -> &Answer {
        let count = work_ns(question, views.views().len()).div_ceil(GRAIN_NS).clamp(1, self.parts.len());
        let ranges = split(question, count);
        let (first, others) = self.parts.split_at_mut(1);
        let first = &mut first[0];
        let work = |part: &mut Part, batches: Range<usize>| {
            part.answer.restart(question.kind);
            views.answer_part(question, batches, &mut part.scratch, &mut part.answer);
        };
        std::thread::scope(|scope| {
            for (part, range) in others.iter_mut().zip(&ranges[1..]) {
                scope.spawn(|| work(part, range.clone()));
            }
            work(first, ranges[0].clone());
        });
        others[..ranges.len() - 1].iter().for_each(|part| first.answer.append(&part.answer));
        &first.answer
    }
}

/// About the nanoseconds that one core takes, measured on the slowest machine at hand.
pub fn work_ns(question: &Question, cameras: usize) -> usize {
    let point_ns = match question.kind {
        QuestionKind::Classes => 6,
        QuestionKind::Edges | QuestionKind::Planes => 250,
        QuestionKind::Exits | QuestionKind::SharedExits => 120,
    };
    question.len().saturating_mul(point_ns * cameras)
}

/// At least one and at most `count` ranges of batches, all together, none empty but for an empty question.
fn split(question: &Question, count: usize) -> Vec<Range<usize>> {
    let each = question.len().div_ceil(count).max(1);
    let mut ranges = Vec::with_capacity(count);
    let (mut start, mut points) = (0, 0);
    for (index, batch) in question.batches.iter().enumerate() {
        points += batch.len();
        // A part ends with the batch that brings it nearest to its share.
        let is_full = points + batch.len() / 2 >= each * (ranges.len() + 1);
        if is_full && ranges.len() + 1 < count && index + 1 < question.batches.len() {
            ranges.push(start..index + 1);
            start = index + 1;
        }
    }
    ranges.push(start..question.batches.len());
    ranges
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use hull::question::{Batch, Points};
    use hull::{Observer, ProbeSettings, Silhouette, View};

    use super::*;

    /// A question large enough to be shared, about a camera whose left half is foreground.
    fn shared() -> (ViewSet, Question) {
        let camera = crate::source::tests::camera(64, 48);
        let mask: Vec<u8> = (0..64 * 48).map(|pixel| u8::from(pixel % 64 < 32)).collect();
        let silhouette = Silhouette::from_mask(64, 48, &mask).expect("a mask");
        let observer = Arc::new(Observer::new(camera, 0, ProbeSettings::default(), None));
        let views = ViewSet::new(vec![View::new(observer, &silhouette)]);
        let points = |batch: usize| {
            let at = |point: usize| {
                let point = (point * 7 + batch * 13) as f64;
                [0.001 * (point % 1000.0) - 0.5, 0.0003 * point % 0.7 - 0.3, 2.0 + 0.01 * batch as f64]
            };
            Points::World((0..5000 + 100 * batch).map(at).collect())
        };
        let batches = (0..9).map(|batch| Batch::all(points(batch))).collect();
        (views, Question { batches, ..Question::default() })
    }

    #[test]
    fn several_cores_answer_as_one_does() {
        let (views, mut question) = shared();
        for kind in [QuestionKind::Classes, QuestionKind::Edges, QuestionKind::SharedExits] {
            question.kind = kind;
            question.directions = match kind {
                QuestionKind::SharedExits => vec![[0.6, 0.0, -0.8]; question.batches.len()],
                _ => vec![],
            };
            let mut one = Cores::new(1);
            let alone = one.answer(&views, &question);
            assert_eq!(alone.len(), question.len());
            for count in [2, 3, 16] {
                assert_eq!(Cores::new(count).answer(&views, &question), alone, "{kind:?} on {count} cores");
            }
        }
    }

    #[test]
    fn parts_are_alike_and_small_questions_stay_whole() {
        let (_, question) = shared();
        let ranges = split(&question, 3);
        assert_eq!(ranges, [0..3, 3..6, 6..9]);
        assert_eq!(split(&Question::default(), 4), vec![Range { start: 0, end: 0 }]);
        let few = Question { batches: question.batches[..2].to_vec(), ..Question::default() };
        assert!(work_ns(&few, 1) < GRAIN_NS);
    }
}
