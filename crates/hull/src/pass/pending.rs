//! A question that is being asked: what its points are, and the answers so far.

use super::PassBody;
use super::found::FoundSample;
use crate::question::{Answer, Change, NO_EXIT_M, Question, QuestionKind, Standing};
use crate::reach::Reach;

/// The body of each of the question's points, and which of its samples, or of those inside, it is.
#[derive(Clone, Debug, Default)]
pub(super) struct Targets(pub Vec<(u32, u32)>);

/// A question, and the answers to it. Merging does not depend on the order of the answers.
#[derive(Clone, Debug, Default)]
pub(super) struct PendingQuestion {
    pub question: Question,
    /// What the question's points are, in its order.
    pub targets: Targets,
    /// The answers so far.
    pub merged: Answer,
    /// For each merged edge the reach of its exit, if it was answered. Has places where that matters alone.
    pub exits_within: Vec<Option<Reach>>,
}

impl PendingQuestion {
    /// Another question, without points.
    pub fn restart(&mut self, kind: QuestionKind) {
        self.question.restart(kind);
        self.targets.0.clear();
    }

    /// Makes the question that of the samples inside that fit, by their body, its index, theirs among those inside.
    pub fn pick(
        &mut self,
        bodies: &[PassBody],
        fits: impl Fn(usize, &PassBody, usize, &FoundSample) -> bool,
    ) {
        let PendingQuestion { question, targets, .. } = self;
        targets.0.clear();
        for (index, body) in bodies.iter().enumerate() {
            let before = targets.0.len();
            let found = body.found.iter().enumerate().filter(|&(at, found)| fits(index, body, at, found));
            targets.0.extend(found.map(|(at, _)| (index as u32, at as u32)));
            let picks = &targets.0[before..];
            if !picks.is_empty() {
                let samples = picks.iter().map(|&(_, at)| body.found[at as usize].sample);
                question.pick(&body.points, [0.0; 3], samples);
            }
        }
    }

    /// As before the first answer.
    pub fn forget_answers(&mut self) {
        let PendingQuestion { question, merged, .. } = self;
        merged.restart(question.kind);
        let count = question.len();
        match question.kind {
            QuestionKind::Classes => merged.standings.resize(count, Standing::inside(0)),
            QuestionKind::Edges | QuestionKind::Planes => merged.edges.resize(count, None),
            QuestionKind::Exits | QuestionKind::SharedExits => merged.exits_m.resize(count, NO_EXIT_M),
        }
    }

    /// Merges a group's answer with those of others.
    pub fn merge(&mut self, answer: &Answer) {
        let PendingQuestion { merged, exits_within, .. } = self;
        for (merged, &standing) in merged.standings.iter_mut().zip(&answer.standings) {
            *merged = merged.and(standing);
        }
        for (at, (merged, edge)) in merged.edges.iter_mut().zip(&answer.edges).enumerate() {
            let Some(edge) = edge else { continue };
            if merged.is_none_or(|before| edge.is_nearer(&before)) {
                *merged = Some(*edge);
                if let Some(within) = exits_within.get_mut(at) {
                    *within = answer.exits_within.get(at).copied();
                }
            }
        }
        for (merged, &exit_m) in merged.exits_m.iter_mut().zip(&answer.exits_m) {
            *merged = merged.min(exit_m);
        }
        merged.changes.extend_from_slice(&answer.changes);
    }

    /// Sorts the merged changes by point and along each ray: of several groups they are not.
    pub fn sort_changes(&mut self) {
        let order = |a: &Change, b: &Change| a.point.cmp(&b.point).then(a.t_m.total_cmp(&b.t_m));
        let changes = &mut self.merged.changes;
        if !changes.is_sorted_by(|a, b| order(a, b).is_le()) {
            changes.sort_unstable_by(order);
        }
    }
}
