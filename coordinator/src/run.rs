//! The loop: for every physics step the frame it must see, one pass over all bodies, and the step.
//!
//! Simulation time is film time. Step k (from 1) ends at T = k · dt and sees the newest frame captured
//! at or before T. A live run makes it at wall time epoch + T + latency, so that film has time to
//! arrive; a lock-step run waits for the frame however long it takes. Both see the same frames, so a
//! live run that missed nothing is the lock-step run.

use std::sync::Arc;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use hull::cull::{Frustum, WorldBox, hull_box};
use hull::pass::{BodyResult, Pass};
use hull::question::Points;
use hull::{Observer, ProbeSettings, Silhouette};
use sim::{BodyResponse, World};
use thiserror::Error;

use crate::facts::{FilmState, FrameFacts, Pace};
use crate::figures::{Figures, Percentiles, Progress, stage_of};
use crate::transport::Transport;

/// How far a lock-step node may film ahead of the frame in use: half of its ring.
const FRAMES_AHEAD: u64 = 4;
/// Live: a pass that takes longer has lost its node.
const LIVE_PATIENCE: Duration = Duration::from_millis(500);
/// Lock-step: as long as a node may take over a frame or an answer before the run is given up.
const LOCK_STEP_PATIENCE: Duration = Duration::from_secs(30);
/// Live steps never lag by more than this behind film.
const MAX_LAG_S: f64 = 0.15;
/// How many frames back a node surely still has: its ring, less the one that is being replaced.
const FRAMES_KEPT: f64 = 7.0;
/// Live film that is older than this has stopped.
const STALE_S: f64 = 1.0;
/// Lock-step: how long a node that has gone is waited for before steps go on without a hull.
const RETURN_PATIENCE: Duration = Duration::from_secs(2);
const REPORT_EVERY: Duration = Duration::from_millis(250);

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

/// All that a picture of one step needs.
pub struct Snapshot<'a> {
    /// Film time, seconds.
    pub film_s: f64,
    /// The frame in use.
    pub frame: u64,
    /// Its silhouettes in rig order.
    pub silhouettes: Vec<Arc<Silhouette>>,
    /// The world after the step.
    pub world: &'a World,
    /// Samples that were inside the hull before the step, world, metres.
    pub inside_world: Vec<[f64; 3]>,
}

/// Who is told of a run as it goes.
pub trait Watcher {
    /// Told four times a second.
    fn progress(&mut self, progress: &Progress);
    /// Asked after every step: is a picture of it wanted?
    fn wants_snapshot(&mut self, film_s: f64) -> bool;
    /// The picture's contents, if it was.
    fn snapshot(&mut self, snapshot: Snapshot<'_>);
}

/// A transport, a world, and the loop over both.
pub struct Coordinator {
    transport: Transport,
    world: World,
    observers: Vec<Arc<Observer>>,
    settings: RunSettings,
    figures: Figures,
    hull_box: Option<(u64, Option<WorldBox>)>,
    frame: Option<u64>,
    blind: Option<String>,
    missing_since: Option<Instant>,
    recent: Recent,
}

struct Recent {
    since: Instant,
    steps_ms: Percentiles,
    bytes: u64,
    contacts: usize,
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
        let since = Instant::now();
        Coordinator {
            transport,
            world,
            observers,
            settings,
            figures: Figures { samples, ..Figures::default() },
            hull_box: None,
            frame: None,
            blind: None,
            missing_since: None,
            recent: Recent { since, steps_ms: Percentiles::default(), bytes: 0, contacts: 0 },
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
        let wanted = (film_s * self.settings.fps + 1e-9).floor() as u64;
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

    /// Asks the hull about every moving body; `None` if there is no hull.
    async fn collide(&mut self, film_s: f64, ended: bool) -> Option<Vec<BodyResult>> {
        if let Some(why) = self.why_blind(film_s, ended) {
            self.go_blind(why);
            return None;
        }
        let frame = self.frame?;
        let began = Instant::now();
        let hull_box = self.hull_box(frame);
        let points = |body: &sim::Body| Points::Body { shape: Arc::clone(&body.shape), pose: body.pose };
        let bodies = self.world.moving_bodies().map(points).collect();
        let mut pass =
            Pass::new(bodies, hull_box.as_ref(), self.settings.probes, self.transport.group_count());
        self.figures.add_stage("cull", began.elapsed().as_secs_f64() * 1e3);
        let patience = if self.settings.lock_step { LOCK_STEP_PATIENCE } else { LIVE_PATIENCE };
        let figures = &mut self.figures;
        let mut took = |round, ms| figures.add_stage(stage_of(round), ms);
        match self.transport.run_pass(&mut pass, frame, patience, &mut took).await {
            Ok(()) => {
                if let Some(before) = self.blind.take() {
                    tracing::warn!("the hull is back (it was gone: {before})");
                }
                let results = pass.into_results();
                self.figures.add_results(&results);
                Some(results)
            }
            Err(why) => {
                self.go_blind(why);
                None
            }
        }
    }

    fn why_blind(&self, film_s: f64, ended: bool) -> Option<String> {
        if let Some(missing) = self.transport.missing().into_iter().next() {
            return Some(missing);
        }
        if let FilmState::Failed(why) = self.transport.film(0) {
            return Some(format!("film failed: {why}"));
        }
        let Some(frame) = self.frame else {
            // At the beginning nothing is lost yet.
            return (film_s > STALE_S).then(|| "no frame has come yet".into());
        };
        let age_s = film_s - frame as f64 / self.settings.fps;
        let stale = !self.settings.lock_step && !ended && age_s > STALE_S;
        stale.then(|| format!("film has stopped at frame {frame}, {age_s:.1} s ago"))
    }

    /// Says once that there is no hull; the world goes on.
    fn go_blind(&mut self, why: String) {
        self.figures.blind_steps += 1;
        if self.blind.is_none() {
            tracing::error!("no hull, bodies meet nobody: {why}");
        }
        self.blind = Some(why);
    }

    /// The box around the hull of a frame, from every camera's frustum.
    fn hull_box(&mut self, frame: u64) -> Option<WorldBox> {
        if let Some((known, hull_box)) = self.hull_box
            && known == frame
        {
            return hull_box;
        }
        let facts = self.transport.facts(frame).unwrap_or_default();
        let found = box_around(&facts, &self.observers, &self.settings.probes);
        self.hull_box = Some((frame, found));
        found
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

    fn note_age(&mut self, results: Option<&[BodyResult]>) {
        let responded = results.is_some_and(|results| results.iter().any(|result| result.response_m.is_ok()));
        let facts = self.frame.and_then(|frame| self.transport.facts(frame)).filter(|_| responded);
        if let Some(facts) = facts.as_ref().and_then(|facts| facts.first()) {
            self.figures.response_age_ms.add((unix_now_s() - facts.captured_unix_s) * 1e3);
        }
    }

    fn report(&mut self, watcher: &mut dyn Watcher, film_s: f64, step_ms: f64, touching: usize) {
        self.recent.steps_ms.add(step_ms);
        self.recent.contacts = touching;
        let elapsed = self.recent.since.elapsed();
        if elapsed < REPORT_EVERY {
            return;
        }
        let bytes = self.transport.bytes();
        let bytes = bytes.to_nodes + bytes.from_nodes;
        watcher.progress(&Progress {
            film_s,
            frame: self.frame,
            passes_per_s: self.recent.steps_ms.count() as f64 / elapsed.as_secs_f64(),
            p50_ms: self.recent.steps_ms.p50().unwrap_or(0.0),
            p99_ms: self.recent.steps_ms.p99().unwrap_or(0.0),
            samples: self.figures.samples,
            contacts: self.recent.contacts,
            bytes_per_s: (bytes - self.recent.bytes) as f64 / elapsed.as_secs_f64(),
            blind: self.blind.clone(),
        });
        self.recent = Recent { since: Instant::now(), steps_ms: Percentiles::default(), bytes, contacts: 0 };
    }

    async fn picture(&mut self, watcher: &mut dyn Watcher, film_s: f64, results: Option<&[BodyResult]>) {
        let Some(frame) = self.frame else { return };
        if !watcher.wants_snapshot(film_s) {
            return;
        }
        match self.transport.silhouettes(frame).await {
            Ok(silhouettes) => {
                let inside_world = inside_points(&self.world, results.unwrap_or_default());
                watcher.snapshot(Snapshot { film_s, frame, silhouettes, world: &self.world, inside_world });
            }
            Err(why) => tracing::warn!("no picture at {film_s:.2} s: {why}"),
        }
    }
}

/// The samples that were inside, where their bodies now are.
fn inside_points(world: &World, results: &[BodyResult]) -> Vec<[f64; 3]> {
    let bodies = world.moving_bodies().zip(results);
    bodies
        .flat_map(|(body, result)| {
            let world_from_body = body.pose.world_from_body();
            let samples = body.shape.samples_body();
            let points = result.touches.iter();
            points
                .map(|touch| world_from_body(samples[touch.sample as usize]).into())
                .collect::<Vec<[f64; 3]>>()
        })
        .collect()
}

fn response(result: &BodyResult) -> BodyResponse {
    BodyResponse { response_m: result.response_m.ok(), inside_samples: result.touches.len() }
}

fn box_around(facts: &[FrameFacts], observers: &[Arc<Observer>], probes: &ProbeSettings) -> Option<WorldBox> {
    let frustum = |observer: &Arc<Observer>| {
        let mut cameras = facts.iter().flat_map(|facts| &facts.cameras);
        let facts = cameras.find(|camera| camera.rig_index == observer.rig_index())?;
        facts.admitted.map(|rect| Frustum::of(observer.camera(), rect))
    };
    hull_box(&observers.iter().map(frustum).collect::<Vec<_>>(), probes.rule())
}

/// Film time against the wall clock.
struct Clock {
    pace: Pace,
    latency_s: f64,
    /// Beyond this lag nodes may have dropped the frame of a step.
    max_lag_s: f64,
    slipped_s: f64,
}

impl Clock {
    async fn sleep_until(&self, film_s: f64) {
        let left_s = self.pace.epoch_unix_s + film_s + self.latency_s - unix_now_s();
        if left_s > 0.0 {
            tokio::time::sleep(Duration::from_secs_f64(left_s)).await;
        }
    }

    /// Gives up film time that steps can no longer make good.
    fn slip(&mut self, film_s: f64) {
        let lag_s = unix_now_s() - (self.pace.epoch_unix_s + film_s + self.latency_s);
        if lag_s > self.max_lag_s {
            tracing::warn!("steps lag {lag_s:.2} s behind film, which goes on without them");
            self.slipped_s += lag_s;
        }
    }
}

/// Wall clock, unix seconds.
fn unix_now_s() -> f64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0.0, |since| since.as_secs_f64())
}
