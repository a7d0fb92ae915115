//! The world at a steady rate.

use std::sync::Arc;
use std::time::Duration;

use coordinator::live::{Follower, Watching, WorldState};
use thiserror::Error;
use tokio::sync::watch;
use tokio::time::{Interval, MissedTickBehavior};

/// Rates that can be asked for, a second: none is above the steps'.
const RATE_HZ: std::ops::RangeInclusive<f64> = 1.0..=120.0;
/// The rate of a program that asks for none.
pub(crate) const DEFAULT_RATE_HZ: f64 = 30.0;

/// A rate that no program can have.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
#[error("a rate of {0} Hz, expected {low} to {high}", low = RATE_HZ.start(), high = RATE_HZ.end())]
pub(crate) struct RateError(f64);

/// The newest state of the world, tick by tick. Ticks that come too late are left out.
pub(crate) struct Ticks {
    interval: Interval,
    world: watch::Receiver<Option<Arc<WorldState>>>,
    _watching: Watching,
}

impl Ticks {
    /// Begins to watch. Must run within a runtime.
    pub fn new(follower: &Follower, rate_hz: f64) -> Result<Ticks, RateError> {
        if !RATE_HZ.contains(&rate_hz) {
            return Err(RateError(rate_hz));
        }
        let mut interval = tokio::time::interval(Duration::from_secs_f64(1.0 / rate_hz));
        interval.set_missed_tick_behavior(MissedTickBehavior::Skip);
        Ok(Ticks { interval, world: follower.world.clone(), _watching: follower.watch() })
    }

    /// The world at the next tick; `None` once the run has ended.
    pub async fn next(&mut self) -> Option<Arc<WorldState>> {
        loop {
            self.interval.tick().await;
            // An error says that the run has ended.
            self.world.has_changed().ok()?;
            let newest = self.world.borrow_and_update().clone();
            if newest.is_some() {
                return newest;
            }
        }
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use coordinator::live::{BodyState, live};

    /// A world of one body that touches, after so many steps.
    pub(crate) fn world(step: u64) -> Arc<WorldState> {
        let body = BodyState {
            id: 7,
            pose: hull::Pose::new([1.0, 2.0, 3.0], [0.0, 0.0, 0.0, 1.0]).expect("a pose"),
            velocity_m_s: [0.0, -1.0, 0.0],
            spin_rad_s: [0.5, 0.0, 0.0],
            inside_samples: 3,
            response_m: Some([0.25, 0.0, 0.0]),
            grabbed: false,
            asleep: false,
        };
        Arc::new(WorldState {
            generation: 2,
            step,
            film_s: step as f64 / 120.0,
            frame: Some(step / 4),
            paused: false,
            bodies: vec![body],
            touches: vec![],
            patches: vec![],
        })
    }

    #[tokio::test(start_paused = true)]
    async fn a_follower_gets_the_newest_world_at_its_rate_and_an_end() {
        let (live, follower) = live();
        assert!(Ticks::new(&follower, 121.0).is_err() && Ticks::new(&follower, f64::NAN).is_err());
        assert!(!live.is_watched());
        let mut ticks = Ticks::new(&follower, 10.0).expect("a rate");
        assert!(live.is_watched());
        live.world.send_replace(Some(world(1)));
        let began = tokio::time::Instant::now();
        assert_eq!(ticks.next().await.expect("runs").step, 1);
        for step in 2..40 {
            live.world.send_replace(Some(world(step)));
        }
        assert_eq!(ticks.next().await.expect("runs").step, 39, "older worlds are left out");
        assert_eq!(ticks.next().await.expect("runs").step, 39, "a world that stands is sent again");
        assert_eq!(began.elapsed(), Duration::from_millis(200));
        drop(live);
        assert!(ticks.next().await.is_none());
    }
}
