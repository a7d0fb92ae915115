//! Where probes are computed: at the nodes, or here of silhouettes that are fetched. Asking takes a trip a question,
//! fetching one a frame; what is faster is measured as the run goes. The answers are the same.
//!
//! Plain decisions, made between two frames.

use std::collections::VecDeque;

/// Passes that decide.
const KEPT: usize = 30;
/// The way is changed where the other's passes take at most this share,
const ADVANTAGE: f64 = 0.7;
/// and nodes are left for silhouettes only where passes take more of a frame than this: otherwise nothing is gained.
const HARMLESS: f64 = 0.25;
/// Of so many passes one may take longer than what counts.
const USUAL: f64 = 0.9;
/// Questions of a pass, before passes are measured.
const USUAL_TRIPS: f64 = 5.0;

/// Where probes are computed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Way {
    /// At the nodes.
    Asks,
    /// In this process, of silhouettes that nodes send.
    Gathers,
}

/// What a pass took the way it was made, and would have taken the other, milliseconds.
#[derive(Clone, Copy, Debug)]
struct Took {
    asks_ms: f64,
    gathers_ms: f64,
}

/// A way, and what speaks for the other.
#[derive(Debug)]
pub(crate) struct Choice {
    way: Way,
    /// A frame's time, milliseconds, where the way may be changed.
    frame_ms: Option<f64>,
    took: VecDeque<Took>,
}

impl Choice {
    /// A way that stays.
    pub fn fixed(way: Way) -> Choice {
        Choice { way, frame_ms: None, took: VecDeque::new() }
    }

    /// Nodes are asked until it is seen that gathering is faster.
    pub fn free(fps: f64) -> Choice {
        Choice { frame_ms: Some(1e3 / fps), ..Choice::fixed(Way::Asks) }
    }

    pub fn way(&self) -> Way {
        self.way
    }

    /// Whether it may change.
    pub fn is_free(&self) -> bool {
        self.frame_ms.is_some()
    }

    /// Before the first pass: a short question takes so long.
    pub fn begin(&mut self, trip_ms: f64) {
        if self.frame_ms.is_some_and(|frame_ms| USUAL_TRIPS * trip_ms > HARMLESS * frame_ms) {
            self.way = Way::Gathers;
        }
    }

    /// Notes a pass.
    pub fn took(&mut self, asks_ms: f64, gathers_ms: f64) {
        self.took.push_back(Took { asks_ms, gathers_ms });
        if self.took.len() > KEPT {
            self.took.pop_front();
        }
    }

    /// Takes the other way if that is better; whether it did.
    pub fn change(&mut self) -> bool {
        let Some(frame_ms) = self.frame_ms.filter(|_| self.took.len() == KEPT) else { return false };
        let usual_ms = |ms: fn(&Took) -> f64| {
            let mut sorted: Vec<f64> = self.took.iter().map(ms).collect();
            sorted.sort_by(f64::total_cmp);
            sorted[(USUAL * KEPT as f64) as usize]
        };
        let (asks_ms, gathers_ms) = (usual_ms(|took| took.asks_ms), usual_ms(|took| took.gathers_ms));
        let better = match self.way {
            Way::Asks if asks_ms > HARMLESS * frame_ms && gathers_ms < ADVANTAGE * asks_ms => Way::Gathers,
            Way::Gathers if asks_ms < ADVANTAGE * gathers_ms.max(HARMLESS * frame_ms) => Way::Asks,
            _ => return false,
        };
        self.way = better;
        self.took.clear();
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn took(choice: &mut Choice, passes: usize, asks_ms: f64, gathers_ms: f64) -> bool {
        (0..passes).any(|_| {
            choice.took(asks_ms, gathers_ms);
            choice.change()
        })
    }

    #[test]
    fn silhouettes_are_gathered_where_asking_takes_long_and_nodes_are_asked_again_where_it_does_not() {
        let mut choice = Choice::free(30.0);
        assert!(!took(&mut choice, 200, 30.0, 25.0), "not much better");
        assert!(!took(&mut choice, 200, 8.0, 1.0), "fast enough");
        assert!(took(&mut choice, 200, 30.0, 12.0));
        assert_eq!(choice.way(), Way::Gathers);
        assert!(!took(&mut choice, 200, 10.0, 12.0), "not much better");
        assert!(!took(&mut choice, 20, 5.0, 2.0), "too few");
        assert!(took(&mut choice, 200, 5.0, 2.0), "fast enough again");
        assert_eq!(choice.way(), Way::Asks);
    }

    #[test]
    fn far_nodes_are_not_asked_first() {
        for (trip_ms, way) in [(0.2, Way::Asks), (10.0, Way::Gathers)] {
            let mut choice = Choice::free(30.0);
            choice.begin(trip_ms);
            assert_eq!(choice.way(), way, "{trip_ms} ms");
        }
        let mut asks = Choice::fixed(Way::Asks);
        asks.begin(10.0);
        assert_eq!(asks.way(), Way::Asks);
    }

    #[test]
    fn a_few_slow_passes_and_a_way_that_is_set_change_nothing() {
        let mut choice = Choice::free(30.0);
        for pass in 0..600 {
            choice.took(if pass % 20 == 0 { 90.0 } else { 3.0 }, 1.0);
            assert!(!choice.change());
        }
        assert!(!took(&mut Choice::fixed(Way::Asks), 600, 90.0, 1.0));
    }
}
