//! The rounds about bodies: how far a body must move along the mean of its samples' responses (paper §5).

use super::super::found::FoundSample;
use super::super::{Pass, PendingQuestion, Response, Round, changes_of, exit_reach};
use super::result::response_m;
use super::{NoResponse, PaperBody};
use crate::merge::{first_exit, inside_count};
use crate::question::{Edge, Points, QuestionKind};
use crate::reach::Reach;
use crate::response::BodyDirection;

/// What is known of a sample's exit along its body's direction.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Along {
    /// Nothing, and it need not be.
    Unknown,
    /// Nothing, but it may be longer than the body's response.
    Wanted,
    /// It is asked for.
    Asked,
    /// The body's response is at least so long.
    Known,
}

/// Samples of a body whose exits along its direction are asked for first, of one group alone: few, since it may
/// be asked again for nothing.
const FARTHEST_BACK: usize = 4;
/// Of several groups all of a body are asked for, if they are no more than this: then the check finds no other,
/// and rounds cost more than answers.
const ALL: usize = 48;
/// Else, and where bytes are dear, so many.
const FARTHEST_BACK_OF_MANY: usize = 24;
/// A direction more oblique than this says little about where it leaves.
const LEAST_COSINE: f32 = 0.25;

impl Pass {
    /// Finds each body's direction, and asks for exits along it: of the samples that lie farthest back. Most
    /// others are outside once the body has moved so far; the check finds those that are not.
    pub(in crate::pass) fn ask_body_exits(&mut self) {
        let alone = self.groups.len() == 1;
        let Pass { bodies, response, trips, .. } = self;
        let Response::Paper(paper) = response else { return };
        let bodies = bodies.all().iter().zip(&mut paper.bodies);
        for (body, state) in bodies.filter(|(body, _)| body.is_near) {
            let mut direction = BodyDirection::default();
            let responses_m = body.found.iter().zip(&state.exits_m);
            let responses_m = responses_m.filter_map(|(found, &exit_m)| response_m(found.edge, exit_m));
            responses_m.for_each(|m| direction.add(m));
            state.direction = direction.unit();
            state.along.clear();
            state.along.resize(body.found.len(), Along::Unknown);
            if state.direction.is_some() {
                if !alone && !trips.saves_bytes && body.found.len() <= ALL {
                    state.along.fill(Along::Asked);
                } else {
                    let most = if alone { FARTHEST_BACK } else { FARTHEST_BACK_OF_MANY };
                    state.mark_farthest_back(&body.points, &body.found, Along::Unknown, most);
                }
            } else if !body.found.is_empty() {
                state.response_m = Err(NoResponse::NoDirection);
                state.left_inside = body.found.len();
            }
        }
        self.ask_marked();
    }

    /// Asks for exits along the body's direction of the samples that are marked.
    /// What several groups are asked first is asked within a reach: a longer exit shows in the check.
    fn ask_marked(&mut self) {
        let alone = self.groups.len() == 1;
        let is_first = self.round != Round::Check;
        let Pass { pending, bodies, response, trips, .. } = self;
        let Response::Paper(paper) = response else { return };
        pending.restart(QuestionKind::SharedExits);
        pending.pick(bodies.all(), |index, _, at, _| {
            let state = &paper.bodies[index];
            state.direction.is_some() && state.along.get(at) == Some(&Along::Asked)
        });
        let PendingQuestion { question, targets, .. } = pending;
        for of_body in targets.0.chunk_by(|a, b| a.0 == b.0) {
            let index = of_body[0].0 as usize;
            let (body, state) = (&bodies.all()[index], &paper.bodies[index]);
            question.directions.extend(state.direction);
            if alone {
                let camera = |&(_, at): &(u32, u32)| body.found[at as usize].edge;
                question.hints.extend(of_body.iter().map(|of| camera(of).map_or(0, |edge| edge.camera)));
            } else if is_first {
                let longest_m = state.exits_m.iter().flatten().copied().fold(0.0, f32::max);
                let farthest = if trips.saves_bytes {
                    exit_reach(longest_m, false)
                } else {
                    body.reaches.of_body(longest_m)
                };
                let reach = |&(_, at): &(u32, u32)| match state.direction {
                    Some(direction) if trips.saves_bytes => {
                        let (edge, exit_m) = (body.found[at as usize].edge, state.exits_m[at as usize]);
                        farthest.min(reach_along(direction, edge, exit_m))
                    }
                    _ => farthest,
                };
                question.within.extend(of_body.iter().map(reach));
            }
        }
        self.ask_distances(Round::BodyExits);
    }

    pub(in crate::pass) fn after_body_exits(&mut self) {
        let rule = self.settings.rule();
        let Pass { pending: PendingQuestion { question, targets, merged, .. }, bodies, response, .. } = self;
        let Response::Paper(paper) = response else { return };
        let mut changes = 0..0;
        for at in 0..targets.0.len() {
            let (body, sample) = targets.0[at];
            let inside_count = bodies.all()[body as usize].found[sample as usize].inside_count;
            changes = changes_of(&merged.changes, at, changes.end);
            let exit_m = first_exit(merged.exits_m[at], &merged.changes[changes.clone()], inside_count, rule);
            let state = &mut paper.bodies[body as usize];
            if exit_m.is_none() && question.bounds(at) {
                state.along[sample as usize] = Along::Unknown;
                continue;
            }
            state.along[sample as usize] = Along::Known;
            match exit_m {
                Some(exit_m) if exit_m > state.longest_m => {
                    state.longest_m = exit_m;
                    state.is_checked = false;
                }
                Some(_) => {}
                None => state.has_exits = false,
            }
        }
        self.ask_check();
    }

    /// Asks which samples inside of the bodies whose response is new are still inside after it.
    fn ask_check(&mut self) {
        let Pass { pending, bodies, response, .. } = self;
        let Response::Paper(paper) = response else { return };
        pending.restart(QuestionKind::Classes);
        let PendingQuestion { question, targets, .. } = pending;
        for (index, (body, state)) in bodies.all().iter().zip(&mut paper.bodies).enumerate() {
            let Some(direction) = state.direction else { continue };
            if !state.has_exits {
                state.response_m = Err(NoResponse::NoExit);
                state.left_inside = body.found.len();
                continue;
            }
            if state.is_checked {
                continue;
            }
            state.is_checked = true;
            let response_m = direction.map(|part| f64::from(part) * f64::from(state.longest_m));
            state.response_m = Ok(response_m);
            state.left_inside = 0;
            targets.0.extend((0..body.found.len() as u32).map(|at| (index as u32, at)));
            question.pick(&body.points, response_m, body.found.iter().map(|found| found.sample));
        }
        if question.is_empty() {
            return self.ask_left();
        }
        self.ask(Round::Check, |_| true);
    }

    pub(in crate::pass) fn after_check(&mut self) {
        let rule = self.settings.rule();
        let Pass { pending: PendingQuestion { targets, merged, .. }, response, .. } = self;
        let Response::Paper(paper) = response else { return };
        for (&(body, sample), &standing) in targets.0.iter().zip(&merged.standings) {
            let state = &mut paper.bodies[body as usize];
            let is_inside = inside_count(standing, rule).is_some();
            state.left_inside += usize::from(is_inside);
            let along = &mut state.along[sample as usize];
            if *along != Along::Known {
                *along = if is_inside { Along::Wanted } else { Along::Unknown };
            }
        }
        self.ask_left();
    }

    /// Asks for the exits of samples that are still inside: they may be longer than the body's response, or
    /// the sample has left and is inside something else. One group alone is asked for few at a time, because
    /// nothing has to travel and the response that they give may free the others.
    fn ask_left(&mut self) {
        let alone = self.groups.len() == 1;
        let Pass { bodies, response, .. } = self;
        let Response::Paper(paper) = response else { return };
        let mut has_marked = false;
        let bodies = bodies.all().iter().zip(&mut paper.bodies);
        for (body, state) in bodies.filter(|(_, state)| state.direction.is_some() && state.has_exits) {
            if alone {
                has_marked |=
                    state.mark_farthest_back(&body.points, &body.found, Along::Wanted, FARTHEST_BACK);
                continue;
            }
            for along in state.along.iter_mut().filter(|along| **along == Along::Wanted) {
                *along = Along::Asked;
                has_marked = true;
            }
        }
        if has_marked { self.ask_marked() } else { self.round = Round::Done }
    }
}

/// How far an exit in a direction is searched at first where bytes are dear: a little farther than if the hull
/// ended there in the plane of the exit along the normal.
fn reach_along(direction: [f32; 3], edge: Option<Edge>, exit_m: Option<f32>) -> Reach {
    let (Some(edge), Some(exit_m)) = (edge, exit_m) else { return Reach::UNBOUNDED };
    let cosine: f32 = edge.normal_world.iter().zip(direction).map(|(n, d)| n * d).sum();
    Reach::covering(1.25 * f64::from(exit_m / cosine.max(LEAST_COSINE)) + 0.01).coarse()
}

impl PaperBody {
    /// Marks some samples of that state, those that lie farthest back along the body's direction; false if
    /// there are none.
    fn mark_farthest_back(&mut self, points: &Points, found: &[FoundSample], of: Along, most: usize) -> bool {
        let Some(direction) = self.direction else { return false };
        let world_along = points.along(direction);
        let mut farthest = [(f64::INFINITY, usize::MAX); FARTHEST_BACK_OF_MANY];
        for (at, found) in found.iter().enumerate().filter(|&(at, _)| self.along[at] == of) {
            let mut next = (world_along(found.sample), at);
            for place in &mut farthest[..most] {
                if next.0 < place.0 {
                    std::mem::swap(&mut next, place);
                }
            }
        }
        for (_, at) in farthest {
            if let Some(along) = self.along.get_mut(at) {
                *along = Along::Asked;
            }
        }
        farthest[0].1 != usize::MAX
    }
}
