//! The hull's surface near a body from frame to frame: planes hold for their film frame, move on at the speed that the
//! frame before tells, and stay where they are while outlines only flicker.
//!
//! Between frames the surface goes on along its normals. So a body is asked about where it would be had the surface
//! stood still since the frame, and again once it has left that place: what rides on a lifted lid is asked once a
//! frame. How fast a surface moves follows from the planes that the same samples had in the frame before; motion along
//! a surface cannot be seen there.

mod speed;
mod still;

use nalgebra::Vector3;

use crate::body::{Pose, Shape};
use crate::contact::{Eye, contacts, depth_m, is_near};
use crate::pass::{BodyResult, Touch};
use speed::{Speeds, velocity_m_s};
use still::Beliefs;

/// Planes that were found for a pose hold while no sample moves farther against the surface, metres.
const HOLD_WITHIN_M: f64 = 0.004;
/// Film that shows a frame for so many periods stands still, and its surfaces with it.
const STILL_PERIODS: f64 = 1.5;

/// The frame that a step sees, and how old it is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrameAge {
    frame: u64,
    fps: f64,
    age_s: f64,
}

impl FrameAge {
    /// A step that ends at `film_s` and sees `frame` of film of so many frames a second.
    pub fn new(frame: u64, fps: f64, film_s: f64) -> FrameAge {
        let age_s = (film_s - frame as f64 / fps).max(0.0);
        FrameAge { frame, fps, age_s: if age_s * fps > STILL_PERIODS { 0.0 } else { age_s } }
    }
}

/// A body and the directions in which it has a surface.
#[derive(Clone, Copy)]
pub struct Sampled<'a, Faces> {
    /// Its samples.
    pub shape: &'a Shape,
    /// Where it is now.
    pub pose: &'a Pose,
    /// Which way the faces of a sample look, body frame.
    pub faces: Faces,
}

/// What is known of the surface near one body.
#[derive(Clone, Debug, Default)]
pub struct BodySurface {
    /// What was asked last: the frame and the pose.
    asked: Option<(u64, Pose)>,
    /// Whether what was asked has yet to be taken in.
    is_new: bool,
    /// No sample moved farther between what was asked last and before, metres.
    moved_m: f64,
    /// Of the surface along the normals of the contacts, world.
    velocity_m_s: Vector3<f64>,
    speeds: Speeds,
    beliefs: Beliefs,
}

impl BodySurface {
    /// The pose to ask about a body whose samples and feelers are `probes`: the one that was asked before, while
    /// its planes hold.
    pub fn pose_to_ask(&mut self, at: FrameAge, present: &Pose, probes: &Shape) -> Pose {
        let pose = self.against_surface(present, at);
        match self.asked {
            Some((frame, asked))
                if frame == at.frame && probes.moved_at_most_m(&asked, &pose) <= HOLD_WITHIN_M =>
            {
                asked
            }
            _ => {
                self.moved_m = self.asked.map_or(0.0, |(_, before)| probes.moved_at_most_m(&before, &pose));
                self.asked = Some((at.frame, pose));
                self.is_new = true;
                pose
            }
        }
    }

    /// The contacts of a body with the planes found for its samples and feelers, where body and surface are now. `eyes`
    /// are those of the rig's cameras.
    pub fn contacts<'a>(
        &mut self,
        at: FrameAge,
        planes: &BodyResult,
        body: &Sampled<'_, impl Fn(usize) -> &'a [Vector3<f64>]>,
        eyes: &[Eye],
    ) -> BodyResult {
        let pose = self.against_surface(body.pose, at);
        let world_from_body = pose.world_from_body();
        let samples = body.shape.samples_body();
        let place = |sample: u32| world_from_body(samples[sample as usize]);
        let is_contact = |touch: &Touch, depth_m: f64| is_near(touch, depth_m, &pose, &body.faces);
        if std::mem::take(&mut self.is_new) {
            let mut seen = contacts(planes, body.shape, &pose, &body.faces, eyes).touches;
            self.speeds.tell(at.frame, at.fps, &mut seen, place, eyes);
            self.beliefs.take(&seen, self.moved_m, place, is_contact, eyes);
        }
        let contact = |touch: &Touch| {
            let depth_m = depth_m(touch, &place(touch.sample), eyes)?;
            is_contact(touch, depth_m).then_some(Touch { exit_m: Some(depth_m as f32), ..*touch })
        };
        let touches: Vec<Touch> = self.beliefs.touches().filter_map(contact).collect();
        self.velocity_m_s = velocity_m_s(&touches);
        BodyResult { touches, ..BodyResult::default() }
    }

    /// Where a body would be had the surface stood still since the frame.
    fn against_surface(&self, pose: &Pose, at: FrameAge) -> Pose {
        // The very same bits where nothing moves: answers are found again by them.
        if self.velocity_m_s == Vector3::zeros() || at.age_s == 0.0 {
            return *pose;
        }
        pose.moved((self.velocity_m_s * -at.age_s).into())
    }
}

#[cfg(test)]
mod tests;
