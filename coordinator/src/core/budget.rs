//! Whether the solver keeps up. A world whose steps take far longer than they last is given up: nothing else would happen any
//! more. Plain decisions: times are arguments.

/// What a step may take without being counted, seconds: twelve times what it lasts.
const SLOW_STEP_S: f64 = 0.1;
/// No more of one step is counted, seconds: a process that was stopped for minutes has one slow step.
const MAX_COUNTED_S: f64 = 1.0;
/// What slow steps may take above that together, unless quick steps make up for it, seconds.
const MAX_EXCESS_S: f64 = 2.0;
/// A world from the memory of nodes is kept again once quick steps have made up for so much, seconds: five or more.
const PROBATION_S: f64 = 0.5;

/// The time that the solver has taken for the steps of a world, above what it may take.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct StepBudget {
    excess_s: f64,
}

impl StepBudget {
    /// Of a world that nodes remembered.
    pub fn on_probation() -> StepBudget {
        StepBudget { excess_s: PROBATION_S }
    }

    /// The solver took so long for a step, seconds.
    pub fn note(&mut self, took_s: f64) {
        self.excess_s = (self.excess_s + took_s.min(MAX_COUNTED_S) - SLOW_STEP_S).max(0.0);
    }

    /// Whether the world must be given up.
    pub fn is_exhausted(self) -> bool {
        self.excess_s > MAX_EXCESS_S
    }

    /// Whether nodes may remember the world: a successor would have to make its steps, too.
    pub fn is_met(self) -> bool {
        self.excess_s == 0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// How many steps of so many seconds a world may make; at most `most`.
    fn steps_until_exhausted(took_s: f64, most: usize) -> Option<usize> {
        let mut budget = StepBudget::default();
        (1..=most).find(|_| {
            budget.note(took_s);
            budget.is_exhausted()
        })
    }

    #[test]
    fn a_world_that_is_far_too_slow_is_given_up_after_two_to_four_seconds() {
        assert_eq!(steps_until_exhausted(8.0, 100), Some(3));
        assert_eq!(steps_until_exhausted(1.0, 100), Some(3));
        let steps = steps_until_exhausted(0.2, 100).expect("exhausted");
        assert!((20..=21).contains(&steps), "{steps}");
        assert_eq!(steps_until_exhausted(0.09, 10_000), None, "slow, but its steps are made");
    }

    #[test]
    fn a_process_that_was_stopped_for_minutes_keeps_its_world() {
        let mut budget = StepBudget::default();
        for _ in 0..10 {
            budget.note(300.0);
            assert!(!budget.is_exhausted() && !budget.is_met(), "{budget:?}");
            (0..20).for_each(|_| budget.note(0.001));
            assert!(budget.is_met(), "{budget:?}");
        }
    }

    #[test]
    fn a_world_that_goes_on_is_kept_once_it_has_made_quick_steps() {
        let mut budget = StepBudget::on_probation();
        let steps = (1..).find(|_| {
            assert!(!budget.is_met() && !budget.is_exhausted());
            budget.note(0.001);
            budget.is_met()
        });
        assert_eq!(steps, Some(6));
    }
}
