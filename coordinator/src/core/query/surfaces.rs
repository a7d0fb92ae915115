//! The hull's surface near each moving body of a world. Under `--response contacts` only.

use std::collections::HashMap;

use hull::contact::{BodyContacts, Eye};
use hull::pass::BodyPlanes;
use hull::surface::{BodySurface, FrameAge, HullTime, PoseToAsk, Sampled};
use sim::{Body, BodyId};

/// The surfaces near the moving bodies of a world.
#[derive(Clone, Debug, Default)]
pub struct Surfaces {
    fps: f64,
    hull_time: HullTime,
    /// Of the rig's cameras.
    eyes: Vec<Eye>,
    ids: Vec<BodyId>,
    bodies: Vec<BodySurface>,
}

impl Surfaces {
    /// Surfaces of film of so many frames a second, seen by these cameras of a rig.
    pub fn of(fps: f64, hull_time: HullTime, eyes: Vec<Eye>) -> Surfaces {
        Surfaces { fps, hull_time, eyes, ids: Vec::new(), bodies: Vec::new() }
    }

    /// Bodies have come or gone: what is known near the others stays.
    pub fn set_bodies(&mut self, ids: Vec<BodyId>) {
        let mut known: HashMap<BodyId, BodySurface> = self.ids.drain(..).zip(self.bodies.drain(..)).collect();
        self.bodies.extend(ids.iter().map(|id| known.remove(id).unwrap_or_default()));
        self.ids = ids;
    }

    /// Another world has begun: its bodies are others.
    pub fn forget(&mut self) {
        self.ids.clear();
        self.bodies.clear();
    }

    /// A step that ends at `film_s` and sees `frame`.
    pub fn frame_age(&self, frame: u64, film_s: f64) -> FrameAge {
        FrameAge::new(frame, self.fps, film_s, self.hull_time)
    }

    /// What to ask about a body.
    pub fn pose_to_ask(&mut self, index: usize, at: FrameAge, body: &Body) -> PoseToAsk {
        self.bodies[index].pose_to_ask(at, &body.pose, &body.probes)
    }

    /// The contacts of a body with the planes found for its samples and feelers, where body and surface are now.
    pub fn contacts(&mut self, index: usize, at: FrameAge, planes: &BodyPlanes, body: &Body) -> BodyContacts {
        // Under `contacts` every body has faces.
        let Some(faces) = &body.faces else { return BodyContacts::default() };
        let sampled = Sampled {
            shape: &body.shape,
            around: body.around.as_deref(),
            pose: &body.pose,
            velocity_m_s: body.velocity_m_s.into(),
            faces,
        };
        self.bodies[index].contacts(at, planes, &sampled, &self.eyes)
    }
}
