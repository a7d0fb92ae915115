//! The rounds about single samples: classes, nearest edges, exits along normals (paper §4).

use super::{AROUND_REACH, MANY_EXITS, Pass, PassBody, Round, Touch, changes_of, exit_reach};
use crate::merge::{first_exit, inside_count};
use crate::question::{QuestionKind, Standing};
use crate::reach::Reach;

impl Pass {
    pub(super) fn after_classes(&mut self) {
        let silent = self.groups.iter().any(|group| !group.is_asked && !group.is_left_out);
        if silent && self.targets.0.is_empty() {
            return self.ask_the_others();
        }
        let rule = self.settings.rule();
        let Pass { targets, merged, results, bodies, asked_count, .. } = self;
        if targets.0.is_empty() {
            let mut standings = merged.standings.iter();
            for (body, result) in bodies[..*asked_count].iter().zip(results).filter(|(body, _)| body.is_near)
            {
                for (sample, &standing) in standings.by_ref().take(body.points.len()).enumerate() {
                    let found = inside_count(standing, rule).map(|count| Touch::new(sample as u32, count));
                    result.touches.extend(found);
                }
            }
        } else {
            for (&(body, sample), &standing) in targets.0.iter().zip(&merged.standings) {
                let found = inside_count(standing, rule).map(|count| Touch::new(sample, count));
                results[body as usize].touches.extend(found);
            }
        }
        if self.only_planes {
            self.drop_needless_feelers();
            self.add_around();
            self.take_planes();
        }
        self.ask_edges(|body, touch| touch.edge.is_none() && !body.is_speculated);
    }

    /// A sample that is inside itself takes the plane where it is: its feeler's is not needed.
    fn drop_needless_feelers(&mut self) {
        for (body, result) in self.bodies[..self.asked_count].iter().zip(&mut self.results) {
            let Some(count) = body.faces.as_ref().map(|faces| faces.sample_count() as u32) else { continue };
            let touches = &mut result.touches;
            let own = touches.partition_point(|touch| touch.sample < count);
            let (mut kept, mut of_own) = (own, 0);
            for at in own..touches.len() {
                let sample = touches[at].sample - count;
                while of_own < own && touches[of_own].sample < sample {
                    of_own += 1;
                }
                if of_own == own || touches[of_own].sample != sample {
                    touches[kept] = touches[at];
                    kept += 1;
                }
            }
            touches.truncate(kept);
        }
    }

    /// All points around the bodies that touch.
    fn add_around(&mut self) {
        for index in self.asked_count..self.count {
            let PassBody { points, owner, .. } = &self.bodies[index];
            let touches = owner.is_some_and(|owner| !self.results[owner].touches.is_empty());
            let count = if touches { points.len() as u32 } else { 0 };
            self.results[index].touches.extend((0..count).map(|sample| Touch::new(sample, 0)));
        }
    }

    /// Asks the groups that were not asked first about the points that no other rejects.
    pub(super) fn ask_the_others(&mut self) {
        let Pass { targets, merged, question, bodies, asked_count, groups, .. } = self;
        question.restart(QuestionKind::Classes);
        let mut at = 0;
        for (index, body) in bodies[..*asked_count].iter().enumerate().filter(|(_, body)| body.is_near) {
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
        self.merged.restart(QuestionKind::Classes);
        self.merged.standings = so_far;
    }

    /// Asks for edges of the touches that fit.
    pub(super) fn ask_edges(&mut self, fits: impl Fn(&PassBody, &Touch) -> bool) {
        let alone = self.groups.len() == 1;
        self.question.restart(if self.only_planes { QuestionKind::Planes } else { QuestionKind::Edges });
        let again = self.round == Round::Edges;
        self.pick_touches([0.0; 3], |body, _, touch| fits(body, touch));
        let has_around =
            self.results[self.asked_count..self.count].iter().any(|around| !around.touches.is_empty());
        let Pass { question, targets, bodies, results, count, speculates, only_planes, .. } = self;
        let speculates = *speculates && *only_planes;
        if !again && (!alone || has_around) {
            for (body, result) in bodies[..*count].iter_mut().zip(results.iter()) {
                body.exits_within.clear();
                body.exits_within.resize(result.touches.len(), None);
            }
            for of_body in targets.0.chunk_by(|a, b| a.0 == b.0) {
                let (body, touches) = (of_body[0].0 as usize, &results[of_body[0].0 as usize].touches);
                let mut from = 0;
                let samples = of_body.iter().map(|&(_, touch)| touches[touch as usize].sample);
                let is_around = bodies[body].owner.is_some();
                question.within.extend(samples.map(|sample| match is_around {
                    true => AROUND_REACH,
                    // A plane that was missing takes no third trip.
                    false if alone || speculates => Reach::UNBOUNDED,
                    false => bodies[body].reaches.of(sample, &mut from),
                }));
            }
        }
        if self.only_planes && self.question.is_empty() {
            return self.after_planes();
        }
        self.ask_distances(Round::Edges);
        if !again {
            self.speculate_on_ways_out();
        }
    }

    pub(super) fn after_edges(&mut self) {
        let Pass { targets, merged, results, question, bodies, exits_within, .. } = self;
        let mut is_open = false;
        for (at, (&(body, touch), &edge)) in targets.0.iter().zip(&merged.edges).enumerate() {
            results[body as usize].touches[touch as usize].edge = edge;
            if let Some(&within) = exits_within.get(at) {
                bodies[body as usize].exits_within[touch as usize] = within;
            }
            is_open |= edge.is_none() && question.bounds(at) && bodies[body as usize].owner.is_none();
        }
        if is_open {
            return self.ask_edges(|body, touch| touch.edge.is_none() && body.owner.is_none());
        }
        if self.only_planes {
            return self.after_planes();
        }
        self.ask_exits(|_| true);
    }

    fn after_planes(&mut self) {
        self.hand_over_around();
        self.ask_ways_out();
    }

    /// Gives the bodies what was found around them.
    fn hand_over_around(&mut self) {
        let (results, around) = self.results[..self.count].split_at_mut(self.asked_count);
        for (body, found) in self.bodies[self.asked_count..].iter().zip(around) {
            let Some(owner) = body.owner else { continue };
            std::mem::swap(&mut results[owner].around, &mut found.touches);
            results[owner].around.retain(|touch| touch.edge.is_some());
        }
    }

    /// Asks for exits of the touches with an edge that fit.
    pub(super) fn ask_exits(&mut self, fits: impl Fn(&Touch) -> bool) {
        let alone = self.groups.len() == 1;
        let again = self.round == Round::Exits;
        self.question.restart(QuestionKind::Exits);
        self.pick_touches([0.0; 3], |_, _, touch| touch.edge.is_some() && fits(touch));
        let Pass { question, targets, bodies, results, saves_bytes, .. } = self;
        let is_of_many = *saves_bytes && targets.0.len() > MANY_EXITS;
        for &(body, touch) in &targets.0 {
            let Some(edge) = results[body as usize].touches[touch as usize].edge else { continue };
            question.directions.push(edge.normal_world);
            if alone {
                question.hints.push(edge.camera);
            } else if !again {
                let told = bodies[body as usize].exits_within[touch as usize];
                question.within.push(told.unwrap_or_else(|| exit_reach(edge.distance_m, is_of_many)));
            }
        }
        if self.saves_bytes {
            return self.ask_distances(Round::Exits);
        }
        self.ask(Round::Exits, |_| true);
        if self.round == Round::Done {
            self.ask_body_exits();
        }
    }

    pub(super) fn after_exits(&mut self) {
        let rule = self.settings.rule();
        let Pass { targets, merged, results, question, .. } = self;
        let mut is_open = false;
        let mut changes = 0..0;
        for (at, (&(body, touch), &outside_m)) in targets.0.iter().zip(&merged.exits_m).enumerate() {
            let touch = &mut results[body as usize].touches[touch as usize];
            changes = changes_of(&merged.changes, at, changes.end);
            touch.exit_m = first_exit(outside_m, &merged.changes[changes.clone()], touch.inside_count, rule);
            is_open |= touch.exit_m.is_none() && question.bounds(at);
        }
        if is_open {
            return self.ask_exits(|touch| touch.exit_m.is_none());
        }
        self.ask_body_exits();
    }
}
