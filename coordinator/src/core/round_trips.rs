//! The usual round trip to each node, and how long a node may take before it is late.
//!
//! Plain decisions, made after a round.

use std::time::Duration;

use crate::roster::Roster;

/// A node that takes three usual round trips, and a frame or this longer, is late.
const LEAST_SLACK_MS: f64 = 20.0;
/// The longest that a node may take, and what it may take until round trips are known.
const LONGEST: Duration = Duration::from_millis(500);
/// The longest round trip is remembered as so much less after every other one.
const FORGET: f64 = 0.995;
/// Round trips are not known before so many rounds.
const KNOWN_ROUNDS: usize = 5;

/// What a round trip to each node usually takes.
#[derive(Clone, Debug)]
pub(crate) struct RoundTrips {
    /// By node: the longest of late, milliseconds.
    longest_ms: Vec<f64>,
    slack_ms: f64,
    rounds: usize,
}

impl RoundTrips {
    /// Of so many nodes, which film so many frames a second.
    pub fn new(nodes: usize, fps: f64) -> RoundTrips {
        RoundTrips { longest_ms: vec![0.0; nodes], slack_ms: LEAST_SLACK_MS.max(1e3 / fps), rounds: 0 }
    }

    /// Notes a round: nodes that were asked together, and the milliseconds that each took, or had at its disposal and did not
    /// answer in.
    pub fn record(&mut self, nodes_ms: &[(usize, f64)]) {
        self.longest_ms.iter_mut().for_each(|ms| *ms *= FORGET);
        for &(node, ms) in nodes_ms {
            self.longest_ms[node] = ms.max(self.longest_ms[node]);
        }
        self.rounds += 1;
    }

    /// How long a node may take before it is late. The slowest node does not count where the run has enough cameras without
    /// it: otherwise a single node would decide how long all are waited for.
    pub fn timeout(&self, roster: &Roster, now_s: f64) -> Duration {
        if self.rounds < KNOWN_ROUNDS {
            return LONGEST;
        }
        let nodes = self.longest_ms.iter().zip(roster.nodes()).enumerate();
        let present = nodes.filter(|(_, (_, node))| !node.is_left_out());
        let (mut slowest, mut second_ms) = ((None, 0.0_f64), 0.0_f64);
        for (node, (&ms, _)) in present {
            if ms >= slowest.1 {
                (slowest, second_ms) = ((Some(node), ms), slowest.1);
            } else {
                second_ms = second_ms.max(ms);
            }
        }
        let can_spare = slowest.0.is_some_and(|node| roster.has_enough_cameras_without(node, now_s));
        let usual_ms = if can_spare { second_ms } else { slowest.1 };
        Duration::from_secs_f64((3.0 * usual_ms + self.slack_ms) * 1e-3).min(LONGEST)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::roster::{LeaveOut, RosterNode};

    const FPS: f64 = 30.0;

    /// Nodes of two cameras, all there, of a run that needs so many cameras.
    fn roster(nodes: u16, least_cameras: usize) -> Roster {
        let node = |node: u16| RosterNode::new(node.to_string(), vec![2 * node, 2 * node + 1]);
        let mut roster = Roster::new((0..nodes).map(node).collect());
        (0..usize::from(nodes)).for_each(|node| roster.up(node));
        roster.leave_out(0, LeaveOut::Late, least_cameras, 0.0);
        roster
    }

    fn timeout_ms(trips: &RoundTrips, roster: &Roster) -> f64 {
        (trips.timeout(roster, 0.0).as_secs_f64() * 1e4).round() / 10.0
    }

    #[test]
    fn a_node_is_late_after_three_usual_round_trips_and_a_frame() {
        let roster = roster(3, 6);
        let mut trips = RoundTrips::new(3, FPS);
        assert_eq!(trips.timeout(&roster, 0.0), LONGEST);
        (0..KNOWN_ROUNDS).for_each(|_| trips.record(&[(0, 2.0), (1, 1.0)]));
        assert_eq!(timeout_ms(&trips, &roster), 39.3);
        trips.record(&[(0, 1000.0), (1, 1.0)]);
        assert_eq!(trips.timeout(&roster, 0.0), LONGEST);
        (0..2000).for_each(|_| trips.record(&[(0, 2.0)]));
        assert_eq!(timeout_ms(&trips, &roster), 39.3);
    }

    #[test]
    fn one_node_that_is_always_late_is_not_waited_for_where_the_run_has_enough_cameras_without_it() {
        let mut trips = RoundTrips::new(3, FPS);
        for _ in 0..10 {
            trips.record(&[(0, 2.0), (1, 200.0), (2, 1.0)]);
            // No other node was asked.
            trips.record(&[(1, 300.0)]);
        }
        assert_eq!(timeout_ms(&trips, &roster(3, 4)), 39.3);
        assert_eq!(trips.timeout(&roster(3, 5), 0.0), LONGEST, "all cameras are needed");
    }

    #[test]
    fn a_late_node_that_was_needed_for_a_while_is_no_longer_waited_for_at_once() {
        let mut roster = roster(3, 4);
        let mut trips = RoundTrips::new(3, FPS);
        roster.down(0, "its cable is out".into());
        roster.leave_out(0, LeaveOut::Late, 4, 0.0);
        (0..10).for_each(|_| trips.record(&[(1, 200.0), (2, 1.0)]));
        assert_eq!(trips.timeout(&roster, 0.0), LONGEST);
        roster.up(0);
        roster.leave_out(0, LeaveOut::Late, 4, 0.0);
        assert_eq!(timeout_ms(&trips, &roster), 36.3);
    }

    #[test]
    fn a_node_without_film_makes_no_other_one_dispensable() {
        let mut roster = roster(3, 3);
        let mut film = |node| roster.film_event(node, crate::roster::tests::frame(0), 1.0);
        film(0);
        film(1);
        roster.leave_out(0, LeaveOut::Late, 3, 0.0);
        let mut trips = RoundTrips::new(3, FPS);
        (0..10).for_each(|_| trips.record(&[(0, 1.0), (1, 30.0)]));
        assert_eq!(timeout_ms(&trips, &roster), 123.3);
        roster.record_late(&[1], 0.0, "no answer within 39 ms");
        assert_eq!(timeout_ms(&trips, &roster), 123.3, "also while it is late");
    }

    #[test]
    fn links_that_all_become_slower_are_waited_for() {
        for nodes in [3, 64] {
            let roster = roster(nodes, 3);
            let all_ms = |ms: f64| (0..usize::from(nodes)).map(|node| (node, ms)).collect::<Vec<_>>();
            let mut trips = RoundTrips::new(usize::from(nodes), FPS);
            (0..10).for_each(|_| trips.record(&all_ms(1.0)));
            let late = (0..10).find(|_| {
                let at_most_ms = timeout_ms(&trips, &roster);
                trips.record(&all_ms(at_most_ms.min(120.0)));
                at_most_ms >= 120.0
            });
            assert_eq!(late, Some(1), "{nodes} nodes");
        }
    }

    #[test]
    fn two_far_nodes_are_waited_for_also_if_they_become_far() {
        let roster = roster(3, 2);
        let mut trips = RoundTrips::new(3, FPS);
        (0..10).for_each(|_| trips.record(&[(0, 2.0), (1, 1.0), (2, 1.0)]));
        let timeout = timeout_ms(&trips, &roster);
        trips.record(&[(0, 2.0), (1, timeout), (2, timeout)]);
        assert!(timeout_ms(&trips, &roster) > 100.0);
    }
}
