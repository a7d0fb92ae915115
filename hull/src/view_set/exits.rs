//! Exits of a group (spec §3.3).

use nalgebra::{Point3, Vector3};

use super::{Asked, Scratch, ViewSet};
use crate::coordinates::Coordinates;
use crate::probe::exit::along;
use crate::question::{Answer, Change, Kind, NO_EXIT_M, Standing};
use crate::view::View;

impl ViewSet {
    /// Appends the exits of a batch.
    #[inline(always)]
    pub(super) fn exits(
        &self,
        asked: &Asked,
        points: &Coordinates,
        scratch: &mut Scratch,
        answer: &mut Answer,
    ) {
        if !self.always_judge {
            for at in 0..points.len() {
                let exit_m = self.exit_with_silence(asked, at, &points.point(at), &mut answer.changes);
                answer.exits_m.push(exit_m);
            }
            return;
        }
        if asked.question.longest_alone && asked.question.kind == Kind::SharedExits {
            return self.longest_exit(asked, points, scratch, answer);
        }
        let mut first = 0;
        for at in 0..points.len() {
            let direction = Vector3::from(asked.direction(at).map(f64::from));
            first = self.hinted(asked, at, first);
            let exit_m = self.exit(&points.point(at), &direction, asked.reach(at), &mut first);
            answer.exits_m.push(exit_m);
        }
    }

    /// Of a batch with one direction, the longest exit; for the others, how long they are at most.
    ///
    /// A point that is outside once it has moved by the longest exit so far has a shorter one.
    #[inline(always)]
    fn longest_exit(&self, asked: &Asked, points: &Coordinates, scratch: &mut Scratch, answer: &mut Answer) {
        let direction = Vector3::from(asked.direction(0).map(f64::from));
        let begin = answer.exits_m.len();
        answer.exits_m.resize(begin + points.len(), NO_EXIT_M);
        let exits_m = &mut answer.exits_m[begin..];
        let Some(deepest) = least_along(points, &direction) else { return };
        let mut first = self.hinted(asked, deepest, 0);
        let mut longest_m = self.exit(&points.point(deepest), &direction, f32::INFINITY, &mut first);
        exits_m[deepest] = longest_m;
        let (moved, standings) = (&mut scratch.moved, &mut scratch.standings);
        moved.clear();
        if longest_m == NO_EXIT_M {
            // Then the body has none, whatever the others' are.
            return;
        }
        moved.extend((0..points.len()).map(|at| along(&points.point(at), &direction, longest_m).into()));
        standings.clear();
        self.append_standings(moved, &mut scratch.block, standings);
        for at in (0..points.len()).filter(|&at| at != deepest) {
            exits_m[at] = longest_m;
            if standings[at] == Standing::OUTSIDE {
                continue;
            }
            let exit_m = self.exit(&points.point(at), &direction, f32::INFINITY, &mut first);
            exits_m[at] = exit_m;
            if exit_m == NO_EXIT_M {
                return;
            }
            longest_m = longest_m.max(exit_m);
        }
    }

    /// The view that is worth trying first: the hinted camera's, or else the last winner.
    #[inline(always)]
    fn hinted(&self, asked: &Asked, at: usize, last: usize) -> usize {
        let Some(hint) = asked.hint(at) else { return last };
        if self.views[last].observer().rig_index() == hint {
            return last;
        }
        self.views.iter().position(|view| view.observer().rig_index() == hint).unwrap_or(last)
    }

    /// Where the ray from a point inside leaves, as far as this group knows and within reach.
    #[inline(always)]
    fn exit(&self, a: &Point3<f64>, n: &Vector3<f64>, reach_m: f32, first: &mut usize) -> f32 {
        let mut exit_m = NO_EXIT_M;
        let begin = *first;
        for order in 0..=self.views.len() {
            let index = if order == 0 { begin } else { order - 1 };
            if order > 0 && index == begin {
                continue;
            }
            let view = &self.views[index];
            let limit_m = limit_m(view, exit_m, reach_m);
            if let Some(found_m) = view.first_outside(a, n, limit_m)
                && found_m < exit_m
                && found_m <= reach_m
            {
                exit_m = found_m;
                *first = index;
            }
        }
        exit_m
    }

    /// The same when cameras may be silent; what happens before goes to `changes`.
    fn exit_with_silence(&self, asked: &Asked, at: usize, a: &Point3<f64>, changes: &mut Vec<Change>) -> f32 {
        let n = Vector3::from(asked.direction(at).map(f64::from));
        let (point, reach_m) = ((asked.first_point + at) as u32, asked.reach(at));
        let begin = changes.len();
        let mut exit_m = NO_EXIT_M;
        for view in &self.views {
            let found_m = view.exit_with_silence(a, &n, limit_m(view, exit_m, reach_m), point, changes);
            if found_m <= reach_m {
                exit_m = exit_m.min(found_m);
            }
        }
        changes[begin..].sort_by(|a, b| a.t_m.total_cmp(&b.t_m).then(a.by.cmp(&b.by)));
        let end = exit_m.min(reach_m.next_up());
        changes.truncate(begin + changes[begin..].partition_point(|change| change.t_m < end));
        exit_m
    }
}

/// How far a view is searched: a little more than the reach, so that rounding leaves nothing out.
#[inline(always)]
fn limit_m(view: &View, exit_m: f32, reach_m: f32) -> f64 {
    f64::from(exit_m.min(reach_m * 1.00001)).min(view.observer().settings().max_depth_m())
}

/// The point that lies farthest back along a direction.
#[inline(always)]
fn least_along(points: &Coordinates, direction: &Vector3<f64>) -> Option<usize> {
    let place = |at: usize| points.point(at).coords.dot(direction);
    (0..points.len()).min_by(|&a, &b| place(a).total_cmp(&place(b)))
}
