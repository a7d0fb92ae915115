//! Can film time be told exactly enough?

use super::super::facts::Facts;
use super::super::finding::{Finding, or_ok};
use super::answering;

/// A camera that is a quarter of a frame out of step is marked as such: that is what must be seen.
const MOST_BOUND_PERIODS: f64 = 0.25;
/// Film does not mind; certificates and logs do.
const MOST_OFFSET_S: f64 = 60.0;

/// Fails for ways to nodes that are so slow that film time may be off by a quarter of a frame; warns of wall clocks.
pub fn check(facts: &Facts) -> Vec<Finding> {
    let answering = match answering(facts) {
        Ok(answering) => answering,
        Err(skipped) => return vec![skipped],
    };
    let most_s = MOST_BOUND_PERIODS / facts.fps;
    let (mut wrong, mut worst_s) = (Vec::new(), 0.0_f64);
    for node in answering {
        let Some(report) = node.report() else { continue };
        let (bound_s, offset_s) = (report.clock_bound_s, report.clock_offset_s);
        worst_s = worst_s.max(bound_s);
        if bound_s > most_s {
            let (found, most) = (1e3 * bound_s, 1e3 * most_s);
            wrong.push(Finding::fail(
                format!("node {}: its clock is known to {found:.1} ms, expected {most:.1}", node.name),
                "use a cable instead of WLAN, and a network without other traffic",
            ));
        }
        if offset_s.abs() > MOST_OFFSET_S {
            wrong.push(Finding::warn(
                format!("node {}: its wall clock is {offset_s:+.0} s from this one's", node.name),
                "set it by NTP (timedatectl set-ntp true): film does not mind, certificates and logs do",
            ));
        }
    }
    or_ok(wrong, || {
        Finding::ok(format!("known to {:.2} ms or better, {:.1} needed", 1e3 * worst_s, 1e3 * most_s))
    })
}
