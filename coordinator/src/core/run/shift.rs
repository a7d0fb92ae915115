//! How far the surface moved that a body meets first, if it may have come fast: which places of a grid about it are inside the hull
//! is asked of the frame before and of the frame in use.

use hull::Pose;
use hull::pass::BodyResult;
use hull::surface::{FrameAge, Occupancy, grid, shift_m};

use super::step::Step;
use super::{Action, CannotGoOn, Clocks, Run, State};
use crate::core::roster::{LOCK_STEP_TIMEOUT, Roster};

/// A step looks for the shifts of so many bodies at most: more that are met at once are taken as their edges tell.
const MOST: usize = 8;

/// A body by its place among those that move, and the place to look at.
type Look = (usize, Pose);

/// A step whose planes are known, and what is asked about them.
#[derive(Debug)]
pub(super) struct ShiftQuestion {
    step: Step,
    frame: u64,
    at: FrameAge,
    /// One a moving body.
    found: Vec<BodyResult>,
    asked: Vec<Look>,
    /// Of the frame before, once that is known.
    before: Option<Vec<Occupancy>>,
}

impl ShiftQuestion {
    pub fn new(
        step: Step,
        frame: u64,
        at: FrameAge,
        found: Vec<BodyResult>,
        asked: Vec<Look>,
    ) -> ShiftQuestion {
        ShiftQuestion { step, frame, at, found, asked, before: None }
    }
}

impl Run {
    /// The bodies whose surface may have come fast, if the frame before was in use and all nodes have it.
    pub(super) fn shifts_to_ask(
        &self,
        frame: u64,
        at: FrameAge,
        found: &[BodyResult],
        roster: &Roster,
    ) -> Option<Vec<Look>> {
        let bodies = self.world.moving_bodies().zip(found).enumerate();
        let looks = bodies.filter_map(|(index, (body, found))| {
            Some((index, self.hull.surfaces.place_to_look(index, at, found.planes()?, body)?))
        });
        let asked: Vec<Look> = looks.take(MOST).collect();
        let before = frame.checked_sub(1).filter(|_| !asked.is_empty())?;
        (self.film.before == Some(before) && roster.reports(before).is_some()).then_some(asked)
    }

    /// Asks about the frame before, then about the frame in use.
    pub(super) fn ask_shifts(&mut self, shifts: ShiftQuestion) -> Action {
        let frame = if shifts.before.is_none() { shifts.frame - 1 } else { shifts.frame };
        let poses: Vec<Pose> = shifts.asked.iter().map(|&(_, pose)| pose).collect();
        self.hull.query.ask_occupancies(&grid(), &poses);
        self.figures.counts.passes.asked += 1;
        let timeout = self.settings.lock_step.then_some(LOCK_STEP_TIMEOUT);
        self.state = State::AskingShifts(shifts);
        Action::Ask { frame, timeout }
    }

    /// That was answered, or not: then nothing is known of shifts.
    pub(super) fn take_occupancies(&mut self, mut shifts: ShiftQuestion, is_answered: bool) {
        let found = self.hull.query.take_occupancies();
        self.state = match shifts.before.take() {
            _ if !is_answered => State::Shifted(shifts),
            None => State::AsksShifts(ShiftQuestion { before: Some(found), ..shifts }),
            Some(before) => {
                for ((&(body, _), before), now) in shifts.asked.iter().zip(&before).zip(&found) {
                    if let Some(shift_m) = shift_m(before, now) {
                        self.hull.surfaces.take_shift(body, shifts.at, shift_m);
                    }
                }
                State::Shifted(shifts)
            }
        };
    }

    /// All is known that the step asks.
    pub(super) fn meet_surfaces(
        &mut self,
        shifts: ShiftQuestion,
        clocks: Clocks,
    ) -> Result<Action, CannotGoOn> {
        let ShiftQuestion { step, at, found, .. } = shifts;
        self.collide(step, at, found, clocks)
    }
}
