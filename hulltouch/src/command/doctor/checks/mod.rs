//! One question a file, over plain data.

mod backgrounds;
mod certificates;
mod clocks;
mod devices;
mod digests;
mod disk;
mod limits;
mod names;
mod phases;
mod ports;
mod rates;
mod stamps;
#[cfg(test)]
mod tests;
mod usb;
mod versions;

use proto::{CameraStatus, CameraTrouble};

use super::facts::{CameraFacts, Facts, NoFilm, NodeFacts};
use super::finding::Finding;

/// A camera that films well for so long has got over what was wrong, seconds.
const LONG_OVER_S: f64 = 60.0;

/// A check: its name, and what finds out.
pub type Check = (&'static str, fn(&Facts) -> Vec<Finding>);

/// All checks, in the order in which one depends on others.
pub const ALL: [Check; 14] = [
    ("names", names::check),
    ("ports", ports::check),
    ("certificates", certificates::check),
    ("versions", versions::check),
    ("digests", digests::check),
    ("clocks", clocks::check),
    ("rates", rates::check),
    ("stamps", stamps::check),
    ("phases", phases::check),
    ("backgrounds", backgrounds::check),
    ("disk", disk::check),
    ("devices", devices::check),
    ("usb", usb::check),
    ("limits", limits::check),
];

/// The nodes that said how they are; or that none did.
fn answering(facts: &Facts) -> Result<Vec<&NodeFacts>, Finding> {
    let answering: Vec<&NodeFacts> = facts.nodes.iter().filter(|node| node.report().is_some()).collect();
    if answering.is_empty() { Err(Finding::skip("no node said how it is")) } else { Ok(answering) }
}

/// What is wrong with a camera's film: not what is long over.
fn trouble(look: &CameraStatus) -> Option<&CameraTrouble> {
    look.trouble.as_ref().filter(|trouble| trouble.age_s < LONG_OVER_S || look.frames_per_s == 0.0)
}

/// The cameras that were looked at; or why none were.
fn filmed(facts: &Facts) -> Result<&[CameraFacts], Finding> {
    facts.film.as_deref().map_err(|none| match none {
        NoFilm::NotTried(why) => Finding::skip(why.clone()),
        NoFilm::Failed(why) => Finding::skip(format!("no camera could be looked at: {why}")),
    })
}
