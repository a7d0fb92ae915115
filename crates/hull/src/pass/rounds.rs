//! The rounds of every response: which samples are inside, and the nearest edge, or plane, of those that are (paper §4).

use super::found::FoundSample;
use super::{AROUND_REACH, Pass, PassBody, PendingQuestion, Response, Round};
use crate::merge::inside_count;
use crate::question::{QuestionKind, Standing};
use crate::reach::Reach;

impl Pass {
    pub(super) fn after_classes(&mut self) {
        let silent = self.groups.iter().any(|group| !group.is_asked && !group.is_left_out);
        if silent && self.pending.targets.0.is_empty() {
            return self.ask_the_others();
        }
        let rule = self.settings.rule();
        let Pass { pending: PendingQuestion { targets, merged, .. }, bodies, .. } = self;
        if targets.0.is_empty() {
            let mut standings = merged.standings.iter();
            for body in bodies.asked_mut().iter_mut().filter(|body| body.is_near) {
                for (sample, &standing) in standings.by_ref().take(body.points.len()).enumerate() {
                    let found =
                        inside_count(standing, rule).map(|count| FoundSample::new(sample as u32, count));
                    body.found.extend(found);
                }
            }
        } else {
            for (&(body, sample), &standing) in targets.0.iter().zip(&merged.standings) {
                let found = inside_count(standing, rule).map(|count| FoundSample::new(sample, count));
                bodies.all_mut()[body as usize].found.extend(found);
            }
        }
        match &mut self.response {
            Response::Paper(paper) => paper.begin(self.bodies.all()),
            Response::Contacts(_) => self.begin_contacts(),
            Response::Classes => {
                self.round = Round::Done;
                return;
            }
        }
        self.ask_edges(|body, found| found.edge.is_none() && !body.are_edges_known);
    }

    /// Asks the groups that were not asked first about the points that no other rejects.
    pub(super) fn ask_the_others(&mut self) {
        let Pass { pending: PendingQuestion { targets, merged, question, .. }, bodies, groups, .. } = self;
        question.restart(QuestionKind::Classes);
        let mut at = 0;
        for (index, body) in bodies.asked().iter().enumerate().filter(|(_, body)| body.is_near) {
            let range = at..at + body.points.len();
            at = range.end;
            let left = (0..).zip(&merged.standings[range]);
            let left = left.filter(|&(_, &standing)| standing != Standing::OUTSIDE);
            let before = targets.0.len();
            targets.0.extend(left.map(|(sample, _)| (index as u32, sample)));
            let picks = &targets.0[before..];
            if !picks.is_empty() {
                question.pick(&body.points, [0.0; 3], picks.iter().map(|&(_, sample)| sample));
            }
        }
        merged.standings.retain(|&standing| standing != Standing::OUTSIDE);
        // What the first said stands; it is merged with what the others say.
        let so_far = std::mem::take(&mut merged.standings);
        for group in groups.iter_mut() {
            (group.is_asked, group.has_answered) = (!group.is_first && !group.is_left_out, false);
        }
        if question.is_empty() {
            self.round = Round::Done;
        }
        merged.restart(QuestionKind::Classes);
        merged.standings = so_far;
    }

    /// Asks for edges of the samples inside that fit.
    pub(super) fn ask_edges(&mut self, fits: impl Fn(&PassBody, &FoundSample) -> bool) {
        let alone = self.groups.len() == 1;
        let by_planes = self.asks_planes();
        let again = self.round == Round::Edges;
        let speculates = self.trips.speculates && by_planes;
        let Pass { pending, bodies, .. } = self;
        pending.restart(if by_planes { QuestionKind::Planes } else { QuestionKind::Edges });
        pending.pick(bodies.all(), |_, body, _, found| fits(body, found));
        let has_around = bodies.split_mut().1.iter().any(|around| !around.found.is_empty());
        if !again && (!alone || has_around) {
            for body in bodies.all_mut() {
                body.exits_within.clear();
                body.exits_within.resize(body.found.len(), None);
            }
            let PendingQuestion { question, targets, .. } = pending;
            for of_body in targets.0.chunk_by(|a, b| a.0 == b.0) {
                let body = &bodies.all()[of_body[0].0 as usize];
                let mut from = 0;
                let samples = of_body.iter().map(|&(_, at)| body.found[at as usize].sample);
                question.within.extend(samples.map(|sample| match body.is_around {
                    true => AROUND_REACH,
                    // A plane that was missing takes no third trip.
                    false if alone || speculates => Reach::UNBOUNDED,
                    false => body.reaches.of(sample, &mut from),
                }));
            }
        }
        if by_planes && pending.question.is_empty() {
            return self.after_planes();
        }
        self.ask_distances(Round::Edges);
        if !again {
            self.speculate_on_ways_out();
        }
    }

    pub(super) fn after_edges(&mut self) {
        let Pass { pending: PendingQuestion { targets, merged, question, exits_within }, bodies, .. } = self;
        let mut is_open = false;
        for (at, (&(body, sample), &edge)) in targets.0.iter().zip(&merged.edges).enumerate() {
            let body = &mut bodies.all_mut()[body as usize];
            body.found[sample as usize].edge = edge;
            if let Some(&within) = exits_within.get(at) {
                body.exits_within[sample as usize] = within;
            }
            is_open |= edge.is_none() && question.bounds(at) && !body.is_around;
        }
        if is_open {
            return self.ask_edges(|body, found| found.edge.is_none() && !body.is_around);
        }
        if self.asks_planes() {
            return self.after_planes();
        }
        self.ask_exits(|_| true);
    }
}
