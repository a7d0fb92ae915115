//! The loop: for every physics step the frame it must see, the hull's answers, and the step.
//!
//! Simulation time is film time. Step k (from 1) ends at T = k · dt and sees the newest frame captured
//! at or before T. A live run makes it at wall time epoch + T + latency, so that film has time to
//! arrive; a lock-step run waits for the frame however long it takes. Both see the same frames, so a
//! live run that missed nothing is the lock-step run.

mod ask;
mod clock;
mod film;
mod orders;
mod publish;
mod watch;

pub use watch::{Snapshot, Watcher};

use std::sync::Arc;
use std::time::{Duration, Instant};

use hull::pass::{BodyResult, Pass};
use hull::{Observer, ProbeSettings};
use sim::{Body, BodyResponse, World};
use thiserror::Error;

use crate::answers::{Answers, Asks};
use crate::bounds::HullBounds;
use crate::facts::{FilmState, Pace};
use crate::figures::Figures;
use crate::live::{Command, Live};
use crate::record::{EndRecord, Recorder, Schedule, Scheduled, Sees, StepRecord};
use crate::transport::Transport;
use clock::{Clock, frame_at, unix_now_s};
use film::Film;
use orders::Steering;
use publish::Seen;
use watch::Recent;

/// How far a lock-step node may film ahead of the frame in use: half of its ring.
const FRAMES_AHEAD: u64 = 4;
/// Lock-step: as long as a node may take over a frame or an answer before the run is given up.
const LOCK_STEP_PATIENCE: Duration = Duration::from_secs(30);
/// Live steps never lag by more than this behind film.
const MAX_LAG_S: f64 = 0.15;
/// How many frames back a node surely still has: its ring, less the one that is being replaced.
const FRAMES_KEPT: f64 = 7.0;
/// Lock-step: how long a node that has gone is waited for before steps go on without a hull.
const RETURN_PATIENCE: Duration = Duration::from_secs(2);

/// How a run goes.
#[derive(Clone, Debug)]
pub struct RunSettings {
    /// How the hull judges.
    pub probes: ProbeSettings,
    /// Frames of the cluster per second.
    pub fps: f64,
    /// Live: wall time from capture to the step that sees it, seconds.
    pub latency_s: f64,
    /// How long the last frame of film that ends is held, seconds.
    pub hold_s: f64,
    /// The run ends after so much film, seconds; `None`: when film does, or never.
    pub seconds: Option<f64>,
    /// Every frame, as fast as it can be made, instead of in real time.
    pub lock_step: bool,
    /// How often the hull is asked.
    pub asks: Asks,
    /// Within one frame a body counts as clear where each of its samples is known to be outside no farther
    /// away than this, metres: no sample deeper than this is ever missed. At 0 answers are used again for
    /// the very same pose alone.
    pub reuse_within_m: f64,
    /// How long to wait for nodes at the beginning.
    pub connect_patience: Duration,
}

/// Why a run could not be made.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum RunError {
    /// Nodes are missing, or not the ones meant.
    #[error("{0}")]
    Nodes(String),
    /// Film failed.
    #[error("film failed: {0}")]
    Film(String),
    /// The world refused.
    #[error("world: {0}")]
    World(String),
}

/// A transport, a world, and the loop over both.
pub struct Coordinator {
    transport: Transport,
    world: World,
    observers: Vec<Arc<Observer>>,
    settings: RunSettings,
    figures: Figures,
    pass: Pass,
    answers: Answers,
    bounds: HullBounds,
    /// The frame whose bounds they are.
    bounded: Option<u64>,
    frame: Option<u64>,
    blind: Option<String>,
    missing_since: Option<Instant>,
    recent: Recent,
    clock: Clock,
    live: Option<Live>,
    steering: Steering,
    recorder: Option<Box<dyn Recorder>>,
    schedule: Option<Box<dyn Schedule>>,
    /// The next step of the schedule, until it is made.
    scheduled: Option<Scheduled>,
    /// Frames that nobody expected: film went by while no steps were wanted.
    frames_passed: u64,
    /// What was done since the last step.
    commands: Vec<Command>,
    /// Counts worlds.
    generation: u32,
    scene_version: u64,
    seen: Seen,
}

impl Coordinator {
    /// A coordinator of connected nodes; `observers` are the whole rig's, in rig order.
    pub fn new(
        transport: Transport,
        world: World,
        observers: Vec<Arc<Observer>>,
        settings: RunSettings,
    ) -> Coordinator {
        let samples = world.moving_bodies().map(|body| body.shape.samples_body().len()).sum();
        let shapes = world.moving_bodies().map(|body| Arc::clone(&body.shape));
        let answers = Answers::new(shapes, settings.asks, settings.reuse_within_m);
        let pass = Pass::new(vec![], None, settings.probes, transport.group_count());
        let pace = Pace { epoch_unix_s: unix_now_s(), lock_step: settings.lock_step };
        let max_lag_s = (FRAMES_KEPT / settings.fps - settings.latency_s).clamp(0.02, MAX_LAG_S);
        Coordinator {
            transport,
            world,
            observers,
            clock: Clock::new(pace, settings.latency_s, max_lag_s),
            settings,
            figures: Figures { samples, ..Figures::default() },
            pass,
            answers,
            bounds: HullBounds::default(),
            bounded: None,
            frame: None,
            blind: None,
            missing_since: None,
            recent: Recent::new(0, 0),
            live: None,
            steering: Steering::default(),
            recorder: None,
            schedule: None,
            scheduled: None,
            frames_passed: 0,
            commands: Vec::new(),
            generation: 0,
            scene_version: 0,
            seen: Seen::default(),
        }
    }

    /// Takes orders from followers, and lets them watch.
    pub fn with_live(mut self, live: Live) -> Coordinator {
        self.live = Some(live);
        self.publish_scene();
        self
    }

    /// Has the run kept.
    pub fn with_recorder(mut self, recorder: Box<dyn Recorder>) -> Coordinator {
        self.recorder = Some(recorder);
        self
    }

    /// Follows a schedule: it decides what every step sees and what comes before it.
    pub fn with_schedule(mut self, schedule: Box<dyn Schedule>) -> Coordinator {
        self.schedule = Some(schedule);
        self
    }

    /// Runs until film or time ends, or `stop` completes. Returns the world as it ended.
    pub async fn run(
        mut self,
        watcher: &mut dyn Watcher,
        stop: impl Future<Output = ()>,
    ) -> Result<(Figures, World), RunError> {
        self.transport.ready(self.settings.connect_patience).await.map_err(RunError::Nodes)?;
        let lock_step = self.settings.lock_step;
        let epoch_unix_s = unix_now_s() + if lock_step { 0.0 } else { 0.3 };
        self.clock.pace = Pace { epoch_unix_s, lock_step };
        self.transport.start(self.clock.pace).await.map_err(RunError::Nodes)?;
        let began = Instant::now();
        tokio::pin!(stop);
        loop {
            let went_on = tokio::select! {
                biased;
                () = &mut stop => break,
                went_on = self.turn(watcher) => went_on?,
            };
            if !went_on {
                break;
            }
            // A step may not wait at all; let the connections breathe.
            tokio::task::yield_now().await;
        }
        self.figures.wall_s = began.elapsed().as_secs_f64();
        self.finish();
        Ok((self.figures, self.world))
    }

    /// What is known at the end alone.
    fn finish(&mut self) {
        let bytes = self.transport.bytes();
        self.figures.bytes_to_nodes = bytes.to_nodes;
        self.figures.bytes_from_nodes = bytes.from_nodes;
        self.figures.bytes_silhouettes = self.transport.silhouette_bytes();
        self.figures.slipped_s = self.clock.slipped_s;
        self.figures.film_failure = match self.transport.film(0) {
            FilmState::Failed(why) => Some(why),
            FilmState::Ended if self.figures.frames == 0 => {
                Some("it ended without a frame that all cameras have".into())
            }
            FilmState::Running | FilmState::Ended => self.blind.clone().filter(|_| self.figures.frames == 0),
        };
        let Coordinator { recorder, commands, figures, world, .. } = self;
        if let Some(recorder) = recorder {
            recorder.end(&EndRecord { commands, figures, world });
        }
    }

    /// One step, or a while of waiting for somebody to say "go on"; false at the end of film or time.
    async fn turn(&mut self, watcher: &mut dyn Watcher) -> Result<bool, RunError> {
        if self.scheduled.is_none()
            && let Some(schedule) = &mut self.schedule
        {
            self.scheduled = schedule.next();
            if self.scheduled.is_none() {
                return Ok(false);
            }
        }
        if self.steering.is_paused() {
            return Ok(self.rest(watcher).await);
        }
        let film_s = self.scheduled_film_s().unwrap_or_else(|| self.film_s());
        if self.is_over(film_s) {
            return Ok(false);
        }
        if !self.settings.lock_step {
            self.clock.sleep_until(film_s).await;
        }
        self.take_orders().await;
        if self.steering.is_paused() {
            return Ok(true);
        }
        match self.scheduled.take() {
            Some(Scheduled { commands, sees }) => {
                self.follow(commands).await?;
                self.scheduled_step(sees, watcher).await
            }
            None => self.film_step(watcher).await,
        }
    }

    /// Film time of the next step's end, seconds.
    fn film_s(&self) -> f64 {
        self.world.next_time_s() + self.clock.offset_s()
    }

    /// The same where a schedule says it.
    fn scheduled_film_s(&self) -> Option<f64> {
        match self.scheduled.as_ref()?.sees {
            Sees::Film => None,
            Sees::Recorded { film_s, .. } | Sees::Given { film_s, .. } => Some(film_s),
        }
    }

    fn is_over(&self, film_s: f64) -> bool {
        self.settings.seconds.is_some_and(|seconds| film_s > seconds + 1e-9)
    }

    /// A step that sees what film has for it; false if film has ended and was held long enough.
    async fn film_step(&mut self, watcher: &mut dyn Watcher) -> Result<bool, RunError> {
        let film_s = self.film_s();
        let wanted = frame_at(film_s, self.settings.fps);
        self.figures.frames_expected = (wanted + 1).saturating_sub(self.frames_passed);
        if self.settings.lock_step {
            self.await_frame(wanted).await?;
        } else {
            self.clock.slip(film_s);
        }
        let newest = self.transport.newest_common(wanted);
        let ended = self.transport.film(wanted) == FilmState::Ended;
        if ended && newest.is_none_or(|newest| newest < wanted) {
            let last_s = newest.map_or(0.0, |newest| (newest + 1) as f64 / self.settings.fps);
            self.figures.frames_expected =
                newest.map_or(0, |newest| (newest + 1).saturating_sub(self.frames_passed));
            if film_s > last_s + self.settings.hold_s {
                return Ok(false);
            }
        } else {
            self.figures.late_steps += u64::from(newest != Some(wanted));
        }
        if newest != self.frame && newest.is_some() {
            self.use_frame(newest).await?;
        }
        let began = Instant::now();
        let results = self.collide(film_s, if ended { Film::Ended } else { Film::Runs }).await;
        self.make(film_s, began, results, None, watcher).await
    }

    /// A step that sees what another run's step saw.
    async fn scheduled_step(&mut self, sees: Sees, watcher: &mut dyn Watcher) -> Result<bool, RunError> {
        let (film_s, frame, given) = match sees {
            Sees::Film => return self.film_step(watcher).await,
            Sees::Recorded { film_s, frame } => (film_s, frame, None),
            Sees::Given { film_s, frame, responses } => (film_s, frame, Some(responses)),
        };
        self.figures.frames_expected = frame_at(film_s, self.settings.fps) + 1;
        if given.is_none()
            && let Some(frame) = frame
        {
            self.await_recorded(frame).await?;
        }
        if frame != self.frame && frame.is_some() {
            self.use_frame(frame).await?;
        }
        let began = Instant::now();
        let mut results = None;
        if frame.is_none() && given.is_none() {
            // At the beginning nothing is lost yet.
            if self.frame.is_some() {
                self.go_blind("there was no hull when this was recorded".into());
            }
        } else if given.is_none() {
            results = self.collide(film_s, Film::Given).await;
            if let (None, Some(why)) = (&results, &self.blind) {
                return Err(RunError::Film(format!("recorded frame {frame:?}: {why}")));
            }
        } else {
            self.blind = None;
        }
        self.make(film_s, began, results, given, watcher).await
    }

    /// The step itself, with the hull's answers, and what is told of it.
    async fn make(
        &mut self,
        film_s: f64,
        began: Instant,
        results: Option<Vec<BodyResult>>,
        given: Option<Vec<BodyResponse>>,
        watcher: &mut dyn Watcher,
    ) -> Result<bool, RunError> {
        let responses = given.unwrap_or_else(|| match &results {
            Some(results) => self.world.moving_bodies().zip(results).map(response).collect(),
            None => vec![BodyResponse::UNTOUCHED; self.world.moving_bodies().len()],
        });
        self.note_touches(&responses, results.as_deref());
        self.seen.touching = self.apply(&responses)?;
        self.seen.film_s = film_s;
        self.seen.frame = self.frame.filter(|_| self.blind.is_none());
        self.steering.count();
        let step_ms = began.elapsed().as_secs_f64() * 1e3;
        self.figures.step_ms.add(step_ms);
        self.figures.steps += 1;
        self.note_age(results.as_deref());
        self.record(&responses, results.as_deref(), step_ms);
        self.publish_world();
        self.report(watcher, Some(step_ms));
        self.picture(watcher, film_s, results.as_deref()).await;
        Ok(true)
    }

    /// Steps the world with the hull's answers; returns how many bodies touch it.
    fn apply(&mut self, responses: &[BodyResponse]) -> Result<usize, RunError> {
        let began = Instant::now();
        let report = self.world.step(responses).map_err(|error| RunError::World(error.to_string()))?;
        self.figures.add_stage("physics", began.elapsed().as_secs_f64() * 1e3);
        self.figures.faults += report.faults.len() as u64;
        for fault in &report.faults {
            tracing::error!("body {} was not finite ({:?}) and was put back", fault.body, fault.kind);
        }
        Ok(report.touched)
    }

    /// Tells the recorder of the step that was made.
    fn record(&mut self, responses: &[BodyResponse], results: Option<&[BodyResult]>, step_ms: f64) {
        if let Some(recorder) = &mut self.recorder {
            recorder.step(&StepRecord {
                generation: self.generation,
                step: self.world.steps(),
                commands: &self.commands,
                film_s: self.seen.film_s,
                slipped_s: self.seen.film_s - self.world.time_s(),
                frame: self.seen.frame,
                responses,
                results,
                step_ms,
                world: &self.world,
            });
        }
        self.commands.clear();
    }
}

fn response((body, result): (&Body, &BodyResult)) -> BodyResponse {
    let mut response = BodyResponse::default();
    response.set(result, &body.shape);
    response
}
