//! A world with what says whose it is: the contents of a checkpoint, and which of several a coordinator goes on from.

use hull::Observer;
use prost::Message as _;
use proto::{CheckpointError, open_checkpoint, seal_checkpoint};
use sim::WorldSnapshot;
use std::sync::Arc;
use thiserror::Error;

use super::message::Kept;
use super::world_bytes::{WorldBytesError, world_from_message, world_to_message};

/// A world that nodes remember.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Checkpoint {
    /// What it can go on in.
    pub place: Place,
    /// When it was kept.
    pub kept: Moment,
    /// The world.
    pub world: WorldSnapshot,
}

/// Where a world can go on: before the same cameras, in a run that begins with the same scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Place {
    /// BLAKE3 of the calibration digests of all cameras in rig order.
    pub rig: [u8; 32],
    /// The digest of the scene with which the run begins, whatever scene somebody chose later.
    pub scene: [u8; 32],
}

/// When a world was kept. A later one is greater, whatever wall clocks say.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Moment {
    /// One above the highest that the nodes remembered when the run began: no clock tells which run is the later.
    pub term: u64,
    /// Drawn when the run began.
    pub run: u64,
    /// Counts the checkpoints of the run.
    pub sequence: u64,
    /// When this one was made, unix seconds.
    pub unix_s: f64,
}

/// Why bytes make no world to go on from. Every message is one line.
#[derive(Clone, Debug, PartialEq, Error)]
pub(crate) enum ReadError {
    /// They are no whole checkpoint.
    #[error(transparent)]
    Checkpoint(#[from] CheckpointError),
    /// Its world cannot be.
    #[error("a checkpoint of no world: {0}")]
    World(#[from] WorldBytesError),
    /// A digest or a time that cannot be.
    #[error("a checkpoint with a wrong {0}")]
    Field(&'static str),
}

impl Place {
    /// The place of a run.
    pub fn of(observers: &[Arc<Observer>], scene: &sim::Scene) -> Place {
        let mut rig = blake3::Hasher::new();
        for observer in observers {
            rig.update(&observer.camera().digest());
        }
        Place { rig: rig.finalize().into(), scene: scene.digest() }
    }
}

impl Moment {
    /// Whether this is newer than another.
    pub fn is_after(&self, other: &Moment) -> bool {
        let Moment { term, run, sequence, unix_s: _ } = *self;
        (term, sequence, run) > (other.term, other.sequence, other.run)
    }
}

impl Checkpoint {
    /// As bytes, with their digest; fails if they are more than nodes keep.
    pub fn to_bytes(&self) -> Result<Vec<u8>, CheckpointError> {
        let Checkpoint { place, kept, world } = self;
        let message = Kept {
            rig: place.rig.to_vec(),
            scene: place.scene.to_vec(),
            run: kept.run,
            term: kept.term,
            sequence: kept.sequence,
            kept_unix_s: kept.unix_s,
            world: Some(world_to_message(world)),
        };
        seal_checkpoint(&message.encode_to_vec())
    }

    /// The checkpoint of such bytes, every number of it checked.
    pub fn from_bytes(bytes: &[u8]) -> Result<Checkpoint, ReadError> {
        let message = Kept::decode(open_checkpoint(bytes)?).map_err(WorldBytesError::from)?;
        let Kept { rig, scene, run, term, sequence, kept_unix_s, world } = message;
        let digest = |field, bytes: Vec<u8>| bytes.try_into().map_err(|_| ReadError::Field(field));
        let place = Place { rig: digest("rig", rig)?, scene: digest("scene", scene)? };
        if !kept_unix_s.is_finite() {
            return Err(ReadError::Field("time"));
        }
        let kept = Moment { term, run, sequence, unix_s: kept_unix_s };
        let world = world_from_message(world.ok_or(WorldBytesError::Missing("world"))?)?;
        Ok(Checkpoint { place, kept, world })
    }
}

/// The newest of some checkpoints that can go on in a place, if any can.
pub(crate) fn newest_of(place: Place, found: Vec<Checkpoint>) -> Option<Checkpoint> {
    let fitting = found.into_iter().filter(|checkpoint| checkpoint.place == place);
    fitting.reduce(|best, other| if other.kept.is_after(&best.kept) { other } else { best })
}
