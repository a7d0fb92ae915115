//! Exits of a group (spec §3.3).

use nalgebra::{Point3, Vector3};

use super::sights::{CHUNK, Sought};
use super::{Asked, Scratch, ViewSet};
use crate::camera::Pixel;
use crate::coordinates::Coordinates;
use crate::probe::exit::along;
use crate::question::{Answer, Change, NO_EXIT_M};
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
        let mut first = 0;
        for from in (0..points.len()).step_by(CHUNK) {
            let chunk = Chunk { from, count: (points.len() - from).min(CHUNK) };
            first = self.chunk_exits(asked, points, &chunk, first, scratch);
            answer.exits_m.extend_from_slice(&scratch.rays.exit_m[..chunk.count]);
        }
    }

    /// The exits of a chunk of points: first in the camera that is worth trying first, then in those that
    /// see anything but foreground before that. Returns the last winner.
    #[inline(always)]
    fn chunk_exits(
        &self,
        asked: &Asked,
        points: &Coordinates,
        chunk: &Chunk,
        mut first: usize,
        scratch: &mut Scratch,
    ) -> usize {
        let Scratch { sights, moved, rays, .. } = scratch;
        sights.look(&self.views, points, chunk.from, Sought::Place, self.path);
        moved.clear();
        for at in 0..chunk.count {
            let point = chunk.from + at;
            let (a, n) = (points.point(point), asked.direction(point));
            let n = Vector3::from(n.map(f64::from));
            first = self.hinted(asked, point, first);
            let view = &self.views[first];
            let reach_m = asked.reach(point);
            let exit_m = view.exit_within(&a, &n, limit_m(view, NO_EXIT_M, reach_m), reach_m);
            rays.exit_m[at] = exit_m;
            rays.tried[at] = first as u32;
            let end_m = exit_m.min(reach_m).min(self.most_depth_m);
            moved.push(along(&a, &n, end_m));
            rays.end_m[at] = end_m;
        }
        for (index, view) in self.views.iter().enumerate() {
            let sight = sights.of(index);
            let ends = &mut rays.ends;
            let (column, row) = (&mut ends.0[..chunk.count], &mut ends.1[..chunk.count]);
            view.frame().pixels(&moved.x, &moved.y, &moved.z, column, row);
            let bend_pixels = view.observer().bend_pixels() as f32;
            for at in 0..chunk.count {
                if sight.clear_m[at] > rays.end_m[at] || rays.tried[at] == index as u32 {
                    continue;
                }
                let start = Pixel { column: sight.column[at], row: sight.row[at] };
                let end = Pixel { column: ends.0[at], row: ends.1[at] };
                let bow = if bend_pixels == 0.0 { 0 } else { 1 };
                let is_bounded = bow == 0 || sight.bow_pixels(at, rays.end_m[at], bend_pixels) < 1.0;
                if is_bounded && is_clear(view, start, end, bow) {
                    continue;
                }
                let point = chunk.from + at;
                let (a, n) = (points.point(point), asked.direction(point));
                let n = Vector3::from(n.map(f64::from));
                let reach_m = asked.reach(point);
                let limit_m = limit_m(view, rays.exit_m[at], reach_m);
                let exit_m = view.exit_within(&a, &n, limit_m, reach_m);
                if exit_m < rays.exit_m[at] {
                    rays.exit_m[at] = exit_m;
                    first = index;
                }
            }
        }
        first
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

    /// Where the ray leaves when cameras may be silent; what happens before goes to `changes`.
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
        changes[begin..].sort_unstable_by(|a, b| a.t_m.total_cmp(&b.t_m).then(a.by.cmp(&b.by)));
        let end = exit_m.min(reach_m.next_up());
        changes.truncate(begin + changes[begin..].partition_point(|change| change.t_m < end));
        exit_m
    }
}

impl View {
    /// The first `t` outside if it is within reach, [`NO_EXIT_M`] if not.
    #[inline(always)]
    fn exit_within(&self, a: &Point3<f64>, n: &Vector3<f64>, limit_m: f64, reach_m: f32) -> f32 {
        match self.first_outside(a, n, limit_m) {
            Some(found_m) if found_m <= reach_m => found_m,
            _ => NO_EXIT_M,
        }
    }
}

/// True if the rectangle around two pixels, so many pixels larger on every side, is all foreground.
#[inline(always)]
fn is_clear(view: &View, a: Pixel, b: Pixel, larger: i32) -> bool {
    let (left, right) = (a.column.min(b.column) - larger, a.column.max(b.column) + larger);
    let (top, bottom) = (a.row.min(b.row) - larger, a.row.max(b.row) + larger);
    let corner = |column, row| Pixel { column, row };
    view.foreground().map().all_ones(corner(left, top), corner(right, bottom))
}

/// Some of a batch's points.
struct Chunk {
    from: usize,
    count: usize,
}

/// What is known of the rays of a chunk.
#[derive(Clone, Debug)]
pub(super) struct Rays {
    exit_m: [f32; CHUNK],
    /// How far the ray is of interest.
    end_m: [f32; CHUNK],
    /// The view that was searched first.
    tried: [u32; CHUNK],
    /// Where a view sees the ends: column and row.
    ends: ([i32; CHUNK], [i32; CHUNK]),
}

impl Default for Rays {
    fn default() -> Rays {
        Rays { exit_m: [0.0; CHUNK], end_m: [0.0; CHUNK], tried: [0; CHUNK], ends: ([0; CHUNK], [0; CHUNK]) }
    }
}

/// How far a view is searched: a little more than the reach, so that rounding leaves nothing out.
#[inline(always)]
fn limit_m(view: &View, exit_m: f32, reach_m: f32) -> f64 {
    f64::from(exit_m.min(reach_m * 1.00001)).min(view.observer().settings().max_depth_m())
}
