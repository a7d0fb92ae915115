//! The hull's surface near each moving body of a world. Under `--response contacts` only.

use hull::Pose;
use hull::contact::{BodyContacts, Eye};
use hull::pass::BodyPlanes;
use hull::surface::{BodySurface, FrameAge, HullTime, Sampled};
use sim::Body;

/// The surfaces near the moving bodies of a world.
#[derive(Clone, Debug, Default)]
pub struct Surfaces {
    fps: f64,
    hull_time: HullTime,
    /// Of the rig's cameras.
    eyes: Vec<Eye>,
    bodies: Vec<BodySurface>,
}

impl Surfaces {
    /// Surfaces of film of so many frames a second, seen by these cameras of a rig.
    pub fn of(fps: f64, hull_time: HullTime, eyes: Vec<Eye>) -> Surfaces {
        Surfaces { fps, hull_time, eyes, bodies: Vec::new() }
    }

    /// Other bodies: nothing is known of any.
    pub fn set_bodies(&mut self, count: usize) {
        self.bodies.clear();
        self.bodies.resize_with(count, BodySurface::default);
    }

    /// A step that ends at `film_s` and sees `frame`.
    pub fn frame_age(&self, frame: u64, film_s: f64) -> FrameAge {
        FrameAge::new(frame, self.fps, film_s, self.hull_time)
    }

    /// The pose to ask about a body.
    pub fn pose_to_ask(&mut self, index: usize, at: FrameAge, body: &Body) -> Pose {
        self.bodies[index].pose_to_ask(at, &body.pose, &body.probes)
    }

    /// The contacts of a body with the planes found for its samples and feelers, where body and surface are now.
    pub fn contacts(&mut self, index: usize, at: FrameAge, planes: &BodyPlanes, body: &Body) -> BodyContacts {
        // Under `contacts` every body has faces.
        let Some(faces) = &body.faces else { return BodyContacts::default() };
        let sampled = Sampled { shape: &body.shape, around: body.around.as_deref(), pose: &body.pose, faces };
        self.bodies[index].contacts(at, planes, &sampled, &self.eyes)
    }
}
