//! Pictures of one frame from any viewpoint: the visual hull of the silhouettes, ray-marched and shaded
//! by its normal, with the bodies in their colours, the samples inside the hull, and the floor.

mod distance;
mod field;
mod hull_ray;
mod mask;
mod overview;
mod shade;
#[cfg(test)]
mod tests;

use hull::{Camera, View};
use image::{Rgb, RgbImage};
use nalgebra::{Point2, Point3, Vector3};
use sim::Body;
use sim::ray::{Ray, SolidHit, SolidTracer};

use self::field::Outline;
use self::hull_ray::{HullTracer, Scratch};
use self::shade::{Colour, Light};

pub use self::mask::overlaps;
pub use self::overview::{interest, overview_camera};

/// Radius of a sample's dot over the picture's height.
const DOT: f64 = 0.0032;
/// A sample is hidden by a body that lies nearer by more than this, metres.
const SAMPLE_SLACK_M: f64 = 0.01;
/// Surfaces farther apart than this are separate things to the eye, metres.
const STEP_M: f64 = 0.035;
/// Shadow rays start so far off the surface, metres.
const LIFT_M: f64 = 0.002;

/// What a picture shows.
#[derive(Clone, Copy)]
pub struct PictureScene<'a> {
    /// The views of one frame, in rig order; none for an empty room.
    pub views: &'a [View],
    /// All bodies, fixed ones too.
    pub bodies: &'a [Body],
    /// The bodies' samples that are inside the hull, world, metres.
    pub inside_world: &'a [Point3<f64>],
    /// The unit vector against gravity.
    pub up: Vector3<f64>,
    /// Height of the floor along `up`, metres.
    pub floor_m: Option<f64>,
}

/// Draws the scene as the camera sees it.
pub fn render(scene: &PictureScene, camera: &Camera) -> RgbImage {
    let mut painter = Painter::new(scene, camera);
    let (width, height) = (camera.width() as usize, camera.height() as usize);
    let mut hits = Vec::with_capacity(width * height);
    for row in 0..height {
        for column in 0..width {
            hits.push(painter.look(column as f64, row as f64));
        }
    }
    let mut picture = RgbImage::new(camera.width(), camera.height());
    for (at, pixel) in picture.pixels_mut().enumerate() {
        let colour = if is_edge(&hits, at, width) {
            let (column, row) = ((at % width) as f64, (at / width) as f64);
            let around = [(-0.25, -0.25), (0.25, -0.25), (-0.25, 0.25), (0.25, 0.25)];
            around.iter().map(|(x, y)| painter.look(column + x, row + y).colour * 0.25).sum()
        } else {
            hits[at].colour
        };
        *pixel = Rgb(shade::bytes(&(colour * crease(&hits, at, width))));
    }
    painter.mark_samples(&hits, &mut picture);
    picture
}

/// What the ray of a pixel meets.
#[derive(Clone, Copy)]
struct PixelHit {
    thing: Thing,
    t_m: f64,
    colour: Colour,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Thing {
    Nothing,
    Floor { lit: bool },
    Hull,
    Body(usize),
}

struct Painter<'a> {
    camera: &'a Camera,
    scene: &'a PictureScene<'a>,
    hull: HullTracer<'a>,
    solids: Vec<SolidTracer>,
    light: Light,
    floor_axes: [Vector3<f64>; 2],
    centre: Point3<f64>,
    scratch: Scratch,
}

impl<'a> Painter<'a> {
    fn new(scene: &'a PictureScene<'a>, camera: &'a Camera) -> Painter<'a> {
        let axis = |row: usize| camera.rotation().row(row).transpose();
        let shown = interest(scene.views, scene.bodies);
        // The floor's lines run along the world's own axes where it is level.
        let along = if scene.up.x.abs() < 0.9 { Vector3::x() } else { Vector3::y() };
        let along = (along - scene.up * scene.up.dot(&along)).normalize();
        Painter {
            camera,
            scene,
            hull: HullTracer::new(scene.views, Outline::Smooth),
            solids: scene.bodies.iter().map(|body| SolidTracer::new(&body.solid, &body.pose)).collect(),
            light: Light::new(scene.up, &axis(0), &-axis(2)),
            floor_axes: [along, scene.up.cross(&along)],
            centre: nalgebra::center(&Point3::from(shown.min), &Point3::from(shown.max)),
            scratch: Scratch::default(),
        }
    }

    fn look(&mut self, u: f64, v: f64) -> PixelHit {
        let background = shade::background(v / f64::from(self.camera.height()));
        let nothing = PixelHit { thing: Thing::Nothing, t_m: f64::INFINITY, colour: background };
        let Some(direction) = self.camera.ray_world(&Point2::new(u, v)) else { return nothing };
        let ray = Ray { start: self.camera.centre_world(), direction };
        let body = self.nearest_body(&ray);
        let hull_m = self.hull.first_inside(&ray, &mut self.scratch);
        let floor_m = self.floor_m(&ray);
        let body_m = body.map_or(f64::INFINITY, |(_, hit)| hit.t_m);
        let hull_m = hull_m.unwrap_or(f64::INFINITY);
        match (body, floor_m) {
            (Some((index, hit)), _) if body_m <= hull_m && floor_m.is_none_or(|t| body_m < t) => {
                self.body_hit(&ray, index, hit)
            }
            (_, Some(t_m)) if t_m < hull_m => self.floor_hit(&ray, t_m, (u, v), &background),
            _ if hull_m.is_finite() => self.hull_hit(&ray, hull_m),
            _ => nothing,
        }
    }

    fn nearest_body(&self, ray: &Ray) -> Option<(usize, SolidHit)> {
        let hits = self.solids.iter().enumerate();
        hits.filter_map(|(index, solid)| Some((index, solid.hit(ray)?)))
            .min_by(|a, b| a.1.t_m.total_cmp(&b.1.t_m))
    }

    fn body_hit(&mut self, ray: &Ray, index: usize, hit: SolidHit) -> PixelHit {
        let lit = self.lit(&ray.at(hit.t_m), &hit.normal_world);
        let colour = shade::linear(self.scene.bodies[index].color);
        let colour = self.light.matte(&colour, &hit.normal_world, lit);
        // Edges are drawn a pixel and a half wide, whatever the distance.
        let edge_m = 1.5 * hit.t_m / self.camera.intrinsics()[(0, 0)];
        let darkened = 0.45 + 0.55 * (hit.edge_m / edge_m).min(1.0);
        PixelHit { thing: Thing::Body(index), t_m: hit.t_m, colour: colour * darkened }
    }

    fn hull_hit(&mut self, ray: &Ray, t_m: f64) -> PixelHit {
        let normal = self.hull.normal(&ray.at(t_m)).unwrap_or(-ray.direction);
        let colour = self.light.matte(&shade::linear(shade::HULL_SRGB), &normal, true);
        PixelHit { thing: Thing::Hull, t_m, colour }
    }

    fn floor_hit(&mut self, ray: &Ray, t_m: f64, (u, v): (f64, f64), background: &Colour) -> PixelHit {
        let point = ray.at(t_m);
        let lit = self.lit(&point, &self.scene.up.clone());
        let place = |point: &Point3<f64>| self.floor_axes.map(|axis| axis.dot(&point.coords));
        let place_m = place(&point);
        let mut footprint_m = [0.0f64; 2];
        for (du, dv) in [(1.0, 0.0), (0.0, 1.0)] {
            let Some(direction) = self.camera.ray_world(&Point2::new(u + du, v + dv)) else { continue };
            let beside = Ray { start: ray.start, direction };
            let moved = self.floor_m(&beside).map_or([f64::INFINITY; 2], |t_m| place(&beside.at(t_m)));
            for axis in 0..2 {
                footprint_m[axis] += (moved[axis] - place_m[axis]).abs();
            }
        }
        let away_m = (point - self.centre).norm();
        let colour = shade::floor(place_m, footprint_m, away_m, lit, background);
        PixelHit { thing: Thing::Floor { lit }, t_m, colour }
    }

    fn floor_m(&self, ray: &Ray) -> Option<f64> {
        let up = &self.scene.up;
        let (above_m, fall) = (up.dot(&ray.start.coords) - self.scene.floor_m?, -up.dot(&ray.direction));
        (above_m > 0.0 && fall > 1e-6).then(|| above_m / fall)
    }

    /// Whether the lamp's light reaches a point of a surface.
    fn lit(&mut self, point: &Point3<f64>, normal: &Vector3<f64>) -> bool {
        let direction = self.light.towards_lamp;
        if normal.dot(&direction) <= 0.0 {
            return false;
        }
        let ray = Ray { start: point + normal * LIFT_M, direction };
        self.nearest_body(&ray).is_none() && self.hull.first_inside(&ray, &mut self.scratch).is_none()
    }

    /// Draws the samples as dots over the hull, unless a body hides them.
    fn mark_samples(&self, hits: &[PixelHit], picture: &mut RgbImage) {
        let (width, height) = (self.camera.width() as i32, self.camera.height() as i32);
        let radius = (DOT * f64::from(height)).max(0.8);
        let reach = radius.ceil() as i32 + 1;
        for point in self.scene.inside_world {
            let Some(image) = self.camera.project(point) else { continue };
            let (column, row) = (image.x.round() as i32, image.y.round() as i32);
            if column < 0 || row < 0 || column >= width || row >= height {
                continue;
            }
            let at = &hits[(row * width + column) as usize];
            let away_m = (point - self.camera.centre_world()).norm();
            if matches!(at.thing, Thing::Body(_)) && at.t_m < away_m - SAMPLE_SLACK_M {
                continue;
            }
            for y in (row - reach).max(0)..=(row + reach).min(height - 1) {
                for x in (column - reach).max(0)..=(column + reach).min(width - 1) {
                    let off = Point2::new(f64::from(x), f64::from(y)) - image;
                    blend(
                        picture.get_pixel_mut(x as u32, y as u32),
                        (radius + 0.5 - off.norm()).clamp(0.0, 1.0),
                    );
                }
            }
        }
    }
}

/// Lays a sample's colour over a pixel.
fn blend(pixel: &mut Rgb<u8>, share: f64) {
    for (channel, value) in pixel.0.iter_mut().zip(shade::SAMPLE_SRGB) {
        *channel = (f64::from(*channel) * (1.0 - share) + 255.0 * f64::from(value) * share + 0.5) as u8;
    }
}

fn neighbours(at: usize, width: usize, length: usize) -> impl Iterator<Item = usize> {
    let column = at % width;
    let left = (column > 0).then(|| at - 1);
    let right = (column + 1 < width).then_some(at + 1);
    let above = at.checked_sub(width);
    let below = Some(at + width).filter(|&below| below < length);
    [left, right, above, below].into_iter().flatten()
}

/// Whether another thing, or another part of the same, begins beside this pixel.
fn is_edge(hits: &[PixelHit], at: usize, width: usize) -> bool {
    let here = &hits[at];
    neighbours(at, width, hits.len()).any(|next| {
        let next = &hits[next];
        let flat = matches!(here.thing, Thing::Floor { .. } | Thing::Nothing);
        next.thing != here.thing || (!flat && (next.t_m - here.t_m).abs() > STEP_M)
    })
}

/// Darkens the hull where another part of it stands in front: a limb before the trunk.
fn crease(hits: &[PixelHit], at: usize, width: usize) -> f64 {
    let here = &hits[at];
    let behind = here.thing == Thing::Hull
        && neighbours(at, width, hits.len()).any(|next| {
            let jump_m = here.t_m - hits[next].t_m;
            // Where the surface is seen at a grazing angle, it falls away on the other side too.
            let other = (2 * at).checked_sub(next).and_then(|other| hits.get(other));
            let slope_m = other.map_or(0.0, |other| (other.t_m - here.t_m).abs());
            hits[next].thing == Thing::Hull && jump_m > STEP_M.max(2.0 * slope_m)
        });
    if behind { 0.7 } else { 1.0 }
}
