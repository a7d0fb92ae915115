//! A person of balls, drawn into a ring of cameras as runs: quick to make, the same on every machine.

use std::sync::Arc;

use hull::coordinates::Coordinates;
use hull::silhouette::{Run, SilhouetteBuilder};
use hull::{Camera, Observer, ProbeSettings, Silhouette, View};
use nalgebra::{Matrix3, Point3, Vector3};

/// Cameras around the person.
const CAMERAS: usize = 8;
/// Their distance from what they look at, metres.
const RADIUS_M: f64 = 3.5;
/// What they look at.
const AIM_M: [f64; 3] = [0.0, 0.95, 0.0];
/// The limbs: from, to, and their thickness (radius), metres.
const LIMBS: [([f64; 3], [f64; 3], f64); 8] = [
    ([0.0, 1.62, 0.0], [0.0, 1.72, 0.02], 0.11),
    ([-0.06, 0.95, 0.0], [-0.08, 1.4, 0.0], 0.14),
    ([0.06, 0.95, 0.0], [0.08, 1.4, 0.0], 0.14),
    ([0.2, 1.42, 0.0], [0.62, 1.35, 0.15], 0.05),
    ([-0.2, 1.42, 0.0], [-0.48, 1.75, 0.05], 0.05),
    ([0.1, 0.9, 0.0], [0.16, 0.08, 0.05], 0.075),
    ([-0.1, 0.9, 0.0], [-0.16, 0.08, -0.05], 0.075),
    ([0.0, 1.42, 0.0], [0.0, 1.6, 0.0], 0.06),
];
/// Balls along a limb.
const BALLS: usize = 40;
/// Points are thrown into this box, metres: the person's.
const BOX_M: ([f64; 3], [f64; 3]) = ([-0.65, 0.0, -0.25], [0.7, 1.9, 0.3]);

/// The drawn studio.
pub struct Studio {
    /// Each camera's fixed side.
    pub observers: Vec<Arc<Observer>>,
    /// What each camera sees.
    pub silhouettes: Vec<Silhouette>,
    /// Random points in the person's box, metres.
    pub in_box: Coordinates,
    /// Those of them that are on foreground for every camera.
    pub inside: Vec<Point3<f64>>,
}

impl Studio {
    /// Cameras of that size around the person, and so many points in the box.
    ///
    /// # Panics
    /// If the size is none that a camera has.
    pub fn new(size: (u32, u32), points: usize) -> Studio {
        let settings = ProbeSettings::default();
        let cameras: Vec<Camera> = (0..CAMERAS).map(|index| camera(index, size)).collect();
        let silhouettes: Vec<Silhouette> = cameras.iter().map(silhouette).collect();
        let observer =
            |(index, camera): (usize, Camera)| Arc::new(Observer::new(camera, index as u16, settings, None));
        let observers = cameras.into_iter().enumerate().map(observer).collect();
        let mut studio = Studio { observers, silhouettes, in_box: Coordinates::default(), inside: vec![] };
        studio.throw(points);
        studio
    }

    /// Every camera at this frame.
    pub fn views(&self) -> Vec<View> {
        let pairs = self.observers.iter().zip(&self.silhouettes);
        pairs.map(|(observer, silhouette)| View::new(Arc::clone(observer), silhouette)).collect()
    }

    fn throw(&mut self, points: usize) {
        let mut state = 1u64;
        let mut share = move || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1u64 << 53) as f64
        };
        for _ in 0..points {
            let (low, high) = BOX_M;
            let point: [f64; 3] = std::array::from_fn(|axis| low[axis] + (high[axis] - low[axis]) * share());
            let point = Point3::from(point);
            self.in_box.push(point);
            let seen = |(observer, silhouette): (&Arc<Observer>, &Silhouette)| {
                let pixel = observer.camera().pixel(&point);
                pixel.is_some_and(|pixel| silhouette.contains(pixel.column, pixel.row))
            };
            if self.observers.iter().zip(&self.silhouettes).all(seen) {
                self.inside.push(point);
            }
        }
    }
}

fn camera(index: usize, size: (u32, u32)) -> Camera {
    let turn = 0.35 + std::f64::consts::TAU * index as f64 / CAMERAS as f64;
    let (sine, cosine) = libm::sincos(turn);
    let aim = Vector3::from(AIM_M);
    let height_m = 0.4 * f64::from(index as u32 % 3);
    let centre = aim + Vector3::new(RADIUS_M * sine, height_m, RADIUS_M * cosine);
    let forward = (aim - centre).normalize();
    let right = forward.cross(&Vector3::y()).normalize();
    let down = forward.cross(&right);
    let rotation = Matrix3::from_rows(&[right.transpose(), down.transpose(), forward.transpose()]);
    let (width, height) = (f64::from(size.0), f64::from(size.1));
    let focal = 0.92 * height;
    let matrix =
        Matrix3::new(focal, 0.0, 0.5 * (width - 1.0), 0.0, focal, 0.5 * (height - 1.0), 0.0, 0.0, 1.0);
    Camera::from_matrices(format!("cam_{index}"), size, matrix, [0.0; 5], &rotation, -(rotation * centre))
        .expect("a ring of plain cameras")
}

/// The balls of the person as discs of the image.
fn silhouette(camera: &Camera) -> Silhouette {
    let (width, height) = (camera.width(), camera.height());
    let mut rows: Vec<Vec<(f64, f64)>> = vec![Vec::new(); height as usize];
    let focal = camera.intrinsics()[(0, 0)];
    for (from, to, radius_m) in LIMBS {
        let (from, to) = (Vector3::from(from), Vector3::from(to));
        for ball in 0..=BALLS {
            let centre = Point3::from(from + (to - from) * (ball as f64 / BALLS as f64));
            let depth_m = camera.camera_from_world(&centre).z;
            let middle = camera.project(&centre).expect("the person stands before every camera");
            let radius = focal * radius_m / depth_m;
            let (top, bottom) = ((middle.y - radius).ceil().max(0.0), (middle.y + radius).floor());
            let drawn = rows.iter_mut().enumerate().take(bottom as usize + 1).skip(top as usize);
            for (row, spans) in drawn {
                let half = (radius * radius - (row as f64 - middle.y).powi(2)).max(0.0).sqrt();
                spans.push((middle.x - half, middle.x + half));
            }
        }
    }
    let mut builder = SilhouetteBuilder::new(width, height).expect("a camera's size");
    for spans in &mut rows {
        builder.push_runs(&runs(spans, width)).expect("runs in order");
    }
    builder.finish().expect("all rows")
}

/// The pixels that spans of a row cover.
fn runs(spans: &mut [(f64, f64)], width: u32) -> Vec<Run> {
    spans.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut runs: Vec<Run> = Vec::new();
    for &(left, right) in spans.iter() {
        let start = left.ceil().clamp(0.0, f64::from(width)) as u16;
        let end = (right.floor() + 1.0).clamp(0.0, f64::from(width)) as u16;
        match runs.last_mut() {
            Some(last) if start <= last.end => last.end = last.end.max(end),
            _ if start < end => runs.push(Run { start, end }),
            _ => {}
        }
    }
    runs
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_cameras_see_the_person_whole_and_some_points_are_inside() {
        let studio = Studio::new((640, 480), 2000);
        for silhouette in &studio.silhouettes {
            let bounds = silhouette.bounds().expect("a person");
            assert!(bounds.top > 0 && bounds.bottom < 480 && bounds.left > 0 && bounds.right < 640);
            assert!(silhouette.area() > 5000, "{}", silhouette.area());
        }
        assert!((50..1000).contains(&studio.inside.len()), "{}", studio.inside.len());
    }

    #[test]
    fn spans_that_meet_become_one_run() {
        let run = |start, end| Run { start, end };
        assert_eq!(runs(&mut [(5.2, 8.0), (1.0, 3.0), (3.5, 4.2)], 100), [run(1, 5), run(6, 9)]);
        assert_eq!(runs(&mut [(-3.0, -1.0), (98.0, 120.0)], 100), [run(98, 100)]);
    }
}
