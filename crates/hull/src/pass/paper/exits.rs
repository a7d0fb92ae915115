//! The round of exits along normals (paper §4).

use super::super::{MANY_EXITS, Pass, PendingQuestion, Response, Round, changes_of, exit_reach};
use crate::merge::first_exit;
use crate::question::QuestionKind;

impl Pass {
    /// Asks for exits of the samples inside with an edge, of which the known exit, if any, fits.
    pub(in crate::pass) fn ask_exits(&mut self, fits: impl Fn(Option<f32>) -> bool) {
        let alone = self.groups.len() == 1;
        let again = self.round == Round::Exits;
        let Pass { pending, bodies, response, trips, .. } = self;
        let Response::Paper(paper) = response else { return };
        pending.restart(QuestionKind::Exits);
        pending.pick(bodies.all(), |index, _, at, found| {
            found.edge.is_some() && fits(paper.bodies[index].exits_m[at])
        });
        let PendingQuestion { question, targets, .. } = pending;
        let is_of_many = trips.saves_bytes && targets.0.len() > MANY_EXITS;
        for &(body, at) in &targets.0 {
            let body = &bodies.all()[body as usize];
            let Some(edge) = body.found[at as usize].edge else { continue };
            question.directions.push(edge.normal_world);
            if alone {
                question.hints.push(edge.camera);
            } else if !again {
                let told = body.exits_within[at as usize];
                question.within.push(told.unwrap_or_else(|| exit_reach(edge.distance_m, is_of_many)));
            }
        }
        if trips.saves_bytes {
            return self.ask_distances(Round::Exits);
        }
        self.ask(Round::Exits, |_| true);
        if self.round == Round::Done {
            self.ask_body_exits();
        }
    }

    pub(in crate::pass) fn after_exits(&mut self) {
        let rule = self.settings.rule();
        let Pass { pending: PendingQuestion { question, targets, merged, .. }, bodies, response, .. } = self;
        let Response::Paper(paper) = response else { return };
        let mut is_open = false;
        let mut changes = 0..0;
        for (at, (&(body, sample), &outside_m)) in targets.0.iter().zip(&merged.exits_m).enumerate() {
            let count = bodies.all()[body as usize].found[sample as usize].inside_count;
            changes = changes_of(&merged.changes, at, changes.end);
            let exit_m = first_exit(outside_m, &merged.changes[changes.clone()], count, rule);
            paper.bodies[body as usize].exits_m[sample as usize] = exit_m;
            is_open |= exit_m.is_none() && question.bounds(at);
        }
        if is_open {
            return self.ask_exits(|exit_m| exit_m.is_none());
        }
        self.ask_body_exits();
    }
}
