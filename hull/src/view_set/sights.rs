//! Where a group's cameras see a few points: found for many at once before each is searched by itself.

use crate::coordinates::Coordinates;
use crate::silhouette::Index;
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
    /// Nothing but foreground is nearer than this, metres; below zero if the camera does not say inside.
    pub clear_m: [f32; CHUNK],
    depth_m: [f32; CHUNK],
    range_m: [f32; CHUNK],
    clear_pixels: [f32; CHUNK],
    stretch_pixels: f32,
}

/// The sights of all cameras of a group.
#[derive(Clone, Debug, Default)]
pub(super) struct Sights(Vec<Sight>);

/// What the camera does not call inside.
pub(super) const NOT_INSIDE_M: f32 = -1.0;

/// What is searched for from a point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Sought {
    /// The centre of a background pixel, from a place anywhere in the point's pixel.
    Centre,
    /// Any place in a background pixel.
    Place,
}

impl Sought {
    /// What pixels between two centres may be more than the clear distance, by half a diagonal an end.
    #[inline(always)]
    fn slack_pixels(self) -> f32 {
        match self {
            Sought::Centre => 0.7072,
            Sought::Place => 1.4143,
        }
    }

    #[inline(always)]
    fn index(self, view: &View) -> &Index {
        match self {
            Sought::Centre => view.edge_candidates(),
            Sought::Place => view.foreground(),
        }
    }
}

impl Sights {
    /// Looks at the points of a chunk, which begins at `from`.
    #[inline(always)]
    pub fn look(&mut self, views: &[View], points: &Coordinates, from: usize, sought: Sought) {
        let nothing = [0.0; CHUNK];
        let blank = Sight {
            column: [0; CHUNK],
            row: [0; CHUNK],
            clear_m: nothing,
            depth_m: nothing,
            range_m: nothing,
            clear_pixels: nothing,
            stretch_pixels: 0.0,
        };
        self.0.resize(views.len(), blank);
        for (sight, view) in self.0.iter_mut().zip(views) {
            sight.look(view, points, from, sought);
        }
    }

    /// What a view sees.
    #[inline(always)]
    pub fn of(&self, view: usize) -> &Sight {
        &self.0[view]
    }
}

impl Sight {
    /// The pixel distance beyond which no pixel's ray comes as near as `distance_m` to a point.
    ///
    /// A ray that near meets a point `b` with `|a − b| ≤ distance`, at a depth of at least `z − distance`;
    /// its projection is at most `distance · √(1 + x² + y²) / (z − distance)` away in normalised
    /// coordinates, times the image's stretch, plus half a pixel's diagonal because the search starts
    /// from a centre.
    #[inline(always)]
    pub fn pixels_within(&self, at: usize, distance_m: f32) -> f32 {
        let (depth_m, range_m) = (self.depth_m[at], self.range_m[at]);
        let left_m = depth_m - 1.00001 * distance_m;
        if left_m <= 0.0 || distance_m == f32::INFINITY {
            return f32::INFINITY;
        }
        self.stretch_pixels * distance_m * range_m / (depth_m * left_m) + 0.7073
    }

    #[inline(always)]
    fn look(&mut self, view: &View, points: &Coordinates, from: usize, sought: Sought) {
        let count = (points.len() - from).min(CHUNK);
        let frame = view.frame();
        let range = from..from + count;
        let (x, y, z) = (&points.x[range.clone()], &points.y[range.clone()], &points.z[range]);
        frame.pixels(x, y, z, &mut self.column[..count], &mut self.row[..count]);
        frame.ranges(x, y, z, &mut self.depth_m[..count], &mut self.range_m[..count]);
        let index = sought.index(view);
        let (depth, slack_pixels) = (index.depth(), sought.slack_pixels());
        for at in 0..count {
            let (column, row) = (self.column[at], self.row[at]);
            let clear_pixels = depth.clear_pixels(column, row);
            // A cell that is full of foreground is inside.
            let inside = if clear_pixels > 0.0 && view.is_plain() {
                true
            } else {
                view.class_of(column, row) == Class::Inside
            };
            self.clear_pixels[at] = if inside { (clear_pixels - slack_pixels).max(0.0) } else { -1.0 };
        }
        let stretch = 1.0001 * view.observer().stretch_pixels() as f32;
        self.stretch_pixels = stretch;
        let tangents = 1.0 / (1.00001 * view.observer().stretch_pixels() as f32);
        for at in 0..count {
            // The nearest ray that matters passes the point at this tangent or more.
            let apart = self.clear_pixels[at] * tangents;
            let (depth_m, range_m) = (self.depth_m[at], self.range_m[at]);
            let clear_m = 0.9999 * depth_m * depth_m * apart / (range_m + depth_m * apart);
            self.clear_m[at] = if apart < 0.0 { NOT_INSIDE_M } else { clear_m };
        }
    }
}
