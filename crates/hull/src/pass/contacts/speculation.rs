//! The speculative question, beside the pass's own: what is likely to be asked next. Together with the classes these are the
//! planes of samples that were inside in the pass before, and of points around their bodies: where little changes nothing else
//! is to be asked, and a pass takes one trip. Together with planes these are the ways out of bodies of which no sample is
//! known to be faced. What turns out not to matter is dropped, and what is missing is asked for next: the results do not
//! depend on it.

use super::super::found::FoundSample;
use super::super::groups::{AnswerError, Group};
use super::super::pending::Targets;
use super::super::{AROUND_REACH, Pass, PendingQuestion, Response, changes_of};
use crate::question::{Answer, Change, NO_EXIT_M, Question, QuestionKind};
use crate::reach::Reach;

/// The speculative question, and the answers to it.
#[derive(Clone, Debug, Default)]
pub(in crate::pass) struct Speculation {
    pending: PendingQuestion,
    /// The groups that have not answered.
    waits: Vec<bool>,
}

impl Speculation {
    /// Whether all groups that were asked have answered.
    pub fn is_answered(&self) -> bool {
        !self.waits.contains(&true)
    }

    /// Whether an answer is to this question, which is of another kind than the pass's own.
    pub fn is_answered_by(&self, answer: &Answer, own: &Question) -> bool {
        !answer.kind.answers(own.kind) && answer.kind.answers(self.pending.question.kind)
    }

    fn restart(&mut self, kind: QuestionKind) {
        self.pending.restart(kind);
        self.pending.merged.restart(kind);
        self.waits.clear();
    }

    /// Hands over the exits of samples inside, in their order, if they were asked for.
    pub fn take_exits(&mut self, inside: &Targets, merged: &mut Answer) -> bool {
        let asks_exits =
            self.pending.question.kind == QuestionKind::Exits && !self.pending.targets.0.is_empty();
        if inside.0.is_empty() || !asks_exits {
            return false;
        }
        self.pending.sort_changes();
        let PendingQuestion { targets, merged: known, .. } = &self.pending;
        merged.restart(QuestionKind::Exits);
        let (mut at, mut changes) = (0, 0..0);
        for (point, found) in inside.0.iter().enumerate() {
            // Both are in order.
            at += targets.0[at..].iter().take_while(|asked| *asked < found).count();
            if targets.0.get(at) != Some(found) {
                return false;
            }
            let before = known.changes[changes.end..].iter();
            let start = changes.end + before.take_while(|change| (change.point as usize) < at).count();
            changes = changes_of(&known.changes, at, start);
            let of_point = known.changes[changes.clone()].iter();
            merged.changes.extend(of_point.map(|&change| Change { point: point as u32, ..change }));
            merged.exits_m.push(known.exits_m.get(at).copied().unwrap_or(NO_EXIT_M));
        }
        true
    }

    /// Asks the groups that the pass's own question asks.
    fn ask(&mut self, groups: &[Group], points_asked: &mut [u64; QuestionKind::ALL.len()]) {
        let Speculation { pending, waits } = self;
        pending.forget_answers();
        if !pending.targets.0.is_empty() {
            waits.extend(groups.iter().map(|group| group.is_asked));
            points_asked[pending.question.kind as usize] += pending.targets.0.len() as u64;
        }
    }

    /// Takes a group's answer.
    pub fn answer(&mut self, group: usize, answer: &Answer) -> Result<(), AnswerError> {
        if !self.waits.get(group).is_some_and(|&waits| waits) {
            return Err(AnswerError::Twice(group));
        }
        let expected = self.pending.merged.len();
        if answer.len() != expected {
            return Err(AnswerError::Count { group, found: answer.len(), expected });
        }
        self.pending.merge(answer);
        self.waits[group] = false;
        Ok(())
    }
}

impl Pass {
    /// From the next pass on, asks together with classes for planes that are likely to matter, if all groups are asked
    /// for these at once, and together with planes for ways out: it takes fewer trips, and some of the answers are dropped.
    /// Only a pass [for contacts](Pass::for_contacts) does, also one that becomes so later.
    pub fn speculate(&mut self, speculates: bool) {
        self.trips.speculates = speculates;
    }

    /// The question to ask together with [`Pass::question`], of the same groups. Its answers may come before or after the
    /// other's.
    pub fn speculative_question(&self) -> Option<&Question> {
        let Response::Contacts(contacts) = &self.response else { return None };
        (!contacts.speculation.is_answered()).then_some(&contacts.speculation.pending.question)
    }

    /// Speculates on planes. The classes are asked already.
    pub(in crate::pass) fn speculate_on_planes(&mut self) {
        let Pass { response, bodies, groups, points_asked, trips, .. } = self;
        let Response::Contacts(contacts) = response else { return };
        contacts.speculation.restart(QuestionKind::Planes);
        let PendingQuestion { question, targets, .. } = &mut contacts.speculation.pending;
        let is_in_one_phase = groups.iter().all(|group| group.is_asked || group.is_left_out);
        let bodies = if trips.speculates && is_in_one_phase { bodies.all() } else { &[] };
        let all = bodies.iter().zip(&contacts.bodies).enumerate();
        for (index, (body, of_contacts)) in
            all.filter(|(_, (body, of_contacts))| body.is_near && of_contacts.back_m.is_none())
        {
            let first = targets.0.len();
            match of_contacts.owner {
                None => {
                    let samples = body.reaches.touched();
                    targets.0.extend(samples.map(|(sample, _)| (index as u32, sample)));
                    question.within.extend(body.reaches.touched().map(|(_, reach)| reach));
                }
                Some(owner) if bodies[owner].reaches.touched().len() > 0 => {
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
        contacts.speculation.ask(groups, points_asked);
    }

    /// Speculates on ways out. Planes are asked already: of samples without one it is not known whether it faces them.
    pub(in crate::pass) fn speculate_on_ways_out(&mut self) {
        let Pass { response, bodies, groups, points_asked, trips, .. } = self;
        let Response::Contacts(contacts) = response else { return };
        contacts.speculation.restart(QuestionKind::Exits);
        let PendingQuestion { question, targets, .. } = &mut contacts.speculation.pending;
        let bodies = if trips.speculates { bodies.asked() } else { &[] };
        for (index, (body, of_contacts)) in bodies.iter().zip(&contacts.bodies).enumerate() {
            let is_faced = |found: &FoundSample| found.edge.is_some() && of_contacts.is_faced(body, found);
            if of_contacts.back_m.is_none() && body.found.iter().any(is_faced) {
                continue;
            }
            let first = targets.0.len();
            for (at, found) in body.found.iter().enumerate() {
                let Some(direction) = of_contacts.likely_way_out(body, found.sample) else { continue };
                targets.0.push((index as u32, at as u32));
                question.directions.push(direction);
                question.within.push(Reach::covering(of_contacts.farthest_m()));
            }
            let picks = &targets.0[first..];
            if !picks.is_empty() {
                let sample = |&(_, at): &(u32, u32)| body.found[at as usize].sample;
                question.pick(&body.points, [0.0; 3], picks.iter().map(sample));
            }
        }
        contacts.speculation.ask(groups, points_asked);
    }

    /// Gives samples the planes that were found speculatively. Points around bodies need no other question, also those
    /// without a plane.
    pub(super) fn take_planes(&mut self) {
        let Pass { response, bodies, .. } = self;
        let Response::Contacts(contacts) = response else { return };
        let PendingQuestion { targets, merged, .. } = &contacts.speculation.pending;
        let mut edges = merged.edges.iter();
        for of_body in targets.0.chunk_by(|a, b| a.0 == b.0) {
            let body = &mut bodies.all_mut()[of_body[0].0 as usize];
            body.are_edges_known = body.is_around;
            let mut inside = body.found.iter_mut().peekable();
            for (&(_, sample), edge) in of_body.iter().zip(edges.by_ref()) {
                while inside.next_if(|found| found.sample < sample).is_some() {}
                if let Some(found) = inside.next_if(|found| found.sample == sample) {
                    found.edge = *edge;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exits_of_some_of_the_samples_that_were_asked_about_are_handed_over_with_their_changes() {
        let change = |point: u32, t_m: f32| Change { point, t_m, by: 1 };
        let mut speculation = Speculation::default();
        speculation.restart(QuestionKind::Exits);
        speculation.pending.targets = Targets(vec![(0, 0), (0, 1), (1, 0), (1, 2), (2, 5)]);
        speculation.pending.merged.exits_m = vec![0.1, 0.2, 0.3, 0.4, 0.5];
        speculation.pending.merged.changes = [(3, 0.2), (1, 0.3), (3, 0.1), (4, 0.4), (0, 0.5)]
            .map(|(point, t_m)| change(point, t_m))
            .to_vec();
        let mut merged = Answer::default();
        assert!(speculation.take_exits(&Targets(vec![(0, 1), (1, 2), (2, 5)]), &mut merged));
        assert_eq!((merged.kind, &merged.exits_m[..]), (QuestionKind::Exits, &[0.2, 0.4, 0.5][..]));
        assert_eq!(merged.changes, [change(0, 0.3), change(1, 0.1), change(1, 0.2), change(2, 0.4)]);
        assert!(
            !speculation.take_exits(&Targets(vec![(0, 1), (1, 1)]), &mut merged),
            "one was not asked about"
        );
        assert!(!speculation.take_exits(&Targets::default(), &mut merged));
    }
}
