//! A world with what says whose it is: the contents of a checkpoint, and which of several a coordinator goes on from.

use hull::Observer;
use prost::Message as _;
use proto::codec::{Entries, TooManyEntries, check_entries};
use proto::{CheckpointError, open_checkpoint, seal_checkpoint};
use sim::WorldSnapshot;
use sim::scene::MAX_BODIES;
use std::sync::Arc;
use thiserror::Error;
use world_encodings::WorldBytesError;
use world_encodings::checkpoint::{world_from_message, world_to_message};

use super::message::{Kept, KeptTerm};

/// No term is higher: coordinators count their starts. A higher one would end the order of worlds.
pub(super) const MAX_TERM: u64 = 1 << 62;
/// Bodies and their forms are counted before a message is decoded: an empty one takes two bytes in it and two hundred in memory.
const ENTRIES: [Entries; 2] = [
    Entries::new("Kept.world.solids", &[7, 10], MAX_BODIES),
    Entries::new("Kept.world.bodies", &[7, 11], MAX_BODIES),
];

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
    /// The digest of the scene with which the run begins, whatever scene was chosen later.
    pub scene: [u8; 32],
}

/// When a world was kept. A later one is greater, whatever wall clocks say.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Moment {
    /// One above the highest that the nodes remembered when the run began: no clock tells which run is the later. At most
    /// [`MAX_TERM`].
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
    /// More bodies, or forms of them, than a world has.
    #[error("a checkpoint of no world: {0}")]
    Entries(#[from] TooManyEntries),
    /// Its world cannot be.
    #[error("a checkpoint of no world: {0}")]
    World(#[from] WorldBytesError),
    /// Above what any coordinator has reached.
    #[error("a checkpoint of term {found}, expected at most {MAX_TERM}")]
    Term {
        /// Its term.
        found: u64,
    },
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

    /// The term that such bytes claim; nothing else of them is read.
    pub fn claimed_term(bytes: &[u8]) -> Option<u64> {
        let KeptTerm { term } = KeptTerm::decode(open_checkpoint(bytes).ok()?).ok()?;
        Some(term)
    }

    /// The checkpoint of such bytes, every number of it checked.
    pub fn from_bytes(bytes: &[u8]) -> Result<Checkpoint, ReadError> {
        let contents = open_checkpoint(bytes)?;
        check_entries(&ENTRIES, contents)?;
        let message = Kept::decode(contents).map_err(WorldBytesError::from)?;
        let Kept { rig, scene, run, term, sequence, kept_unix_s, world } = message;
        let digest = |field, bytes: Vec<u8>| bytes.try_into().map_err(|_| ReadError::Field(field));
        let place = Place { rig: digest("rig", rig)?, scene: digest("scene", scene)? };
        if !kept_unix_s.is_finite() {
            return Err(ReadError::Field("time"));
        }
        if term > MAX_TERM {
            return Err(ReadError::Term { found: term });
        }
        let kept = Moment { term, run, sequence, unix_s: kept_unix_s };
        let world = world_from_message(world.ok_or(WorldBytesError::Missing("world"))?)?;
        Ok(Checkpoint { place, kept, world })
    }
}
