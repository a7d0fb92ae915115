//! How a node behaves: one that refuses or answers wrongly again and again is left out for a while, longer each time.

/// A fault so long after the one before is forgiven what came before, seconds.
const FORGIVEN_S: f64 = 20.0;
/// The last of so many faults excludes.
const FAULTS: u32 = 3;
/// The first exclusion lasts so long, and each one after it twice as long, up to this, seconds.
const FIRST_S: f64 = 1.0;
const LONGEST_S: f64 = 32.0;

/// What a node has done wrong of late.
#[derive(Clone, Debug, Default)]
pub(super) struct Conduct {
    faults: u32,
    /// Exclusions, one after the other.
    exclusions: i32,
    /// When the last fault was, or the last exclusion ends, by [`proto::monotonic_s`].
    until_s: f64,
    is_excluded: bool,
    why: String,
}

impl Conduct {
    /// It did something wrong.
    pub fn fault(&mut self, now_s: f64, why: String) {
        if self.is_excluded(now_s) {
            return;
        }
        if now_s > self.until_s + FORGIVEN_S {
            *self = Conduct::default();
        }
        (self.faults, self.is_excluded, self.until_s, self.why) = (self.faults + 1, false, now_s, why);
        if self.faults >= FAULTS {
            // Of one that has been excluded before, the next fault excludes again.
            self.faults = FAULTS - 1;
            self.is_excluded = true;
            self.until_s = now_s + (FIRST_S * 2f64.powi(self.exclusions)).min(LONGEST_S);
            self.exclusions = (self.exclusions + 1).min(16);
        }
    }

    /// Whether it is excluded.
    pub fn is_excluded(&self, now_s: f64) -> bool {
        self.is_excluded && now_s < self.until_s
    }

    /// Why it is excluded, or was last.
    pub fn why(&self) -> &str {
        &self.why
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
}
