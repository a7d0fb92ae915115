//! Two ways to ask the nodes of a round: all at once, or in two phases, where the second knows what the first
//! answered. Then there is less to search and to send, for another round trip. Decided by what both took so
//! far; the answers are the same.

use proto::convert::Precision;

/// How much a new measurement counts against those before it.
const NEW_SHARE: f64 = 0.1;
/// Of so many measurements of a way the median counts: the first passes of a run, and those that something
/// else disturbed, say little.
const KEPT: usize = 7;
/// Passes that try a way before it is judged.
const TRIAL_PASSES: u64 = 8;
/// The way that is not taken is tried again after so many passes: links and scenes change.
const TRY_AGAIN_PASSES: u64 = 240;
/// Passes of such a trial; the first finds cold lists and is not counted.
const AGAIN_PASSES: u64 = 5;
/// For classes two phases must be this much faster: it may send more. Where both are about as fast, as
/// on one machine, chance must not decide how many bytes a run sends.
const CLASSES_ADVANTAGE: f64 = 0.8;
/// For edges and exits it may be so much slower: it sends and computes much less.
const DISTANCES_ADVANTAGE: f64 = 1.3;

/// A mean that forgets.
#[derive(Clone, Copy, Debug, Default)]
struct Recent(Option<f64>);

impl Recent {
    fn add(&mut self, value: f64) {
        let mean = self.0.unwrap_or(value);
        self.0 = Some(mean + NEW_SHARE * (value - mean));
    }
}

/// The last measurements of a way.
#[derive(Clone, Copy, Debug, Default)]
struct Measured {
    ms: [f64; KEPT],
    count: usize,
}

impl Measured {
    fn add(&mut self, ms: f64) {
        self.ms[self.count % KEPT] = ms;
        self.count += 1;
    }

    fn median(&self) -> Option<f64> {
        let mut ms = self.ms;
        let ms = &mut ms[..self.count.min(KEPT)];
        ms.sort_by(f64::total_cmp);
        ms.get(ms.len() / 2).copied()
    }
}

/// What is known of one node's answers.
#[derive(Clone, Copy, Debug, Default)]
struct NodeRate {
    /// From question to answer without the computation, milliseconds.
    trip_ms: Recent,
    /// Computation of a thousand points' classes, milliseconds.
    compute_ms: Recent,
    /// The share of the points that it was asked about and rejected.
    rejects: Recent,
}

/// A way to ask for classes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phases {
    One,
    Two,
}

/// Measures both ways and chooses.
#[derive(Debug)]
pub(crate) struct AskPolicy {
    nodes: Vec<NodeRate>,
    one_phase_ms: Measured,
    two_phases_ms: Measured,
    advantage: f64,
    passes: u64,
}

impl AskPolicy {
    /// How to ask so many nodes for classes. Nothing is known of them yet.
    pub fn of_classes(node_count: usize, precision: Precision) -> AskPolicy {
        let advantage = match precision {
            Precision::Exact => CLASSES_ADVANTAGE,
            // Naming the points that are left takes more bytes than their answers spare.
            Precision::Quantised => 0.0,
        };
        AskPolicy::new(node_count, advantage)
    }

    /// How to ask so many nodes for edges and exits.
    pub fn of_distances(node_count: usize, precision: Precision) -> AskPolicy {
        let advantage = match precision {
            Precision::Exact => DISTANCES_ADVANTAGE,
            // Rounded numbers are chosen for fewer bytes.
            Precision::Quantised => f64::INFINITY,
        };
        AskPolicy::new(node_count, advantage)
    }

    fn new(node_count: usize, advantage: f64) -> AskPolicy {
        AskPolicy {
            advantage,
            nodes: vec![NodeRate::default(); node_count],
            one_phase_ms: Measured::default(),
            two_phases_ms: Measured::default(),
            passes: 0,
        }
    }

    /// A node answered about the classes of `points` points after `took_ms`, `compute_ms` of it computing, and
    /// rejected `rejected` of them.
    pub fn answered(&mut self, node: usize, points: usize, rejected: usize, took_ms: f64, compute_ms: f64) {
        if points == 0 {
            return;
        }
        let rate = &mut self.nodes[node];
        rate.trip_ms.add((took_ms - compute_ms).max(0.0));
        rate.compute_ms.add(compute_ms * 1e3 / points as f64);
        rate.rejects.add(rejected as f64 / points as f64);
    }

    /// The rounds of a pass over `points` points took so long, asked in two phases or at once.
    pub fn took(&mut self, in_two_phases: bool, points: usize, ms: f64) {
        self.passes += 1;
        if points == 0 || self.is_warming_up() {
            return;
        }
        let a_thousand_ms = ms * 1e3 / points as f64;
        if in_two_phases {
            self.two_phases_ms.add(a_thousand_ms);
        } else {
            self.one_phase_ms.add(a_thousand_ms);
        }
    }

    /// True if some nodes are to be asked first in the next pass.
    pub fn asks_in_two_phases(&self) -> bool {
        // With fewer, one of the two groups is a single node that the other could not spare much.
        self.nodes.len() >= 3 && self.way() == Phases::Two
    }

    /// The nodes to ask first in the next pass, those that reject most for their time; none: all at once.
    pub fn first(&self) -> Vec<usize> {
        if !self.asks_in_two_phases() {
            return Vec::new();
        }
        let gain = |node: &NodeRate| {
            let ms = node.trip_ms.0.unwrap_or(0.0) + node.compute_ms.0.unwrap_or(0.0);
            node.rejects.0.unwrap_or(0.0) / ms.max(1e-3)
        };
        let mut order: Vec<usize> = (0..self.nodes.len()).collect();
        order.sort_by(|&a, &b| gain(&self.nodes[b]).total_cmp(&gain(&self.nodes[a])).then(a.cmp(&b)));
        order.truncate(self.nodes.len().div_ceil(4));
        order.sort_unstable();
        order
    }

    fn way(&self) -> Phases {
        match self.passes {
            _ if self.advantage == f64::INFINITY => return Phases::Two,
            _ if self.advantage == 0.0 => return Phases::One,
            0..TRIAL_PASSES => return Phases::One,
            passes if passes < 2 * TRIAL_PASSES => return Phases::Two,
            _ => {}
        }
        let better = self.better();
        let other = if better == Phases::One { Phases::Two } else { Phases::One };
        if self.since_trial() < AGAIN_PASSES { other } else { better }
    }

    fn better(&self) -> Phases {
        match (self.one_phase_ms.median(), self.two_phases_ms.median()) {
            (Some(at_once), Some(selective)) if selective < self.advantage * at_once => Phases::Two,
            _ => Phases::One,
        }
    }

    fn since_trial(&self) -> u64 {
        match self.passes {
            0..TRIAL_PASSES => self.passes,
            passes if passes < 2 * TRIAL_PASSES => passes - TRIAL_PASSES,
            passes => (passes - 2 * TRIAL_PASSES + AGAIN_PASSES) % TRY_AGAIN_PASSES,
        }
    }

    /// The pass just noted was the first of a trial: connections and lists were new to it.
    fn is_warming_up(&self) -> bool {
        self.since_trial() == 1
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// So many passes where both ways take so long; returns the share of the last hundred that were selective.
    fn run(policy: &mut AskPolicy, passes: u64, one_phase_ms: f64, two_phases_ms: f64) -> f64 {
        let mut selective = 0;
        for pass in 0..passes {
            let in_two_phases = !policy.first().is_empty();
            selective += u64::from(in_two_phases && pass + 100 >= passes);
            policy.took(in_two_phases, 1000, if in_two_phases { two_phases_ms } else { one_phase_ms });
        }
        selective as f64 / 100.0
    }

    #[test]
    fn the_faster_way_is_taken_and_the_other_tried_again() {
        assert!(run(&mut AskPolicy::of_classes(8, Precision::Exact), 400, 2.0, 1.0) > 0.9);
        assert!(run(&mut AskPolicy::of_classes(8, Precision::Exact), 400, 1.0, 2.0) < 0.1);
        let mut policy = AskPolicy::of_classes(8, Precision::Exact);
        run(&mut policy, 300, 1.0, 2.0);
        // Only the occasional trial notices a change: it takes a while.
        assert!(run(&mut policy, 20 * TRY_AGAIN_PASSES, 3.0, 1.0) > 0.9, "links change");
    }

    #[test]
    fn those_that_reject_most_for_their_time_are_asked_first() {
        let mut policy = AskPolicy::of_classes(8, Precision::Exact);
        for node in 0..8 {
            let slow_ms = if node == 5 { 20.0 } else { 0.1 };
            let rejected = if node == 5 || node == 2 || node == 6 { 900 } else { 500 };
            policy.answered(node, 1000, rejected, slow_ms + 0.2, 0.2);
        }
        run(&mut policy, 60, 2.0, 1.0);
        assert_eq!(policy.first(), [2, 6]);
    }

    #[test]
    fn a_little_time_is_given_for_fewer_bytes() {
        let rounded = &mut AskPolicy::of_classes(8, Precision::Quantised);
        assert_eq!(run(rounded, 400, 2.0, 1.0), 0.0, "for classes two phases sends more");
        let policy = |precision| AskPolicy::of_distances(8, precision);
        assert!(run(&mut policy(Precision::Exact), 400, 1.0, 1.2) > 0.9);
        assert!(run(&mut policy(Precision::Exact), 400, 1.0, 1.4) < 0.1);
        assert_eq!(run(&mut policy(Precision::Quantised), 400, 1.0, 1.2), 1.0);
    }

    #[test]
    fn a_cold_start_is_forgotten() {
        let mut policy = AskPolicy::of_classes(8, Precision::Exact);
        run(&mut policy, 3, 50.0, 50.0);
        assert!(run(&mut policy, 200, 1.0, 2.0) < 0.1);
    }

    #[test]
    fn two_nodes_are_always_asked_at_once() {
        assert_eq!(run(&mut AskPolicy::of_classes(2, Precision::Exact), 300, 2.0, 1.0), 0.0);
    }
}
