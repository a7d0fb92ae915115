//! Bodies that are deep in the hull: the surface nearest to a sample is not the one that it came through. Each sample asks for
//! its way out, and then for the plane of the surface there.
//!
//! - Of a body whose motion against the surface is known, each sample inside goes back the way it came (paper §7: very fast
//!   objects).
//! - Of a body of which no sample is faced by the surface found for it, each goes against its own face. Where some
//!   are faced these push the body out, and the others have nothing to add: their ways lead through the limb to another
//!   side of it.

use nalgebra::{Point3, Vector3};

use super::super::found::FoundSample;
use super::super::{Pass, PassBody, PendingQuestion, Response, Round, changes_of};
use super::ContactBody;
use crate::merge::first_exit;
use crate::question::{Batch, Points, QuestionKind};
use crate::reach::Reach;

/// A longer way out is none, metres: what moves so far in a frame is another limb.
const MAX_WAY_OUT_M: f64 = 0.2;
/// The plane is asked for so far before the exit, metres: there it is the nearest.
const BEFORE_EXIT_M: f64 = 1e-3;

impl Pass {
    /// Asks for the exits of the samples of such bodies, against their faces.
    pub(super) fn ask_ways_out(&mut self) {
        let Pass { pending, bodies, response, .. } = self;
        let Response::Contacts(contacts) = response else { return };
        pending.restart(QuestionKind::Exits);
        for (body, of_contacts) in bodies.asked().iter().zip(&mut contacts.bodies) {
            if of_contacts.back_m.is_some() {
                continue;
            }
            let is_faced = |found: &FoundSample| found.edge.is_some() && of_contacts.is_faced(body, found);
            if body.found.iter().any(is_faced) {
                of_contacts.faces = None;
            }
        }
        // What is around bodies has no faces, and what was found there is the bodies'.
        pending.pick(bodies.asked(), |index, body, _, found| {
            contacts.bodies[index].way_out(body, found).is_some()
        });
        let PendingQuestion { question, targets, merged, .. } = pending;
        for &(body, at) in &targets.0 {
            let (body, of_contacts) = (&bodies.asked()[body as usize], &contacts.bodies[body as usize]);
            question.directions.extend(of_contacts.way_out(body, &body.found[at as usize]));
        }
        let reach = |&(body, _): &(u32, u32)| Reach::covering(contacts.bodies[body as usize].farthest_m());
        question.within.extend(targets.0.iter().map(reach));
        if contacts.speculation.take_exits(targets, merged) {
            return self.after_ways_out();
        }
        self.ask(Round::Exits, |_| true);
    }

    /// Asks for the planes where the ways out end.
    pub(in crate::pass) fn after_ways_out(&mut self) {
        let rule = self.settings.rule();
        let Pass { pending: PendingQuestion { question, targets, merged, .. }, bodies, response, .. } = self;
        let Response::Contacts(contacts) = response else { return };
        let (mut changes, mut points, mut ending) = (0..0, Vec::new(), Vec::new());
        for (at, (&(body, index), &outside_m)) in targets.0.iter().zip(&merged.exits_m).enumerate() {
            let of_pass = &bodies.asked()[body as usize];
            let found = &of_pass.found[index as usize];
            changes = changes_of(&merged.changes, at, changes.end);
            let exit_m = first_exit(outside_m, &merged.changes[changes.clone()], found.inside_count, rule);
            let Some((exit_m, place)) = exit_m.zip(of_pass.place_world(found.sample)) else {
                continue;
            };
            let exit_m = f64::from(exit_m);
            if exit_m > contacts.bodies[body as usize].farthest_m() {
                continue;
            }
            let way = Vector3::from(question.directions[at].map(f64::from));
            points.push((place + way * (exit_m - BEFORE_EXIT_M.min(0.5 * exit_m))).into());
            ending.push((body, index));
        }
        targets.0 = ending;
        question.restart(QuestionKind::Planes);
        if !points.is_empty() {
            question.batches.push(Batch::all(Points::World(points.into())));
        }
        self.ask(Round::Check, |_| true);
    }

    /// Takes those planes.
    pub(in crate::pass) fn after_planes_beyond(&mut self) {
        let Pass { pending: PendingQuestion { targets, merged, .. }, bodies, .. } = self;
        for (&(body, found), edge) in targets.0.iter().zip(&merged.edges) {
            if edge.is_some() {
                bodies.asked_mut()[body as usize].found[found as usize].edge = *edge;
            }
        }
        self.round = Round::Done;
    }
}

impl ContactBody {
    /// Which way a sample inside leaves the hull, if that is asked: back, or against its faces if the surface found for it does
    /// not face it. Unit, world.
    fn way_out(&self, body: &PassBody, found: &FoundSample) -> Option<[f32; 3]> {
        if let Some(back) = self.back() {
            return Some(back);
        }
        let is_odd = found.edge.is_some() && !self.is_faced(body, found);
        self.against_faces(body, found.sample).filter(|_| is_odd)
    }

    /// Which way the body goes back, if that is known. Unit, world.
    fn back(&self) -> Option<[f32; 3]> {
        let back = Vector3::from(self.back_m?.map(f64::from)).try_normalize(0.0)?;
        Some(back.map(|part| part as f32).into())
    }

    /// How long a way out may be, metres.
    pub fn farthest_m(&self) -> f64 {
        self.back_m.map_or(MAX_WAY_OUT_M, |back_m| Vector3::from(back_m.map(f64::from)).norm())
    }

    /// Which way a sample leaves the hull, as far as that is known before planes are. Unit, world.
    pub fn likely_way_out(&self, body: &PassBody, sample: u32) -> Option<[f32; 3]> {
        self.back().or_else(|| self.against_faces(body, sample))
    }

    /// Against a sample's faces, if it has some.
    fn against_faces(&self, body: &PassBody, sample: u32) -> Option<[f32; 3]> {
        let (Points::Body { pose, .. }, Some(faces)) = (&body.points, &self.faces) else { return None };
        let sum: Vector3<f64> = faces.at(sample as usize).iter().sum();
        let way = (pose.rotation() * -sum).try_normalize(1e-6)?;
        Some(way.map(|part| part as f32).into())
    }

    /// Whether the surface found for a sample faces it.
    pub fn is_faced(&self, body: &PassBody, found: &FoundSample) -> bool {
        let (Points::Body { pose, .. }, Some(faces)) = (&body.points, &self.faces) else { return false };
        let normal = found.edge.map_or_else(Vector3::zeros, |edge| edge.normal_world.map(f64::from).into());
        faces.is_faced(found.sample as usize, pose, &normal)
    }
}

impl PassBody {
    fn place_world(&self, sample: u32) -> Option<Point3<f64>> {
        let Points::Body { shape, pose } = &self.points else { return None };
        let world_from_body = pose.world_from_body();
        shape.samples_body().get(sample as usize).map(|&sample| world_from_body(sample))
    }
}
