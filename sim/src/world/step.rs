//! One step: the hull's answers, then the solver.

use super::limits::check_pairs;
use super::{World, WorldError, WorldSettings};
use crate::response::{BodyResponse, HullContact, ResponseMode, mirrored};
use crate::solver::Surface;
use nalgebra::Vector3;

/// A contact so near to the surface holds its body, metres.
const HELD_M: f32 = 1e-3;

/// What happened in one step.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct StepReport {
    /// Bodies with a response or a sample inside the hull.
    pub touched: usize,
    /// Numbers that were none. What they would have done has not been done.
    pub faults: Vec<Fault>,
}

/// Numbers that are not finite, and where.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Fault {
    /// The body's name.
    pub body: String,
    /// Where they came from.
    pub kind: FaultKind,
}

/// Where numbers that are not finite came from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FaultKind {
    /// The response that was handed in; the body was left where it was.
    Response,
    /// The solver; the body was put to rest where it was before the step.
    Solver,
}

impl World {
    /// Applies one response per moving body (in the order of [`World::moving_bodies`]) and moves all
    /// bodies by one step. Fails, and does nothing, if the number of responses is another, or if so many bodies overlap
    /// that the solver would take seconds. Numbers that are not finite are reported and do no harm.
    pub fn step(&mut self, responses: &[BodyResponse]) -> Result<StepReport, WorldError> {
        if responses.len() != self.moving.len() {
            return Err(WorldError::ResponseCount { found: responses.len(), expected: self.moving.len() });
        }
        check_pairs(self.bodies.iter())?;
        let mut report = StepReport::default();
        for (slot, response) in responses.iter().enumerate() {
            let index = self.moving[slot];
            match self.settings.response {
                ResponseMode::Paper if response.touches() => self.touch(index, response, &mut report),
                ResponseMode::Paper => {}
                ResponseMode::Contacts => self.set_contacts(index, response, &mut report),
            }
        }
        self.solver.step();
        self.steps += 1;
        for slot in 0..self.moving.len() {
            self.take_over(self.moving[slot], &mut report);
        }
        self.trajectory.add(self.bodies.iter().map(|body| &body.pose));
        Ok(report)
    }

    /// Applies what the hull says about one body; bodies that do not answer are only counted.
    fn touch(&mut self, index: usize, response: &BodyResponse, report: &mut StepReport) {
        let time_s = self.next_time_s();
        report.touched += 1;
        if !self.answers_hull {
            return;
        }
        self.solver.wake(index);
        if let Some(response_m) = response.response_m
            && !self.answer_as_paper(index, response_m)
        {
            let body = self.bodies[index].name.clone();
            report.faults.push(Fault { body, kind: FaultKind::Response });
            if response.inside_samples == 0 {
                report.touched -= 1;
                return;
            }
        }
        self.summaries[index].first_touch_s.get_or_insert(time_s);
    }

    /// Puts the hull's surface where a body's contacts say; contacts that are not finite are ignored. Bodies that do not
    /// answer meet no hull.
    fn set_contacts(&mut self, index: usize, response: &BodyResponse, report: &mut StepReport) {
        let is_finite = |contact: &HullContact| {
            let HullContact { sample: _, point_body_m, normal_world, depth_m, speed_m_s, slide_m_s } =
                contact;
            let numbers =
                point_body_m.iter().chain(normal_world).chain([depth_m]).chain(speed_m_s).chain(slide_m_s);
            numbers.into_iter().all(|number| number.is_finite())
        };
        let has_spin = response.spin_rad_s.iter().all(|part| part.is_finite());
        if !has_spin || !response.contacts.iter().all(is_finite) {
            report.faults.push(Fault { body: self.bodies[index].name.clone(), kind: FaultKind::Response });
            return;
        }
        report.touched += usize::from(response.touches());
        // Contacts hold a body before a sample is inside.
        let is_held = response.contacts.iter().any(|contact| contact.depth_m > -HELD_M);
        if self.answers_hull && (is_held || response.touches()) {
            let time_s = self.next_time_s();
            self.summaries[index].first_touch_s.get_or_insert(time_s);
        }
        let WorldSettings { mirror_restitution: restitution, hull_friction: friction, .. } = self.settings;
        let contacts = if self.answers_hull { &response.contacts[..] } else { &[] };
        let spin_rad_s = response.spin_rad_s;
        self.solver.set_contacts(index, contacts, spin_rad_s, Surface { friction, restitution });
    }

    /// Translates a body and mirrors its velocity; does nothing and says `false` if the response is not
    /// finite, or leads where the solver has no numbers.
    fn answer_as_paper(&mut self, index: usize, response_m: [f64; 3]) -> bool {
        let state = self.solver.state(index);
        let position_m: [f32; 3] =
            core::array::from_fn(|axis| (f64::from(state.position_m[axis]) + response_m[axis]) as f32);
        let length_m = Vector3::from(response_m).norm();
        if !length_m.is_finite() || position_m.iter().any(|coordinate| !coordinate.is_finite()) {
            return false;
        }
        self.solver.set_position(index, position_m);
        self.summaries[index].hull_moved_m += length_m;
        let velocity_m_s = state.velocity_m_s.map(f64::from);
        if let Some(mirrored) =
            mirrored(velocity_m_s, response_m, self.settings.mirror_restitution, self.settings.hull_friction)
        {
            self.solver.set_velocity(index, mirrored);
        }
        true
    }

    /// Takes over what the solver made of a body, or puts the body back to where it was.
    fn take_over(&mut self, index: usize, report: &mut StepReport) {
        let state = self.solver.state(index);
        let body = &mut self.bodies[index];
        match state.pose().filter(|_| !self.solver.failed(index)) {
            Some(pose) => {
                body.pose = pose;
                body.velocity_m_s = state.velocity_m_s.map(f64::from);
                body.spin_rad_s = state.spin_rad_s.map(f64::from);
            }
            None => {
                self.solver.put_to_rest(index, &body.pose);
                body.velocity_m_s = [0.0; 3];
                body.spin_rad_s = [0.0; 3];
                report.faults.push(Fault { body: body.name.clone(), kind: FaultKind::Solver });
            }
        }
        let speed_m_s = Vector3::from(body.velocity_m_s).norm();
        self.summaries[index].add(body.pose, speed_m_s, self.up);
    }
}
