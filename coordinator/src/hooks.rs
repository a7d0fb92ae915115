//! How a run is recorded, and how a recorded run is made again.
//!
//! A [`Recorder`] receives every frame that comes into use and every step with all that decided it: the
//! commands before it, the film it saw, the hull's responses. A [`Schedule`] is the mirror image: for each step
//! the commands before it and the frame it sees. A run that follows the schedule of its own recording, over the
//! same silhouettes, has the same digest after every step.

use film_time::FrameReport;
use hull::collision::BodyCollision;
use sim::{BodyResponse, World};

use crate::figures::Figures;
use crate::live::Command;
use crate::transport::Fetching;

/// A frame that comes into use.
pub struct FrameRecord<'a> {
    /// Its number.
    pub frame: u64,
    /// What each node reported of it; empty if that is forgotten already.
    pub reports: &'a [&'a FrameReport],
    /// Its silhouettes. Nodes keep a frame for a quarter of a second, so begin to wait for them at once, on
    /// whatever runtime (a node's connection is driven by the loop's).
    pub silhouettes: Fetching,
}

/// One step and what decided it.
pub struct StepRecord<'a> {
    /// Counts worlds: a reset or another scene begins a new one.
    pub generation: u32,
    /// Counts the steps of this world, from 1.
    pub step: u64,
    /// The commands that took effect since the step before, in their order: only those that change a world
    /// ([`Command::changes_world`]).
    pub commands: &'a [Command],
    /// Film time of the step's end, seconds.
    pub film_s: f64,
    /// Film time that passed without steps so far (pauses, lag, worlds before), seconds: `film_s` less the
    /// world's own time, so negative in a world that has gone on from an earlier run.
    pub slipped_s: f64,
    /// The frame that the step saw; `None`: there was no hull.
    pub frame: Option<u64>,
    /// What was handed to the world, one a moving body.
    pub responses: &'a [BodyResponse],
    /// How the hull meets these bodies, if there was one.
    pub collisions: Option<&'a [BodyCollision]>,
    /// What the step with its pass took, milliseconds.
    pub step_ms: f64,
    /// The world after the step.
    pub world: &'a World,
}

/// How a run ended.
pub struct EndRecord<'a> {
    /// Commands since the last step.
    pub commands: &'a [Command],
    /// Everything that was measured.
    pub figures: &'a Figures,
    /// The world at the end.
    pub world: &'a World,
}

/// Who keeps a run. Called on the loop's thread: hand work that takes time to another one.
pub trait Recorder: Send {
    /// A frame comes into use: before the first step that sees it.
    fn frame(&mut self, record: FrameRecord<'_>);
    /// A step was made.
    fn step(&mut self, record: &StepRecord<'_>);
    /// The run has ended.
    fn end(&mut self, record: &EndRecord<'_>);
    /// Whether another frame may come into use. A lock-step run waits for it, so that no film is lost; a live
    /// run never does.
    fn is_ready(&self) -> bool {
        true
    }
}

/// Changes what the hull answers about a body before the world gets it: for experiments.
pub type AlterResponse = fn(&mut BodyResponse);

/// What a step sees.
#[derive(Clone, Debug, PartialEq)]
pub enum Sees {
    /// What film has for it, as in a run without a schedule.
    Film,
    /// What a step before it saw.
    Recorded {
        /// Film time of the step's end, seconds.
        film_s: f64,
        /// The frame; `None`: no hull. The transport must have it, or get it when it is credited.
        frame: Option<u64>,
    },
    /// The same, but the hull is not asked: its answers are given, where they cannot be found again (they
    /// were rounded, or a record lacks the frame).
    Given {
        /// Film time of the step's end, seconds.
        film_s: f64,
        /// The frame; `None`: no hull.
        frame: Option<u64>,
        /// One a moving body.
        responses: Vec<BodyResponse>,
    },
}

/// One step of a schedule.
#[derive(Clone, Debug, PartialEq)]
pub struct Scheduled {
    /// What comes before it, in this order. Commands that do not change a world are passed over.
    pub commands: Vec<Command>,
    /// What it sees.
    pub sees: Sees,
}

/// What a run follows instead of its followers: commands that say how it is played are still taken, other
/// orders refused.
pub trait Schedule: Send {
    /// The next step; `None` ends the run.
    fn next(&mut self) -> Option<Scheduled>;
    /// The next step is the first again.
    fn begin_again(&mut self);
}

impl Command {
    /// Whether cameras carry it out, which takes as long as they film.
    pub fn is_of_background(&self) -> bool {
        matches!(self, Command::TakeBackground { .. } | Command::RestoreBackground { .. })
    }

    /// Whether it says when steps are made, and not what they do: a replay takes these commands and no others.
    pub fn is_of_playback(&self) -> bool {
        let is_of_replay = matches!(self, Command::Seek { .. } | Command::SetSpeed(_) | Command::SetLoop(_));
        is_of_replay || matches!(self, Command::Pause | Command::Resume | Command::Step(_))
    }

    /// Whether it changes what bodies there are, what they do, or which world it is.
    pub fn changes_world(&self) -> bool {
        !self.is_of_playback() && !self.is_of_background()
    }
}
