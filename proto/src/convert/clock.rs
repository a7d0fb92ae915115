//! Runs, and film time by a node's clock: messages and back.

use film_time::{ClockLine, RunStart};

use super::ConvertError;
use super::bulk::Field;
use super::film::{MAX_TIME_S, within};
use crate::v1;

/// No clock that runs is faster or slower by more.
const MOST_DRIFT: f64 = 0.01;

/// A run.
pub fn start_to_wire(start: RunStart) -> v1::StartRequest {
    let RunStart { run, clock, epoch_unix_s, lock_step } = start;
    v1::StartRequest { run, clock: Some(clock_to_wire(clock)), epoch_unix_s, lock_step, holder: 0 }
}

/// A run; its epoch is a date that clocks can reach.
pub fn start_from_wire(request: &v1::StartRequest) -> Result<RunStart, ConvertError> {
    let v1::StartRequest { run, clock, epoch_unix_s, lock_step, holder: _ } = request;
    let field = |name| Field("StartRequest", name);
    let epoch_unix_s = within(*epoch_unix_s, 0.0, MAX_TIME_S, field("epoch_unix_s"))?;
    let clock = clock.as_ref().ok_or_else(|| field("clock").value("is missing"))?;
    Ok(RunStart { run: *run, clock: clock_from_wire(clock)?, epoch_unix_s, lock_step: *lock_step })
}

/// Film time by a node's clock.
pub fn clock_to_wire(clock: ClockLine) -> v1::ClockLine {
    let ClockLine { node_s, film_s, rate, bound_s } = clock;
    v1::ClockLine { node_s, film_s, rate, bound_s }
}

/// Film time by a node's clock, which runs about as fast.
pub fn clock_from_wire(clock: &v1::ClockLine) -> Result<ClockLine, ConvertError> {
    let &v1::ClockLine { node_s, film_s, rate, bound_s } = clock;
    let field = |name| Field("ClockLine", name);
    Ok(ClockLine {
        node_s: within(node_s, -MAX_TIME_S, MAX_TIME_S, field("node_s"))?,
        film_s: within(film_s, -MAX_TIME_S, MAX_TIME_S, field("film_s"))?,
        rate: within(rate, 1.0 - MOST_DRIFT, 1.0 + MOST_DRIFT, field("rate"))?,
        bound_s: within(bound_s, 0.0, MAX_TIME_S, field("bound_s"))?,
    })
}

/// Where film is cut into frames, periods.
pub fn phase_from_wire(phase: f64) -> Result<f64, ConvertError> {
    within(phase, -1.0, 1.0, Field("KeepTimeRequest", "phase"))
}

/// A reading of a node's clock.
pub fn node_clock_from_wire(reply: v1::KeepTimeReply) -> Result<f64, ConvertError> {
    within(reply.node_s, -MAX_TIME_S, MAX_TIME_S, Field("KeepTimeReply", "node_s"))
}

#[cfg(test)]
mod tests {
    use super::*;

    type Spoil = fn(&mut v1::ClockLine);

    #[test]
    fn what_no_clock_says_is_refused() {
        let clock = ClockLine { node_s: 7.0, film_s: -0.25, rate: 1.0001, bound_s: 0.002 };
        assert_eq!(clock_from_wire(&clock_to_wire(clock)), Ok(clock));
        let wrong: [(Spoil, &str); 5] = [
            (|clock| clock.node_s = f64::NAN, "ClockLine.node_s: is NaN"),
            (|clock| clock.film_s = 1e300, "ClockLine.film_s: is 1"),
            (|clock| clock.rate = 0.0, "ClockLine.rate: is 0"),
            (|clock| clock.bound_s = -1.0, "ClockLine.bound_s: is -1"),
            (|clock| clock.bound_s = f64::INFINITY, "ClockLine.bound_s: is inf"),
        ];
        for (spoil, expected) in wrong {
            let mut wire = clock_to_wire(clock);
            spoil(&mut wire);
            let error = clock_from_wire(&wire).expect_err("no clock").to_string();
            assert!(error.contains(expected), "{error}");
        }
        assert!(phase_from_wire(-0.5).is_ok() && phase_from_wire(f64::NAN).is_err());
        assert!(node_clock_from_wire(v1::KeepTimeReply { node_s: f64::INFINITY }).is_err());
    }

    #[test]
    fn a_run_has_a_clock_and_a_date() {
        let clock = ClockLine { node_s: 7.0, film_s: -0.25, rate: 1.0, bound_s: 0.0 };
        let start = RunStart { run: 9, clock, epoch_unix_s: 1.7e9, lock_step: true };
        assert_eq!(start_from_wire(&start_to_wire(start)), Ok(start));
        for epoch_unix_s in [f64::NAN, 1e300, -1.0, f64::INFINITY] {
            let request = v1::StartRequest { epoch_unix_s, ..start_to_wire(start) };
            let error = start_from_wire(&request).expect_err("no date").to_string();
            assert!(error.starts_with("StartRequest.epoch_unix_s: is "), "{error}");
        }
        let request = v1::StartRequest { clock: None, ..start_to_wire(start) };
        assert_eq!(
            start_from_wire(&request).expect_err("no clock").to_string(),
            "StartRequest.clock: is missing"
        );
    }
}
