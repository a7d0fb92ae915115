//! How fast the surface near a body moves, from the planes that its samples had in the frame before.

use nalgebra::{Matrix3, Point3, Vector3};

use crate::contact::{Eye, depth_m, normal_of};
use crate::pass::Touch;

/// A surface that moves faster than this is another surface, m/s.
const MAX_SPEED_M_S: f64 = 10.0;
/// A surface that moves slower than this stands still, m/s.
const LEAST_SPEED_M_S: f64 = 0.002;
/// Planes of one sample are of one surface if their normals are so near: cosine of 25 degrees.
const SAME_SURFACE: f64 = 0.906;
/// Frames back to which a speed is measured.
const MAX_FRAMES_BACK: u64 = 3;
/// What a body's surface is taken to do where its contacts do not say: nothing, by so much of each contact's weight.
const REST_WEIGHT: f64 = 0.01;

/// The planes of a body's samples as the newest frame has them, and the frame before.
#[derive(Clone, Debug, Default)]
pub(super) struct Speeds {
    newest: FramePlanes,
    before: FramePlanes,
}

/// The planes of samples at one frame, ascending by sample.
#[derive(Clone, Debug, Default)]
struct FramePlanes {
    frame: u64,
    touches: Vec<Touch>,
}

impl Speeds {
    /// Keeps a frame's planes, and says of each how fast the surface moved out along its normal since the frame before.
    pub fn tell(
        &mut self,
        frame: u64,
        fps: f64,
        touches: &mut [Touch],
        place: impl Fn(u32) -> Point3<f64>,
        eyes: &[Eye],
    ) {
        if self.newest.frame != frame {
            std::mem::swap(&mut self.before, &mut self.newest);
            self.newest.frame = frame;
        }
        self.newest.touches.clear();
        self.newest.touches.extend_from_slice(touches);
        let back = frame.saturating_sub(self.before.frame);
        if !(1..=MAX_FRAMES_BACK).contains(&back) {
            return;
        }
        let mut before = self.before.touches.iter().peekable();
        for touch in touches {
            while before.next_if(|plane| plane.sample < touch.sample).is_some() {}
            if let Some(plane) = before.next_if(|plane| plane.sample == touch.sample) {
                touch.speed_m_s = speed_m_s(plane, touch, &place(touch.sample), eyes, fps / back as f64);
            }
        }
    }
}

fn speed_m_s(before: &Touch, now: &Touch, at: &Point3<f64>, eyes: &[Eye], per_s: f64) -> Option<f32> {
    // Two cameras' planes lie millimetres apart: what they differ by is no motion.
    let is_same =
        before.edge?.camera == now.edge?.camera && normal_of(before).dot(&normal_of(now)) > SAME_SURFACE;
    let speed_m_s = (depth_m(now, at, eyes)? - depth_m(before, at, eyes)?) * per_s;
    let is_still = speed_m_s.abs() < LEAST_SPEED_M_S;
    (is_same && speed_m_s.abs() <= MAX_SPEED_M_S).then_some(if is_still { 0.0 } else { speed_m_s as f32 })
}

/// The velocity that explains the contacts' speeds best, m/s.
pub(super) fn velocity_m_s(touches: &[Touch]) -> Vector3<f64> {
    let (mut normals, mut speeds) = (Matrix3::zeros(), Vector3::zeros());
    for touch in touches {
        let Some(speed_m_s) = touch.speed_m_s else { continue };
        let normal = normal_of(touch);
        normals += normal * normal.transpose() + Matrix3::identity() * REST_WEIGHT;
        speeds += normal * f64::from(speed_m_s);
    }
    if speeds == Vector3::zeros() {
        return speeds;
    }
    normals.try_inverse().map_or(Vector3::zeros(), |inverse| inverse * speeds)
}
