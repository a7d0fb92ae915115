//! A run as actions: [`Run::next`] says what to do, the caller does it and calls again. What nodes report goes into the
//! [`Roster`], what is asked of the world into [`Run::prepare`] and [`Run::carry_out`], and what clocks say is an argument:
//! the same events make the same run, on any machine and in no time.
//!
//! Simulation time is film time. Step k (from 1) ends at T = k · dt and sees the newest frame captured at or before T. A
//! live run makes it at T + latency by this process's clock, so that film has time to arrive; a lock-step run waits for the
//! frame however long it takes. Both see the same frames, so a live run that missed nothing is the lock-step run.
//!
//! A step waits until it is due, takes orders, chooses its frame ([`film`]), asks the hull about it ([`ask`]), and moves
//! the bodies ([`step`]).

mod ask;
mod commands;
mod film;
mod replay;
mod settings;
mod shift;
mod step;

use std::sync::Arc;
use std::time::Duration;

use film_time::{Pace, ring_frames};
use hull::Observer;
use sim::{ResponseMode, World};
use thiserror::Error;

use crate::core::answering::Answering;
use crate::core::budget::StepBudget;
use crate::core::clock::{Clock, LEAST_LAG_S, Now};
use crate::core::latency::{FilmLatency, Heard};
use crate::core::playback::Playback;
use crate::core::roster::{Arrival, HullUnavailable, Roster, WaitError};
use crate::figures::Figures;
use crate::hooks::Sees;

pub(crate) use ask::Unanswered;
use ask::{HullInUse, OpenQuestion};
pub(crate) use commands::{Change, Prepared, Steering};
use film::FilmInUse;
pub(crate) use replay::Follow;
pub use settings::{GoingOn, RunSettings};
use shift::ShiftQuestion;
use step::Step;
pub(crate) use step::{AnsweredStep, MadeStep};

/// How far a lock-step node may film ahead of the frame in use: half of its ring.
pub const FRAMES_AHEAD: u64 = 4;
/// No node has a frame so long before its time, seconds of film.
const MOST_EARLY_S: f64 = 1.0;
/// A replay looks for seeks so often while no step is due, seconds.
const MOST_EARLY_WAIT_S: f64 = 0.1;

/// Reads the clocks. Steps are timed, so a step reads them more than once.
pub(crate) type Clocks<'a> = &'a dyn Fn() -> Now;

/// What is to be done before [`Run::next`] is called again.
#[derive(Debug)]
pub(crate) enum Action {
    /// Wait until nodes report something, at most so long, seconds.
    Wait {
        /// The longest wait, seconds.
        at_most_s: f64,
    },
    /// Do what was asked for by now.
    TakeOrders,
    /// Let cameras film up to this frame: in lock-step, or because a schedule names it.
    Credit(u64),
    /// Have nodes keep this frame, however old it gets, until another is in use.
    UseFrame(u64),
    /// Have the pass answered, and hand over what came of it: [`Run::answered`].
    Ask {
        /// The frame that it is about.
        frame: u64,
        /// How long a round may take; `None`: what is usual.
        timeout: Option<Duration>,
    },
    /// The steps of this world take too long: begin another in its place.
    StartAfresh,
    /// Make the step: [`Run::make`].
    Make(AnsweredStep),
    /// No step is made yet: the world stands still until there is film.
    StandStill,
    /// No step is made: the run is paused.
    Rest,
    /// Film, or the run's time, is over.
    End,
}

/// Why a run cannot go on.
#[derive(Debug, Error, PartialEq)]
pub(crate) enum CannotGoOn {
    /// A frame did not come.
    #[error(transparent)]
    Waited(#[from] WaitError),
    /// A recorded step has no hull any more.
    #[error("recorded frame {frame}: {why}")]
    Recorded {
        /// The frame.
        frame: u64,
        /// Why there is none.
        why: HullUnavailable,
    },
}

/// Where a run is between two calls of [`Run::next`].
#[derive(Debug, Default)]
enum State {
    /// Between two steps.
    #[default]
    Between,
    /// The step that ends at this film time, seconds, is not due yet.
    Early { film_s: f64 },
    /// It is due, and orders were taken.
    Due,
    /// There is no film yet.
    Beginning,
    /// In lock-step it waits for a frame, since a time, seconds.
    AwaitsFrame { film_s: f64, wanted: u64, since_s: f64 },
    /// It waits for the frame that a schedule names.
    AwaitsRecorded { step: Step, frame: u64, since_s: f64 },
    /// The step's frame is in use.
    Framed(Step),
    /// The hull is to be asked once more.
    Asks(OpenQuestion),
    /// A pass is on its way.
    Asking(OpenQuestion),
    /// The hull has answered, or not.
    Asked { question: OpenQuestion, is_answered: bool },
    /// Which places near a body are inside the hull is to be asked.
    AsksShifts(ShiftQuestion),
    /// That is on its way.
    AskingShifts(ShiftQuestion),
    /// How far surfaces moved is known, or will not be.
    Shifted(ShiftQuestion),
    /// The run's time is over.
    Over,
}

/// A world that follows film.
pub(crate) struct Run {
    pub world: World,
    pub settings: RunSettings,
    pub hull: HullInUse,
    pub film: FilmInUse,
    pub clock: Clock,
    pub figures: Figures,
    /// What the solver took for the steps of the world.
    pub budget: StepBudget,
    pub steering: Steering,
    /// What a schedule has for the next step; `None` without a schedule.
    pub sees: Option<Sees>,
    /// How the schedule is played, if it is a recording that can be sought.
    pub playback: Option<Playback>,
    state: State,
}

impl Run {
    /// A run of the nodes of a roster; `observers` are the whole rig's, in rig order.
    pub fn new(
        world: World,
        observers: Vec<Arc<Observer>>,
        settings: RunSettings,
        (roster, answering): (&Roster, Answering),
    ) -> Run {
        let RunSettings { fps, latency_s, lock_step, .. } = settings;
        // Until the run begins.
        let pace = Pace { run: 0, zero_s: 0.0, epoch_unix_s: 0.0, lock_step };
        // The ring, less the frame that is being replaced.
        let kept_s = (ring_frames(fps) - 1) as f64 / fps;
        let latency =
            FilmLatency::new(latency_s, (roster.nodes().len(), observers.len()), kept_s - LEAST_LAG_S);
        let mut run = Run {
            clock: Clock::new(pace, latency, kept_s),
            hull: HullInUse::new(observers, &settings, world.settings(), answering),
            world,
            settings,
            film: FilmInUse::default(),
            figures: Figures::default(),
            budget: StepBudget::default(),
            steering: Steering::default(),
            sees: None,
            playback: None,
            state: State::default(),
        };
        run.bodies_changed();
        run
    }

    /// What to do next.
    pub fn next(&mut self, roster: &mut Roster, clocks: Clocks) -> Result<Action, CannotGoOn> {
        match std::mem::take(&mut self.state) {
            State::Between => Ok(self.begin_step(roster, clocks)),
            State::Early { film_s } => Ok(self.wait_until_due(film_s, clocks)),
            State::Due => self.due_step(roster, clocks),
            State::Beginning => Ok(self.stand_still(roster, clocks)),
            State::AwaitsFrame { film_s, wanted, since_s } => {
                self.wait_for_frame(film_s, wanted, since_s, roster, clocks)
            }
            State::AwaitsRecorded { step, frame, since_s } => {
                self.wait_for_recorded(step, frame, since_s, roster, clocks)
            }
            State::Framed(step) => self.meet_hull(step, roster, clocks),
            // One whose answer was not handed over is asked again.
            State::Asks(question) | State::Asking(question) => self.ask(question, roster, clocks),
            State::Asked { question, is_answered } => {
                self.take_answers(question, is_answered, roster, clocks)
            }
            State::AsksShifts(shifts) | State::AskingShifts(shifts) => Ok(self.ask_shifts(shifts)),
            State::Shifted(shifts) => self.meet_surfaces(shifts, clocks),
            State::Over => Ok(Action::End),
        }
    }

    fn begin_step(&mut self, roster: &mut Roster, clocks: Clocks) -> Action {
        if self.stands() {
            return Action::Rest;
        }
        let film_s = self.scheduled_film_s().unwrap_or_else(|| self.film_s());
        if self.is_over(film_s) {
            return Action::End;
        }
        self.follow_film(roster, clocks);
        self.wait_until_due(film_s, clocks)
    }

    fn wait_until_due(&mut self, film_s: f64, clocks: Clocks) -> Action {
        // A viewer may have sought, or changed the speed, while this step was waited for.
        if let Some(due_s) = self.playback.as_mut().and_then(|playback| playback.take_due(film_s)) {
            self.clock.play_from(due_s, clocks());
        }
        if !self.settings.lock_step
            && !self.is_seeking()
            && let Some(left_s) = self.clock.left_s(film_s, clocks())
        {
            self.state = State::Early { film_s };
            // A recording may have no step for long: a seek does not wait for the next.
            let at_most_s = if self.playback.is_some() { left_s.min(MOST_EARLY_WAIT_S) } else { left_s };
            return Action::Wait { at_most_s };
        }
        self.state = State::Due;
        Action::TakeOrders
    }

    /// Live: notes how late frames come, and goes towards the latency that they need.
    fn follow_film(&mut self, roster: &mut Roster, clocks: Clocks) {
        // Frames of a recording come when they are asked for.
        if self.settings.lock_step || self.playback.is_some() {
            return;
        }
        let now = clocks();
        let (arrivals, is_there) = roster.take_arrivals(now.monotonic_s);
        for Arrival { node, frame, heard_s } in arrivals {
            let film_s = frame as f64 / self.settings.fps;
            let late_s = heard_s - self.clock.pace.zero_s - film_s;
            if late_s < -MOST_EARLY_S {
                let why = format!("frame {frame} was reported {:.1} s before its time", -late_s);
                roster.fault(node, now.monotonic_s, why);
                continue;
            }
            let is_left_out = roster.nodes()[node].is_left_out();
            self.clock.latency.note(Heard { node, frame, film_s, late_s, is_left_out }, &is_there);
            let Some(report) = roster.nodes()[node].report(frame) else { continue };
            // What came after the node's last camera is the way here.
            let slowest_s = report.cameras.iter().map(|camera| camera.late_s).fold(f64::MIN, f64::max);
            for camera in &report.cameras {
                let camera_late_s = late_s - slowest_s + camera.late_s;
                self.clock.latency.note_camera(camera.rig_index.into(), film_s, camera_late_s);
            }
        }
        self.clock.latency.slew(self.clock.film_now_s(now));
    }

    /// Film time of the next step's end, seconds.
    pub fn film_s(&self) -> f64 {
        self.world.next_time_s() + self.clock.offset_s()
    }

    /// The same where a schedule sets it.
    pub fn scheduled_film_s(&self) -> Option<f64> {
        match self.sees.as_ref()? {
            Sees::Film => None,
            Sees::Recorded { film_s, .. } | Sees::Given { film_s, .. } => Some(*film_s),
        }
    }

    /// Whether the run's time is over before a step that ends at this film time.
    pub fn is_over(&self, film_s: f64) -> bool {
        self.settings.seconds.is_some_and(|seconds| film_s > seconds + 1e-9)
    }

    /// The whole rig's, in rig order.
    pub fn observers(&self) -> &[Arc<Observer>] {
        self.hull.query.observers()
    }

    /// How many cameras a hull is made of at least.
    pub fn least_cameras(&self) -> usize {
        self.settings.going_on.min_cameras.min(self.observers().len())
    }

    /// Whether bodies meet planes, not samples.
    fn is_by_contacts(&self) -> bool {
        self.world.settings().response == ResponseMode::Contacts
    }
}

#[cfg(test)]
mod tests;
