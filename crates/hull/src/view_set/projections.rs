//! Where a group's cameras see a chunk of points: computed for all at once, before each is searched by itself.

use crate::camera::Pixel;
use crate::coordinates::Coordinates;
use crate::silhouette::Index;
use crate::vector::VectorPath;
use crate::view::{Class, View};

/// Points that are projected together.
pub(super) const CHUNK: usize = 64;

/// From outside no plane is searched farther than 256 pixels, squared: nothing makes such a search quick.
const OUTSIDE_SQUARED: f32 = 65_536.0;

/// Bounds in single precision are so much wider.
const SCALE_MARGIN: f32 = 1.0002;

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
    /// A pixel at unit distance is no wider than this; in a lens that bends, of the distance from the centre.
    pixel_m: f32,
    is_straight: bool,
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
            pixel_m: 0.0,
            is_straight: true,
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
        let is_endless = (left_m <= 0.0) | (distance_m == f32::INFINITY);
        let pixels = self.stretch_pixels * distance_m * range_m / (depth_m * left_m) + 0.7073;
        if is_endless { f32::INFINITY } else { pixels }
    }

    /// No plane through the camera's centre and a line of the image is farther from a point than this, metres, if the
    /// line has a place within so many pixels of the point's image.
    ///
    /// Through a straight lens the distance from a line `l` is that of the plane `Pᵀl`, times the point's depth. Else
    /// the plane holds the ray through that place, which passes the point at the sine of the angle between them.
    #[inline(always)]
    pub fn metres_within(&self, at: usize, pixels: f32) -> f32 {
        SCALE_MARGIN * pixels * self.pixel_m * self.away_m()[at] + self.rounding_m(at)
    }

    /// What rounding to single precision adds to the distance of a plane, metres: of its normal, as far as the camera is away.
    #[inline(always)]
    fn rounding_m(&self, at: usize) -> f32 {
        1e-6 + 2e-7 * self.range_m[at]
    }

    #[inline(always)]
    fn away_m(&self) -> &[f32; CHUNK] {
        if self.is_straight { &self.depth_m } else { &self.range_m }
    }

    /// Of points that the camera sees on its image and not inside, how far planes from outside may be, metres, and how
    /// far the foreground is searched, pixels squared, if it is no nearer than the one of these arrays and within the
    /// other. Of all others −1.
    #[inline(always)]
    pub fn bounds_beside(
        &self,
        (width, height): (u32, u32),
        reaches_m: &[f32; CHUNK],
        slack_pixels: f32,
        [clear_squared, within_squared]: [&[i32; CHUNK]; 2],
        (most_m, limit_squared): (&mut [f32; CHUNK], &mut [i32; CHUNK]),
    ) {
        let (away_m, scale) = (self.away_m(), SCALE_MARGIN * self.pixel_m);
        for at in 0..CHUNK {
            let limit_pixels = self.pixels_within(at, reaches_m[at]);
            // Not a number where the camera sees nothing: below, such a point is no point on the image.
            let squared = limit_pixels * limit_pixels;
            let squared = if squared < OUTSIDE_SQUARED { squared } else { OUTSIDE_SQUARED };
            let limit = squared as i32 + 1;
            limit_squared[at] = if limit < within_squared[at] { limit } else { within_squared[at] };
        }
        for at in 0..CHUNK {
            let is_on_image = ((self.column[at] as u32) < width) & ((self.row[at] as u32) < height);
            let is_outside = self.clear_m[at].is_nan() & is_on_image;
            let may_have = is_outside & (clear_squared[at] <= limit_squared[at]);
            let pixels = (limit_squared[at] as f32).sqrt() + slack_pixels;
            let farthest_m = scale * pixels * away_m[at] + self.rounding_m(at);
            most_m[at] = if may_have { farthest_m } else { -1.0 };
        }
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
        let mut is_inside = [false; CHUNK];
        if view.is_plain() && path == VectorPath::Avx512 {
            // Foreground is on the image.
            view.foreground().map().look_up(&self.column, &self.row, &mut is_inside, path);
        } else {
            for (at, is_inside) in is_inside[..count].iter_mut().enumerate() {
                // A cell that is full of foreground is inside.
                let is_full = self.clear_pixels[at] > 0.0 && view.is_plain();
                let pixel = Pixel { column: self.column[at], row: self.row[at] };
                *is_inside = is_full || view.class_at(Some(pixel)) == Class::Inside;
            }
        }
        for (clear_pixels, is_inside) in self.clear_pixels[..count].iter_mut().zip(is_inside) {
            let clear = *clear_pixels - slack_pixels;
            let clear = if clear > 0.0 { clear } else { 0.0 };
            *clear_pixels = if is_inside { clear } else { f32::NAN };
        }
        let stretch = 1.0001 * view.observer().stretch_pixels() as f32;
        self.stretch_pixels = stretch;
        self.pixel_m = (1.0 / view.observer().bounds().shrink) as f32;
        self.is_straight = view.camera().lens().is_straight();
        let tangents = 1.0 / (1.00001 * view.observer().stretch_pixels() as f32);
        for at in 0..count {
            // The nearest ray that matters passes the point at this tangent or more.
            let apart = self.clear_pixels[at] * tangents;
            let (depth_m, range_m) = (self.depth_m[at], self.range_m[at]);
            self.clear_m[at] = 0.9999 * depth_m * depth_m * apart / (range_m + depth_m * apart);
        }
    }
}
