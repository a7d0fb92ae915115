//! The loop: for every physics step the frame it must see, the hull's answers, and the step.
//!
//! Simulation time is film time. Step k (from 1) ends at T = k · dt and sees the newest frame captured
//! at or before T. A live run makes it at T + latency by this process's clock, so that film has time to
//! arrive; a lock-step run waits for the frame however long it takes. Both see the same frames, so a
//! live run that missed nothing is the lock-step run.
//!
//! The loop waits; what is decided is decided by the [`Roster`](crate::roster::Roster), the [`HullQuery`] and the
//! clock.

mod begin;
mod commands;
mod frames;
mod hull;
mod metrics;
mod observe;
mod publish;
mod remember;
mod step;
mod watch;

use std::collections::{HashSet, VecDeque};
use std::sync::Arc;
use std::time::Duration;

use ::hull::contact::Eye;
use ::hull::{Observer, ProbeSettings};
use film_time::{FilmState, Pace, ring_frames};
use sim::{ResponseMode, World};
use thiserror::Error;

use crate::core::budget::StepBudget;
use crate::core::clock::{Clock, LEAST_LAG_S, Now};
use crate::core::latency::{FilmLatency, Heard};
use crate::figures::Figures;
use crate::hooks::{AlterResponse, EndRecord, Recorder, Schedule, Scheduled, Sees};
use crate::live::{Command, Live, Order, Refusal};
use crate::memory::{Memory, MemoryUse};
use crate::query::{AskEvery, HullQuery, Surfaces};
use crate::roster::{Arrival, WaitError};
use crate::transport::{Transport, TransportError};
use commands::Steering;
use frames::FilmInUse;
use publish::Publisher;
use tokio::time::Instant;

pub use watch::{GoneOn, Snapshot, Watcher};

/// What the clocks of this process say.
fn now() -> Now {
    Now { monotonic_s: film_time::monotonic_s(), unix_s: film_time::unix_now_s() }
}

/// Bodies of which a fault is logged; further ones are counted alone.
const MAX_FAULTY: usize = 64;
/// How far a lock-step node may film ahead of the frame in use: half of its ring.
pub const FRAMES_AHEAD: u64 = 4;
/// No node has a frame so long before its time, seconds of film.
const MOST_EARLY_S: f64 = 1.0;

/// How a run goes.
#[derive(Clone, Debug)]
pub struct RunSettings {
    /// The hull rule and the probes' settings.
    pub probes: ProbeSettings,
    /// Frames of the cluster per second.
    pub fps: f64,
    /// Live: wall time from capture to the step that sees it, seconds; `None`: no more than frames need to be known
    /// everywhere, as it is measured.
    pub latency_s: Option<f64>,
    /// How long the last frame of film that ends is held, seconds.
    pub hold_s: f64,
    /// The run ends after so much film, seconds; `None`: when film does, or never.
    pub seconds: Option<f64>,
    /// Every frame, as fast as it can be made, instead of in real time.
    pub lock_step: bool,
    /// How often the hull is asked.
    pub ask_every: AskEvery,
    /// See [`HullQuery::set_bodies`], metres.
    pub reuse_within_m: f64,
    /// How it goes on without a camera.
    pub going_on: GoingOn,
    /// How long to wait for nodes at the beginning, and live from then on for their first frame.
    pub connect_timeout: Duration,
}

/// How a run goes on without a camera, and when it does not.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GoingOn {
    /// A missing camera is left out while at least so many remain; below it there is no hull.
    pub min_cameras: usize,
    /// For a second after a camera has gone or come back, the hull moves bodies no faster, m/s.
    pub push_m_s: f64,
}

impl Default for GoingOn {
    fn default() -> GoingOn {
        GoingOn { min_cameras: 3, push_m_s: 1.5 }
    }
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

impl From<WaitError> for RunError {
    fn from(error: WaitError) -> RunError {
        match error {
            WaitError::Missing(_) => RunError::Missing(error),
            WaitError::FilmFailed(_) | WaitError::Late { .. } => RunError::Film(error),
        }
    }
}

/// A transport, a world, and the loop over both.
pub struct Coordinator {
    transport: Transport,
    world: World,
    settings: RunSettings,
    query: HullQuery,
    /// Under contacts: the hull's surface near each moving body.
    surfaces: Surfaces,
    film: FilmInUse,
    clock: Clock,
    figures: Figures,
    /// What the solver took for the steps of the world.
    budget: StepBudget,
    commands: Commands,
    script: Script,
    log: Log,
    publisher: Publisher,
    remembering: Remembering,
}

/// What followers asked for.
#[derive(Default)]
struct Commands {
    steering: Steering,
    /// Commands that were received, at most [`MAX_WAITING`](crate::live::MAX_WAITING) and a few resets.
    waiting: VecDeque<Order>,
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
    /// Its next step, until it is made.
    next: Option<Scheduled>,
    alter: Option<AlterResponse>,
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
        let RunSettings { probes, fps, latency_s, lock_step, ask_every, .. } = settings;
        let pace = Pace { lock_step, ..Pace::live(0, 0.0) };
        // The ring, less the frame that is being replaced.
        let kept_s = (ring_frames(fps) - 1) as f64 / fps;
        let nodes = transport.roster().nodes().len();
        let latency = FilmLatency::new(latency_s, (nodes, observers.len()), kept_s - LEAST_LAG_S);
        let eyes = observers.iter().map(|observer| Eye::of(observer.camera())).collect();
        let mut query = HullQuery::new(observers, probes, transport.group_count(), ask_every);
        if world.settings().response == ResponseMode::Contacts {
            query.ask_planes();
        }
        query.speculate(transport.asks_nodes());
        let surfaces = Surfaces::of(fps, world.settings().hull_time, eyes);
        let mut coordinator = Coordinator {
            transport,
            world,
            clock: Clock::new(pace, latency, kept_s),
            settings,
            query,
            surfaces,
            film: FilmInUse::default(),
            figures: Figures::default(),
            budget: StepBudget::default(),
            commands: Commands::default(),
            script: Script::default(),
            log: Log::default(),
            publisher: Publisher::default(),
            remembering: Remembering::default(),
        };
        coordinator.bodies_changed();
        coordinator
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
            () = &mut stop => {
                self.finish(true);
                return Ok((self.figures, self.world));
            }
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
        self.figures.wall_s = began.elapsed().as_secs_f64();
        self.finish(is_stopped);
        Ok((self.figures, self.world))
    }

    /// Adds what is known at the end alone.
    fn finish(&mut self, is_stopped: bool) {
        self.transport.drain();
        self.figures.counts = self.counts();
        self.figures.film_failure = match self.transport.roster().film(0) {
            FilmState::Failed(why) => Some(why),
            FilmState::Running | FilmState::Ended if self.figures.counts.frames > 0 || is_stopped => None,
            FilmState::Ended => Some("it ended without a frame that all cameras have".into()),
            FilmState::Running => Some(match &self.film.unavailable {
                Some(why) => why.to_string(),
                None => "no frame has come".into(),
            }),
        };
        let Coordinator { log, figures, world, .. } = self;
        if let Some(recorder) = &mut log.recorder {
            recorder.end(&EndRecord { commands: &log.commands, figures, world });
        }
    }

    /// One step, or a while of waiting while paused; false at the end of film or time.
    async fn turn(&mut self, watcher: &mut dyn Watcher) -> Result<bool, RunError> {
        self.remember();
        if self.script.next.is_none()
            && let Some(schedule) = &mut self.script.schedule
        {
            self.script.next = schedule.next();
            if self.script.next.is_none() {
                return Ok(false);
            }
        }
        if let Some(held) = self.transport.roster().displaced() {
            return Err(TransportError::Held(held).into());
        }
        if self.commands.steering.is_paused() {
            return Ok(self.rest(watcher).await);
        }
        let film_s = self.scheduled_film_s().unwrap_or_else(|| self.film_s());
        if self.is_over(film_s) {
            return Ok(false);
        }
        self.follow_film();
        if !self.settings.lock_step
            && let Some(left_s) = self.clock.left_s(film_s, now())
        {
            self.transport.until(Instant::now() + Duration::from_secs_f64(left_s)).await;
        }
        self.take_orders().await;
        if self.commands.steering.is_paused() {
            return Ok(true);
        }
        self.give_up_slow_world().await?;
        match self.script.next.take() {
            Some(Scheduled { commands, sees }) => {
                self.follow(commands).await?;
                self.scheduled_step(sees, watcher).await
            }
            None if self.awaits_first_frame() => Ok(self.await_first_frame(watcher).await),
            None => self.film_step(watcher).await,
        }
    }

    /// Live: notes how late frames come, and goes towards the latency that they need.
    fn follow_film(&mut self) {
        if self.settings.lock_step {
            return;
        }
        self.transport.drain();
        let (arrivals, is_there) = self.transport.take_arrivals();
        for Arrival { node, frame, heard_s } in arrivals {
            let film_s = frame as f64 / self.settings.fps;
            let late_s = heard_s - self.clock.pace.zero_s - film_s;
            if late_s < -MOST_EARLY_S {
                self.transport
                    .fault(node, format!("frame {frame} was reported {:.1} s before its time", -late_s));
                continue;
            }
            let is_left_out = self.transport.roster().nodes()[node].is_left_out();
            self.clock.latency.note(Heard { node, frame, film_s, late_s, is_left_out }, &is_there);
            let Some(report) = self.transport.roster().nodes()[node].report(frame) else { continue };
            // What came after the node's last camera is the way here.
            let slowest_s = report.cameras.iter().map(|camera| camera.late_s).fold(f64::MIN, f64::max);
            for camera in &report.cameras {
                let camera_late_s = late_s - slowest_s + camera.late_s;
                self.clock.latency.note_camera(camera.rig_index.into(), film_s, camera_late_s);
            }
        }
        self.clock.latency.slew(self.clock.pace.film_now_s());
    }

    /// Film time of the next step's end, seconds.
    fn film_s(&self) -> f64 {
        self.world.next_time_s() + self.clock.offset_s()
    }

    /// The same where a schedule sets it.
    fn scheduled_film_s(&self) -> Option<f64> {
        match self.script.next.as_ref()?.sees {
            Sees::Film => None,
            Sees::Recorded { film_s, .. } | Sees::Given { film_s, .. } => Some(film_s),
        }
    }

    fn is_over(&self, film_s: f64) -> bool {
        self.settings.seconds.is_some_and(|seconds| film_s > seconds + 1e-9)
    }
}
