//! The hull's surface near each body from frame to frame: planes hold for their film frame and move on at the speed
//! that the frame before tells. Under `--response contacts` only.
//!
//! Between frames the surface goes on along its normals. So a body is asked about where it would be had the surface
//! stood still since the frame, and again once it has left that place: what rides on a lifted lid is asked once a
//! frame. How fast a surface moves follows from the planes that the same samples had in the frame before; motion along
//! a surface cannot be seen there.

use hull::contact::contacts;
use hull::pass::{BodyResult, Touch};
use hull::{Pose, Shape};
use nalgebra::{Matrix3, Point3, Vector3};
use sim::Body;

use super::answers::moved_at_most_m;

/// Planes that were found for a pose hold while no sample moves farther against the surface, metres.
const HOLD_WITHIN_M: f64 = 0.004;
/// A surface that moves faster than this is another surface, m/s.
const MAX_SPEED_M_S: f64 = 10.0;
/// Planes of one sample are of one surface if their normals are so near: cosine of 25 degrees.
const SAME_SURFACE: f64 = 0.906;
/// Frames back to which a speed is measured.
const MAX_FRAMES_BACK: u64 = 3;
/// Film that shows a frame for so many periods stands still, and its surfaces with it.
const STILL_PERIODS: f64 = 1.5;
/// What a body's surface is taken to do where its contacts do not say: nothing, by so much of each contact's weight.
const REST_WEIGHT: f64 = 0.01;

/// The surfaces near the moving bodies of a world.
#[derive(Clone, Debug, Default)]
pub struct Surfaces {
    fps: f64,
    bodies: Vec<BodySurface>,
}

/// The frame that a step sees, and how old it is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrameAge {
    frame: u64,
    age_s: f64,
}

#[derive(Clone, Debug, Default)]
struct BodySurface {
    /// What was asked last: the frame and the pose.
    asked: Option<(u64, Pose)>,
    /// Of the surface along the normals of the contacts, world.
    velocity_m_s: Vector3<f64>,
    newest: FramePlanes,
    before: FramePlanes,
}

/// The planes of samples at one frame, ascending by sample.
#[derive(Clone, Debug, Default)]
struct FramePlanes {
    frame: u64,
    planes: Vec<SamplePlane>,
}

#[derive(Clone, Copy, Debug)]
struct SamplePlane {
    sample: u32,
    normal: Vector3<f64>,
    camera: u16,
}

impl Surfaces {
    /// Surfaces of film of so many frames a second.
    pub fn at(fps: f64) -> Surfaces {
        Surfaces { fps, bodies: Vec::new() }
    }

    /// Other bodies: nothing is known of any.
    pub fn set_bodies(&mut self, count: usize) {
        self.bodies.clear();
        self.bodies.resize_with(count, BodySurface::default);
    }

    /// A step that ends at `film_s` and sees `frame`.
    pub fn frame_age(&self, frame: u64, film_s: f64) -> FrameAge {
        let age_s = (film_s - frame as f64 / self.fps).max(0.0);
        FrameAge { frame, age_s: if age_s * self.fps > STILL_PERIODS { 0.0 } else { age_s } }
    }

    /// The pose to ask about a body whose samples and feelers are `probes`: the one that was asked before, while
    /// its planes hold.
    pub fn pose_to_ask(&mut self, body: usize, at: FrameAge, present: &Pose, probes: &Shape) -> Pose {
        let surface = &mut self.bodies[body];
        let pose = surface.against_surface(present, at);
        match surface.asked {
            Some((frame, asked))
                if frame == at.frame && moved_at_most_m(probes, &asked, &pose) <= HOLD_WITHIN_M =>
            {
                asked
            }
            _ => {
                surface.asked = Some((at.frame, pose));
                pose
            }
        }
    }

    /// The contacts of a body with the planes found for its samples and feelers, where body and surface are now.
    /// `centres` are those of the rig's cameras.
    pub fn contacts(
        &mut self,
        index: usize,
        at: FrameAge,
        planes: &BodyResult,
        body: &Body,
        centres: &[Point3<f64>],
    ) -> BodyResult {
        let surface = &mut self.bodies[index];
        let pose = surface.against_surface(&body.pose, at);
        let faces = |sample: usize| body.faces.as_ref().map_or(&[][..], |faces| faces.at(sample));
        let mut result = contacts(planes, &body.shape, &pose, faces, centres);
        surface.keep_planes(at.frame, &result);
        let back = at.frame.saturating_sub(surface.before.frame);
        if (1..=MAX_FRAMES_BACK).contains(&back) {
            let world_from_body = pose.world_from_body();
            let samples = body.shape.samples_body();
            let per_s = self.fps / back as f64;
            let place = |sample: u32| world_from_body(samples[sample as usize]);
            surface.before.find_speeds(&mut result, place, centres, per_s);
        }
        surface.velocity_m_s = velocity(&result);
        result
    }
}

impl BodySurface {
    /// Where a body would be had the surface stood still since the frame.
    fn against_surface(&self, pose: &Pose, at: FrameAge) -> Pose {
        // The very same bits where nothing moves: answers are found again by them.
        if self.velocity_m_s == Vector3::zeros() || at.age_s == 0.0 {
            return *pose;
        }
        pose.moved((self.velocity_m_s * -at.age_s).into())
    }

    fn keep_planes(&mut self, frame: u64, result: &BodyResult) {
        if self.newest.frame != frame {
            std::mem::swap(&mut self.before, &mut self.newest);
            self.newest.frame = frame;
        }
        let plane = |touch: &Touch| {
            let edge = touch.edge?;
            let normal = Vector3::from(edge.normal_world.map(f64::from));
            Some(SamplePlane { sample: touch.sample, normal, camera: edge.camera })
        };
        self.newest.planes.clear();
        self.newest.planes.extend(result.touches.iter().filter_map(plane));
    }
}

impl FramePlanes {
    /// Says of each contact how fast the surface moved out along its normal since these planes, m/s.
    fn find_speeds(
        &self,
        result: &mut BodyResult,
        place: impl Fn(u32) -> Point3<f64>,
        centres: &[Point3<f64>],
        per_s: f64,
    ) {
        let mut before = self.planes.iter().peekable();
        for touch in &mut result.touches {
            while before.next_if(|plane| plane.sample < touch.sample).is_some() {}
            let (Some(plane), Some(edge), Some(depth_m)) =
                (before.next_if(|plane| plane.sample == touch.sample), touch.edge, touch.exit_m)
            else {
                continue;
            };
            let Some(centre) = centres.get(usize::from(plane.camera)) else { continue };
            let normal = Vector3::from(edge.normal_world.map(f64::from));
            let depth_before_m = plane.normal.dot(&(centre - place(touch.sample)));
            let speed_m_s = (f64::from(depth_m) - depth_before_m) * per_s;
            // Two cameras' planes lie millimetres apart: what they differ by is no motion.
            let is_same = plane.camera == edge.camera && normal.dot(&plane.normal) > SAME_SURFACE;
            if is_same && speed_m_s.abs() <= MAX_SPEED_M_S {
                touch.speed_m_s = Some(speed_m_s as f32);
            }
        }
    }
}

/// The velocity that explains the contacts' speeds best, m/s.
fn velocity(result: &BodyResult) -> Vector3<f64> {
    let (mut normals, mut speeds) = (Matrix3::zeros(), Vector3::zeros());
    for touch in &result.touches {
        let (Some(edge), Some(speed_m_s)) = (touch.edge, touch.speed_m_s) else { continue };
        let normal = Vector3::from(edge.normal_world.map(f64::from));
        normals += normal * normal.transpose() + Matrix3::identity() * REST_WEIGHT;
        speeds += normal * f64::from(speed_m_s);
    }
    normals.try_inverse().map_or(Vector3::zeros(), |inverse| inverse * speeds)
}

#[cfg(test)]
mod tests {
    use super::*;
    use hull::camera::Pixel;
    use hull::question::Edge;
    use sim::{ResponseMode, Scene, World, WorldSettings};

    const FPS: f64 = 30.0;
    /// A camera that sees a surface beside it, 3 m away; its planes lean as the surface rises.
    const CENTRES: [Point3<f64>; 1] = [Point3::new(3.0, 0.998, 0.0)];

    fn world() -> World {
        let text = "[[bodies]]\nname = 'box'\nshape.box.size = [0.2, 0.2, 0.2]\nplace.at = [0.0, 1.1, 0.0]";
        let scene = Scene::from_toml("test", text).expect("a scene");
        let settings = WorldSettings { response: ResponseMode::Contacts, ..WorldSettings::default() };
        World::new(&scene, settings).expect("a world")
    }

    /// Planes for every sample of the lower face and its feeler, of a surface at that height below the middle of the body.
    fn planes(body: &Body, height_m: f64) -> BodyResult {
        let normal = Vector3::new(height_m - CENTRES[0].y, CENTRES[0].x, 0.0).normalize();
        let edge = Edge {
            distance_m: 0.01,
            camera: 0,
            pixel: Pixel { column: 0, row: 0 },
            normal_world: [normal.x as f32, normal.y as f32, 0.0],
        };
        let count = body.shape.samples_body().len() as u32;
        let lower = (0..count).filter(|&sample| body.shape.samples_body()[sample as usize][1] < -0.09);
        let both: Vec<u32> = lower.clone().chain(lower.map(|sample| sample + count)).collect();
        let touch =
            |sample| Touch { sample, inside_count: 3, edge: Some(edge), exit_m: None, speed_m_s: None };
        BodyResult { touches: both.into_iter().map(touch).collect(), ..BodyResult::default() }
    }

    #[test]
    fn a_surface_that_rises_has_its_speed_and_goes_on_between_frames() {
        let world = world();
        let body = &world.bodies()[0];
        let mut surfaces = Surfaces::at(FPS);
        surfaces.set_bodies(1);
        let depth = |result: &BodyResult| result.touches[0].exit_m.expect("a depth");
        // It rises by 1 cm a frame, to 2 mm below the box and on.
        let first =
            surfaces.contacts(0, surfaces.frame_age(7, 7.0 / FPS), &planes(body, 0.998), body, &CENTRES);
        assert!((depth(&first) + 0.002).abs() < 1e-6 && first.touches[0].speed_m_s.is_none());
        let at = surfaces.frame_age(8, 8.0 / FPS);
        let second = surfaces.contacts(0, at, &planes(body, 1.008), body, &CENTRES);
        assert!((depth(&second) - 0.008).abs() < 5e-4);
        assert!(second.touches.iter().all(|touch| (touch.speed_m_s.expect("known") - 0.3).abs() < 0.02));
        // Half a frame later it has gone on by half of that, and the body is asked about as much lower.
        let later = surfaces.frame_age(8, 8.5 / FPS);
        let asked = surfaces.pose_to_ask(0, later, &body.pose, &body.probes);
        assert!((asked.position_m()[1] - (1.1 - 0.005)).abs() < 2e-4, "{asked:?}");
        let third = surfaces.contacts(0, later, &planes(body, 1.008), body, &CENTRES);
        assert!((depth(&third) - 0.013).abs() < 5e-4);
        // A frame that stays is film that stands still.
        let still = surfaces.frame_age(8, 12.0 / FPS);
        let fourth = surfaces.contacts(0, still, &planes(body, 1.008), body, &CENTRES);
        assert!((depth(&fourth) - 0.008).abs() < 5e-4);
    }

    #[test]
    fn a_body_is_asked_again_once_it_has_moved_against_the_surface_or_at_another_frame() {
        let world = world();
        let body = &world.bodies()[0];
        let mut surfaces = Surfaces::at(FPS);
        surfaces.set_bodies(1);
        let mut ask = |frame: u64, down_m: f64| {
            let pose = body.pose.moved([0.0, -down_m, 0.0]);
            let at = surfaces.frame_age(frame, frame as f64 / FPS);
            1.1 - surfaces.pose_to_ask(0, at, &pose, &body.probes).position_m()[1]
        };
        let is = |found: f64, expected: f64| (found - expected).abs() < 1e-6;
        assert!(is(ask(3, 0.0), 0.0) && is(ask(3, 0.003), 0.0), "near enough");
        assert!(is(ask(3, 0.005), 0.005) && is(ask(3, 0.007), 0.005), "moved");
        assert!(is(ask(4, 0.007), 0.007), "another frame");
    }
}
