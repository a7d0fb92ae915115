//! The bodies of a pass, and after them the points around them. Buffers are kept from pass to pass.

use super::found::FoundSample;
use super::{AskedBody, Reaches};
use crate::cull::WorldBox;
use crate::question::Points;
use crate::reach::Reach;

/// A body of a pass, or what is around one.
#[derive(Clone, Debug)]
pub(super) struct PassBody {
    pub points: Points,
    pub reaches: Reaches,
    /// Its samples inside the hull, ascending.
    pub found: Vec<FoundSample>,
    /// Of each of them the reach of its exit along its edge's normal, if it was answered.
    pub exits_within: Vec<Option<Reach>>,
    /// Its box meets the hull's.
    pub is_near: bool,
    /// These points are around a body.
    pub is_around: bool,
    /// All its edges were asked for together with the classes.
    pub are_edges_known: bool,
}

/// The bodies of a pass, and what is around them.
#[derive(Clone, Debug, Default)]
pub(super) struct Bodies {
    /// Bodies of this pass, then what is around them, then buffers.
    buffers: Vec<PassBody>,
    /// How many are bodies or around one.
    count: usize,
    /// How many are bodies.
    asked_count: usize,
    /// The points around bodies and their owners, until all bodies are there.
    around: Vec<(usize, Points)>,
}

impl Bodies {
    /// Begins a pass without bodies.
    pub fn restart(&mut self) {
        (self.count, self.asked_count) = (0, 0);
        self.around.clear();
    }

    /// Adds a body. Without a `hull_box` nothing can be inside.
    pub fn add(&mut self, body: AskedBody<'_>, hull_box: Option<&WorldBox>) {
        let is_near = match (hull_box, &body.points) {
            (None, _) => false,
            (Some(hull_box), Points::Body { shape, pose }) => hull_box.meets(&WorldBox::of_body(shape, pose)),
            (Some(_), Points::World(_)) => true,
        };
        self.around.extend(body.around.map(|points| (self.asked_count, points)));
        self.push(body.points, body.reaches, is_near, false);
        self.asked_count += 1;
    }

    /// Adds what is around the bodies, once all bodies are there; `of_owner` gets the owner of each.
    pub fn add_around(&mut self, mut of_owner: impl FnMut(usize)) {
        let unknown = Reaches::default();
        let mut around = std::mem::take(&mut self.around);
        for (owner, points) in around.drain(..) {
            let is_near = self.buffers[owner].is_near;
            self.push(points, &unknown, is_near, true);
            of_owner(owner);
        }
        self.around = around;
    }

    fn push(&mut self, points: Points, known: &Reaches, is_near: bool, is_around: bool) {
        let old = self.buffers.get_mut(self.count);
        let take = |old: &mut PassBody| {
            let PassBody { found, exits_within, reaches, .. } = old;
            (std::mem::take(found), std::mem::take(exits_within), std::mem::take(reaches))
        };
        let (mut found, exits_within, mut reaches) = old.map(take).unwrap_or_default();
        found.clear();
        reaches.copy_from(known);
        let are_edges_known = false;
        let body = PassBody { points, reaches, found, exits_within, is_near, is_around, are_edges_known };
        if self.count < self.buffers.len() {
            self.buffers[self.count] = body;
        } else {
            self.buffers.push(body);
        }
        self.count += 1;
    }

    /// The bodies, and after them what is around them.
    pub fn all(&self) -> &[PassBody] {
        &self.buffers[..self.count]
    }

    /// The same, to change.
    pub fn all_mut(&mut self) -> &mut [PassBody] {
        &mut self.buffers[..self.count]
    }

    /// The bodies alone.
    pub fn asked(&self) -> &[PassBody] {
        &self.buffers[..self.asked_count]
    }

    /// The same, to change.
    pub fn asked_mut(&mut self) -> &mut [PassBody] {
        &mut self.buffers[..self.asked_count]
    }

    /// The bodies, and what is around them, apart.
    pub fn split_mut(&mut self) -> (&mut [PassBody], &mut [PassBody]) {
        self.buffers[..self.count].split_at_mut(self.asked_count)
    }
}
