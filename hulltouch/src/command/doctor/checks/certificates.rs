//! Do certificates let this machine and the nodes talk, and for how long?

use net::CertificateError;

use super::super::facts::{Certificates, Facts, NodeFacts};
use super::super::finding::{Finding, or_ok};

/// Certificates that end sooner are named.
const LEAST_DAYS: f64 = 14.0;
const DAY_S: f64 = 86_400.0;

/// Fails for a folder that cannot be used and for nodes that are refused or refuse; warns before certificates end.
pub fn check(facts: &Facts) -> Vec<Finding> {
    let mut wrong = Vec::new();
    let well = match &facts.certificates {
        Certificates::NotNeeded => "none are needed: all stays on this machine".to_owned(),
        Certificates::Missing { node, is_wanted } => {
            let what = format!("what is sent to {node} is not encrypted, and peers are not authenticated");
            let cure = "hulltouch certs FILE --into FOLDER, and then --certs FOLDER everywhere";
            wrong.push(if *is_wanted { Finding::warn(what, cure) } else { Finding::fail(what, cure) });
            String::new()
        }
        Certificates::Folder { folder, found: Ok((owner, ends_unix_s)) } => {
            let days = (ends_unix_s - facts.now_unix_s) / DAY_S;
            let whose = format!("that of {owner} in {}", folder.display());
            wrong.extend(ends_soon(&whose, days));
            format!("{owner}, {days:.0} days left")
        }
        Certificates::Folder { found: Err(error), .. } => {
            wrong.push(Finding::fail(error.to_string(), cure(error)));
            String::new()
        }
    };
    for node in &facts.nodes {
        if let Some(Err(error)) = node.found.as_ref().filter(|_| is_about(node, facts)) {
            wrong.push(Finding::fail(
                format!("node {}: {error}", node.name),
                "give both sides certificates of one authority (hulltouch certs), or none; this side needs the \
                 coordinator's or a viewer's",
            ));
        }
        let ends = node.report().and_then(|report| report.status.certificate_ends_unix_s);
        wrong.extend(ends.and_then(|ends| {
            ends_soon(&format!("that of node {}", node.name), (ends - facts.now_unix_s) / DAY_S)
        }));
    }
    or_ok(wrong, || Finding::ok(well))
}

fn ends_soon(whose: &str, days: f64) -> Option<Finding> {
    (days < LEAST_DAYS).then(|| {
        Finding::warn(
            format!("{whose} ends in {days:.1} days"),
            "renew it: run hulltouch certs again, or see to your authority; nothing need be restarted",
        )
    })
}

/// Whether a node did not answer because of who it or we are.
pub fn is_about(node: &NodeFacts, facts: &Facts) -> bool {
    // On its own port only a node itself has to do with certificates.
    let Some(Err(error)) = node.found.as_ref().filter(|_| facts.host.is_none()) else { return false };
    let text = error.to_string();
    // Where TLS or the node refuses, the reason is a text of the library's or of the node's.
    text.contains("certificate") || text.contains("this is for coordinator")
}

fn cure(error: &CertificateError) -> &'static str {
    match error {
        CertificateError::Read { .. } => {
            "name the folder with ca.crt, tls.crt and tls.key, readable to this user"
        }
        CertificateError::KeyOpen { .. } => "chmod 600 tls.key, and a new key if others may have read it",
        CertificateError::NoFile { .. }
        | CertificateError::TooLong { .. }
        | CertificateError::Content { .. } => "copy the folder again, or make it with hulltouch certs",
        CertificateError::Mismatch { .. } => "take tls.crt and tls.key from the same folder of the same day",
        CertificateError::Refused { .. } => {
            "set this PC's clock (timedatectl), then renew: hulltouch certs, with the authority of the room"
        }
        CertificateError::Name { .. } => {
            "take this machine's own folder: nodes/NAME on a node, coordinator, or viewer"
        }
    }
}
