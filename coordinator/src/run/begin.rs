//! The start of a run: waits for the nodes, takes up the world that they remember, starts their film.

use std::time::Duration;

use film_time::{Pace, unix_now_s};
use tokio::time::Instant;

use super::watch::REPORT_EVERY;
use super::{Coordinator, MemoryUse, RunError, Watcher};
use crate::memory::{Home, Place, newest_world};
use crate::transport::TransportError;

/// A run that resumes a remembered world waits so long for all its nodes.
const RESUME_PATIENCE: Duration = Duration::from_secs(2);
/// If that world is not older, seconds: nodes that are away may remember a newer one.
const RECENT_S: f64 = 300.0;
/// From the start of a live run to its first frame, seconds: nodes open their cameras meanwhile.
const LEAD_S: f64 = 0.3;

impl Coordinator {
    /// Waits for the nodes, takes up what they remember, and has them film.
    pub(super) async fn begin(&mut self, watcher: &mut dyn Watcher) -> Result<(), RunError> {
        self.await_nodes().await?;
        self.begin_memory(watcher).await;
        let run = getrandom::u64().map_err(RunError::NoRandom)?;
        let lock_step = self.run.settings.lock_step;
        self.run.clock.pace = if lock_step { Pace::lock_step(run) } else { Pace::live(run, LEAD_S) };
        let least_cameras = (!lock_step).then(|| self.run.least_cameras());
        self.transport.start(self.run.clock.pace, least_cameras).await?;
        self.regroup();
        Ok(())
    }

    /// Waits until all nodes are connected. If enough cameras are, a live run whose world the nodes keep starts without the
    /// others after the connect timeout, and after [`RESUME_PATIENCE`] if the nodes remember a world to resume: a coordinator
    /// can be restarted while a node is broken.
    async fn await_nodes(&mut self) -> Result<(), RunError> {
        let began = Instant::now();
        let deadline = began + self.run.settings.connect_timeout;
        let mut look_at = began + RESUME_PATIENCE;
        loop {
            let left = deadline - Instant::now();
            let missing = match self.transport.ready(left.min(REPORT_EVERY)).await {
                Err(TransportError::Missing(missing)) => missing,
                ready => return Ok(ready?),
            };
            let is_last = left <= REPORT_EVERY;
            let is_enough = self.may_begin_without_missing();
            let looks = is_enough && Instant::now() >= look_at;
            if looks {
                look_at = Instant::now() + RESUME_PATIENCE;
            }
            if is_enough && is_last || looks && self.is_remembered().await {
                missing.iter().for_each(|missing| tracing::warn!("it begins without {missing}"));
                return Ok(());
            }
            if is_last {
                return Err(TransportError::Missing(missing).into());
            }
            self.publish_waiting();
        }
    }

    fn may_begin_without_missing(&self) -> bool {
        self.remembering.memory_use != MemoryUse::Off
            && !self.run.settings.lock_step
            && self.transport.roster().may_begin_without_missing(self.run.least_cameras())
    }

    /// Whether the connected nodes remember a recent world that this run resumes.
    async fn is_remembered(&self) -> bool {
        if self.remembering.memory_use != MemoryUse::GoOn {
            return false;
        }
        let scene = self.run.world.scene();
        let home = Home::new(Place::of(self.run.observers(), scene), scene);
        let newest = newest_world(home, self.transport.clients().to_vec()).await;
        newest.is_some_and(|found| (unix_now_s() - found.kept.unix_s).abs() < RECENT_S)
    }
}
