//! A recorded run that is played: where it is sought, and how it begins again.

use sim::World;

use super::{Clocks, Run, State, Steering};
use crate::core::answering::Answering;
use crate::core::command::Refusal;
use crate::core::playback::Playback;
use crate::core::roster::Roster;
use crate::figures::Figures;

/// What a schedule is asked for before a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Follow {
    /// The run begins again, and the schedule with it.
    BeginAgain,
    /// The next step.
    Take,
    /// Nothing: the next step was taken already, or none is to be made.
    GoOn,
    /// Nothing more: the run is over.
    End,
}

impl Run {
    /// What the schedule is asked for, between two steps. `has_page`: whether a page is connected.
    pub fn follow(&mut self, has_page: bool, clocks: Clocks) -> Follow {
        let Some(playback) = &mut self.playback else { return self.take_if_none() };
        let now_s = clocks().monotonic_s;
        playback.note_page(has_page, now_s);
        if playback.goes_back() {
            return Follow::BeginAgain;
        }
        if !playback.has_ended() {
            return self.take_if_none();
        }
        let stays = playback.stays(now_s);
        self.steering = Steering::Paused;
        if stays { Follow::GoOn } else { Follow::End }
    }

    fn take_if_none(&self) -> Follow {
        if self.sees.is_none() { Follow::Take } else { Follow::GoOn }
    }

    /// The schedule has no more steps.
    pub fn end_of_schedule(&mut self, clocks: Clocks) -> Follow {
        let Some(playback) = &mut self.playback else { return Follow::End };
        let begins_again = playback.end();
        if !playback.stays(clocks().monotonic_s) {
            return Follow::End;
        }
        if begins_again && !self.steering.is_paused() {
            // A seek to the end has arrived there.
            playback.forget_seek();
            return Follow::BeginAgain;
        }
        self.steering = Steering::Paused;
        Follow::GoOn
    }

    /// Whether the film time that was sought is there: from now on steps are made in their time, and shown.
    pub fn arrive(&mut self) -> bool {
        let next_s = self.scheduled_film_s();
        self.playback.as_mut().is_some_and(|playback| playback.arrive(next_s))
    }

    /// Whether a film time is being sought.
    pub fn is_seeking(&self) -> bool {
        self.playback.as_ref().is_some_and(Playback::is_seeking)
    }

    /// Whether no step is to be made.
    pub fn stands(&self) -> bool {
        self.steering.is_paused() && !self.is_seeking()
    }

    /// Whether the step that was begun is put off: a seek came since, and says whether it is made at all.
    pub fn puts_off_step(&mut self) -> bool {
        let is_begun = matches!(self.state, State::Early { .. } | State::Due);
        let puts_off = is_begun && self.playback.as_ref().is_some_and(Playback::has_new_seek);
        if puts_off {
            self.state = State::Between;
        }
        puts_off
    }

    /// The recording, if the run is a replay.
    pub(super) fn recording(&mut self) -> Result<&mut Playback, Refusal> {
        self.playback.as_mut().ok_or(Refusal::NoReplay)
    }

    /// Seeks a film time, seconds: paused, the run stands there, else it goes on from there.
    pub(super) fn seek(&mut self, film_s: f64) -> Result<(), Refusal> {
        self.recording()?.seek(film_s)?;
        // Steps that were counted from another place mean nothing there.
        if let Steering::Counting { .. } = self.steering {
            self.steering = Steering::Paused;
        }
        Ok(())
    }

    /// Changes how many seconds of film go by in a second.
    pub(super) fn set_speed(&mut self, speed: f64) -> Result<(), Refusal> {
        let playback = self.recording()?;
        playback.set_speed(speed)?;
        self.clock.speed = playback.speed();
        Ok(())
    }

    /// The run is as it was at its beginning, with a world as it was then. Figures count on.
    pub fn begin_again(&mut self, world: World, (roster, answering): (&Roster, Answering)) {
        let mut settings = self.settings.clone();
        settings.reuse_within_m = world.scene().hull().reuse_within_m;
        let observers = self.observers().to_vec();
        let again = Run::new(world, observers, settings, (roster, answering));
        let before = std::mem::replace(self, again);
        self.figures = Figures { samples: self.figures.samples, ..before.figures };
        (self.clock.pace, self.clock.speed) = (before.clock.pace, before.clock.speed);
        self.film = before.film.again();
        (self.steering, self.playback) = (before.steering, before.playback);
        if let Some(playback) = &mut self.playback {
            playback.begin_again();
        }
    }
}
