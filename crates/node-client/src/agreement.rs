//! What the nodes of a run and their coordinator agree on: who is meant, the hull rule, shapes, the run, who leads.

use std::fmt;
use std::sync::Arc;

use film_time::{Cut, Pace, unix_now_s};
use hull::{ProbeSettings, Shape};
use parking_lot::{Mutex, MutexGuard};
use proto::convert::ExpectedCamera;
use proto::text::{MAX_NAME_CHARS, clean};
use proto::{Address, CameraDescription, Claim, NodeDescription};

use crate::connection::{Destination, Dial, Sockets};
use crate::counting::{ByteCounters, ByteCounts};
use crate::error::Mismatch;
use crate::place::NodePlace;

/// A node that must be there.
#[derive(Clone, Debug)]
pub struct ExpectedNode {
    /// Its name, if the cluster file gives it one.
    pub name: Option<String>,
    /// Where it listens.
    pub place: NodePlace,
    /// Its cameras in rig order.
    pub cameras: Vec<CameraDescription>,
    /// What their answers are checked against.
    pub expected_cameras: Vec<ExpectedCamera>,
    /// Whether all its cameras film without end: live ones, and the synthetic studio's.
    pub is_endless: bool,
}

impl ExpectedNode {
    /// The node where it may be.
    pub(crate) fn at(&self, address: &Address) -> Destination {
        Destination { address: address.clone(), node: self.name.clone() }
    }
}

impl fmt::Display for ExpectedNode {
    /// The name, or else the address, and the cameras there: `left (cam_0, cam_1)`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let names: Vec<&str> = self.cameras.iter().map(|camera| &camera.name[..]).collect();
        match &self.name {
            Some(name) => f.write_str(name)?,
            None => self.place.fmt(f)?,
        }
        write!(f, " ({})", names.join(", "))
    }
}

/// What a coordinator is to its nodes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Role {
    /// Leads nodes without a coordinator.
    #[default]
    Leads,
    /// Displaces another that leads them.
    TakesOver,
    /// Reads what they report, and changes nothing.
    Observes,
}

/// What the nodes of a run and their coordinator agree on.
pub struct Agreement {
    settings: ProbeSettings,
    fps: f64,
    claim: Claim,
    role: Role,
    terms: Mutex<Terms>,
    cut: Mutex<Cut>,
    pub(crate) counters: Arc<ByteCounters>,
    pub(crate) dial: Arc<dyn Dial>,
}

/// What changes of it.
#[derive(Clone, Default)]
pub(crate) struct Terms {
    pub shapes: Vec<Arc<Shape>>,
    pub pace: Option<Pace>,
}

impl Agreement {
    /// The hull rule, frames per second, and the shapes that there will be questions about.
    pub fn new(settings: ProbeSettings, fps: f64, shapes: Vec<Arc<Shape>>) -> Agreement {
        let terms = Mutex::new(Terms { shapes, pace: None });
        let claim = claim_of_this_machine();
        Agreement {
            settings,
            fps,
            claim,
            role: Role::Leads,
            terms,
            cut: Mutex::default(),
            counters: Arc::default(),
            dial: Arc::new(Sockets::default()),
        }
    }

    /// Frames of the cluster per second.
    pub fn fps(&self) -> f64 {
        self.fps
    }

    /// The same for a coordinator in this role.
    pub fn with_role(self, role: Role) -> Agreement {
        Agreement { role, ..self }
    }

    /// The same over connections that are made like this.
    pub fn dialling(self, dial: Arc<dyn Dial>) -> Agreement {
        Agreement { dial, ..self }
    }

    /// Whether nodes are only observed.
    pub(crate) fn observes(&self) -> bool {
        self.role == Role::Observes
    }

    /// Replaces the shapes; nodes that come back receive these. Returns those that are new.
    pub fn replace_shapes(&self, shapes: Vec<Arc<Shape>>) -> Vec<Arc<Shape>> {
        let mut terms = self.terms();
        let is_new = |shape: &&Arc<Shape>| terms.shapes.iter().all(|old| old.digest() != shape.digest());
        let new = shapes.iter().filter(is_new).cloned().collect();
        terms.shapes = shapes;
        new
    }

    /// From now on nodes that come back begin a run of this pace.
    pub fn begin_run(&self, pace: Pace) {
        self.terms().pace = Some(pace);
        *self.cut() = Cut::default();
    }

    /// Whether what is reported of a run concerns us: once we have begun one, no other does.
    pub fn is_of_run(&self, run: u64) -> bool {
        self.terms().pace.is_none_or(|pace| pace.run == run)
    }

    /// Where film is cut into frames, by what nodes have reported of their cameras.
    pub(crate) fn cut(&self) -> MutexGuard<'_, Cut> {
        self.cut.lock()
    }

    /// The bytes of all connections so far.
    pub fn bytes(&self) -> ByteCounts {
        self.counters.read()
    }

    /// Our claim to a node whose lease has this term; 0 without a holder.
    pub(crate) fn claim(&self, held_term: u64) -> Claim {
        let over = if self.role == Role::TakesOver { held_term.saturating_add(1) } else { 0 };
        Claim { term: self.claim.term.max(over), ..self.claim.clone() }
    }

    /// The id by which nodes know us: 0, anonymous, for one that only observes.
    pub(crate) fn holder(&self) -> u64 {
        if self.observes() { 0 } else { self.claim.id }
    }

    pub(crate) fn terms(&self) -> MutexGuard<'_, Terms> {
        self.terms.lock()
    }

    /// Is this the node that the cluster file means?
    pub fn check(&self, expected: &ExpectedNode, found: &NodeDescription) -> Result<(), Mismatch> {
        if found.settings != self.settings {
            return Err(Mismatch::of_settings(&found.settings, &self.settings));
        }
        if found.fps != self.fps {
            return Err(Mismatch::FrameRate { found: found.fps, expected: self.fps });
        }
        for camera in &expected.cameras {
            let name = || camera.name.clone();
            // Names of a peer are cleaned, so that ours is compared cleaned too.
            let cleaned = clean(&camera.name, MAX_NAME_CHARS);
            let described = found.cameras.iter().find(|described| described.name == cleaned);
            let described = described.ok_or_else(|| Mismatch::NoCamera(name()))?;
            if described.calibration_digest != camera.calibration_digest {
                return Err(Mismatch::Calibration(name()));
            }
            if described.rig_index != camera.rig_index {
                let (found, expected) = (described.rig_index, camera.rig_index);
                return Err(Mismatch::Place { name: name(), found, expected });
            }
        }
        if found.cameras.len() != expected.cameras.len() {
            return Err(Mismatch::Count { found: found.cameras.len(), expected: expected.cameras.len() });
        }
        Ok(())
    }
}

/// A claim that no other process makes.
fn claim_of_this_machine() -> Claim {
    // Where the system has no random numbers, a process at a time is one too.
    let id = getrandom::u64().unwrap_or_else(|_| unix_now_s().to_bits() ^ u64::from(std::process::id()));
    let host = rustix::system::uname();
    let name = format!("the coordinator on {}", host.nodename().to_string_lossy());
    Claim { id: id.max(1), term: 1, name }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn described(name: &str) -> CameraDescription {
        CameraDescription { name: name.into(), rig_index: 1, size: (8, 8), calibration_digest: [0; 32] }
    }

    #[test]
    fn another_node_than_the_one_meant_is_refused_with_the_difference() {
        let agreement = Agreement::new(ProbeSettings::default(), 30.0, vec![]);
        let place = Address::Tcp("127.0.0.1:1".into()).into();
        let (cameras, expected_cameras) = (vec![described("left")], vec![]);
        let node = ExpectedNode { name: None, place, cameras, expected_cameras, is_endless: false };
        let description = || NodeDescription {
            version: "0".into(),
            cameras: vec![described("left")],
            settings: ProbeSettings::default(),
            fps: 30.0,
            term: 0,
        };
        assert_eq!(agreement.check(&node, &description()), Ok(()));
        type Change = fn(&mut NodeDescription);
        let changes: [(Change, &str); 5] = [
            (|node| node.fps = 25.0, "it films 25 frames/s, expected 30"),
            (|node| node.cameras[0].name = "top".into(), "it has no camera \"left\""),
            (
                |node| node.cameras[0].calibration_digest[0] = 1,
                "its calibration of camera \"left\" is not the rig's",
            ),
            (|node| node.cameras[0].rig_index = 2, "it has camera \"left\" at place 2, expected 1"),
            (|node| node.cameras.push(described("top")), "it has 2 cameras, expected 1"),
        ];
        for (change, expected) in changes {
            let mut found = description();
            change(&mut found);
            assert_eq!(agreement.check(&node, &found).expect_err(expected).to_string(), expected);
        }
    }
}
