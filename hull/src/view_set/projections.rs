//! Where a group's cameras see a chunk of points: computed for all at once, before each is searched by itself.

use crate::camera::Pixel;
use crate::coordinates::Coordinates;
use crate::silhouette::Index;
use crate::vector::VectorPath;
use crate::view::{Class, View};

/// Points that are projected together.
pub(super) const CHUNK: usize = 64;

/// A chunk of points as one camera sees them.
#[derive(Clone, Copy, Debug)]
pub(super) struct Projection {
    /// Their pixels.
    pub column: [i32; CHUNK],
    /// Their pixels.
    pub row: [i32; CHUNK],
    /// Nothing but foreground is nearer than this, metres; not a number if the camera does not say inside.
    pub clear_m: [f32; CHUNK],
    depth_m: [f32; CHUNK],
    range_m: [f32; CHUNK],
    clear_pixels: [f32; CHUNK],
    stretch_pixels: f32,
}

/// The projections of all cameras of a group.
#[derive(Clone, Debug, Default)]
pub(super) struct Projections {
    views: Vec<Projection>,
    least: LeastClear,
}

/// For each point the view that is clear least far.
#[derive(Clone, Debug)]
struct LeastClear {
    clear_m: [f32; CHUNK],
    view: [u32; CHUNK],
}

impl Default for LeastClear {
    fn default() -> LeastClear {
        LeastClear { clear_m: [0.0; CHUNK], view: [0; CHUNK] }
    }
}

/// What is searched for, starting at a point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum SearchTarget {
    /// The centre of a background pixel, from a place anywhere in the point's pixel.
    PixelCentre,
    /// Any place in a background pixel.
    AnyPlace,
}

impl SearchTarget {
    /// What pixels between two centres may be more than the clear distance, by half a diagonal an end.
    #[inline(always)]
    fn slack_pixels(self) -> f32 {
        match self {
            SearchTarget::PixelCentre => 0.7072,
            SearchTarget::AnyPlace => 1.4143,
        }
    }

    #[inline(always)]
    fn index(self, view: &View) -> &Index {
        match self {
            SearchTarget::PixelCentre => view.edge_candidates(),
            SearchTarget::AnyPlace => view.foreground(),
        }
    }
}

impl Projections {
    /// Projects the points of a chunk, which begins at `from`.
    #[inline(always)]
    pub fn project(
        &mut self,
        views: &[View],
        points: &Coordinates,
        from: usize,
        target: SearchTarget,
        path: VectorPath,
    ) {
        let nothing = [0.0; CHUNK];
        let blank = Projection {
            column: [0; CHUNK],
            row: [0; CHUNK],
            clear_m: nothing,
            depth_m: nothing,
            range_m: nothing,
            clear_pixels: nothing,
            stretch_pixels: 0.0,
        };
        self.views.resize(views.len(), blank);
        self.least.clear_m = [f32::INFINITY; CHUNK];
        for ((projection, view), index) in self.views.iter_mut().zip(views).zip(0..) {
            projection.project(view, points, from, target, path);
            let LeastClear { clear_m, view } = &mut self.least;
            for at in 0..CHUNK {
                let is_less = projection.clear_m[at] < clear_m[at];
                clear_m[at] = if is_less { projection.clear_m[at] } else { clear_m[at] };
                view[at] = if is_less { index } else { view[at] };
            }
        }
    }

    /// The view that is clear least far, if any says inside; a hint.
    #[inline(always)]
    pub fn least_clear(&self, at: usize) -> usize {
        (self.least.view[at] as usize).min(self.views.len() - 1)
    }

    /// The projection into a view.
    #[inline(always)]
    pub fn of(&self, view: usize) -> &Projection {
        &self.views[view]
    }
}

impl Projection {
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

    /// How far the image of a ray of that length from a point may be from its chord, pixels.
    #[inline(always)]
    pub fn bow_pixels(&self, at: usize, length_m: f32, bend_pixels: f32) -> f32 {
        let (depth_m, range_m) = (self.depth_m[at], self.range_m[at]);
        let left_m = depth_m - 1.00001 * length_m;
        let tangent = length_m * range_m / (depth_m * left_m);
        if left_m > 0.0 { 0.126 * bend_pixels * tangent * tangent } else { f32::INFINITY }
    }

    #[inline(always)]
    fn project(
        &mut self,
        view: &View,
        points: &Coordinates,
        from: usize,
        target: SearchTarget,
        path: VectorPath,
    ) {
        let count = (points.len() - from).min(CHUNK);
        let coefficients = view.coefficients();
        let range = from..from + count;
        let (x, y, z) = (&points.x[range.clone()], &points.y[range.clone()], &points.z[range]);
        coefficients.pixels(x, y, z, &mut self.column[..count], &mut self.row[..count]);
        coefficients.ranges(x, y, z, &mut self.depth_m[..count], &mut self.range_m[..count]);
        let (index, slack_pixels) = (target.index(view), target.slack_pixels());
        let looked_up = (&self.column[..count], &self.row[..count], &mut self.clear_pixels[..count]);
        index.depth().look_up(looked_up.0, looked_up.1, looked_up.2, path);
        for at in 0..count {
            let clear_pixels = self.clear_pixels[at];
            // A cell that is full of foreground is inside.
            let inside = if clear_pixels > 0.0 && view.is_plain() {
                true
            } else {
                view.class_at(Some(Pixel { column: self.column[at], row: self.row[at] })) == Class::Inside
            };
            self.clear_pixels[at] = if inside { (clear_pixels - slack_pixels).max(0.0) } else { f32::NAN };
        }
        let stretch = 1.0001 * view.observer().stretch_pixels() as f32;
        self.stretch_pixels = stretch;
        let tangents = 1.0 / (1.00001 * view.observer().stretch_pixels() as f32);
        for at in 0..count {
            // The nearest ray that matters passes the point at this tangent or more.
            let apart = self.clear_pixels[at] * tangents;
            let (depth_m, range_m) = (self.depth_m[at], self.range_m[at]);
            self.clear_m[at] = 0.9999 * depth_m * depth_m * apart / (range_m + depth_m * apart);
        }
    }
}
