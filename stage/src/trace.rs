//! One solid as one camera sees it: which pixels it may touch, where a viewing ray meets it, and how it
//! looks there. Rays are `(x, y, 1)` in the camera frame, so the ray parameter is the depth in metres.

use hull::Camera;
use nalgebra::{Matrix3, Matrix4x3, Point2, Vector2, Vector3};

use crate::material::{Colour, albedo};
use crate::solid::{Form, Material, Solid, taper};

/// A rectangle of pixels; the ends are not in it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Rect {
    pub columns: (usize, usize),
    pub rows: (usize, usize),
}

impl Rect {
    pub const EMPTY: Rect = Rect { columns: (0, 0), rows: (0, 0) };

    pub fn is_empty(self) -> bool {
        self.columns.0 >= self.columns.1 || self.rows.0 >= self.rows.1
    }

    pub fn union(self, other: Rect) -> Rect {
        if self.is_empty() {
            return other;
        }
        if other.is_empty() {
            return self;
        }
        let join = |a: (usize, usize), b: (usize, usize)| (a.0.min(b.0), a.1.max(b.1));
        Rect { columns: join(self.columns, other.columns), rows: join(self.rows, other.rows) }
    }
}

/// A solid in the frame of a camera's rays.
#[derive(Clone, Debug)]
pub(crate) struct View {
    pub rect: Rect,
    /// Local direction of the ray `(x, y, 1)`: `from_ray · (x, y, 1)`.
    from_ray: [[f32; 3]; 3],
    /// The camera's centre in local coordinates.
    origin: [f32; 3],
    form: ViewForm,
    /// World normal from the local one, before normalising.
    normal: [[f32; 3]; 3],
    squash: [f32; 3],
    light: [f32; 3],
    material: Material,
}

#[derive(Clone, Debug)]
enum ViewForm {
    Cone { length: f32, start: f32, end: f32, slope: f32, rest: f32, low: f32, high: f32 },
    Cuboid { half: [f32; 3] },
}

/// No hit.
const MISS: f32 = f32::INFINITY;

impl View {
    /// `None` if the camera cannot see the solid.
    pub fn new(solid: &Solid, camera: &Camera, light_world: &Vector3<f64>) -> Option<View> {
        let rect = rect(solid, camera);
        if rect.is_empty() {
            return None;
        }
        let inverse = Matrix3::from_diagonal(&solid.squash.map(|s| 1.0 / s)) * solid.frame.transpose();
        let from_ray = inverse * camera.rotation().transpose();
        let origin = inverse * (camera.centre_world().coords - solid.origin);
        let form = match solid.form {
            Form::Cuboid { half_m } => ViewForm::Cuboid { half: vector(&half_m) },
            Form::RoundCone { length_m, start_m, end_m } => {
                let (slope, rest) = taper(length_m, start_m, end_m);
                ViewForm::Cone {
                    length: length_m as f32,
                    start: start_m as f32,
                    end: end_m as f32,
                    slope: slope as f32,
                    rest: rest as f32,
                    low: (start_m * slope) as f32,
                    high: (length_m + end_m * slope) as f32,
                }
            }
        };
        Some(View {
            rect,
            from_ray: matrix(&from_ray),
            origin: vector(&origin),
            form,
            normal: matrix(&inverse.transpose()),
            squash: vector(&solid.squash),
            light: vector(&(light_world - solid.origin).normalize()),
            material: solid.material,
        })
    }

    #[inline(always)]
    fn direction(&self, [x, y]: [f32; 2]) -> [f32; 3] {
        let m = &self.from_ray;
        [
            m[0][0] * x + m[0][1] * y + m[0][2],
            m[1][0] * x + m[1][1] * y + m[1][2],
            m[2][0] * x + m[2][1] * y + m[2][2],
        ]
    }

    /// The least depth at which each ray of a row meets the solid, where less than what `depths` holds;
    /// then `part` is written too. Rays that are not numbers meet nothing.
    pub fn trace_row(&self, rays: &[[f32; 2]], depths: &mut [f32], parts: &mut [u8], part: u8) {
        match self.form {
            ViewForm::Cone { length, start, end, slope, rest, low, high } => {
                let o = self.origin;
                let (rest2, slope2) = (rest * rest, slope * slope);
                let k = start - slope * o[1];
                let c = rest2 * (o[0] * o[0] + o[2] * o[2]) - k * k;
                for ((ray, depth), at) in rays.iter().zip(depths).zip(parts) {
                    let d = self.direction(*ray);
                    let a = rest2 * (d[0] * d[0] + d[2] * d[2]) - slope2 * d[1] * d[1];
                    let b = rest2 * (o[0] * d[0] + o[2] * d[2]) + k * slope * d[1];
                    let discriminant = b * b - a * c;
                    if discriminant >= 0.0 || discriminant.is_nan() {
                        let root = discriminant.sqrt();
                        let mut t = (-b - root) / a;
                        let y = o[1] + t * d[1];
                        if a <= 0.0 {
                            t = along_axis(&d, &o, (low, high), (a, b, root), (start, end, length));
                        } else if y < low {
                            t = ball(&d, &o, start);
                        } else if y > high {
                            t = ball(&d, &[o[0], o[1] - length, o[2]], end);
                        }
                        if t < *depth {
                            (*depth, *at) = (t, part);
                        }
                    }
                }
            }
            ViewForm::Cuboid { half } => {
                for ((ray, depth), at) in rays.iter().zip(depths).zip(parts) {
                    let t = slab(&self.direction(*ray), &self.origin, &half);
                    if t < *depth {
                        (*depth, *at) = (t, part);
                    }
                }
            }
        }
    }

    /// The lit colour of the solid where `ray` meets it at `depth`.
    #[inline]
    pub fn colour(&self, ray: [f32; 2], depth: f32) -> Colour {
        let d = self.direction(ray);
        let p: [f32; 3] = std::array::from_fn(|axis| self.origin[axis] + depth * d[axis]);
        let (local, length) = match self.form {
            ViewForm::Cone { length, slope, rest, low, high, .. } => {
                let local = if p[1] <= low {
                    p
                } else if p[1] >= high {
                    [p[0], p[1] - length, p[2]]
                } else {
                    let across = (p[0] * p[0] + p[2] * p[2]).sqrt();
                    [rest * p[0], slope * across, rest * p[2]]
                };
                (local, length)
            }
            ViewForm::Cuboid { half } => {
                let share: [f32; 3] = std::array::from_fn(|axis| p[axis].abs() - half[axis]);
                let mut local = [0.0; 3];
                let face = if share[0] > share[1] && share[0] > share[2] {
                    0
                } else if share[1] > share[2] {
                    1
                } else {
                    2
                };
                local[face] = if p[face] < 0.0 { -1.0 } else { 1.0 };
                (local, 0.0)
            }
        };
        let metres = std::array::from_fn(|axis| p[axis] * self.squash[axis]);
        lit(albedo(self.material, metres, length), self.world_normal(local), &self.light)
    }

    #[inline(always)]
    fn world_normal(&self, local: [f32; 3]) -> [f32; 3] {
        let m = &self.normal;
        let n: [f32; 3] =
            std::array::from_fn(|axis| m[axis][0] * local[0] + m[axis][1] * local[1] + m[axis][2] * local[2]);
        let inverse = 1.0 / (n[0] * n[0] + n[1] * n[1] + n[2] * n[2]).sqrt();
        n.map(|component| component * inverse)
    }
}

/// Soft light from above and from `light`, wrapped round the edge of the shade.
#[inline(always)]
fn lit(colour: Colour, normal: [f32; 3], light: &[f32; 3]) -> Colour {
    let facing = normal[0] * light[0] + normal[1] * light[1] + normal[2] * light[2];
    let wrapped = ((facing + 0.35) * (1.0 / 1.35)).max(0.0);
    let sky = 0.5 + 0.5 * normal[1];
    let strength = 0.34 + 0.22 * sky + 0.50 * wrapped;
    colour.map(|channel| channel * strength)
}

#[inline(always)]
fn ball(d: &[f32; 3], o: &[f32; 3], radius: f32) -> f32 {
    let a = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
    let b = o[0] * d[0] + o[1] * d[1] + o[2] * d[2];
    let c = o[0] * o[0] + o[1] * o[1] + o[2] * o[2] - radius * radius;
    let discriminant = b * b - a * c;
    if discriminant >= 0.0 { (-b - discriminant.sqrt()) / a } else { MISS }
}

/// The rare ray that runs steeper than the cone's side: whatever it meets first.
#[cold]
fn along_axis(
    d: &[f32; 3],
    o: &[f32; 3],
    (low, high): (f32, f32),
    (a, b, root): (f32, f32, f32),
    (start, end, length): (f32, f32, f32),
) -> f32 {
    let mut least = ball(d, o, start).min(ball(d, &[o[0], o[1] - length, o[2]], end));
    for t in [(-b - root) / a, (-b + root) / a] {
        let y = o[1] + t * d[1];
        if y >= low && y <= high && t > 0.0 {
            least = least.min(t);
        }
    }
    least
}

#[inline(always)]
fn slab(d: &[f32; 3], o: &[f32; 3], half: &[f32; 3]) -> f32 {
    let (mut from, mut to) = (0.0_f32, MISS);
    for axis in 0..3 {
        let inverse = 1.0 / d[axis];
        let (a, b) = ((-half[axis] - o[axis]) * inverse, (half[axis] - o[axis]) * inverse);
        from = from.max(a.min(b));
        to = to.min(a.max(b));
    }
    if from <= to && from > 0.0 && d[0] == d[0] { from } else { MISS }
}

/// The pixels that the solid may touch, no fewer.
fn rect(solid: &Solid, camera: &Camera) -> Rect {
    match normalised_bounds(solid, camera) {
        Bounds::Behind => Rect::EMPTY,
        Bounds::Everywhere => whole(camera),
        Bounds::Box { low, high } => pixels(camera, low, high),
    }
}

pub(crate) fn whole(camera: &Camera) -> Rect {
    Rect { columns: (0, camera.width() as usize), rows: (0, camera.height() as usize) }
}

enum Bounds {
    Behind,
    Everywhere,
    Box { low: Vector2<f64>, high: Vector2<f64> },
}

fn normalised_bounds(solid: &Solid, camera: &Camera) -> Bounds {
    let scaled = camera.rotation() * solid.frame * Matrix3::from_diagonal(&solid.squash);
    let centre = camera.camera_from_world(&solid.origin.into());
    let (mut low, mut high) = (Vector2::repeat(f64::INFINITY), Vector2::repeat(f64::NEG_INFINITY));
    let mut join = |a: Vector2<f64>, b: Vector2<f64>| {
        low = low.inf(&a);
        high = high.sup(&b);
    };
    let near_m = 0.01;
    let (mut nearest_m, mut farthest_m) = (f64::INFINITY, f64::NEG_INFINITY);
    match solid.form {
        Form::Cuboid { half_m } => {
            for corner in 0..8 {
                let sign = |bit: u32| if corner >> bit & 1 == 0 { -1.0 } else { 1.0 };
                let place = centre + scaled * half_m.component_mul(&Vector3::new(sign(0), sign(1), sign(2)));
                (nearest_m, farthest_m) = (nearest_m.min(place.z), farthest_m.max(place.z));
                let seen = place.xy() / place.z;
                join(seen, seen);
            }
        }
        Form::RoundCone { length_m, start_m, end_m } => {
            // The outline of each end's ellipsoid: planes (1, 0, −x) and (0, 1, −y) that touch it.
            for (along_m, radius_m) in [(0.0, start_m), (length_m, end_m)] {
                let place = centre + scaled * Vector3::new(0.0, along_m, 0.0);
                let spread = scaled * scaled.transpose() * (radius_m * radius_m);
                let reach_m = spread[(2, 2)].sqrt();
                (nearest_m, farthest_m) =
                    (nearest_m.min(place.z - reach_m), farthest_m.max(place.z + reach_m));
                let a = place.z * place.z - spread[(2, 2)];
                let extent = |axis: usize| {
                    let b = place[axis] * place.z - spread[(axis, 2)];
                    let c = place[axis] * place[axis] - spread[(axis, axis)];
                    let root = (b * b - a * c).max(0.0).sqrt();
                    ((b - root) / a, (b + root) / a)
                };
                let ((left, right), (top, bottom)) = (extent(0), extent(1));
                join(Vector2::new(left, top), Vector2::new(right, bottom));
            }
        }
    }
    if farthest_m <= near_m {
        Bounds::Behind
    } else if nearest_m <= near_m {
        Bounds::Everywhere
    } else {
        Bounds::Box { low, high }
    }
}

/// The pixels around a rectangle of undistorted normalised coordinates: its border is followed through
/// the lens. A border that the lens does not see gives the whole image.
fn pixels(camera: &Camera, low: Vector2<f64>, high: Vector2<f64>) -> Rect {
    let steps = if camera.lens().is_straight() { 1 } else { 16 };
    let (mut least, mut most) = (Point2::new(f64::INFINITY, f64::INFINITY), Point2::new(-1.0, -1.0));
    for step in 0..=steps {
        let share = f64::from(step) / f64::from(steps);
        let (x, y) = (low.x + (high.x - low.x) * share, low.y + (high.y - low.y) * share);
        for (x, y) in [(x, low.y), (x, high.y), (low.x, y), (high.x, y)] {
            let Some(image) = camera.image_from_camera(&Vector3::new(x, y, 1.0)) else {
                return whole(camera);
            };
            least = least.inf(&image);
            most = most.sup(&image);
        }
    }
    // Between the steps a bent border bulges a little.
    let margin = if steps == 1 { 1.0 } else { 2.0 + 0.01 * (most - least).amax() };
    let span = |least: f64, most: f64, side: u32| {
        let limit = f64::from(side);
        ((least - margin).clamp(0.0, limit) as usize, (most + margin + 1.0).clamp(0.0, limit).ceil() as usize)
    };
    Rect { columns: span(least.x, most.x, camera.width()), rows: span(least.y, most.y, camera.height()) }
}

/// The pixels around four points of the world, or the whole image if one is not in front of the camera.
pub(crate) fn rect_of_quad(camera: &Camera, corners_world: &Matrix4x3<f64>) -> Rect {
    let mut least = Vector2::repeat(f64::INFINITY);
    let mut most = Vector2::repeat(f64::NEG_INFINITY);
    for corner in corners_world.row_iter() {
        let place = camera.camera_from_world(&corner.transpose().into());
        if place.z <= 0.05 {
            return whole(camera);
        }
        least = least.inf(&(place.xy() / place.z));
        most = most.sup(&(place.xy() / place.z));
    }
    pixels(camera, least, most)
}

fn vector(v: &Vector3<f64>) -> [f32; 3] {
    [v.x as f32, v.y as f32, v.z as f32]
}

fn matrix(m: &Matrix3<f64>) -> [[f32; 3]; 3] {
    std::array::from_fn(|row| std::array::from_fn(|column| m[(row, column)] as f32))
}
