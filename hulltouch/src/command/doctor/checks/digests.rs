//! Do nodes have the calibration, the cameras and the settings of this cluster file?

use super::super::facts::Facts;
use super::super::finding::{Finding, or_ok};
use super::answering;

/// Fails for nodes that a coordinator would refuse.
pub fn check(facts: &Facts) -> Vec<Finding> {
    if let Err(skipped) = answering(facts) {
        return vec![skipped];
    }
    let wrong = facts.nodes.iter().filter_map(|node| {
        let mismatch = node.agrees.as_ref()?.as_ref().err()?;
        Some(Finding::fail(
            format!("node {}: {mismatch}", node.name),
            "copy cluster file and rig of this PC to that one, and restart its node",
        ))
    });
    or_ok(wrong.collect(), || Finding::ok("nodes have the calibration and the settings of this cluster file"))
}
