//! One step: what it sees, and what the hull's answers do to the moving bodies.

use hull::collision::BodyCollision;
use sim::{Body, BodyResponse, Fault, WorldError};

use super::{Action, CannotGoOn, Clocks, Run, State};
use crate::core::clock::frame_at;
use crate::core::roster::{HullUnavailable, Roster};
use crate::figures::Stage;
use crate::hooks::Sees;

/// Which part of film a step is in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum FilmPhase {
    /// Frames come.
    Runs,
    /// The last one is held.
    Held,
    /// The frame in use stays, whatever the time.
    Frozen,
    /// A schedule names the frame.
    Recorded,
}

impl FilmPhase {
    /// Whether the step sees this frame or none.
    pub fn has_fixed_frame(self) -> bool {
        matches!(self, FilmPhase::Frozen | FilmPhase::Recorded)
    }
}

/// A step that is being made.
#[derive(Debug)]
pub(super) struct Step {
    /// Film time of its end, seconds.
    pub film_s: f64,
    pub phase: FilmPhase,
    /// The hull's responses, where a schedule has them: the hull is not asked.
    pub given: Option<Vec<BodyResponse>>,
    /// When its frame was there, seconds.
    pub began_s: f64,
}

impl Step {
    pub fn of(film_s: f64, phase: FilmPhase) -> Step {
        Step { film_s, phase, given: None, began_s: 0.0 }
    }
}

/// A step whose responses are known.
#[derive(Debug)]
pub(crate) struct AnsweredStep {
    /// Film time of its end, seconds.
    pub film_s: f64,
    /// One a moving body.
    pub responses: Vec<BodyResponse>,
    /// How the hull meets these bodies, if there is one and it was asked.
    pub collisions: Option<Vec<BodyCollision>>,
    began_s: f64,
}

/// A step that was made.
#[derive(Debug)]
pub(crate) struct MadeStep {
    /// Bodies that touch the hull.
    pub touched: usize,
    /// What was not finite.
    pub faults: Vec<Fault>,
    /// What it took from its frame on, milliseconds.
    pub step_ms: f64,
    /// How old the film is that the bodies collided with, milliseconds, if they did with any.
    pub hull_age_ms: Option<f64>,
}

impl Run {
    /// A step that is due, and whose orders were taken.
    pub(super) fn due_step(&mut self, roster: &mut Roster, clocks: Clocks) -> Result<Action, CannotGoOn> {
        if self.stands() {
            return Ok(Action::Rest);
        }
        // Others have no deadline, and are to be the same on any machine.
        let is_live = !self.settings.lock_step && self.sees.is_none();
        if is_live && self.budget.is_exhausted() {
            self.state = State::Due;
            return Ok(Action::StartAfresh);
        }
        let (film_s, frame, given) = match self.sees.take() {
            None if self.lacks_first_frame(roster, clocks) => return Ok(self.wait_for_first_frame()),
            None | Some(Sees::Film) => return self.film_step(roster, clocks),
            Some(Sees::Recorded { film_s, frame }) => (film_s, frame, None),
            Some(Sees::Given { film_s, frame, responses }) => (film_s, frame, Some(responses)),
        };
        self.figures.frames_expected = frame_at(film_s, self.settings.fps) + 1;
        let step = Step { given, ..Step::of(film_s, FilmPhase::Recorded) };
        match frame {
            Some(frame) => self.wait_for_recorded(step, frame, clocks().monotonic_s, roster, clocks),
            None if step.given.is_some() => self.meet_hull(step, roster, clocks),
            None => {
                self.lose_hull(match self.film.frame {
                    Some(_) => HullUnavailable::Recorded,
                    // At the beginning nothing is lost yet.
                    None => HullUnavailable::NotYet,
                });
                let step = Step { began_s: clocks().monotonic_s, ..step };
                Ok(self.make_of(step, None))
            }
        }
    }

    /// The hull's answers are known, or that there is none. A recorded step had one.
    pub(super) fn answered_step(
        &mut self,
        step: Step,
        collisions: Option<Vec<BodyCollision>>,
    ) -> Result<Action, CannotGoOn> {
        if step.phase == FilmPhase::Recorded
            && step.given.is_none()
            && collisions.is_none()
            && let (Some(frame), Some(why)) = (self.film.frame, self.film.unavailable.take())
        {
            return Err(CannotGoOn::Recorded { frame, why });
        }
        Ok(self.make_of(step, collisions))
    }

    fn make_of(&self, step: Step, collisions: Option<Vec<BodyCollision>>) -> Action {
        let Step { film_s, given, began_s, .. } = step;
        let responses = given.unwrap_or_else(|| self.responses(film_s, collisions.as_deref()));
        Action::Make(AnsweredStep { film_s, responses, collisions, began_s })
    }

    /// What the hull's answers do to the moving bodies.
    fn responses(&self, film_s: f64, collisions: Option<&[BodyCollision]>) -> Vec<BodyResponse> {
        let Some(collisions) = collisions else {
            return vec![BodyResponse::UNTOUCHED; self.world.moving_bodies().len()];
        };
        let mut responses: Vec<BodyResponse> =
            self.world.moving_bodies().zip(collisions).map(response).collect();
        if film_s < self.film.gentle_until_s {
            let (push_m_s, dt_s) = (self.settings.going_on.push_m_s, self.world.settings().dt_s);
            responses.iter_mut().for_each(|response| response.limit(push_m_s, dt_s));
        }
        responses
    }

    /// Steps the world with the responses of a step.
    pub fn make(
        &mut self,
        step: &AnsweredStep,
        roster: &Roster,
        clocks: Clocks,
    ) -> Result<MadeStep, WorldError> {
        let began_s = clocks().monotonic_s;
        let report = self.world.step(&step.responses)?;
        let took_s = clocks().monotonic_s - began_s;
        self.budget.note(took_s);
        self.figures.add_stage(Stage::Physics, took_s * 1e3);
        self.figures.counts.faults += report.faults.len() as u64;
        if !self.is_seeking() {
            self.steering.count();
        }
        if let Some(playback) = &mut self.playback {
            playback.note(step.film_s);
        }
        let step_ms = (clocks().monotonic_s - step.began_s) * 1e3;
        self.figures.times.step_ms.add(step_ms);
        self.figures.counts.steps += 1;
        let hull_age_ms = self.note_age(step.collisions.as_deref(), roster, clocks);
        Ok(MadeStep { touched: report.touched, faults: report.faults, step_ms, hull_age_ms })
    }

    /// How old the film is that this step asked, and that caused its responses, if there were any.
    fn note_age(
        &mut self,
        collisions: Option<&[BodyCollision]>,
        roster: &Roster,
        clocks: Clocks,
    ) -> Option<f64> {
        if self.playback.is_some() {
            // Film of a recording was not captured just now.
            return None;
        }
        let collisions = collisions?;
        let reports = roster.reports(self.film.frame?)?;
        let later_s = self.world.settings().hull_time.frames_later() / self.settings.fps;
        let age_ms = (self.clock.age_s(reports.first()?, clocks()) + later_s) * 1e3;
        self.figures.times.hull_age.add(age_ms / 1e3);
        if collisions.iter().any(BodyCollision::is_touched) {
            self.figures.times.response_age_ms.add(age_ms);
        }
        Some(age_ms)
    }
}

fn response((body, collision): (&Body, &BodyCollision)) -> BodyResponse {
    let mut response = BodyResponse::default();
    response.set(collision, &body.shape);
    response
}
