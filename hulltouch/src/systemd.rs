//! What systemd hears of this process: that it serves, how it is, that it works, that it ends. Says nothing where there is
//! no NOTIFY_SOCKET.

use std::time::Duration;

use camera_node::pulse::Pulse;
use sd_notify::NotifyState;
use tokio::time::{MissedTickBehavior, interval};

/// It serves from now on.
pub fn ready(status: &str) {
    tell(&[NotifyState::Ready, NotifyState::Status(&one_line(status))]);
}

/// How it is, in a short line.
pub fn status(status: &str) {
    tell(&[NotifyState::Status(&one_line(status))]);
}

/// It was asked to end, and does.
pub fn stopping() {
    tell(&[NotifyState::Stopping]);
}

/// Does the work of this process, and feeds the watchdog at half its time while all of it gets on. Both on one thread: if
/// that is blocked, the watchdog hears nothing either.
pub async fn watched<T>(pulse: &Pulse, work: impl Future<Output = T>) -> T {
    match sd_notify::watchdog_enabled() {
        Some(period) => fed(pulse, period / 2, || tell(&[NotifyState::Watchdog]), work).await,
        None => work.await,
    }
}

/// Calls `feed` this often until the work is done, but not while something has been stuck for as long.
async fn fed<T>(pulse: &Pulse, every: Duration, feed: impl Fn(), work: impl Future<Output = T>) -> T {
    tokio::pin!(work);
    // An interval of no time is none.
    let mut ticks = interval(every.max(Duration::from_millis(1)));
    ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
    let mut is_stuck = false;
    loop {
        tokio::select! {
            done = &mut work => return done,
            _ = ticks.tick() => {}
        }
        let stuck = pulse.stuck(every);
        match &stuck {
            None => feed(),
            Some(stuck) if !is_stuck => tracing::error!("{stuck}: systemd's watchdog is not fed"),
            Some(_) => {}
        }
        is_stuck = stuck.is_some();
    }
}

fn tell(states: &[NotifyState<'_>]) {
    if let Err(error) = sd_notify::notify(states) {
        tracing::debug!("systemd cannot be told: {error}");
    }
}

/// What is sent ends at a line's end.
fn one_line(text: &str) -> String {
    text.replace(['\n', '\r'], " ")
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;

    use super::*;

    /// How often it is fed in four of its times, when work was begun two of them ago or not at all.
    async fn feeds(begun: bool) -> usize {
        let (pulse, every) = (Pulse::default(), Duration::from_millis(40));
        let beat = pulse.beat("the work");
        if begun {
            beat.works();
            std::thread::sleep(every * 2);
        }
        let count = Cell::new(0);
        fed(&pulse, every, || count.set(count.get() + 1), tokio::time::sleep(every * 4)).await;
        count.get()
    }

    #[tokio::test]
    async fn work_that_waits_feeds_the_watchdog_and_work_that_is_stuck_does_not() {
        assert!(feeds(false).await > 1);
        assert_eq!(feeds(true).await, 0);
    }
}
