//! The rounds about bodies: how far a body must move along the mean of its samples' responses (paper §5).

use super::{BodyResult, NoResponse, Pass, PassBody, Round, Touch, changes_of, exit_reach};
use crate::merge::{first_exit, inside_count};
use crate::question::QuestionKind;
use crate::reach::Reach;
use crate::response::BodyDirection;

/// What is known of a touch's exit along its body's direction.
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

/// Touches of a body whose exits along its direction are asked for first, of one group alone: few, since it may
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
    /// Finds each body's direction, and asks for exits along it: of the touches that lie farthest back. Most
    /// others are outside once the body has moved so far; the check finds those that are not.
    pub(super) fn ask_body_exits(&mut self) {
        let alone = self.groups.len() == 1;
        let Pass { bodies, results, count, saves_bytes, .. } = self;
        for (body, result) in bodies[..*count].iter_mut().zip(results).filter(|(body, _)| body.is_near) {
            let mut direction = BodyDirection::default();
            result.touches.iter().filter_map(Touch::response_m).for_each(|m| direction.add(m));
            body.direction = direction.unit();
            body.along.clear();
            body.along.resize(result.touches.len(), Along::Unknown);
            if body.direction.is_some() {
                if !alone && !*saves_bytes && result.touches.len() <= ALL {
                    body.along.fill(Along::Asked);
                } else {
                    let most = if alone { FARTHEST_BACK } else { FARTHEST_BACK_OF_MANY };
                    body.mark_farthest_back(&result.touches, Along::Unknown, most);
                }
            } else if !result.touches.is_empty() {
                result.response_m = Err(NoResponse::NoDirection);
                result.left_inside = result.touches.len();
            }
        }
        self.ask_marked();
    }

    /// Asks for exits along the body's direction of the touches that are marked.
    /// What several groups are asked first is asked within a reach: a longer exit shows in the check.
    pub(super) fn ask_marked(&mut self) {
        let alone = self.groups.len() == 1;
        let is_first = self.round != Round::Check;
        self.question.restart(QuestionKind::SharedExits);
        self.pick_touches([0.0; 3], |body, at, _| {
            body.direction.is_some() && body.along.get(at) == Some(&Along::Asked)
        });
        let Pass { question, targets, bodies, results, saves_bytes, .. } = self;
        for of_body in targets.0.chunk_by(|a, b| a.0 == b.0) {
            let index = of_body[0].0 as usize;
            question.directions.extend(bodies[index].direction);
            if alone {
                let camera = |&(_, touch): &(u32, u32)| results[index].touches[touch as usize].edge;
                question.hints.extend(of_body.iter().map(|of| camera(of).map_or(0, |edge| edge.camera)));
            } else if is_first {
                let exits_m = results[index].touches.iter().filter_map(|touch| touch.exit_m);
                let longest_m = exits_m.fold(0.0, f32::max);
                let farthest = if *saves_bytes {
                    exit_reach(longest_m, false)
                } else {
                    bodies[index].reaches.of_body(longest_m)
                };
                let reach = |&(_, touch): &(u32, u32)| match bodies[index].direction {
                    Some(direction) if *saves_bytes => {
                        farthest.min(results[index].touches[touch as usize].reach_along(direction))
                    }
                    _ => farthest,
                };
                question.within.extend(of_body.iter().map(reach));
            }
        }
        self.ask_distances(Round::BodyExits);
    }

    pub(super) fn after_body_exits(&mut self) {
        let rule = self.settings.rule();
        let Pass { targets, merged, results, question, bodies, .. } = self;
        let mut changes = 0..0;
        for at in 0..targets.0.len() {
            let (body, touch) = targets.0[at];
            let inside_count = results[body as usize].touches[touch as usize].inside_count;
            changes = changes_of(&merged.changes, at, changes.end);
            let exit_m = first_exit(merged.exits_m[at], &merged.changes[changes.clone()], inside_count, rule);
            let state = &mut bodies[body as usize];
            if exit_m.is_none() && question.bounds(at) {
                state.along[touch as usize] = Along::Unknown;
                continue;
            }
            state.along[touch as usize] = Along::Known;
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

    /// Asks which touches of the bodies whose response is new are still inside after it.
    pub(super) fn ask_check(&mut self) {
        let Pass { bodies, results, count, question, targets, .. } = self;
        question.restart(QuestionKind::Classes);
        targets.0.clear();
        for (index, (body, result)) in bodies[..*count].iter_mut().zip(results).enumerate() {
            let Some(direction) = body.direction else { continue };
            if !body.has_exits {
                result.response_m = Err(NoResponse::NoExit);
                result.left_inside = result.touches.len();
                continue;
            }
            if body.is_checked {
                continue;
            }
            body.is_checked = true;
            let response_m = direction.map(|part| f64::from(part) * f64::from(body.longest_m));
            result.response_m = Ok(response_m);
            result.left_inside = 0;
            targets.0.extend((0..result.touches.len() as u32).map(|touch| (index as u32, touch)));
            question.pick(&body.points, response_m, result.touches.iter().map(|touch| touch.sample));
        }
        if question.is_empty() {
            return self.ask_left();
        }
        self.ask(Round::Check, |_| true);
    }

    pub(super) fn after_check(&mut self) {
        let rule = self.settings.rule();
        for (&(body, touch), &standing) in self.targets.0.iter().zip(&self.merged.standings) {
            let result = &mut self.results[body as usize];
            let is_inside = inside_count(standing, rule).is_some();
            result.left_inside += usize::from(is_inside);
            let along = &mut self.bodies[body as usize].along[touch as usize];
            if *along != Along::Known {
                *along = if is_inside { Along::Wanted } else { Along::Unknown };
            }
        }
        self.ask_left();
    }

    /// Asks for the exits of touches that are still inside: they may be longer than the body's response, or
    /// the touch has left and is inside something else. One group alone is asked for few at a time, because
    /// nothing has to travel and the response that they give may free the others.
    pub(super) fn ask_left(&mut self) {
        let alone = self.groups.len() == 1;
        let Pass { bodies, results, count, .. } = self;
        let mut has_marked = false;
        let open = |(body, _): &(&mut PassBody, &BodyResult)| body.direction.is_some() && body.has_exits;
        for (body, result) in bodies[..*count].iter_mut().zip(&*results).filter(open) {
            if alone {
                has_marked |= body.mark_farthest_back(&result.touches, Along::Wanted, FARTHEST_BACK);
                continue;
            }
            for along in body.along.iter_mut().filter(|along| **along == Along::Wanted) {
                *along = Along::Asked;
                has_marked = true;
            }
        }
        if has_marked { self.ask_marked() } else { self.round = Round::Done }
    }
}

impl Touch {
    /// How far its exit in a direction is searched at first where bytes are dear: a little farther than if the hull
    /// ended there in the plane of its exit along its normal.
    fn reach_along(&self, direction: [f32; 3]) -> Reach {
        let (Some(edge), Some(exit_m)) = (self.edge, self.exit_m) else { return Reach::UNBOUNDED };
        let cosine: f32 = edge.normal_world.iter().zip(direction).map(|(n, d)| n * d).sum();
        Reach::covering(1.25 * f64::from(exit_m / cosine.max(LEAST_COSINE)) + 0.01).coarse()
    }
}

impl PassBody {
    /// Marks some touches of that state, those that lie farthest back along the body's direction; false if
    /// there are none.
    fn mark_farthest_back(&mut self, touches: &[Touch], of: Along, most: usize) -> bool {
        let Some(direction) = self.direction else { return false };
        let world_along = self.points.along(direction);
        let mut farthest = [(f64::INFINITY, usize::MAX); FARTHEST_BACK_OF_MANY];
        for (at, touch) in touches.iter().enumerate().filter(|&(at, _)| self.along[at] == of) {
            let mut next = (world_along(touch.sample), at);
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
