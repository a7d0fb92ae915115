//! How a node behaves: one that refuses, answers wrongly or is late again and again is excluded for a while; for faults longer each
//! time.

/// So many faults or late answers within this time exclude a node, seconds. Fewer cost the run a step each, and no more.
const FAULTS: usize = 3;
const WITHIN_S: f64 = 10.0;
/// The first exclusion lasts so long, and each one after it twice as long, up to this, seconds.
const FIRST_S: f64 = 1.0;
const LONGEST_S: f64 = 32.0;
/// A node without a fault for so long after an exclusion is as one that was never excluded, seconds. Until then one fault
/// excludes it again.
const PROBATION_S: f64 = 10.0;

/// What a node has done wrong of late. Times are of [`proto::monotonic_s`].
#[derive(Clone, Debug)]
pub(super) struct Conduct {
    /// The last faults, oldest first.
    faults_s: [f64; FAULTS - 1],
    /// Exclusions, one after the other.
    exclusions: i32,
    /// When the last exclusion ends.
    until_s: f64,
    why: String,
}

impl Default for Conduct {
    fn default() -> Conduct {
        let never = f64::NEG_INFINITY;
        Conduct { faults_s: [never; FAULTS - 1], exclusions: 0, until_s: never, why: String::new() }
    }
}

impl Conduct {
    /// It did something wrong. What it does while it is excluded changes nothing.
    pub fn fault(&mut self, now_s: f64, why: String) {
        if self.is_excluded(now_s) {
            return;
        }
        if now_s > self.until_s + PROBATION_S {
            self.exclusions = 0;
        }
        let is_one_too_many = self.note(now_s, why);
        if is_one_too_many || self.exclusions > 0 {
            self.until_s = now_s + (FIRST_S * 2f64.powi(self.exclusions)).min(LONGEST_S);
            self.exclusions = (self.exclusions + 1).min(16);
        }
    }

    /// It did not answer in time. Exclusions for that do not become longer: a way that is slow for a while is no fault of the
    /// node.
    pub fn late(&mut self, now_s: f64, why: String) {
        if !self.is_excluded(now_s) && self.note(now_s, why) {
            self.until_s = now_s + FIRST_S;
        }
    }

    /// Notes one of both; whether that is one too many.
    fn note(&mut self, now_s: f64, why: String) -> bool {
        let is_one_too_many = now_s - self.faults_s[0] <= WITHIN_S;
        self.faults_s.rotate_left(1);
        self.faults_s[FAULTS - 2] = now_s;
        self.why = why;
        is_one_too_many
    }

    /// Whether it is excluded.
    pub fn is_excluded(&self, now_s: f64) -> bool {
        now_s < self.until_s
    }

    /// For how much longer it is excluded, seconds, and why.
    pub fn exclusion(&self, now_s: f64) -> Option<(f64, &str)> {
        self.is_excluded(now_s).then_some((self.until_s - now_s, self.why.as_str()))
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
            let now_s = conduct.until_s + 0.1;
            conduct.fault(now_s, "busy".into());
            assert!((conduct.until_s - now_s - f64::from(expected) * 0.1).abs() < 1e-9, "{expected}");
        }
    }

    #[test]
    fn a_node_that_is_late_again_and_again_is_excluded_for_a_second_each_time() {
        let mut conduct = Conduct::default();
        let mut excluded_s = |now_s| {
            conduct.late(now_s, "no answer within 26 ms".into());
            conduct.exclusion(now_s).map(|(lasts_s, _)| lasts_s)
        };
        assert_eq!([0.0, 0.1, 0.2].map(&mut excluded_s), [None, None, Some(1.0)]);
        assert_eq!([1.5, 2.75, 4.0].map(&mut excluded_s), [Some(1.0); 3]);
        assert_eq!([30.0, 36.0].map(&mut excluded_s), [None; 2], "now and then");
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
