//! The loop: does what a [`Run`] decides, and waits for it. What the run decides, and why, stands in `core/run`.

mod begin;
mod commands;
mod make;
mod metrics;
mod observe;
mod publish;
mod remember;
mod replay;
mod watch;

use std::collections::{HashSet, VecDeque};
use std::sync::Arc;
use std::time::Duration;

use film_time::FilmState;
use hull::Observer;
use sim::{Scene, World, WorldSettings};
use thiserror::Error;
use tokio::time::Instant;

use crate::core::clock::Now;
use crate::core::holds::Holds;
use crate::core::playback::{Playback, PlaybackSettings};
use crate::core::run::{Action, CannotGoOn, Run};
use crate::figures::Figures;
use crate::hooks::{AlterResponse, EndRecord, Recorder, Schedule};
use crate::live::{Command, Live, Order, Refusal};
use crate::memory::{Memory, MemoryUse};
use crate::roster::WaitError;
use crate::transport::{Transport, TransportError};
use publish::Publisher;

pub use crate::core::run::{FRAMES_AHEAD, GoingOn, RunSettings};
pub use watch::{GoneOn, Snapshot, Watcher};

/// What the clocks of this process say.
fn now() -> Now {
    Now { monotonic_s: film_time::monotonic_s(), unix_s: film_time::unix_now_s() }
}

/// Why a run could not be made.
#[derive(Debug, Error)]
pub enum RunError {
    /// Nodes are missing, or not the ones meant.
    #[error(transparent)]
    Nodes(#[from] TransportError),
    /// Film failed, or a frame did not come.
    #[error("film failed: {0}")]
    Film(WaitError),
    /// Nodes stayed away.
    #[error(transparent)]
    Missing(WaitError),
    /// A recorded step has no hull any more.
    #[error("film failed: recorded frame {frame}: {why}")]
    Recorded {
        /// The frame.
        frame: u64,
        /// Why the recorded step had no hull.
        why: crate::roster::HullUnavailable,
    },
    /// The recorder could not take a frame in time.
    #[error("film failed: frame {frame} could not be kept")]
    Unrecorded {
        /// The frame.
        frame: u64,
    },
    /// The system gives no number for the run.
    #[error("no random number for the run: {0}")]
    NoRandom(getrandom::Error),
    /// The world refused a step.
    #[error("world: {0}")]
    World(#[from] sim::WorldError),
    /// The world refused what a recording has for it.
    #[error("world: a recorded command was refused: {0}")]
    Command(Refusal),
}

impl From<CannotGoOn> for RunError {
    fn from(error: CannotGoOn) -> RunError {
        match error {
            CannotGoOn::Waited(error @ WaitError::Missing(_)) => RunError::Missing(error),
            CannotGoOn::Waited(error) => RunError::Film(error),
            CannotGoOn::Recorded { frame, why } => RunError::Recorded { frame, why },
        }
    }
}

/// A transport, a run, and the loop over both.
pub struct Coordinator {
    transport: Transport,
    run: Run,
    script: Script,
    log: Log,
    publisher: Publisher,
    remembering: Remembering,
    /// Commands that were received, at most [`MAX_WAITING`](crate::live::MAX_WAITING) and a few resets.
    waiting: VecDeque<Order>,
    holds: Holds,
    /// Locked while cameras learn a background.
    background_turn: Arc<tokio::sync::Mutex<()>>,
}

/// The memory of the run's nodes.
#[derive(Default)]
struct Remembering {
    memory_use: MemoryUse,
    /// Once the run has begun, if it uses that of its nodes.
    memory: Option<Memory>,
}

/// What a run follows instead of film and followers, if anything.
#[derive(Default)]
struct Script {
    schedule: Option<Box<dyn Schedule>>,
    /// The commands before its next step, until they are done.
    commands: Option<Vec<Command>>,
    alter: Option<AlterResponse>,
    /// What the world of a recording began as.
    beginning: Option<(Scene, WorldSettings)>,
}

/// Who keeps the run, and the commands since the last step that it has not received.
#[derive(Default)]
struct Log {
    recorder: Option<Box<dyn Recorder>>,
    commands: Vec<Command>,
    /// Bodies of which a fault was logged, by name.
    faulty: HashSet<String>,
}

impl Coordinator {
    /// A coordinator of connected nodes; `observers` are the whole rig's, in rig order.
    pub fn new(
        transport: Transport,
        world: World,
        observers: Vec<Arc<Observer>>,
        settings: RunSettings,
    ) -> Coordinator {
        let run = Run::new(world, observers, settings, (transport.roster(), transport.answering()));
        Coordinator {
            transport,
            run,
            script: Script::default(),
            log: Log::default(),
            publisher: Publisher::default(),
            remembering: Remembering::default(),
            waiting: VecDeque::new(),
            holds: Holds::default(),
            background_turn: Arc::default(),
        }
    }

    /// Takes orders from followers, and lets them watch.
    pub fn with_live(mut self, live: Live) -> Coordinator {
        self.publisher.live = Some(live);
        self.publish_scene();
        self
    }

    /// Has the run kept.
    pub fn with_recorder(mut self, recorder: Box<dyn Recorder>) -> Coordinator {
        self.log.recorder = Some(recorder);
        self
    }

    /// Has a live run over nodes use their memory.
    pub fn with_memory(mut self, memory_use: MemoryUse) -> Coordinator {
        self.remembering.memory_use = memory_use;
        self
    }

    /// Follows a schedule: it decides what every step sees and what comes before it.
    pub fn with_schedule(mut self, schedule: Box<dyn Schedule>) -> Coordinator {
        self.script.schedule = Some(schedule);
        self
    }

    /// Lets followers seek in a schedule that has an end, and play it again.
    pub fn with_playback(mut self, settings: PlaybackSettings) -> Coordinator {
        let world = &self.run.world;
        self.script.beginning = Some((world.scene().clone(), *world.settings()));
        self.run.playback = Some(Playback::new(settings));
        self
    }

    /// Has the hull's answers changed before every step: recordings keep them as they were changed.
    pub fn with_altered(mut self, alter: AlterResponse) -> Coordinator {
        self.script.alter = Some(alter);
        self
    }

    /// Runs until film or time ends, or `stop` completes. Returns the world as it ended.
    pub async fn run(
        mut self,
        watcher: &mut dyn Watcher,
        stop: impl Future<Output = ()>,
    ) -> Result<(Figures, World), RunError> {
        tokio::pin!(stop);
        tokio::select! {
            biased;
            () = &mut stop => return Ok(self.finish(true)),
            begun = self.begin(watcher) => begun?,
        }
        let began = Instant::now();
        let is_stopped = loop {
            let goes_on = tokio::select! {
                biased;
                () = &mut stop => break true,
                goes_on = self.turn(watcher) => goes_on?,
            };
            if !goes_on {
                break false;
            }
            watcher.turned();
            // A step may not wait at all; let the connections breathe.
            tokio::task::yield_now().await;
        };
        self.run.figures.wall_s = began.elapsed().as_secs_f64();
        Ok(self.finish(is_stopped))
    }

    /// Adds what is known at the end alone.
    fn finish(mut self, is_stopped: bool) -> (Figures, World) {
        self.transport.drain();
        self.run.figures.counts = self.counts();
        self.run.figures.film_failure = match self.transport.roster().film(0) {
            FilmState::Failed(why) => Some(why),
            FilmState::Running | FilmState::Ended if self.run.figures.counts.frames > 0 || is_stopped => None,
            FilmState::Ended => Some("it ended without a frame that all cameras have".into()),
            FilmState::Running => Some(match &self.run.film.unavailable {
                Some(why) => why.to_string(),
                None => "no frame has come".into(),
            }),
        };
        let Coordinator { log, run: Run { figures, world, .. }, .. } = self;
        if let Some(mut recorder) = log.recorder {
            recorder.end(&EndRecord { commands: &log.commands, figures: &figures, world: &world });
        }
        (figures, world)
    }

    /// One step, or a while of waiting while there is none to make; false at the end of film or time.
    async fn turn(&mut self, watcher: &mut dyn Watcher) -> Result<bool, RunError> {
        self.remember();
        if !self.follow_schedule().await? {
            return Ok(false);
        }
        if let Some(held) = self.transport.roster().displaced() {
            return Err(TransportError::Held(held).into());
        }
        self.transport.drain();
        loop {
            match self.run.next(self.transport.roster_mut(), &now)? {
                Action::Wait { at_most_s } => {
                    self.transport.next_within(Duration::from_secs_f64(at_most_s)).await;
                    self.transport.drain();
                    if self.run.playback.is_some() {
                        self.take_orders().await;
                        // A gap in the recording may be long.
                        self.report(watcher);
                        if self.run.puts_off_step() {
                            return Ok(true);
                        }
                    }
                }
                Action::TakeOrders => {
                    self.take_orders().await;
                    if self.run.puts_off_step() {
                        return Ok(true);
                    }
                    if !self.run.stands() {
                        self.follow_commands().await?;
                    }
                    self.transport.drain();
                }
                Action::Credit(up_to_frame) => {
                    self.transport.credit(up_to_frame);
                    self.transport.drain();
                }
                Action::UseFrame(frame) => self.use_frame(frame).await?,
                Action::Ask { frame, timeout } => self.ask_hull(frame, timeout).await,
                Action::StartAfresh => self.start_afresh("the solver takes over 0.1 s a step").await?,
                Action::Make(step) => {
                    self.make_step(step, watcher).await?;
                    return Ok(true);
                }
                Action::StandStill => {
                    self.report(watcher);
                    return Ok(true);
                }
                Action::Rest => {
                    self.rest(watcher).await;
                    return Ok(!self.run.is_over(self.run.film_s()));
                }
                Action::End => return Ok(false),
            }
        }
    }
}
