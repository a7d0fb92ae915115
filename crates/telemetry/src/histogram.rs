//! How often something took how long.

/// Upper bounds of the buckets, seconds: a tenth of a millisecond to ten seconds.
const BOUNDS_S: [f64; 16] =
    [1e-4, 2e-4, 5e-4, 1e-3, 2e-3, 5e-3, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0];

/// Durations, counted in buckets whose bounds are the same everywhere.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Histogram {
    /// Durations up to each bound and above the one before; the last are longer than all.
    counts: [u64; BOUNDS_S.len() + 1],
    sum_s: f64,
}

impl Histogram {
    /// Counts a duration, seconds.
    pub fn add(&mut self, seconds: f64) {
        self.counts[BOUNDS_S.partition_point(|&bound_s| bound_s < seconds)] += 1;
        self.sum_s += seconds;
    }

    /// All durations together, seconds.
    pub fn sum_s(&self) -> f64 {
        self.sum_s
    }

    /// Upper bound, seconds, and count of each bucket, ascending; the last bound is infinite.
    pub fn buckets(&self) -> impl Iterator<Item = (f64, u64)> + '_ {
        BOUNDS_S.into_iter().chain([f64::INFINITY]).zip(self.counts)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_duration_counts_in_the_bucket_of_the_least_bound_that_is_not_below_it() {
        let mut histogram = Histogram::default();
        [0.0, 1e-4, 1.1e-4, 10.0, 11.0].into_iter().for_each(|seconds| histogram.add(seconds));
        let filled: Vec<(f64, u64)> = histogram.buckets().filter(|(_, count)| *count > 0).collect();
        assert_eq!(filled, [(1e-4, 2), (2e-4, 1), (10.0, 1), (f64::INFINITY, 1)]);
        assert!((histogram.sum_s() - 21.00021).abs() < 1e-9);
    }
}
