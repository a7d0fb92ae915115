//! Does the node's program listen at each node's address, and can it be reached?

use node_client::NodeError;

use super::super::facts::{Facts, NodeFacts, Reach};
use super::super::finding::{Finding, or_ok};

/// Fails for ports that are closed, filtered, or another program's.
pub fn check(facts: &Facts) -> Vec<Finding> {
    let wrong: Vec<Finding> = facts.nodes.iter().filter_map(|node| of_node(node, facts)).collect();
    let tried = facts.nodes.iter().filter(|node| node.reach != Reach::NotTried).count();
    or_ok(wrong, || match (tried, &facts.host) {
        (0, _) => Finding::skip("there is no address to try"),
        (_, Some(host)) => Finding::ok(match facts.nodes.iter().any(|node| node.reach == Reach::Open) {
            true => format!("node {host} listens"),
            false => format!("the port of node {host} is free"),
        }),
        (tried, None) => Finding::ok(format!("nodes listen at {tried} addresses")),
    })
}

fn of_node(node: &NodeFacts, facts: &Facts) -> Option<Finding> {
    let (name, is_own) = (&node.name, facts.host.is_some());
    let other = |why: &str| {
        Some(Finding::fail(
            format!("node {name}: another program than it answers there: {why}"),
            "end what has the port (ss -tlnp), or give the node another; if it is a node with certificates, give --certs",
        ))
    };
    match &node.reach {
        Reach::NotTried => None,
        Reach::Refused(_) if is_own => None,
        Reach::Refused(at) => Some(Finding::fail(
            format!("node {name}: nothing listens at {at}"),
            format!(
                "start it there: systemctl start hulltouch-node, or hulltouch node FILE --host {name} --certs FOLDER"
            ),
        )),
        Reach::Timeout(at) => Some(Finding::fail(
            format!("node {name}: nothing comes back from {at}, as if a firewall took it"),
            "look at its power and its cable (ping it); then allow the port there: ufw allow from THIS-PC to any port \
             PORT proto tcp",
        )),
        Reach::Failed(at, why) => Some(Finding::fail(
            format!("node {name}: no connection to {at}: {why}"),
            "look at address, cable and route: ping the PC",
        )),
        Reach::Open => match node.found.as_ref()?.as_ref().err().map(NodeError::innermost)? {
            NodeError::AtOnce { why, .. } if !super::certificates::is_about(node, facts) => other(why),
            NodeError::Timeout(_) => other("it takes connections and says nothing"),
            NodeError::Invalid(error) => other(&error.to_string()),
            error @ (NodeError::Lost(_) | NodeError::Unreachable(_))
                if !super::certificates::is_about(node, facts) =>
            {
                other(&error.to_string())
            }
            _ => None,
        },
    }
}
