//! Do nodes and this program speak the same protocol?

use node_client::NodeError;

use super::super::facts::Facts;
use super::super::finding::{Finding, or_ok};
use super::answering;

/// Fails for versions that are more than one minor version apart.
pub fn check(facts: &Facts) -> Vec<Finding> {
    let cure = || format!("install version {} everywhere, nodes first", facts.version);
    let mut wrong = Vec::new();
    for node in &facts.nodes {
        let failure = node.found.as_ref().and_then(|found| found.as_ref().err());
        if let Some(NodeError::NoStatus) = failure.map(NodeError::innermost) {
            wrong.push(Finding::fail(format!("node {}: an older version than this one", node.name), cure()));
        }
        let Some(report) = node.report() else { continue };
        let found = &report.status.node.version;
        if !may_talk(found, &facts.version) {
            let (name, own) = (&node.name, &facts.version);
            wrong.push(Finding::fail(format!("node {name} is version {found}, this is {own}"), cure()));
        }
    }
    let well = || match answering(facts) {
        Ok(_) => Finding::ok(format!("{} and those that it goes with", facts.version)),
        Err(skipped) => skipped,
    };
    or_ok(wrong, well)
}

/// Versions of the same major version whose minor ones differ by one at most.
fn may_talk(one: &str, other: &str) -> bool {
    let parts = |version: &str| -> Option<(u64, u64)> {
        let mut parts = version.split('.');
        Some((parts.next()?.parse().ok()?, parts.next()?.parse().ok()?))
    };
    match (parts(one), parts(other)) {
        (Some((major, minor)), Some((other_major, other_minor))) => {
            major == other_major && minor.abs_diff(other_minor) <= 1
        }
        _ => false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn versions_may_be_one_minor_version_apart() {
        for (one, other, expected) in [
            ("0.1.0", "0.1.9", true),
            ("0.2.0", "0.1.0", true),
            ("0.1.0", "0.2.3-rc.1", true),
            ("0.3.0", "0.1.0", false),
            ("1.1.0", "0.1.0", false),
            ("", "0.1.0", false),
            ("x.y", "0.1.0", false),
        ] {
            assert_eq!(may_talk(one, other), expected, "{one} and {other}");
        }
    }
}
