//! The loop: for every physics step the frame it must see, the hull's answers, and the step.
//!
//! Simulation time is film time. Step k (from 1) ends at T = k · dt and sees the newest frame captured
//! at or before T. A live run makes it at wall time epoch + T + latency, so that film has time to
//! arrive; a lock-step run waits for the frame however long it takes. Both see the same frames, so a
//! live run that missed nothing is the lock-step run.

mod ask;
mod clock;
mod watch;

pub use watch::{Snapshot, Watcher};

use std::sync::Arc;
use std::time::{Duration, Instant};

use hull::pass::{BodyResult, Pass};
use hull::{Observer, ProbeSettings};
use sim::{BodyResponse, World};
use thiserror::Error;

use crate::answers::{Answers, Asks};
use crate::bounds::HullBounds;
use crate::facts::{FilmState, Pace};
use crate::figures::Figures;
use crate::transport::Transport;
use clock::{Clock, frame_at, unix_now_s};
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
        Coordinator {
            transport,
            world,
            observers,
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
        }
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
        let pace = Pace { epoch_unix_s, lock_step };
        self.transport.start(pace).await.map_err(RunError::Nodes)?;
        let began = Instant::now();
        let latency_s = self.settings.latency_s;
        let max_lag_s = (FRAMES_KEPT / self.settings.fps - latency_s).clamp(0.02, MAX_LAG_S);
        let mut clock = Clock { pace, latency_s, max_lag_s, slipped_s: 0.0 };
        tokio::pin!(stop);
        loop {
            let film_s = self.world.next_time_s() + clock.slipped_s;
            if self.settings.seconds.is_some_and(|seconds| film_s > seconds + 1e-9) {
                break;
            }
            let stepped = tokio::select! {
                biased;
                () = &mut stop => break,
                stepped = self.step(&mut clock, film_s, watcher) => stepped?,
            };
            if !stepped {
                break;
            }
            // A step may not wait at all; let the connections breathe.
            tokio::task::yield_now().await;
        }
        self.figures.wall_s = began.elapsed().as_secs_f64();
        let bytes = self.transport.bytes();
        self.figures.bytes_to_nodes = bytes.to_nodes;
        self.figures.bytes_from_nodes = bytes.from_nodes;
        self.figures.bytes_silhouettes = self.transport.silhouette_bytes();
        self.figures.slipped_s = clock.slipped_s;
        self.figures.steps = self.world.steps();
        self.figures.film_failure = match self.transport.film(0) {
            FilmState::Failed(why) => Some(why),
            FilmState::Ended if self.figures.frames == 0 => {
                Some("it ended without a frame that all cameras have".into())
            }
            FilmState::Running | FilmState::Ended => self.blind.filter(|_| self.figures.frames == 0),
        };
        Ok((self.figures, self.world))
    }

    /// One step with its pass; false if film has ended and was held long enough.
    async fn step(
        &mut self,
        clock: &mut Clock,
        film_s: f64,
        watcher: &mut dyn Watcher,
    ) -> Result<bool, RunError> {
        let wanted = frame_at(film_s, self.settings.fps);
        self.figures.frames_expected = wanted + 1;
        if self.settings.lock_step {
            self.await_frame(wanted).await?;
        } else {
            clock.sleep_until(film_s).await;
            clock.slip(film_s);
        }
        let newest = self.transport.newest_common(wanted);
        let ended = self.transport.film(wanted) == FilmState::Ended;
        if ended && newest.is_none_or(|newest| newest < wanted) {
            let last_s = newest.map_or(0.0, |newest| (newest + 1) as f64 / self.settings.fps);
            self.figures.frames_expected = newest.map_or(0, |newest| newest + 1);
            if film_s > last_s + self.settings.hold_s {
                return Ok(false);
            }
        } else {
            self.figures.late_steps += u64::from(newest != Some(wanted));
        }
        if newest != self.frame && newest.is_some() {
            self.use_frame(newest);
        }
        let began = Instant::now();
        let results = self.collide(film_s, ended).await;
        let touching = self.apply(results.as_deref())?;
        let step_ms = began.elapsed().as_secs_f64() * 1e3;
        self.figures.step_ms.add(step_ms);
        self.note_age(results.as_deref());
        self.report(watcher, film_s, step_ms, touching);
        self.picture(watcher, film_s, results.as_deref()).await;
        Ok(true)
    }

    /// Lock-step: waits until every node has a frame that new, or film has ended.
    async fn await_frame(&mut self, wanted: u64) -> Result<(), RunError> {
        self.transport.credit(wanted + FRAMES_AHEAD);
        let deadline = Instant::now() + LOCK_STEP_PATIENCE;
        loop {
            match self.transport.film(wanted) {
                FilmState::Failed(why) => return Err(RunError::Film(why)),
                FilmState::Ended => return Ok(()),
                FilmState::Running => {}
            }
            let newest = self.transport.newest_common(u64::MAX);
            if newest.is_some_and(|newest| newest >= wanted) {
                return Ok(());
            }
            let missing = self.transport.missing();
            if missing.is_empty() {
                self.missing_since = None;
            } else {
                // A node may come back; a dead one makes no hull, and no reason to wait for ever.
                let gone = self.missing_since.get_or_insert_with(Instant::now).elapsed();
                if gone > LOCK_STEP_PATIENCE {
                    return Err(RunError::Nodes(missing.join("; ")));
                }
                if gone > RETURN_PATIENCE {
                    return Ok(());
                }
            }
            if Instant::now() > deadline {
                return Err(RunError::Film(format!(
                    "frame {wanted} did not come within {} s",
                    LOCK_STEP_PATIENCE.as_secs()
                )));
            }
            self.transport.told(Duration::from_millis(100)).await;
        }
    }

    fn use_frame(&mut self, frame: Option<u64>) {
        self.frame = frame;
        self.figures.frames += 1;
        let facts = frame.and_then(|frame| self.transport.facts(frame)).unwrap_or_default();
        let cameras = facts.iter().flat_map(|facts| &facts.cameras);
        if let Some(slowest_ms) = cameras.map(|camera| camera.segment_ms).reduce(f64::max) {
            self.figures.add_stage("segment", slowest_ms);
        }
    }

    /// Steps the world with the hull's answers; returns how many bodies touch it.
    fn apply(&mut self, results: Option<&[BodyResult]>) -> Result<usize, RunError> {
        let responses: Vec<BodyResponse> = match results {
            Some(results) => results.iter().map(response).collect(),
            None => vec![BodyResponse::UNTOUCHED; self.world.moving_bodies().len()],
        };
        let began = Instant::now();
        let report = self.world.step(&responses).map_err(|error| RunError::World(error.to_string()))?;
        self.figures.add_stage("physics", began.elapsed().as_secs_f64() * 1e3);
        self.figures.faults += report.faults.len() as u64;
        for fault in &report.faults {
            tracing::error!("body {} was not finite ({:?}) and was put back", fault.body, fault.kind);
        }
        Ok(report.touched)
    }
}

fn response(result: &BodyResult) -> BodyResponse {
    BodyResponse { response_m: result.response_m.ok(), inside_samples: result.touches.len() }
}
