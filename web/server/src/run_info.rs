//! The description of a run for those who watch it.

use hull::rule::OutOfView;
use hull::{Camera, ProbeSettings, Rig, Silhouette};
use nalgebra::{Matrix3, Point3, Vector3};
use sim::ResponseMode;

/// Points along each edge of the grid that looks for the working volume.
const GRID: usize = 41;

/// What does not change while a run lasts.
#[derive(Clone, Debug)]
pub struct RunInfo {
    /// The cameras that take part.
    pub rig: Rig,
    /// Of each camera, in rig order, the pixels where it is silent whatever it sees; `None` if there are none.
    pub ignored: Vec<Option<Silhouette>>,
    /// The hull rule and the probes' settings.
    pub probes: ProbeSettings,
    /// Frames of the cluster per second.
    pub fps: f64,
    /// A step of the world, seconds.
    pub step_s: f64,
    /// How bodies answer the hull.
    pub response: ResponseMode,
    /// From the capture of film to the step that collides with it, seconds; `None`: it is measured, see the status.
    pub latency_s: Option<f64>,
    /// The unit vector against gravity, world.
    pub up: [f64; 3],
    /// Height of the floor along up, metres, if there is one.
    pub floor_m: Option<f64>,
    /// Whether any camera films in colour.
    pub has_colour: bool,
    /// Whether a recording is replayed: then only commands that say how it is played are taken.
    pub is_replay: bool,
    /// Film time of the recording's last step, seconds, if one is replayed.
    pub length_s: Option<f64>,
    /// Whether film waits while the run is paused, so that each step sees the film that belongs to it. Live film goes by.
    pub film_waits: bool,
    /// What is not encrypted though others may be on the way, in words; `None`: nothing.
    pub insecure: Option<String>,
}

/// A box along the axes of the world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Volume {
    /// Its least corner, metres.
    pub low_m: [f64; 3],
    /// Its greatest corner, metres.
    pub high_m: [f64; 3],
}

impl RunInfo {
    /// The reason that pages get at the end.
    pub fn end(&self) -> &'static str {
        if self.is_replay { "the recording has ended" } else { "the run has ended" }
    }

    /// A box that holds wherever a hull can be: where as many cameras see a point as the rule asks for, all of them
    /// if the unseen counts as outside. Found on a grid around the point that the cameras look at; the whole
    /// grid where it finds none.
    pub fn volume(&self) -> Volume {
        let cameras = self.rig.cameras();
        let rule = self.probes.rule();
        let least = match rule.out_of_view {
            OutOfView::Outside => cameras.len(),
            OutOfView::Abstain => (rule.min_views as usize).min(cameras.len()),
        };
        let centre = looked_at(cameras);
        let far_m = |camera: &Camera| (camera.centre_world() - centre).norm();
        let reach_m = cameras.iter().map(far_m).fold(0.5, f64::max);
        let mut found: Option<Volume> = None;
        for cell in 0..GRID.pow(3) {
            let steps = [cell % GRID, cell / GRID % GRID, cell / (GRID * GRID)];
            let part = steps.map(|step| 2.0 * step as f64 / (GRID - 1) as f64 - 1.0);
            let point = centre + reach_m * Vector3::from(part);
            if cameras.iter().filter(|camera| sees(camera, &point)).count() >= least {
                let (low_m, high_m) = found.map_or((point, point), |volume| {
                    let (low, high) = (Point3::from(volume.low_m), Point3::from(volume.high_m));
                    (low.inf(&point), high.sup(&point))
                });
                found = Some(Volume { low_m: low_m.into(), high_m: high_m.into() });
            }
        }
        let all = Vector3::repeat(reach_m);
        let Some(Volume { low_m, high_m }) = found else {
            return Volume { low_m: (centre - all).into(), high_m: (centre + all).into() };
        };
        // What is seen may reach to the next point of the grid, which is not.
        let spacing = Vector3::repeat(2.0 * reach_m / (GRID - 1) as f64);
        Volume {
            low_m: (Point3::from(low_m) - spacing).into(),
            high_m: (Point3::from(high_m) + spacing).into(),
        }
    }
}

fn sees(camera: &Camera, point: &Point3<f64>) -> bool {
    let image = camera.image_from_camera(&camera.camera_from_world(point));
    let within = |value: f64, side: u32| value >= -0.5 && value < f64::from(side) - 0.5;
    image.is_some_and(|image| within(image.x, camera.width()) && within(image.y, camera.height()))
}

/// The point nearest to all optical axes; parallel axes are met a metre ahead.
fn looked_at(cameras: &[Camera]) -> Point3<f64> {
    // A light pull towards a metre ahead of each camera makes parallel axes meet somewhere.
    const PULL: f64 = 1e-3;
    let (mut matrix, mut right) = (Matrix3::zeros(), Vector3::zeros());
    for camera in cameras {
        let axis: Vector3<f64> = camera.rotation().row(2).transpose();
        let across = Matrix3::identity() - axis * axis.transpose();
        let centre = camera.centre_world().coords;
        matrix += across + PULL * Matrix3::identity();
        right += across * centre + PULL * (centre + axis);
    }
    Point3::from(matrix.try_inverse().map_or(Vector3::zeros(), |inverse| inverse * right))
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use hull::rule::{HullRule, NormalWindow};

    /// Cameras on a circle of 3 m around (0, 1, 0) that all look there, 90 degrees wide.
    pub(crate) fn ring(count: usize, out_of_view: OutOfView) -> RunInfo {
        let camera = |index: usize| {
            let angle = std::f64::consts::TAU * index as f64 / count as f64;
            let (sine, cosine) = libm::sincos(angle);
            // Rows: right, down, ahead.
            let rotation = Matrix3::new(cosine, 0.0, -sine, 0.0, -1.0, 0.0, -sine, 0.0, -cosine);
            let centre = Vector3::new(3.0 * sine, 1.0, 3.0 * cosine);
            let intrinsics = Matrix3::new(50.0, 0.0, 49.5, 0.0, 50.0, 49.5, 0.0, 0.0, 1.0);
            let name = format!("cam_{index}");
            let translation = -(rotation * centre);
            Camera::from_matrices(name, (100, 100), intrinsics, [0.0; 5], &rotation, translation)
                .expect("a camera")
        };
        let rule = HullRule { out_of_view, min_views: 2 };
        RunInfo {
            rig: Rig::new((0..count).map(camera).collect()).expect("a rig"),
            ignored: vec![None; count],
            probes: ProbeSettings::new(rule, NormalWindow::Auto, 1.0).expect("settings"),
            fps: 30.0,
            step_s: 1.0 / 120.0,
            response: ResponseMode::Paper,
            latency_s: Some(0.06),
            up: [0.0, 1.0, 0.0],
            floor_m: Some(0.0),
            has_colour: true,
            is_replay: false,
            length_s: None,
            film_waits: false,
            insecure: None,
        }
    }

    #[test]
    fn the_volume_is_where_the_rule_lets_a_hull_be() {
        let all = ring(4, OutOfView::Outside).volume();
        // Four pyramids of 90 degrees: across, what is left is the square between them.
        for axis in [0, 2] {
            assert!(all.high_m[axis] < 3.2 && all.high_m[axis] > 1.3, "{all:?}");
        }
        assert!((all.low_m[0] + all.high_m[0]).abs() < 0.2, "it lies around the middle: {all:?}");
        assert!((0.5 * (all.low_m[1] + all.high_m[1]) - 1.0).abs() < 0.2, "{all:?}");
        let some = ring(4, OutOfView::Abstain).volume();
        assert!(some.high_m[0] >= all.high_m[0] && some.high_m[1] >= all.high_m[1], "fewer views, more room");
    }

    #[test]
    fn a_single_camera_has_a_volume_ahead_of_it() {
        let one = ring(1, OutOfView::Outside).volume();
        assert!(one.low_m[2] < 2.5 && one.low_m.iter().all(|value| value.is_finite()), "{one:?}");
    }
}
