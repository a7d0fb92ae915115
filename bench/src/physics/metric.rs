//! Figures of runs, and what they must keep to.

/// A figure of a run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Metric {
    /// Its name, with its unit.
    pub name: &'static str,
    /// What was found; no number where it never came to be.
    pub value: f64,
    /// What must hold, if anything.
    pub limit: Option<Limit>,
}

/// What a figure must keep to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Limit {
    /// No more than this.
    Most(f64),
    /// No less than this.
    Least(f64),
    /// Between these.
    Within(f64, f64),
}

impl Limit {
    /// Whether a figure keeps to it; what is no number does not.
    pub fn holds(self, value: f64) -> bool {
        match self {
            Limit::Most(most) => value <= most,
            Limit::Least(least) => value >= least,
            Limit::Within(least, most) => (least..=most).contains(&value),
        }
    }

    /// The worse of two figures.
    pub fn worse(self, a: f64, b: f64) -> f64 {
        let badness = |value: f64| match self {
            _ if value.is_nan() => f64::INFINITY,
            Limit::Most(_) => value,
            Limit::Least(_) => -value,
            Limit::Within(least, most) => (value - 0.5 * (least + most)).abs(),
        };
        if badness(b) > badness(a) { b } else { a }
    }
}

/// A figure.
pub fn metric(name: &'static str, value: f64, limit: Option<Limit>) -> Metric {
    Metric { name, value, limit }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn limits_hold_and_know_the_worse() {
        for (limit, good, bad) in [
            (Limit::Most(2.0), 1.0, 3.0),
            (Limit::Least(2.0), 3.0, 1.0),
            (Limit::Within(1.0, 3.0), 2.5, 3.5),
            (Limit::Most(2.0), 1.0, f64::NAN),
        ] {
            assert!(limit.holds(good) && !limit.holds(bad), "{limit:?}");
            assert!(limit.worse(good, bad).to_bits() == bad.to_bits(), "{limit:?}");
            assert!(limit.worse(bad, good).to_bits() == bad.to_bits(), "{limit:?}");
        }
    }
}
