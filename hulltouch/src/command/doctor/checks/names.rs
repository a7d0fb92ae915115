//! Is it known where each node is?

use super::super::facts::{Facts, Place};
use super::super::finding::{Finding, or_ok};

/// Fails for hosts that are not known, and for nodes that are not announced.
pub fn check(facts: &Facts) -> Vec<Finding> {
    let wrong = facts.nodes.iter().filter_map(|node| match &node.place {
        Place::At(_) => None,
        Place::UnknownHost(host, why) => Some(Finding::fail(
            format!("node {}: the host {host:?} of its address is not known here ({why})", node.name),
            "write its IP address into the cluster file, or make the name known (DNS or /etc/hosts; .local needs \
             libnss-mdns)",
        )),
        Place::NotAnnounced => Some(Finding::fail(
            format!("node {}: it is not announced in this network (DNS-SD)", node.name),
            "look at its power and its cable, start its node, allow UDP port 5353 on both machines, or give it an address \
             in the cluster file",
        )),
    });
    let well = || match &facts.nodes[..] {
        [] => Finding::ok("no node has an address: all runs on this machine"),
        nodes => Finding::ok(format!("it is known where each node is ({})", nodes.len())),
    };
    or_ok(wrong.collect(), well)
}
