//! One solid as one camera sees it: which pixels it may touch, where a viewing ray meets it, and how it
//! looks there. Rays are `(x, y, 1)` in the camera frame, so the ray parameter is the depth in metres.

use hull::Camera;
use nalgebra::{Matrix3, Vector3};

use crate::material::{Colour, albedo};
use crate::rect::{Rect, rect_of_solid};
use crate::solid::{Form, Material, Solid, taper};

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
        let rect = rect_of_solid(solid, camera);
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
    if from <= to && from > 0.0 && !d[0].is_nan() { from } else { MISS }
}

fn vector(v: &Vector3<f64>) -> [f32; 3] {
    [v.x as f32, v.y as f32, v.z as f32]
}

fn matrix(m: &Matrix3<f64>) -> [[f32; 3]; 3] {
    std::array::from_fn(|row| std::array::from_fn(|column| m[(row, column)] as f32))
}
