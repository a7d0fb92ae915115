//! Commands to a run, their outcomes, and why the run refuses one.

use std::error::Error;
use std::ops::RangeInclusive;

use film_time::BACKGROUND_S;
use sim::{BodyId, BodySpec, Parameters, Scene, WorldSnapshot};
use thiserror::Error;

/// Commands that wait for the next step at most: a page that drags sends one a picture.
pub const MAX_WAITING: usize = 256;
/// What is asked of a run.
#[derive(Clone, Debug, PartialEq)]
pub enum Command {
    /// Steps stop; film goes on.
    Pause,
    /// Steps go on, with the film of then.
    Resume,
    /// So many steps, and paused again: answered at once; the world's state shows when they are made.
    Step(u32),
    /// Of a replay: the world as it was at a film time. Answered at once; the world's state shows when it is there.
    Seek {
        /// Film time, seconds.
        film_s: f64,
    },
    /// Of a replay: so many seconds of film go by in a second.
    SetSpeed(f64),
    /// Of a replay: whether it begins again at its end.
    SetLoop(bool),
    /// The scene from its start, with its seed.
    Reset,
    /// Another scene from its start, under the gravity of this one: the rig's up is the same.
    Choose(Scene),
    /// A world that was kept, where it was, with this run's seed.
    GoOn(Box<WorldSnapshot>),
    /// Another body; the answer is its number.
    Spawn(Box<BodySpec>),
    /// A body goes.
    Remove(BodyId),
    /// A push.
    Push {
        /// The body that is pushed.
        body: BodyId,
        /// Newton seconds, world.
        impulse_n_s: [f64; 3],
        /// Where, world, metres; `None`: at the centre of mass.
        at_m: Option<[f64; 3]>,
    },
    /// Holds a body by a point of it and draws that point to a target, until it is let go. Asked again it
    /// moves the target.
    Grab {
        /// The body that is held.
        body: BodyId,
        /// The point, body frame, metres.
        grip_body_m: [f64; 3],
        /// Where it is drawn to, world, metres.
        target_m: [f64; 3],
    },
    /// Lets go; the body keeps the velocity it has, or is given one.
    Release {
        /// The body that is let go.
        body: BodyId,
        /// The velocity it is thrown with, m/s, world.
        velocity_m_s: Option<[f64; 3]>,
    },
    /// Parameters of the world.
    Set(Parameters),
    /// Every camera learns its background again from the film of the next seconds. If one cannot, all keep theirs.
    TakeBackground {
        /// How long, seconds.
        seconds: f64,
        /// Also if the room does not look empty by the background in use: the light has changed, or furniture.
        allow_foreground: bool,
    },
    /// Every camera uses the background again that was in use before.
    RestoreBackground {
        /// The id of the one that goes.
        id: u64,
    },
}

/// What a command did.
#[derive(Clone, Debug, PartialEq)]
pub enum Outcome {
    /// It took effect.
    Applied,
    /// A body was spawned.
    Spawned(BodyId),
    /// It took a body, a world or a background away. This command brings it back as it was: a body with its place and velocity
    /// and another number, without its spin; a world with all its bodies.
    Revocable(Box<Command>),
}

/// The most steps that one command makes: a quarter of an hour.
pub const MAX_STEPS: u32 = 100_000;

/// How fast a recording may be played, seconds of film in a second.
pub const SPEEDS: RangeInclusive<f64> = 0.1..=10.0;

/// Why a command did nothing.
#[derive(Debug, Error)]
pub enum Refusal {
    /// The world refused it.
    #[error(transparent)]
    World(#[from] sim::CommandError),
    /// There can be no such world.
    #[error(transparent)]
    NewWorld(#[from] sim::WorldError),
    /// There can be no such scene.
    #[error(transparent)]
    Scene(#[from] sim::SceneError),
    /// Nodes refused it.
    #[error(transparent)]
    Nodes(Box<dyn Error + Send + Sync>),
    /// Another client holds the body.
    #[error("body `{body}` is held by {holder}")]
    Held {
        /// The body's name.
        body: String,
        /// What the other client is.
        holder: &'static str,
    },
    /// Too few or too many steps.
    #[error("{found} steps, expected 1 to {MAX_STEPS}")]
    Steps {
        /// Steps asked for.
        found: u32,
    },
    /// Too little or too much film.
    #[error("a background of {found_s} s, expected {} to {} s", BACKGROUND_S.start(), BACKGROUND_S.end())]
    Background {
        /// Film asked for, seconds.
        found_s: f64,
    },
    /// One background at a time.
    #[error("a background is being taken already: wait until it is there")]
    BackgroundBusy,
    /// The run follows a recording.
    #[error("this run follows a recording, which others steered: pause, resume, step, seek, speed or loop")]
    Replay,
    /// The run follows no recording.
    #[error("this run is no replay: only a recording can be sought, looped or played at another speed")]
    NoReplay,
    /// A film time that the recording has not.
    #[error("a seek to {found_s} s, expected 0 to {:.3} s: the recording is so long", (length_s * 1e3).floor() / 1e3)]
    Seek {
        /// The film time that was sought, seconds.
        found_s: f64,
        /// The length of the recording, seconds.
        length_s: f64,
    },
    /// Too slow or too fast.
    #[error("a speed of {found}, expected {} to {}", SPEEDS.start(), SPEEDS.end())]
    Speed {
        /// The speed that was asked for.
        found: f64,
    },
    /// Another coordinator leads the run.
    #[error("this coordinator observes the run of another, which alone steers it")]
    Observes,
    /// A recording keeps no more between two steps.
    #[error("{limit} commands since the last step, expected a step before more")]
    TooManyCommands {
        /// The most that are kept.
        limit: usize,
    },
    /// The world that it was for has ended.
    #[error("a reset or another scene came before it was done")]
    Superseded,
    /// Too many commands wait for the next step.
    #[error("{MAX_WAITING} commands wait, expected fewer")]
    Busy,
    /// The run has ended.
    #[error("the run has ended")]
    Ended,
}
