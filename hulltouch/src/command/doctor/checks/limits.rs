//! May a process open as many files as a run takes?

use super::super::facts::Facts;
use super::super::finding::Finding;

/// A coordinator of 64 nodes, its page and its viewers.
const LEAST: u64 = 1024;

/// Warns of a low limit.
pub fn check(facts: &Facts) -> Vec<Finding> {
    vec![match facts.open_files {
        Some(most) if most < LEAST => Finding::warn(
            format!("a process may have {most} files open, {LEAST} are expected"),
            "ulimit -n 4096, or LimitNOFILE=4096 in a unit",
        ),
        Some(most) => Finding::ok(format!("a process may have {most} files open")),
        None => Finding::ok("a process may have any number of files open"),
    }]
}
