//! Which of the worlds that nodes remember a coordinator goes on from. Plain decisions: a node may hand out any bytes.

use std::collections::{BTreeMap, BTreeSet};

use bytes::Bytes;
use sim::Scene;
use thiserror::Error;

use super::checkpoint::{Checkpoint, MAX_TERM, Place, ReadError};

/// Nodes that must have the same bytes before they are read, in a room of two nodes or more.
const WITNESSES: usize = 2;

/// Terms of checkpoints that only one node has count up to so far above the highest that two nodes have: a coordinator may have
/// reached one node alone before it was killed, but a node may also claim any term.
const MAX_TERMS_AHEAD: u64 = 1 << 16;

/// What a run may go on in: before the same cameras, from the scene with which it begins.
#[derive(Clone, Debug)]
pub(crate) struct Home {
    place: Place,
    scene: Scene,
}

/// Why a coordinator does not go on from what nodes remember. Every message is one line.
#[derive(Debug, PartialEq, Error)]
pub(crate) enum Unfit {
    #[error("no two nodes remember the same one")]
    Disputed,
    #[error(transparent)]
    Unreadable(#[from] ReadError),
    #[error("it is of another rig")]
    Rig,
    #[error("it began with another scene, or with this one before it was edited")]
    Scene,
    #[error("its scene `{0}` is neither the run's own nor one that comes with the program")]
    UnknownScene(String),
}

/// What was found in the memory of the nodes.
#[derive(Debug, Default)]
pub(crate) struct Recalled {
    /// The newest that the run can go on from.
    pub newest: Option<Checkpoint>,
    /// The highest term that counts; 0 without any. The run's own is the next.
    pub highest_term: u64,
    /// Why something was passed over.
    pub unfit: Option<Unfit>,
}

impl Home {
    pub fn new(place: Place, scene: &Scene) -> Home {
        Home { place, scene: scene.clone() }
    }

    pub fn place(&self) -> Place {
        self.place
    }

    /// Whether a run of this home can go on from a checkpoint. A node may write what it likes, so the scene that Reset leads
    /// back to must be known here: the run's own, or one that followers may choose.
    fn check(&self, found: &Checkpoint) -> Result<(), Unfit> {
        if found.place.rig != self.place.rig {
            return Err(Unfit::Rig);
        }
        if found.place.scene != self.place.scene {
            return Err(Unfit::Scene);
        }
        let scene = found.world.scene();
        let shipped =
            || Scene::named(scene.name()).and_then(|scene| scene.with_gravity(self.scene.gravity_m_s2()));
        if scene.digest() == self.scene.digest()
            || shipped().is_ok_and(|shipped| shipped.digest() == scene.digest())
        {
            return Ok(());
        }
        Err(Unfit::UnknownScene(scene.name().to_owned()))
    }

    /// The newest world to go on from, of what each node of a room remembers.
    pub fn recall(&self, nodes: &[Vec<Bytes>]) -> Recalled {
        let (witnessed, is_disputed) = witnessed(nodes);
        let mut recalled = Recalled { unfit: is_disputed.then_some(Unfit::Disputed), ..Recalled::default() };
        for bytes in witnessed {
            let fit = Checkpoint::from_bytes(bytes).map_err(Unfit::from).and_then(|found| {
                recalled.highest_term = recalled.highest_term.max(found.kept.term);
                self.check(&found).map(|()| found)
            });
            match (fit, &recalled.newest) {
                (Ok(found), Some(newest)) if newest.kept.is_after(&found.kept) => {}
                (Ok(found), _) => recalled.newest = Some(found),
                (Err(why), _) => recalled.unfit = Some(why),
            }
        }
        let known = recalled.highest_term.saturating_add(MAX_TERMS_AHEAD);
        let claimed = nodes.iter().flatten().filter_map(|bytes| Checkpoint::claimed_term(bytes));
        recalled.highest_term =
            claimed.filter(|&term| term <= known).fold(recalled.highest_term, u64::max).min(MAX_TERM - 1);
        recalled
    }
}

/// The checkpoints that enough nodes of a room have, each once, and whether others were passed over and none was left. A
/// single node is its own witness: it has all there is.
fn witnessed(nodes: &[Vec<Bytes>]) -> (Vec<&Bytes>, bool) {
    let mut witnesses: BTreeMap<&Bytes, usize> = BTreeMap::new();
    for node in nodes {
        let distinct: BTreeSet<&Bytes> = node.iter().collect();
        distinct.into_iter().for_each(|bytes| *witnesses.entry(bytes).or_default() += 1);
    }
    let is_empty = witnesses.is_empty();
    witnesses.retain(|_, &mut count| count >= WITNESSES.min(nodes.len()));
    let is_disputed = !is_empty && witnesses.is_empty();
    (witnesses.into_keys().collect(), is_disputed)
}
