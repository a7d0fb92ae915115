//! What a node that lies says it remembers: a world that was made of an honest one.

use bytes::Bytes;
use prost::Message;
use proto::{open_checkpoint, seal_checkpoint};
use sim::{BodySnapshot, WorldSnapshot};
use world_encodings::{world_from_bytes, world_to_bytes};

/// Steps that the poisoned world claims to have made.
const CLAIMED_STEPS: u64 = 1_000_000;

/// The contents of a checkpoint as its coordinator writes them; the world is a message of its own.
#[derive(Clone, PartialEq, Message)]
struct Kept {
    #[prost(bytes = "vec", tag = "1")]
    rig: Vec<u8>,
    #[prost(bytes = "vec", tag = "2")]
    scene: Vec<u8>,
    #[prost(fixed64, tag = "3")]
    run: u64,
    #[prost(uint64, tag = "4")]
    term: u64,
    #[prost(uint64, tag = "5")]
    sequence: u64,
    #[prost(double, tag = "6")]
    kept_unix_s: f64,
    #[prost(bytes = "vec", tag = "7")]
    world: Vec<u8>,
}

/// How a remembered world is poisoned.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Poison {
    /// A later second of the same run.
    Later,
    /// Of the next run.
    NextTerm,
    /// Of the last run there can be.
    LastTerm,
    /// A later second, and no other world beside it.
    Twice,
}

impl Poison {
    pub const ALL: [Poison; 4] = [Poison::Later, Poison::NextTerm, Poison::LastTerm, Poison::Twice];

    /// Poisons the newest and the previous checkpoint of an honest node.
    pub fn spoil(self, newest: &Bytes, previous: Bytes) -> (Bytes, Bytes) {
        if newest.is_empty() {
            return (Bytes::new(), previous);
        }
        let poisoned = self.poisoned(newest);
        let previous = if self == Poison::Twice { poisoned.clone() } else { previous };
        (poisoned, previous)
    }

    /// A hundred bodies at one place, which move, in a run that is newer than the honest one.
    fn poisoned(self, checkpoint: &[u8]) -> Bytes {
        let mut kept = Kept::decode(open_checkpoint(checkpoint).expect("whole")).expect("a message");
        match self {
            Poison::Later | Poison::Twice => kept.sequence += 1000,
            Poison::NextTerm => kept.term += 1,
            Poison::LastTerm => kept.term = u64::MAX,
        }
        let world = world_from_bytes(&kept.world).expect("a world");
        let first = world.bodies()[0].clone();
        let body = |id| {
            let mut body = BodySnapshot { id, ..first.clone() };
            body.spec.name = format!("poison_{id}");
            body.spec.velocity_m_s = [0.0, 30.0, 0.0];
            body
        };
        let (scene, parameters) = (world.scene().clone(), world.parameters());
        let bodies = (0..100).map(body).collect();
        let world = WorldSnapshot::new(scene, parameters, CLAIMED_STEPS, 100, bodies).expect("possible");
        kept.world = world_to_bytes(&world);
        seal_checkpoint(&kept.encode_to_vec()).expect("short").into()
    }
}
