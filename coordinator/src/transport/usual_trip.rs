//! What a trip to the nodes usually takes, and how long a node may take before it is silent.
//!
//! Plain decisions, made after a trip.

use std::time::Duration;

use crate::roster::Roster;

/// A node that takes three usual trips and so much longer is silent.
const SILENT_MS: f64 = 20.0;
/// The longest that a node may take, and what it may take until the usual trip is known.
const LONGEST: Duration = Duration::from_millis(500);
/// The longest trip is remembered as so much less after every other trip.
const FORGET: f64 = 0.995;
/// What is usual is not known before so many trips.
const KNOWN_TRIPS: usize = 5;

/// What a trip to the nodes usually takes.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct UsualTrip {
    longest_ms: f64,
    trips: usize,
}

impl UsualTrip {
    /// Notes a trip: the nodes that were asked together, and the milliseconds that each took. The slowest does not count if
    /// the run can go on without it: a node that is always late would make that usual, and be waited for.
    pub fn took(&mut self, nodes_ms: &[(usize, f64)], roster: &Roster, now_s: f64) {
        let Some(&(slowest, _)) = nodes_ms.iter().max_by(|(_, a), (_, b)| a.total_cmp(b)) else { return };
        let can_spare = roster.can_spare(slowest, now_s);
        let counts = nodes_ms.iter().filter(|(node, _)| !can_spare || *node != slowest);
        let Some(ms) = counts.map(|(_, ms)| *ms).max_by(f64::total_cmp) else { return };
        self.longest_ms = ms.max(FORGET * self.longest_ms);
        self.trips += 1;
    }

    /// A node did not answer within a time. Where the run cannot go on without it, it is given longer.
    pub fn timed_out(&mut self, node: usize, after: Duration, roster: &Roster, now_s: f64) {
        self.took(&[(node, after.as_secs_f64() * 1e3)], roster, now_s);
    }

    /// How long a node may take before it is silent.
    pub fn timeout(&self) -> Duration {
        if self.trips < KNOWN_TRIPS {
            return LONGEST;
        }
        Duration::from_secs_f64((3.0 * self.longest_ms + SILENT_MS) * 1e-3).min(LONGEST)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::roster::{LeaveOut, RosterNode};

    /// Three nodes of two cameras, all there, where a run needs so many cameras.
    fn roster(least_cameras: usize) -> Roster {
        let nodes = (0..3).map(|node| RosterNode::new(node.to_string(), vec![2 * node, 2 * node + 1]));
        let mut roster = Roster::new(nodes.collect());
        (0..3).for_each(|node| roster.up(node));
        roster.leave_out(0, LeaveOut::Late, least_cameras, 0.0);
        roster
    }

    #[test]
    fn a_node_is_silent_after_three_usual_trips_and_a_little() {
        let roster = roster(6);
        let mut usual = UsualTrip::default();
        assert_eq!(usual.timeout(), LONGEST);
        (0..KNOWN_TRIPS).for_each(|_| usual.took(&[(0, 2.0), (1, 1.0)], &roster, 0.0));
        assert_eq!(usual.timeout(), Duration::from_millis(26));
        usual.took(&[(0, 1000.0), (1, 1.0)], &roster, 0.0);
        assert_eq!(usual.timeout(), LONGEST);
        (0..2000).for_each(|_| usual.took(&[(0, 2.0)], &roster, 0.0));
        assert!(usual.timeout() < Duration::from_millis(27));
    }

    #[test]
    fn one_node_that_is_always_late_is_not_waited_for_where_the_run_can_go_on_without_it() {
        let timeout = |least_cameras| {
            let roster = roster(least_cameras);
            let mut usual = UsualTrip::default();
            for _ in 0..10 {
                usual.took(&[(0, 2.0), (1, 200.0), (2, 1.0)], &roster, 0.0);
                // No other node was asked.
                usual.took(&[(1, 300.0)], &roster, 0.0);
            }
            usual.timeout()
        };
        assert_eq!(timeout(4), Duration::from_millis(26));
        assert_eq!(timeout(5), LONGEST, "all cameras are needed");
    }

    #[test]
    fn what_takes_longer_than_ever_is_waited_for_where_the_run_needs_it() {
        let roster = roster(6);
        let mut usual = UsualTrip::default();
        (0..10).for_each(|_| usual.took(&[(0, 2.0), (1, 1.0)], &roster, 0.0));
        let timeouts = [26, 98, 314, 500].map(Duration::from_millis);
        for expected in timeouts {
            assert_eq!(usual.timeout(), expected);
            usual.timed_out(1, expected, &roster, 0.0);
        }
    }

    #[test]
    fn two_far_nodes_are_waited_for() {
        let roster = roster(2);
        let mut usual = UsualTrip::default();
        (0..10).for_each(|_| usual.took(&[(0, 2.0), (1, 40.0), (2, 42.0)], &roster, 0.0));
        assert_eq!(usual.timeout(), Duration::from_millis(140));
    }
}
