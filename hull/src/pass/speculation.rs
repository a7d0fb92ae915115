//! The speculative question: planes that are asked for together with the classes, of samples that touched in the pass
//! before, and of points around their bodies. Where little changes nothing else is to be asked, and a pass takes one trip.
//! Planes of samples that no longer touch are dropped, and planes that are missing are asked for next: the results do not
//! depend on it.

use super::groups::AnswerError;
use super::{AROUND_REACH, Pass, PassBody, Targets};
use crate::question::{Answer, Edge, Question, QuestionKind};

/// The speculative question, and the answers to it.
#[derive(Clone, Debug, Default)]
pub(super) struct Speculation {
    question: Question,
    targets: Targets,
    /// One for each target.
    merged: Vec<Option<Edge>>,
    /// The groups that have not answered.
    waits: Vec<bool>,
}

impl Speculation {
    pub fn is_answered(&self) -> bool {
        !self.waits.contains(&true)
    }
}

impl Pass {
    /// From the next pass on, asks for planes that are likely to matter together with the classes, if all groups are asked
    /// for these at once: it takes fewer trips, and some of the planes are dropped. Needs [`Pass::only_planes`].
    pub fn speculate(&mut self, speculates: bool) {
        self.speculates = speculates;
    }

    /// The question to ask together with [`Pass::question`], of the same groups. Its answers may come before or after the
    /// other's.
    pub fn speculative_question(&self) -> Option<&Question> {
        (!self.speculation.is_answered()).then_some(&self.speculation.question)
    }

    /// Makes the speculative question. The classes are asked already.
    pub(super) fn ask_speculatively(&mut self) {
        let Pass { speculation, bodies, count, groups, .. } = self;
        let Speculation { question, targets, merged, waits } = speculation;
        question.restart(QuestionKind::Planes);
        targets.0.clear();
        waits.clear();
        let is_in_one_phase = groups.iter().all(|group| group.is_asked || group.is_left_out);
        let is_wanted = self.speculates && self.only_planes && is_in_one_phase;
        let (all, count) = (&*bodies, if is_wanted { *count } else { 0 });
        for (index, body) in all[..count].iter().enumerate().filter(|(_, body)| body.is_near) {
            let first = targets.0.len();
            match body.owner {
                None => {
                    let samples = body.reaches.touched();
                    targets.0.extend(samples.map(|(sample, _)| (index as u32, sample)));
                    question.within.extend(body.reaches.touched().map(|(_, reach)| reach));
                }
                Some(owner) if all[owner].reaches.touched().len() > 0 => {
                    let points = 0..body.points.len() as u32;
                    targets.0.extend(points.clone().map(|point| (index as u32, point)));
                    question.within.extend(points.map(|_| AROUND_REACH));
                }
                Some(_) => {}
            }
            let picks = &targets.0[first..];
            if !picks.is_empty() {
                question.pick(&body.points, [0.0; 3], picks.iter().map(|&(_, sample)| sample));
            }
        }
        merged.clear();
        merged.resize(targets.0.len(), None);
        if !targets.0.is_empty() {
            waits.extend(groups.iter().map(|group| group.is_asked));
            self.points_asked[QuestionKind::Planes as usize] += self.speculation.targets.0.len() as u64;
        }
    }

    pub(super) fn answer_speculation(&mut self, group: usize, answer: &Answer) -> Result<(), AnswerError> {
        let Speculation { merged, waits, .. } = &mut self.speculation;
        if !waits.get(group).is_some_and(|&waits| waits) {
            return Err(AnswerError::Twice(group));
        }
        if answer.edges.len() != merged.len() {
            return Err(AnswerError::Count { group, found: answer.edges.len(), expected: merged.len() });
        }
        for (merged, edge) in merged.iter_mut().zip(&answer.edges) {
            let Some(edge) = edge else { continue };
            if merged.is_none_or(|before| edge.is_nearer(&before)) {
                *merged = Some(*edge);
            }
        }
        waits[group] = false;
        Ok(())
    }

    /// Gives touches the planes that were found speculatively. Points around bodies need no other question, also those
    /// without a plane.
    pub(super) fn take_speculation(&mut self) {
        let Pass { speculation, bodies, results, .. } = self;
        let mut edges = speculation.merged.iter();
        for of_body in speculation.targets.0.chunk_by(|a, b| a.0 == b.0) {
            let index = of_body[0].0 as usize;
            let PassBody { owner, is_speculated, .. } = &mut bodies[index];
            *is_speculated = owner.is_some();
            let mut touches = results[index].touches.iter_mut().peekable();
            for (&(_, sample), edge) in of_body.iter().zip(edges.by_ref()) {
                while touches.next_if(|touch| touch.sample < sample).is_some() {}
                if let Some(touch) = touches.next_if(|touch| touch.sample == sample) {
                    touch.edge = *edge;
                }
            }
        }
    }
}
