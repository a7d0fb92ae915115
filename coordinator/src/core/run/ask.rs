//! The hull's answers for a step: which question is asked, and what the answers make of it.

use std::sync::Arc;

use hull::collision::BodyCollision;
use hull::contact::{BodyContacts, Eye};
use hull::pass::{BodyResult, Pass, Round};
use hull::surface::{FrameAge, PoseToAsk};
use hull::{Observer, Pose};
use sim::{Body, BodyId, ResponseMode, WorldSettings};
use thiserror::Error;

use super::shift::ShiftQuestion;
use super::step::Step;
use super::{Action, CannotGoOn, Clocks, Run, RunSettings, State};
use crate::core::answering::Answering;
use crate::core::clock::steps_that_share;
use crate::core::query::{HullQuery, MAX_STEPS_AHEAD, QueryBody, Surfaces};
use crate::core::roster::{HullUnavailable, LOCK_STEP_TIMEOUT, Roster};
use crate::figures::Stage;

/// A step asks at most so many times more, without the nodes that did not answer: they may be heard of and fail again meanwhile.
const MAX_REPEATS: usize = 3;

/// What is known of the hull, and who answers.
pub(crate) struct HullInUse {
    pub query: HullQuery,
    /// Under contacts: the hull's surface near each moving body.
    pub surfaces: Surfaces,
    answering: Answering,
}

impl HullInUse {
    pub fn new(
        observers: Vec<Arc<Observer>>,
        settings: &RunSettings,
        world: &WorldSettings,
        answering: Answering,
    ) -> HullInUse {
        let eyes = observers.iter().map(|observer| Eye::of(observer.camera())).collect();
        let mut query =
            HullQuery::new(observers, settings.probes, answering.group_count(), settings.ask_every);
        if world.response == ResponseMode::Contacts {
            query.ask_planes();
        }
        query.speculate(answering.asks_nodes());
        HullInUse { query, surfaces: Surfaces::of(settings.fps, world.hull_time, eyes), answering }
    }

    /// From the next pass on these answer.
    pub fn ask_from(&mut self, answering: Answering, roster: &Roster) {
        self.answering = answering;
        self.query.ask_groups(answering.group_count());
        self.query.speculate(answering.asks_nodes());
        self.leave_out(roster);
    }

    /// Other bodies: see [`HullQuery::set_bodies`] and [`Surfaces::set_bodies`].
    pub fn set_bodies(&mut self, ids: Vec<BodyId>, bodies: Vec<QueryBody>, reuse_within_m: f64) {
        self.surfaces.set_bodies(ids);
        self.query.set_bodies(bodies, reuse_within_m);
    }

    /// Another world has begun.
    pub fn forget_surfaces(&mut self) {
        self.surfaces.forget();
    }

    /// Asks nothing of the nodes that steps go on without.
    pub fn leave_out(&mut self, roster: &Roster) {
        let asks_nodes = self.answering.asks_nodes();
        self.query.leave_out(|group| asks_nodes && roster.nodes()[group].is_left_out());
    }
}

/// Why a pass was not answered.
#[derive(Clone, Debug, PartialEq, Error)]
#[error("{0}")]
pub(crate) struct Unanswered(pub String);

/// A step whose hull is asked about.
#[derive(Debug)]
pub(crate) struct OpenQuestion {
    step: Step,
    frame: u64,
    at: FrameAge,
    passes_before: u64,
    repeats: usize,
    /// When the pass was asked, seconds; `None` if that asks nothing.
    asked_s: Option<f64>,
}

impl Run {
    /// The step's frame is in use: asks the hull about every moving body, if there is one.
    pub(super) fn meet_hull(
        &mut self,
        step: Step,
        roster: &mut Roster,
        clocks: Clocks,
    ) -> Result<Action, CannotGoOn> {
        let step = Step { began_s: clocks().monotonic_s, ..step };
        if step.given.is_some() {
            self.film.unavailable = None;
            return self.answered_step(step, None);
        }
        match self.begin_question(&step, roster) {
            Ok((frame, at)) => {
                let passes_before = self.figures.counts.passes.asked;
                let question = OpenQuestion { step, frame, at, passes_before, repeats: 0, asked_s: None };
                self.ask(question, roster, clocks)
            }
            Err(why) => {
                self.lose_hull(why);
                self.answered_step(step, None)
            }
        }
    }

    fn begin_question(&mut self, step: &Step, roster: &Roster) -> Result<(u64, FrameAge), HullUnavailable> {
        let frame = self.hull_frame(step.film_s, step.phase, roster)?;
        self.go_on_with_cameras(frame, roster)?;
        let reports = match roster.reports(frame) {
            Some(reports) => reports,
            None if self.hull.query.knows_bounds_of(frame) => vec![],
            None => return Err(HullUnavailable::Forgotten { frame }),
        };
        let by_contacts = self.is_by_contacts();
        let HullInUse { query, surfaces, .. } = &mut self.hull;
        let at = surfaces.frame_age(frame, step.film_s);
        let poses = self.world.moving_bodies().enumerate().map(|(index, body)| {
            if by_contacts { surfaces.pose_to_ask(index, at, body) } else { PoseToAsk::plain(body.pose) }
        });
        query.begin_step(frame, &reports, poses);
        Ok((frame, at))
    }

    /// One pass over all that this step lacks, and what is worth foreseeing.
    pub(super) fn ask(
        &mut self,
        question: OpenQuestion,
        roster: &Roster,
        clocks: Clocks,
    ) -> Result<Action, CannotGoOn> {
        if !self.hull.query.must_ask() {
            return self.take_answers(question, true, roster, clocks);
        }
        let ahead = self.foresee(question.step.film_s, clocks);
        let began_s = clocks().monotonic_s;
        let asks = self.hull.query.ask(&ahead).question().is_some();
        self.figures.add_stage(Stage::Cull, (clocks().monotonic_s - began_s) * 1e3);
        self.figures.counts.passes.asked += u64::from(asks);
        self.figures.answers.poses_asked += self.hull.query.poses_asked() as u64;
        let is_gathered = self.hull.answering == Answering::Gathered;
        self.figures.counts.passes.gathered += u64::from(asks && is_gathered);
        let timeout = self.settings.lock_step.then_some(LOCK_STEP_TIMEOUT);
        let frame = question.frame;
        self.state = State::Asking(OpenQuestion { asked_s: asks.then_some(began_s), ..question });
        Ok(Action::Ask { frame, timeout })
    }

    /// The pass to have answered, and what counts each of its rounds and milliseconds.
    pub fn pass(&mut self) -> (&mut Pass, impl FnMut(Round, f64)) {
        let Run { hull, figures, .. } = self;
        let took = |round: Round, ms: f64| {
            figures.counts.passes.round_trips += 1;
            figures.add_stage(round.into(), ms);
        };
        (hull.query.pass(), took)
    }

    /// The pass was answered, or why not. Without the nodes that failed to answer, which are left out, it is asked once more.
    pub fn answered(&mut self, answered: Result<(), Unanswered>, roster: &mut Roster, clocks: Clocks) {
        let mut question = match std::mem::take(&mut self.state) {
            State::Asking(question) => question,
            State::AskingShifts(shifts) => return self.take_occupancies(shifts, answered.is_ok()),
            _ => return,
        };
        self.figures.counts.passes.points = *self.hull.query.pass().points_asked();
        let Err(Unanswered(why)) = answered else {
            if let Some(asked_s) = question.asked_s {
                self.figures.times.pass.add(clocks().monotonic_s - asked_s);
            }
            self.hull.query.answered();
            self.state = State::Asked { question, is_answered: true };
            return;
        };
        question.repeats += 1;
        let may_repeat = !question.step.phase.has_fixed_frame() && question.repeats <= MAX_REPEATS;
        self.state = if may_repeat && self.go_on_without(question.frame, roster, clocks) {
            State::Asks(question)
        } else {
            self.lose_hull(HullUnavailable::Unanswered(why));
            State::Asked { question, is_answered: false }
        };
    }

    /// What the hull answers about every moving body.
    pub(super) fn take_answers(
        &mut self,
        question: OpenQuestion,
        is_answered: bool,
        roster: &Roster,
        clocks: Clocks,
    ) -> Result<Action, CannotGoOn> {
        let OpenQuestion { step, frame, at, passes_before, .. } = question;
        let answers = if is_answered { self.hull.query.take() } else { None };
        let Some(answers) = answers else { return self.answered_step(step, None) };
        if let Some(before) = self.film.unavailable.take().filter(HullUnavailable::is_fault) {
            tracing::warn!("hull available again (it was not: {before})");
        }
        self.figures.answers.steps_without_question +=
            u64::from(self.figures.counts.passes.asked == passes_before);
        self.figures.answers.used += answers.asked as u64;
        self.figures.answers.reused += answers.reused as u64;
        match self.shifts_to_ask(frame, at, &answers.results, roster) {
            Some(asked) => Ok(self.ask_shifts(ShiftQuestion::new(step, frame, at, answers.results, asked))),
            None => self.collide(step, at, answers.results, clocks),
        }
    }

    /// The answers about every moving body are whole: makes collisions of them.
    pub(super) fn collide(
        &mut self,
        step: Step,
        at: FrameAge,
        found: Vec<BodyResult>,
        clocks: Clocks,
    ) -> Result<Action, CannotGoOn> {
        let collisions = self.collisions(at, found, clocks);
        self.figures.add_collisions(&collisions);
        self.answered_step(step, Some(collisions))
    }

    /// What was found for the bodies, for contacts from the planes.
    fn collisions(&mut self, at: FrameAge, found: Vec<BodyResult>, clocks: Clocks) -> Vec<BodyCollision> {
        let began_s = clocks().monotonic_s;
        let bodies = self.world.moving_bodies().zip(found).enumerate();
        let surfaces = &mut self.hull.surfaces;
        let collision = |(index, (body, found)): (usize, (&Body, BodyResult))| match found {
            BodyResult::Paper(paper) => BodyCollision::Paper(paper),
            BodyResult::Planes(planes) => {
                BodyCollision::Contacts(surfaces.contacts(index, at, &planes, body))
            }
            // Asked about grids alone.
            BodyResult::Inside(_) => BodyCollision::Contacts(BodyContacts::default()),
        };
        let collisions = bodies.map(collision).collect();
        if self.is_by_contacts() {
            self.figures.add_stage(Stage::Contacts, (clocks().monotonic_s - began_s) * 1e3);
        }
        collisions
    }

    /// The poses of the steps that will share the frame in use, if they are worth a question.
    fn foresee(&mut self, film_s: f64, clocks: Clocks) -> Vec<Vec<Pose>> {
        let dt_s = self.world.settings().dt_s;
        let steps = steps_that_share(film_s, dt_s, self.settings.fps, MAX_STEPS_AHEAD);
        if steps == 0 || !self.hull.query.may_foresee() {
            return vec![];
        }
        let began_s = clocks().monotonic_s;
        let ahead = self.world.poses_ahead(steps);
        self.figures.add_stage(Stage::Foresee, (clocks().monotonic_s - began_s) * 1e3);
        ahead
    }
}
