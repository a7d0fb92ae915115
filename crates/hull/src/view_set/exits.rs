//! Exits of a group (spec §3.3).

use nalgebra::{Point3, Vector3};

use super::projections::{CHUNK, Projection, SearchTarget};
use super::selection::Selection;
use super::{BatchQuestion, Scratch, ViewSet};
use crate::camera::Pixel;
use crate::coordinates::Coordinates;
use crate::probe::coefficients::OFF_IMAGE;
use crate::question::{Answer, Change, NO_EXIT_M};
use crate::view::View;

impl ViewSet {
    /// Appends the exits of a batch.
    #[inline(always)]
    pub(super) fn exits(
        &self,
        batch: &BatchQuestion,
        points: &Coordinates,
        scratch: &mut Scratch,
        answer: &mut Answer,
    ) {
        if !self.always_judge {
            for at in 0..points.len() {
                let exit_m = self.exit_with_silence(batch, at, &points.point(at), &mut answer.changes);
                answer.exits_m.push(exit_m);
            }
            return;
        }
        for from in (0..points.len()).step_by(CHUNK) {
            let chunk = Chunk { from, count: (points.len() - from).min(CHUNK) };
            self.chunk_exits(batch, points, &chunk, scratch);
            answer.exits_m.extend_from_slice(&scratch.rays.exit_m[..chunk.count]);
        }
    }

    /// The exits of a chunk of points: first in the camera that is worth trying first, then in those that
    /// see anything but foreground before that.
    #[inline(always)]
    fn chunk_exits(&self, batch: &BatchQuestion, points: &Coordinates, chunk: &Chunk, scratch: &mut Scratch) {
        let Scratch { projections, rays, .. } = scratch;
        projections.project(&self.views, points, chunk.from, SearchTarget::AnyPlace, self.path);
        rays.begin(batch, chunk, self.most_depth_m);
        for at in 0..chunk.count {
            rays.first[at] =
                self.hinted(batch, chunk.from + at).unwrap_or(projections.least_clear(at)) as u32;
        }
        let turns: &[bool] = if self.views.len() == 1 { &[true] } else { &[true, false] };
        for &is_first in turns {
            for (index, view) in self.views.iter().enumerate() {
                let projection = projections.of(index);
                rays.selection.select(chunk.count, |at| {
                    let may_leave = projection.clear_m[at] <= rays.end_m[at];
                    may_leave & ((rays.first[at] == index as u32) == is_first)
                });
                rays.leave(view, projection, points, chunk.from);
            }
        }
    }

    /// The view that is worth trying first.
    #[inline(always)]
    fn hinted(&self, batch: &BatchQuestion, at: usize) -> Option<usize> {
        let hint = batch.hint(at)?;
        // Most often all cameras of the rig are here.
        let is_hinted = |view: &View| view.observer().rig_index() == hint;
        let same = usize::from(hint);
        if self.views.get(same).is_some_and(is_hinted) {
            return Some(same);
        }
        self.views.iter().position(is_hinted)
    }

    /// Where the ray leaves when cameras may be silent; what happens before goes to `changes`.
    fn exit_with_silence(
        &self,
        batch: &BatchQuestion,
        at: usize,
        a: &Point3<f64>,
        changes: &mut Vec<Change>,
    ) -> f32 {
        let n = Vector3::from(batch.direction(at).map(f64::from));
        let (point, reach_m) = ((batch.first_point + at) as u32, batch.reach(at));
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

impl Rays {
    /// Takes a chunk's directions and reaches.
    #[inline(always)]
    fn begin(&mut self, batch: &BatchQuestion, chunk: &Chunk, most_depth_m: f32) {
        for at in 0..chunk.count {
            let n = batch.direction(chunk.from + at);
            self.n.x[at] = f64::from(n[0]);
            self.n.y[at] = f64::from(n[1]);
            self.n.z[at] = f64::from(n[2]);
        }
        batch.reaches(chunk.from, &mut self.reach_m[..chunk.count]);
        for at in 0..CHUNK {
            self.exit_m[at] = NO_EXIT_M;
            self.end_m[at] = self.reach_m[at].min(most_depth_m);
        }
    }

    /// Finds the exits of the picked rays from a view, as far as they are of interest.
    #[inline(always)]
    fn leave(&mut self, view: &View, projection: &Projection, points: &Coordinates, from: usize) {
        let count = self.selection.len();
        let Rays { moved, n, ends, .. } = self;
        for (place, at) in self.selection.iter().enumerate() {
            let (a, end_m) = (points.point(from + at), f64::from(self.end_m[at]));
            moved.x[place] = a.x + end_m * n.x[at];
            moved.y[place] = a.y + end_m * n.y[at];
            moved.z[place] = a.z + end_m * n.z[at];
        }
        let (column, row) = (&mut ends.0[..count], &mut ends.1[..count]);
        view.coefficients().pixels(&moved.x[..count], &moved.y[..count], &moved.z[..count], column, row);
        let bend_pixels = view.observer().bounds().bend as f32;
        for (place, at) in self.selection.iter().enumerate() {
            let end = Pixel { column: self.ends.0[place], row: self.ends.1[place] };
            if projection.is_clear_to(view, at, end, self.end_m[at], bend_pixels) {
                continue;
            }
            let reach_m = self.reach_m[at];
            let limit_m = limit_m(view, self.exit_m[at], reach_m);
            let (a, n) = (points.point(from + at), Vector3::new(self.n.x[at], self.n.y[at], self.n.z[at]));
            let exit_m = view.exit_within(&a, &n, limit_m, reach_m);
            if exit_m < self.exit_m[at] {
                self.exit_m[at] = exit_m;
                self.end_m[at] = self.end_m[at].min(exit_m);
            }
        }
    }
}

impl Projection {
    /// True if all that a view sees of a ray from a point to its end is foreground.
    #[inline(always)]
    fn is_clear_to(&self, view: &View, at: usize, end: Pixel, end_m: f32, bend_pixels: f32) -> bool {
        if end.column == OFF_IMAGE {
            return false;
        }
        let start = Pixel { column: self.column[at], row: self.row[at] };
        let bow = if bend_pixels == 0.0 { 0 } else { 1 };
        if bow != 0 && self.bow_pixels(at, end_m, bend_pixels) >= 1.0 {
            return false;
        }
        let (left, right) = (start.column.min(end.column) - bow, start.column.max(end.column) + bow);
        let (top, bottom) = (start.row.min(end.row) - bow, start.row.max(end.row) + bow);
        let corner = |column, row| Pixel { column, row };
        view.foreground().map().all_ones(corner(left, top), corner(right, bottom))
    }
}

/// Some of a batch's points.
struct Chunk {
    from: usize,
    count: usize,
}

/// A number of each point of a chunk, for each axis.
#[derive(Clone, Debug)]
struct Axes {
    x: [f64; CHUNK],
    y: [f64; CHUNK],
    z: [f64; CHUNK],
}

impl Default for Axes {
    fn default() -> Axes {
        Axes { x: [0.0; CHUNK], y: [0.0; CHUNK], z: [0.0; CHUNK] }
    }
}

/// What is known of the rays of a chunk.
#[derive(Clone, Debug)]
pub(super) struct Rays {
    n: Axes,
    reach_m: [f32; CHUNK],
    exit_m: [f32; CHUNK],
    /// How far the ray is of interest.
    end_m: [f32; CHUNK],
    /// The view that is searched first.
    first: [u32; CHUNK],
    selection: Selection,
    /// The ends of the picked rays.
    moved: Axes,
    /// Where a view sees them: column and row.
    ends: ([i32; CHUNK], [i32; CHUNK]),
}

impl Default for Rays {
    fn default() -> Rays {
        Rays {
            n: Axes::default(),
            reach_m: [0.0; CHUNK],
            exit_m: [0.0; CHUNK],
            end_m: [0.0; CHUNK],
            first: [0; CHUNK],
            selection: Selection::default(),
            moved: Axes::default(),
            ends: ([0; CHUNK], [0; CHUNK]),
        }
    }
}

/// How far a view is searched: a little more than the reach, so that rounding leaves nothing out.
#[inline(always)]
fn limit_m(view: &View, exit_m: f32, reach_m: f32) -> f64 {
    f64::from(exit_m.min(reach_m * 1.00001)).min(view.observer().settings().max_depth_m())
}
