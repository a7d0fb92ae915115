//! Bodies of which no sample is faced by the surface found for it: deep in the hull, or met by a limb between two
//! frames. Each sample asks for its exit against its own face, and then for the plane of the surface there. Where some
//! are faced these push the body out, and the others have nothing to add: their ways lead through the limb to another
//! side of it.

use nalgebra::{Point3, Vector3};

use super::{Pass, PassBody, Round, Touch, changes_of};
use crate::merge::first_exit;
use crate::question::{Batch, Points, QuestionKind};
use crate::reach::Reach;

/// A longer way out is none, metres: what moves so far in a frame is another limb.
pub(super) const MAX_WAY_OUT_M: f64 = 0.2;
/// The plane is asked for so far before the exit, metres: there it is the nearest.
const BEFORE_EXIT_M: f64 = 1e-3;

impl Pass {
    /// Asks for the exits of the samples of such bodies, against their faces.
    pub(super) fn ask_ways_out(&mut self) {
        self.question.restart(QuestionKind::Exits);
        for (body, result) in self.bodies[..self.asked_count].iter_mut().zip(&self.results) {
            let is_faced = |touch: &Touch| touch.edge.is_some() && body.is_faced(touch);
            if result.touches.iter().any(is_faced) {
                body.faces = None;
            }
        }
        self.pick_touches([0.0; 3], |body, _, touch| way_out(body, touch).is_some());
        let Pass { question, targets, bodies, results, merged, speculation, .. } = self;
        for &(body, touch) in &targets.0 {
            let touch = &results[body as usize].touches[touch as usize];
            question.directions.extend(way_out(&bodies[body as usize], touch));
        }
        question.within.resize(targets.0.len(), Reach::covering(MAX_WAY_OUT_M));
        if speculation.take_exits(targets, merged) {
            return self.after_ways_out();
        }
        self.ask(Round::Exits, |_| true);
    }

    /// Asks for the planes where the ways out end.
    pub(super) fn after_ways_out(&mut self) {
        let rule = self.settings.rule();
        let Pass { targets, merged, results, bodies, question, .. } = self;
        let (mut changes, mut points, mut found) = (0..0, Vec::new(), Vec::new());
        for (at, (&(body, index), &outside_m)) in targets.0.iter().zip(&merged.exits_m).enumerate() {
            let touch = &results[body as usize].touches[index as usize];
            changes = changes_of(&merged.changes, at, changes.end);
            let exit_m = first_exit(outside_m, &merged.changes[changes.clone()], touch.inside_count, rule);
            let Some((exit_m, place)) = exit_m.zip(bodies[body as usize].place_world(touch.sample)) else {
                continue;
            };
            let exit_m = f64::from(exit_m);
            if exit_m > MAX_WAY_OUT_M {
                continue;
            }
            let way = Vector3::from(question.directions[at].map(f64::from));
            points.push((place + way * (exit_m - BEFORE_EXIT_M.min(0.5 * exit_m))).into());
            found.push((body, index));
        }
        targets.0 = found;
        question.restart(QuestionKind::Planes);
        if !points.is_empty() {
            question.batches.push(Batch::all(Points::World(points.into())));
        }
        self.ask(Round::Check, |_| true);
    }

    /// Takes those planes.
    pub(super) fn after_planes_beyond(&mut self) {
        let Pass { targets, merged, results, .. } = self;
        for (&(body, touch), edge) in targets.0.iter().zip(&merged.edges) {
            if edge.is_some() {
                results[body as usize].touches[touch as usize].edge = *edge;
            }
        }
        self.round = Round::Done;
    }
}

/// Against a sample's faces, if it is in the hull and the surface found for it does not face it.
fn way_out(body: &PassBody, touch: &Touch) -> Option<[f32; 3]> {
    let is_odd = touch.edge.is_some() && !body.is_faced(touch);
    body.against_faces(touch.sample).filter(|_| is_odd)
}

impl PassBody {
    /// Against a sample's faces, if it has some.
    pub(super) fn against_faces(&self, sample: u32) -> Option<[f32; 3]> {
        let (Points::Body { pose, .. }, Some(faces)) = (&self.points, &self.faces) else { return None };
        let sum: Vector3<f64> = faces.at(sample as usize).iter().sum();
        let way = (pose.rotation() * -sum).try_normalize(1e-6)?;
        Some(way.map(|part| part as f32).into())
    }

    /// Whether the surface found for a touch faces its sample.
    pub(super) fn is_faced(&self, touch: &Touch) -> bool {
        let (Points::Body { pose, .. }, Some(faces)) = (&self.points, &self.faces) else { return false };
        faces.is_faced(touch.sample as usize, pose, &touch.normal_world())
    }

    fn place_world(&self, sample: u32) -> Option<Point3<f64>> {
        let Points::Body { shape, pose } = &self.points else { return None };
        let world_from_body = pose.world_from_body();
        shape.samples_body().get(sample as usize).map(|&sample| world_from_body(sample))
    }
}
