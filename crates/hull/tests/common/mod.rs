//! Random rigs around the origin with random silhouettes of a few blobs.

use std::sync::Arc;

use hull::oracle::DenseView;
use hull::rotation::rodrigues_from_matrix;
use hull::{Camera, Observer, ProbeSettings, Silhouette, View};
use nalgebra::{Matrix3, Point3, Vector3};

/// A small deterministic generator.
pub struct Dice(pub u64);

impl Dice {
    /// A number in `from..to`.
    pub fn between(&mut self, from: f64, to: f64) -> f64 {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        from + (to - from) * ((self.0 >> 33) as f64 / (1u64 << 31) as f64)
    }
}

/// A camera that looks from a random place at a point near the origin.
pub fn random_camera(dice: &mut Dice, name: &str, bent: bool) -> Camera {
    let angle = dice.between(0.0, std::f64::consts::TAU);
    let centre = Vector3::new(3.0 * libm::cos(angle), dice.between(-1.0, 2.0), 3.0 * libm::sin(angle));
    let target = Vector3::new(dice.between(-0.2, 0.2), dice.between(-0.2, 0.2), dice.between(-0.2, 0.2));
    let forward = (target - centre).normalize();
    let right = forward.cross(&Vector3::new(dice.between(-0.2, 0.2), 1.0, 0.1)).normalize();
    let down = forward.cross(&right);
    let rotation = Matrix3::from_rows(&[right.transpose(), down.transpose(), forward.transpose()]);
    let focal = dice.between(90.0, 130.0);
    let k = Matrix3::new(
        focal,
        dice.between(-1.0, 1.0),
        dice.between(55.0, 65.0),
        0.0,
        focal * dice.between(0.95, 1.05),
        dice.between(40.0, 50.0),
        0.0,
        0.0,
        1.0,
    );
    let lens = if bent {
        [dice.between(-0.35, 0.1), dice.between(-0.05, 0.1), 0.001, -0.002, dice.between(-0.02, 0.02)]
    } else {
        [0.0; 5]
    };
    let translation = -(rotation * centre);
    Camera::new(name, (120, 90), k, lens, rodrigues_from_matrix(&rotation), translation).expect("valid")
}

/// The silhouette of a few balls near the origin, with salt and holes.
pub fn random_mask(dice: &mut Dice, camera: &Camera, balls: &[(Point3<f64>, f64)], noise: f64) -> Vec<u8> {
    let (width, height) = (camera.width(), camera.height());
    let mut mask = vec![0; (width * height) as usize];
    for row in 0..height {
        for column in 0..width {
            let image = nalgebra::Point2::new(f64::from(column), f64::from(row));
            let hit = camera.ray_world(&image).is_some_and(|ray| {
                balls
                    .iter()
                    .any(|(centre, radius)| (centre - camera.centre_world()).cross(&ray).norm() < *radius)
            });
            let flip = dice.between(0.0, 1.0) < noise;
            mask[(row * width + column) as usize] = if hit != flip { 255 } else { 0 };
        }
    }
    mask
}

/// Some balls that most cameras see whole, and some that leave the image.
pub fn random_balls(dice: &mut Dice) -> Vec<(Point3<f64>, f64)> {
    (0..4)
        .map(|_| {
            let reach = dice.between(0.1, 0.9);
            let centre = Point3::new(
                dice.between(-reach, reach),
                dice.between(-reach, reach),
                dice.between(-reach, reach),
            );
            (centre, dice.between(0.15, 0.5))
        })
        .collect()
}

/// A random rig seen densely and as views.
pub fn random_rig(seed: u64, settings: ProbeSettings, with_ignored: bool) -> (Vec<DenseView>, Vec<View>) {
    let mut dice = Dice(seed);
    let balls = random_balls(&mut dice);
    let count = 2 + (dice.between(0.0, 4.0) as usize);
    let mut dense = Vec::new();
    let mut views = Vec::new();
    for index in 0..count {
        let bent = dice.between(0.0, 1.0) < 0.5;
        let camera = random_camera(&mut dice, &format!("cam_{index}"), bent);
        let noise = if dice.between(0.0, 1.0) < 0.5 { 0.002 } else { 0.0 };
        let mask = random_mask(&mut dice, &camera, &balls, noise);
        let ignored = with_ignored.then(|| {
            let left = dice.between(0.0, 100.0) as u32;
            let pixels = (0..120 * 90u32).map(|at| u8::from((left..left + 15).contains(&(at % 120))));
            pixels.collect::<Vec<u8>>()
        });
        let runs = |mask: &[u8]| Silhouette::from_mask(120, 90, mask).expect("size");
        let ignored_runs = ignored.as_deref().map(runs);
        let observer = Observer::new(camera.clone(), index as u16, settings, ignored_runs.as_ref());
        views.push(View::new(Arc::new(observer), &runs(&mask)));
        dense.push(DenseView { camera, mask, ignored });
    }
    (dense, views)
}
