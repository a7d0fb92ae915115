//! Where a group's cameras see a few points: found for many at once before each is searched by itself.

use crate::coordinates::Coordinates;
use crate::view::{Class, View};

/// Points that are looked at together.
pub(super) const CHUNK: usize = 64;

/// One camera's view of a chunk of points.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sight {
    /// Their pixels.
    pub column: [i32; CHUNK],
    /// Their pixels.
    pub row: [i32; CHUNK],
    /// No edge is nearer than this, metres; infinite if the camera does not say inside.
    pub least_m: [f32; CHUNK],
    depth_m: [f32; CHUNK],
    range_m: [f32; CHUNK],
}

/// The sights of all cameras of a group.
#[derive(Clone, Debug, Default)]
pub(super) struct Sights(Vec<Sight>);

/// A pixel's centre and a projection in it are at most so far apart, pixels.
const HALF_DIAGONAL: f32 = 0.7072;

impl Sights {
    /// Looks at the points of a chunk, which begins at `from`.
    #[inline(always)]
    pub fn look(&mut self, views: &[View], points: &Coordinates, from: usize) {
        let nothing = [0.0; CHUNK];
        let blank = Sight {
            column: [0; CHUNK],
            row: [0; CHUNK],
            least_m: nothing,
            depth_m: nothing,
            range_m: nothing,
        };
        self.0.resize(views.len(), blank);
        for (sight, view) in self.0.iter_mut().zip(views) {
            sight.look(view, points, from);
        }
    }

    /// What a view sees.
    #[inline(always)]
    pub fn of(&self, view: usize) -> &Sight {
        &self.0[view]
    }
}

impl Sight {
    #[inline(always)]
    fn look(&mut self, view: &View, points: &Coordinates, from: usize) {
        let count = (points.len() - from).min(CHUNK);
        let frame = view.frame();
        let range = from..from + count;
        let (x, y, z) = (&points.x[range.clone()], &points.y[range.clone()], &points.z[range]);
        frame.pixels(x, y, z, &mut self.column[..count], &mut self.row[..count]);
        frame.ranges(x, y, z, &mut self.depth_m[..count], &mut self.range_m[..count]);
        let stretch = 1.00001 * view.observer().stretch_pixels() as f32;
        let depth = view.edge_candidates().depth();
        for at in 0..count {
            let (column, row) = (self.column[at], self.row[at]);
            let clear_pixels = depth.clear_pixels(column, row) - HALF_DIAGONAL;
            // The nearest ray that may be an edge passes the point at this tangent or more.
            let apart = clear_pixels.max(0.0) / stretch;
            let (depth_m, range_m) = (self.depth_m[at], self.range_m[at]);
            let least_m = 0.9999 * depth_m * depth_m * apart / (range_m + depth_m * apart);
            let inside = view.class_of(column, row) == Class::Inside;
            self.least_m[at] = if inside { least_m } else { f32::INFINITY };
        }
    }
}
