//! How far each pixel of a view is from the silhouette's edge: lets rays take long steps through what a
//! camera calls outside, and gives edges a smooth 2D normal.

use hull::camera::Pixel;
use hull::{Class, View};
use nalgebra::{Point2, Vector2, Vector3};

use super::distance::{STRAIGHT, averaged, distances};

/// The counts over this are never more than the true distance, pixels.
const COUNTS_PER_PIXEL: f64 = 3.17;
/// A point may lie so far from its pixel's centre, and the edge from its own, pixels together.
const CENTRES_PIXELS: f64 = 1.42;
/// The shortest step beside an edge, pixels: what is thinner may be missed.
const SHORTEST_PIXELS: f64 = 0.4;
/// No smoothed edge strays farther from the pixels' own, pixels.
const STRAY_PIXELS: f64 = 1.0;
/// The step where nothing is known of a camera's image, metres.
const BLIND_STEP_M: f64 = 0.01;

/// A ray in one camera's frame, metres.
#[derive(Clone, Copy, Debug)]
pub(super) struct CameraRay {
    pub start: Vector3<f64>,
    pub direction: Vector3<f64>,
}

/// How a camera classifies a point of a ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Verdict {
    Inside,
    Unknown,
    /// Outside, and so is all of the ray for so many metres more (or what is shortest).
    Outside {
        step_m: f64,
    },
}

/// Where a silhouette ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Outline {
    /// Between pixels, as the hull rule has it.
    Exact,
    /// Along a line through the stairs of the pixels, never more than a pixel off: for the eye.
    Smooth,
}

/// Signed distances to the edge of what one view does not reject.
pub(super) struct Field<'a> {
    view: &'a View,
    outline: Outline,
    left: i32,
    top: i32,
    columns: i32,
    rows: i32,
    /// Thirds of a pixel, above zero outside.
    thirds: Vec<i16>,
    /// The same to the line between pixels, averaged over three pixels each way; empty unless wanted.
    smooth: Vec<f32>,
    always_judges: bool,
    /// The image moves by at most so many pixels per unit of normalised coordinates.
    stretch_pixels: f64,
    /// Bounds, in normalised coordinates, of all that is not outside.
    seen: Option<(Point2<f64>, Point2<f64>)>,
}

impl<'a> Field<'a> {
    pub fn new(view: &'a View, outline: Outline) -> Field<'a> {
        let (map, camera) = (view.foreground().map(), view.camera());
        let always_judges = view.observer().always_judges();
        let (left, top, right, bottom) = if always_judges {
            (map.left(), map.top(), map.right(), map.bottom())
        } else {
            (0, 0, camera.width() as i32, camera.height() as i32)
        };
        let (columns, rows) = (right - left, bottom - top);
        let pixels = (top..bottom).flat_map(|row| (left..right).map(move |column| Pixel { column, row }));
        let kept: Vec<bool> = if always_judges {
            pixels.map(|pixel| map.get(pixel)).collect()
        } else {
            pixels.map(|pixel| view.class_at(Some(pixel)) != Class::Outside).collect()
        };
        // Where cameras may be silent, what is off the image is not outside.
        let to_kept = distances(&kept, columns as usize, true, !always_judges);
        let to_outside = distances(&kept, columns as usize, false, always_judges);
        let thirds = to_kept.iter().zip(&to_outside).map(|(&out, &within)| out as i16 - within as i16);
        let thirds: Vec<i16> = thirds.collect();
        let smooth = match outline {
            Outline::Exact => Vec::new(),
            Outline::Smooth => averaged(&thirds, columns as usize),
        };
        let seen = normalised_bounds(view, [left, top, right, bottom]);
        let stretch_pixels = stretch_pixels(view, [left, top, right, bottom]);
        Field { view, outline, left, top, columns, rows, thirds, smooth, always_judges, stretch_pixels, seen }
    }

    /// How many metres a pixel spans at a depth, at least.
    pub fn pixel_m(&self, depth_m: f64) -> f64 {
        depth_m / self.stretch_pixels
    }

    pub fn view(&self) -> &'a View {
        self.view
    }

    /// From where to where on the ray this camera may answer inside, metres; empty if the end comes first.
    pub fn span_m(&self, ray: &CameraRay) -> (f64, f64) {
        let (o, d) = (&ray.start, &ray.direction);
        let mut span_m = (0.0f64, f64::INFINITY);
        let mut keep = |value: f64, slope: f64| {
            if slope > 0.0 {
                span_m.0 = span_m.0.max(-value / slope);
            } else if slope < 0.0 {
                span_m.1 = span_m.1.min(-value / slope);
            } else if value < 0.0 {
                span_m.1 = f64::NEG_INFINITY;
            }
        };
        keep(o.z, d.z);
        if let Some((low, high)) = &self.seen {
            keep(o.x - low.x * o.z, d.x - low.x * d.z);
            keep(high.x * o.z - o.x, high.x * d.z - d.x);
            keep(o.y - low.y * o.z, d.y - low.y * d.z);
            keep(high.y * o.z - o.y, high.y * d.z - d.y);
        }
        span_m
    }

    /// How the camera classifies the ray's point at `t_m`.
    pub fn verdict(&self, ray: &CameraRay, t_m: f64) -> Verdict {
        let point = ray.start + ray.direction * t_m;
        let camera = self.view.camera();
        let Some(image) = camera.image_from_camera(&point) else {
            return if self.always_judges {
                Verdict::Outside { step_m: BLIND_STEP_M }
            } else {
                self.asked(None, BLIND_STEP_M)
            };
        };
        let pixel = Pixel::holding(image.x, image.y);
        let (thirds, beyond) = self.at(pixel);
        if !self.always_judges && (thirds <= 0 || beyond > 0.0) {
            let class = self.view.class_at(Some(pixel));
            if class == Class::Unknown || beyond > 0.0 {
                return self.asked(Some(pixel), BLIND_STEP_M);
            }
        }
        let mut clear = (f64::from(thirds) / COUNTS_PER_PIXEL).max(beyond) - CENTRES_PIXELS;
        let inside = match self.outline {
            Outline::Exact => thirds <= 0 && beyond == 0.0,
            Outline::Smooth => {
                clear -= STRAY_PIXELS;
                clear < SHORTEST_PIXELS && self.smoothed(&image) <= 0.0
            }
        };
        if inside {
            return Verdict::Inside;
        }
        Verdict::Outside { step_m: self.step_m(&point, &ray.direction, clear.max(SHORTEST_PIXELS)) }
    }

    /// The smoothed distance at a point of the image, between the pixels around it.
    fn smoothed(&self, image: &Point2<f64>) -> f64 {
        let (x, y) = (image.x - f64::from(self.left), image.y - f64::from(self.top));
        let (column, row) = (x.floor(), y.floor());
        let (right, down) = (x - column, y - row);
        let at = |column: f64, row: f64| {
            let (c, r) = ((column as i32).clamp(0, self.columns - 1), (row as i32).clamp(0, self.rows - 1));
            f64::from(self.smooth[r as usize * self.columns as usize + c as usize])
        };
        let upper = at(column, row) * (1.0 - right) + at(column + 1.0, row) * right;
        let lower = at(column, row + 1.0) * (1.0 - right) + at(column + 1.0, row + 1.0) * right;
        upper * (1.0 - down) + lower * down
    }

    fn asked(&self, pixel: Option<Pixel>, step_m: f64) -> Verdict {
        match self.view.class_at(pixel) {
            Class::Inside => Verdict::Inside,
            Class::Unknown => Verdict::Unknown,
            Class::Outside => Verdict::Outside { step_m },
        }
    }

    /// How far a point may go without its image moving by more than so many pixels.
    fn step_m(&self, point: &Vector3<f64>, direction: &Vector3<f64>, pixels: f64) -> f64 {
        let reach = pixels / self.stretch_pixels;
        let (x, y) = (point.x / point.z, point.y / point.z);
        let across = Vector2::new(direction.x - x * direction.z, direction.y - y * direction.z).norm();
        let slope = across - reach * direction.z;
        if slope > 0.0 { reach * point.z / slope } else { f64::INFINITY }
    }

    /// The distance at a pixel, thirds, and how many pixels it lies beyond the field.
    fn at(&self, pixel: Pixel) -> (i16, f64) {
        let (column, row) = (pixel.column.saturating_sub(self.left), pixel.row.saturating_sub(self.top));
        let (c, r) = (column.clamp(0, self.columns - 1), row.clamp(0, self.rows - 1));
        let thirds = self.thirds[r as usize * self.columns as usize + c as usize];
        if c == column && r == row {
            return (thirds, 0.0);
        }
        (thirds, Vector2::new(f64::from(column - c), f64::from(row - r)).norm())
    }

    /// How deep within the silhouette a pixel is, pixels; below zero outside.
    pub fn depth_pixels(&self, pixel: Pixel) -> f64 {
        -f64::from(self.at(pixel).0) / f64::from(STRAIGHT)
    }

    /// The same averaged, and the slope of the distance there, averaged over the
    /// view's window for normals: points out of the silhouette, length about one.
    pub fn depth_and_slope(&self, pixel: Pixel) -> (f64, Vector2<f64>) {
        let half = 2 * self.view.observer().window_pixels() as i32 + 1;
        let stride = (half / 4).max(1);
        let (mut slope, mut sum, mut weight) = (Vector2::zeros(), 0.0, 0.0);
        let places = || (-half..=half).step_by(stride as usize);
        for (dy, dx) in places().flat_map(|dy| places().map(move |dx| (dy, dx))) {
            let near = Pixel { column: pixel.column.saturating_add(dx), row: pixel.row.saturating_add(dy) };
            let value = f64::from(self.at(near).0) / f64::from(STRAIGHT);
            slope += Vector2::new(f64::from(dx), f64::from(dy)) * value;
            sum += value;
            weight += 1.0;
        }
        let steps = f64::from(half / stride);
        let spread = f64::from(stride * stride) * weight * steps * (steps + 1.0) / 3.0;
        (-sum / weight, slope / spread)
    }
}

/// The most that the image moves per unit of normalised coordinates on pixels `left, top, right, bottom`,
/// which the lens's tightest bound alone would overrate: a grid finds it, and a little more covers what lies between.
fn stretch_pixels(view: &View, rect: [i32; 4]) -> f64 {
    const STEPS: i32 = 24;
    const MORE: f64 = 1.05;
    let camera = view.camera();
    let bound = view.observer().stretch_pixels();
    if camera.lens().is_straight() {
        return bound;
    }
    let [left, top, right, bottom] = rect.map(f64::from);
    let grid = (0..=STEPS).flat_map(|row| (0..=STEPS).map(move |column| (column, row)));
    let found = grid.filter_map(|(column, row)| {
        let share = |step: i32| f64::from(step) / f64::from(STEPS);
        let image = Point2::new(left + (right - left) * share(column), top + (bottom - top) * share(row));
        let jacobian = camera.image_jacobian(&camera.normalised(&image)?);
        Some(jacobian.fixed_columns::<2>(0).into_owned().singular_values().max())
    });
    (found.fold(0.0, f64::max) * MORE).min(bound)
}

/// The box of normalised coordinates around pixels `left, top, right, bottom`; `None` where part of
/// their border has no ray.
fn normalised_bounds(view: &View, rect: [i32; 4]) -> Option<(Point2<f64>, Point2<f64>)> {
    const STEPS: i32 = 64;
    let [left, top, right, bottom] = rect.map(|side| f64::from(side) - 0.5);
    let corners = [(left, top), (right, top), (right, bottom), (left, bottom)];
    let mut bounds: Option<(Point2<f64>, Point2<f64>)> = None;
    let mut margin: f64 = 0.0;
    let mut before: Option<Vector2<f64>> = None;
    for side in 0..4 {
        let (from, to) = (corners[side], corners[(side + 1) % 4]);
        for step in 0..STEPS {
            let share = f64::from(step) / f64::from(STEPS);
            let image = Point2::new(from.0 + (to.0 - from.0) * share, from.1 + (to.1 - from.1) * share);
            let seen = view.camera().normalised(&image)?;
            margin = before.map_or(margin, |before| margin.max((seen - before).norm()));
            before = Some(seen);
            let point = Point2::from(seen);
            bounds = Some(bounds.map_or((point, point), |(low, high)| (low.inf(&point), high.sup(&point))));
        }
    }
    // Between two samples a bent border strays less than their distance.
    let margin = if view.camera().lens().is_straight() { 1e-9 } else { margin };
    bounds.map(|(low, high)| (low.map(|value| value - margin), high.map(|value| value + margin)))
}
