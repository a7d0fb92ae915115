//! The hull's surface near each moving body of a world. Under `--response contacts` only.

use std::collections::HashMap;

use hull::Pose;
use hull::contact::{BodyContacts, Eye};
use hull::pass::BodyPlanes;
use hull::surface::{BodySurface, FrameAge, HullTime, PoseToAsk, Sampled};
use nalgebra::Vector3;
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

    /// Where to look for how far the surface near a body moved, if that must be known.
    pub fn place_to_look(
        &self,
        index: usize,
        at: FrameAge,
        planes: &BodyPlanes,
        body: &Body,
    ) -> Option<Pose> {
        self.bodies[index].place_to_look(at, planes, &sampled(body)?)
    }

    /// How far it moved before the frame, world, metres.
    pub fn take_shift(&mut self, index: usize, at: FrameAge, shift_m: Vector3<f64>) {
        self.bodies[index].take_shift(at, shift_m);
    }

    /// The contacts of a body with the planes found for its samples and offset samples, where body and surface are now.
    pub fn contacts(&mut self, index: usize, at: FrameAge, planes: &BodyPlanes, body: &Body) -> BodyContacts {
        let Some(sampled) = sampled(body) else { return BodyContacts::default() };
        self.bodies[index].contacts(at, planes, &sampled, &self.eyes)
    }
}

/// A body as its surface sees it. Under `contacts` every body has faces.
fn sampled(body: &Body) -> Option<Sampled<'_>> {
    Some(Sampled {
        shape: &body.shape,
        around: body.around.as_deref(),
        pose: &body.pose,
        velocity_m_s: body.velocity_m_s.into(),
        faces: body.faces.as_ref()?,
    })
}
