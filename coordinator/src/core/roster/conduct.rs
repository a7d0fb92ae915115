//! How a node behaves: one that refuses, answers wrongly or is late again and again is excluded for a while, longer each time.

/// So many faults, or late answers, within this time exclude a node, seconds. Each of fewer costs the run a step without a hull
/// at most.
const MOST: usize = 3;
const WITHIN_S: f64 = 10.0;
/// The first exclusion lasts so long, and each one after it twice as long, seconds.
const FIRST_S: f64 = 1.0;
/// The longest exclusion for faults, and for late answers: a network that is slow for a while is no fault of the node.
const LONGEST_S: f64 = 32.0;
const LONGEST_FOR_LATE_S: f64 = 2.0;
/// A node without a fault (or late answer) for so long after an exclusion is as one that was never excluded, seconds. Until then
/// one excludes it again.
const PROBATION_S: f64 = 10.0;

/// What a node has done wrong of late. Times are of [`film_time::monotonic_s`].
#[derive(Clone, Debug, Default)]
pub(super) struct Conduct {
    faults: History,
    late: History,
}

/// Faults, or late answers.
#[derive(Clone, Debug)]
struct History {
    /// The last ones, oldest first.
    at_s: [f64; MOST - 1],
    /// Exclusions, one after the other.
    exclusions: i32,
    /// When the last exclusion ends.
    until_s: f64,
    why: String,
}

impl Default for History {
    fn default() -> History {
        let never = f64::NEG_INFINITY;
        History { at_s: [never; MOST - 1], exclusions: 0, until_s: never, why: String::new() }
    }
}

impl History {
    fn add(&mut self, now_s: f64, longest_s: f64, why: String) {
        if now_s > self.until_s + PROBATION_S {
            self.exclusions = 0;
        }
        let is_one_too_many = now_s - self.at_s[0] <= WITHIN_S;
        self.at_s.rotate_left(1);
        self.at_s[MOST - 2] = now_s;
        self.why = why;
        if is_one_too_many || self.exclusions > 0 {
            self.until_s = now_s + (FIRST_S * 2f64.powi(self.exclusions)).min(longest_s);
            self.exclusions = (self.exclusions + 1).min(16);
        }
    }
}

impl Conduct {
    /// It did something wrong. What it does while it is excluded changes nothing.
    pub fn fault(&mut self, now_s: f64, why: String) {
        if !self.is_excluded(now_s) {
            self.faults.add(now_s, LONGEST_S, why);
        }
    }

    /// It did not answer in time.
    pub fn late(&mut self, now_s: f64, why: String) {
        if !self.is_excluded(now_s) {
            self.late.add(now_s, LONGEST_FOR_LATE_S, why);
        }
    }

    /// Whether it is excluded.
    pub fn is_excluded(&self, now_s: f64) -> bool {
        now_s < self.faults.until_s.max(self.late.until_s)
    }

    /// For how much longer it is excluded, and why, if it is.
    pub fn exclusion(&self, now_s: f64) -> Option<String> {
        let (history, after) = match now_s < self.faults.until_s {
            true => (&self.faults, "repeated faults"),
            false => (&self.late, "late answers"),
        };
        let left_s = history.until_s - now_s;
        (left_s > 0.0).then(|| format!("excluded for {left_s:.1} s after {after}: {}", history.why))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_third_fault_excludes_and_each_later_one_for_longer() {
        let mut conduct = Conduct::default();
        let mut fault = |now_s| {
            conduct.fault(now_s, "busy".into());
            let lasts = (0..1000).map(|tenth| now_s + f64::from(tenth) * 0.1);
            lasts.take_while(|&at_s| conduct.is_excluded(at_s)).count()
        };
        assert_eq!([fault(0.0), fault(0.1), fault(0.2)], [0, 0, 10]);
        assert_eq!(fault(0.7), 5, "what it does meanwhile changes nothing");
        assert_eq!([fault(1.3), fault(5.0), fault(10.0)], [20, 40, 80]);
        assert_eq!([fault(60.0), fault(60.1), fault(60.2)], [0, 0, 10], "forgiven");
        for expected in [20, 40, 80, 160, 320, 320] {
            let now_s = conduct.faults.until_s + 0.1;
            conduct.fault(now_s, "busy".into());
            assert!((conduct.faults.until_s - now_s - f64::from(expected) * 0.1).abs() < 1e-9, "{expected}");
        }
    }

    #[test]
    fn a_node_that_is_late_again_and_again_is_excluded_for_two_seconds_at_most() {
        let mut conduct = Conduct::default();
        let mut excluded = |now_s| {
            conduct.late(now_s, "no answer within 39 ms".into());
            conduct.exclusion(now_s)
        };
        let for_s = |s: &str| Some(format!("excluded for {s} s after late answers: no answer within 39 ms"));
        assert_eq!([0.0, 0.1, 0.2].map(&mut excluded), [None, None, for_s("1.0")]);
        assert_eq!([1.5, 4.0].map(&mut excluded), [for_s("2.0"), for_s("2.0")]);
        assert_eq!([30.0, 36.0].map(&mut excluded), [None, None], "now and then");
    }

    #[test]
    fn late_answers_make_no_exclusion_for_faults_longer() {
        let mut conduct = Conduct::default();
        for late in 0..100 {
            conduct.late(3.0 * f64::from(late), "no answer within 39 ms".into());
        }
        let now_s = 310.0;
        conduct.fault(now_s, "busy".into());
        conduct.fault(now_s + 0.1, "busy".into());
        assert!(!conduct.is_excluded(now_s + 0.1));
        conduct.fault(now_s + 0.2, "busy".into());
        assert_eq!(
            conduct.exclusion(now_s + 0.2),
            Some("excluded for 1.0 s after repeated faults: busy".into())
        );
    }

    #[test]
    fn a_fault_now_and_then_excludes_nothing() {
        let mut conduct = Conduct::default();
        for fault in 0..100 {
            let now_s = 6.0 * f64::from(fault);
            conduct.fault(now_s, "busy".into());
            assert!(!conduct.is_excluded(now_s), "fault {fault}");
        }
    }
}
