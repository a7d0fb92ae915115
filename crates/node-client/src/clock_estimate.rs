//! A node's clock against ours, from readings of it: each tells that the node's clock showed so much at some moment
//! between question and answer. Those with the least round trips of a minute count: others were held up somewhere. All
//! lines that pass through every reading's moments are possible; the one in their middle is taken, and half of what
//! they leave open is how far it may be off.

use std::collections::VecDeque;

use film_time::ClockLine;

/// Readings older than this are forgotten, seconds.
const REMEMBERED_S: f64 = 60.0;
/// Of the readings of so much time the one with the least round trip is kept, seconds.
const BIN_S: f64 = 5.0;
/// No two clocks' rates differ by more.
const MOST_DRIFT: f64 = 5e-4;
/// Readings are no better than this, seconds: a clock has a resolution.
const LEAST_HALF_TRIP_S: f64 = 1e-6;
/// How much a new reading counts in what one usually takes.
const NEW_SHARE: f64 = 0.2;
/// Rates are searched so often, each time in two thirds of the range: to a millionth of a millionth.
const SEARCHES: usize = 60;

/// What is known of a node's clock.
#[derive(Clone, Debug, Default)]
pub(crate) struct ClockEstimate {
    /// The best of each bin, oldest first.
    best: VecDeque<Reading>,
    /// What a reading usually takes, seconds.
    trip_s: f64,
}

/// The node's clock, and ours in the middle of a round trip, seconds.
#[derive(Clone, Copy, Debug)]
struct Reading {
    node_s: f64,
    our_s: f64,
    half_trip_s: f64,
}

impl Reading {
    fn bin(&self) -> i64 {
        (self.our_s / BIN_S).floor() as i64
    }
}

impl ClockEstimate {
    /// Takes a reading that was asked for at `sent_s` and came at `received_s`, both by our clock.
    pub fn read(&mut self, sent_s: f64, node_s: f64, received_s: f64) {
        let half_trip_s = (0.5 * (received_s - sent_s)).max(LEAST_HALF_TRIP_S);
        let trip_s = received_s - sent_s;
        let usual_s = if self.best.is_empty() { trip_s } else { self.trip_s };
        self.trip_s = usual_s + NEW_SHARE * (trip_s - usual_s);
        let reading = Reading { node_s, our_s: 0.5 * (sent_s + received_s), half_trip_s };
        match self.best.back_mut() {
            Some(last) if last.bin() == reading.bin() => {
                if half_trip_s <= last.half_trip_s {
                    *last = reading;
                }
            }
            _ => self.best.push_back(reading),
        }
        while self.best.front().is_some_and(|first| reading.our_s - first.our_s > REMEMBERED_S) {
            self.best.pop_front();
        }
        if self.film_time(0.0, reading.our_s).is_none() {
            // No clock that goes on shows all of this: the machine slept.
            self.best.clear();
            self.best.push_back(reading);
        }
    }

    /// What a reading usually takes, seconds.
    pub fn trip_s(&self) -> f64 {
        self.trip_s
    }

    /// Film time by the node's clock, where ours shows `zero_s` at film time zero; `None` before the first reading.
    pub fn film_time(&self, zero_s: f64, now_s: f64) -> Option<ClockLine> {
        let last = self.best.back()?;
        let node_s = last.node_s + (now_s - last.our_s);
        let range = |rate: f64| self.range_at(node_s, rate);
        let width_s = |rate: f64| range(rate).1 - range(rate).0;
        let (least, most) = (1.0 - MOST_DRIFT, 1.0 + MOST_DRIFT);
        let widest = highest(least, most, width_s);
        if width_s(widest) < 0.0 {
            return None;
        }
        // The rates that are possible, and the earliest and latest that our clock may show at any of them.
        let (slow, fast) = (edge(least, widest, width_s), edge(most, widest, width_s));
        let from_s = range(highest(slow, fast, |rate| -range(rate).0)).0;
        let to_s = range(highest(slow, fast, |rate| range(rate).1)).1;
        Some(ClockLine {
            node_s,
            film_s: 0.5 * (from_s + to_s) - zero_s,
            rate: 0.5 * (slow + fast),
            bound_s: 0.5 * (to_s - from_s),
        })
    }

    /// What our clock shows at least and at most when the node's shows `node_s` and its rate is this; the least above the
    /// most if no line of that rate passes through all readings.
    fn range_at(&self, node_s: f64, rate: f64) -> (f64, f64) {
        let of = |reading: &Reading| reading.our_s + (node_s - reading.node_s) * rate;
        let least = self.best.iter().map(|reading| of(reading) - reading.half_trip_s);
        let most = self.best.iter().map(|reading| of(reading) + reading.half_trip_s);
        (least.fold(f64::NEG_INFINITY, f64::max), most.fold(f64::INFINITY, f64::min))
    }
}

/// Where a concave function is highest.
fn highest(mut low: f64, mut high: f64, height: impl Fn(f64) -> f64) -> f64 {
    for _ in 0..SEARCHES {
        let third = (high - low) / 3.0;
        if height(low + third) < height(high - third) {
            low += third;
        } else {
            high -= third;
        }
    }
    0.5 * (low + high)
}

/// Where a concave function that is positive at `within` gets negative on the way to `beyond`; `beyond` if it does not.
fn edge(mut beyond: f64, mut within: f64, height: impl Fn(f64) -> f64) -> f64 {
    if height(beyond) >= 0.0 {
        return beyond;
    }
    for _ in 0..SEARCHES {
        let middle = 0.5 * (beyond + within);
        if height(middle) >= 0.0 { within = middle } else { beyond = middle }
    }
    within
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A node's clock that began at another time and is faster, read over links whose ways take as long as `ways` says.
    fn follow(rate: f64, seconds: u32, mut ways: impl FnMut(u32) -> (f64, f64)) -> Vec<(f64, f64)> {
        let node_at = |our_s: f64| 1e5 + (our_s - 3.0) * rate;
        let mut estimate = ClockEstimate::default();
        let mut found = vec![];
        for tick in 0..2 * seconds {
            let sent_s = 40.0 + f64::from(tick) * 0.5;
            let (there_s, back_s) = ways(tick);
            estimate.read(sent_s, node_at(sent_s + there_s), sent_s + there_s + back_s);
            let now_s = sent_s + 0.4;
            let line = estimate.film_time(10.0, now_s).expect("was read");
            let off_s = line.film_s_at(node_at(now_s)) - (now_s - 10.0);
            found.push((off_s, line.bound_s));
        }
        found
    }

    /// Numbers between 0 and 1 that look random.
    fn noise(at: u32) -> f64 {
        f64::from((at.wrapping_mul(2_654_435_761) >> 8) % 10_007) / 10_007.0
    }

    #[test]
    fn film_time_is_never_off_by_more_than_its_bound() {
        for rate in [1.0, 1.0 + 8e-5, 1.0 - 8e-5] {
            for most_s in [0.0005, 0.005, 0.04] {
                let way = |at: u32| 0.0002 + most_s * noise(at) * noise(at + 77);
                for (off_s, bound_s) in follow(rate, 180, |tick| (way(2 * tick), way(2 * tick + 1))) {
                    assert!(off_s.abs() <= bound_s, "{off_s} s off, bound {bound_s} s, rate {rate}");
                }
            }
        }
    }

    #[test]
    fn what_is_slow_one_way_alone_is_within_the_bound_too() {
        let found = follow(1.0, 100, |tick| (0.0002 + 0.02 * noise(tick), 0.0002));
        assert!(found.iter().all(|(off_s, bound_s)| off_s.abs() <= *bound_s));
        let late = &found[60..];
        assert!(late.iter().all(|(off_s, _)| off_s.abs() < 0.0015), "the least round trips count");
    }

    #[test]
    fn drift_is_learnt_within_half_a_minute() {
        let found = follow(1.0001, 120, |tick| (0.0003 + 1e-4 * noise(tick), 0.0003));
        for (off_s, bound_s) in &found[80..] {
            assert!(off_s.abs() < 1e-4 && *bound_s < 1e-3, "{off_s} s, bound {bound_s} s");
        }
    }

    #[test]
    fn a_clock_that_stood_still_is_believed_again() {
        let mut estimate = ClockEstimate::default();
        for tick in 0..60 {
            let our_s = f64::from(tick);
            let node_s = if tick < 40 { our_s } else { our_s - 5.0 };
            estimate.read(our_s, node_s, our_s + 0.001);
        }
        let line = estimate.film_time(0.0, 59.0).expect("was read");
        assert!((line.film_s_at(54.0) - 59.0).abs() < 0.002);
    }
}
