//! What is reported of a run while it goes on: figures four times a second, and pictures.

use std::time::Duration;

use hull::collision::BodyCollision;
use sim::World;
use tokio::time::Instant;

use super::Coordinator;
use crate::core::run::MadeStep;
use crate::figures::{Percentiles, Progress};
use crate::transport::Silhouettes;

pub(super) const REPORT_EVERY: Duration = Duration::from_millis(250);

/// All that a picture of one step needs.
pub struct Snapshot<'a> {
    /// Film time, seconds.
    pub film_s: f64,
    /// The frame in use.
    pub frame: u64,
    /// Its silhouettes in rig order.
    pub silhouettes: Silhouettes,
    /// The world after the step.
    pub world: &'a World,
    /// Samples that were inside the hull before the step, world, metres.
    pub inside_world: Vec<[f64; 3]>,
}

/// The world that a run goes on from.
#[derive(Clone, Debug, PartialEq)]
pub struct GoneOn {
    /// The scene that it began as.
    pub scene: String,
    /// How many bodies it has.
    pub bodies: usize,
    /// Steps that were made.
    pub steps: u64,
    /// Its own time, seconds.
    pub time_s: f64,
    /// How long ago nodes were handed it, seconds, by the clocks of two coordinators.
    pub age_s: f64,
}

/// Receives reports of a run as it goes.
pub trait Watcher {
    /// Once at the beginning, if the run goes on from a world that its nodes remember.
    fn gone_on(&mut self, _from: &GoneOn) {}
    /// The loop has gone round once more: a step was made, or waited for as long as it may be.
    fn turned(&mut self) {}
    /// Four times a second.
    fn progress(&mut self, progress: &Progress);
    /// Whether a picture of the step is wanted; called after every step.
    fn wants_snapshot(&mut self, film_s: f64) -> bool;
    /// The picture's contents, if it was.
    fn snapshot(&mut self, snapshot: Snapshot<'_>);
}

/// What was measured since the last report.
pub(super) struct RecentFigures {
    since: Instant,
    steps_ms: Percentiles,
    hull_age_ms: Percentiles,
    bytes: u64,
    passes: u64,
}

impl Default for RecentFigures {
    fn default() -> RecentFigures {
        RecentFigures::since(0, 0)
    }
}

impl RecentFigures {
    /// Nothing yet, since so many bytes and passes.
    pub fn since(bytes: u64, passes: u64) -> RecentFigures {
        let (steps_ms, hull_age_ms) = Default::default();
        RecentFigures { since: Instant::now(), steps_ms, hull_age_ms, bytes, passes }
    }

    /// A step was made.
    pub fn note(&mut self, step: &MadeStep) {
        self.steps_ms.add(step.step_ms);
        step.hull_age_ms.into_iter().for_each(|age_ms| self.hull_age_ms.add(age_ms));
    }
}

impl Coordinator {
    /// Reports how the run goes, four times a second.
    pub(super) fn report(&mut self, watcher: &mut dyn Watcher) {
        let elapsed = self.publisher.recent.since.elapsed();
        if elapsed < REPORT_EVERY {
            return;
        }
        let bytes = self.transport.bytes();
        let bytes = bytes.to_nodes + bytes.from_nodes;
        let passes = self.run.figures.counts.passes.asked;
        let progress = Progress {
            film_s: self.publisher.view.film_s,
            frame: self.run.film.frame,
            steps_per_s: self.publisher.recent.steps_ms.count() as f64 / elapsed.as_secs_f64(),
            passes_per_s: (passes - self.publisher.recent.passes) as f64 / elapsed.as_secs_f64(),
            p50_ms: self.publisher.recent.steps_ms.p50().unwrap_or(0.0),
            p99_ms: self.publisher.recent.steps_ms.p99().unwrap_or(0.0),
            samples: self.run.figures.samples,
            contacts: self.publisher.view.touching,
            hull_age_ms: self.publisher.recent.hull_age_ms.p50(),
            latency_ms: self.run.clock.latency.now_s() * 1e3,
            bytes_per_s: (bytes - self.publisher.recent.bytes) as f64 / elapsed.as_secs_f64(),
            hull_unavailable: self
                .run
                .film
                .unavailable
                .as_ref()
                .filter(|why| why.is_fault())
                .map(ToString::to_string),
        };
        watcher.progress(&progress);
        self.publish_status(progress);
        // A viewer may have begun to watch a world that does not move.
        self.publish_world();
        self.publisher.recent = RecentFigures::since(bytes, passes);
    }

    pub(super) async fn picture(
        &mut self,
        watcher: &mut dyn Watcher,
        film_s: f64,
        collisions: Option<&[BodyCollision]>,
    ) {
        let Some(frame) = self.run.film.frame else { return };
        if !watcher.wants_snapshot(film_s) {
            return;
        }
        match self.transport.silhouettes(frame).await {
            Ok(silhouettes) => {
                let inside_world = inside_points(&self.run.world, collisions.unwrap_or_default());
                watcher.snapshot(Snapshot {
                    film_s,
                    frame,
                    silhouettes,
                    world: &self.run.world,
                    inside_world,
                });
            }
            Err(why) => tracing::warn!("no picture at {film_s:.2} s: {why}"),
        }
    }
}

/// The samples that were inside, where their bodies now are.
fn inside_points(world: &World, collisions: &[BodyCollision]) -> Vec<[f64; 3]> {
    let bodies = world.moving_bodies().zip(collisions);
    bodies
        .flat_map(|(body, collision)| {
            let world_from_body = body.pose.world_from_body();
            let samples = body.shape.samples_body();
            collision.inside().map(move |(sample, _)| world_from_body(samples[sample as usize]).into())
        })
        .collect()
}
