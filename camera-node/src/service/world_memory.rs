//! The worlds that a node remembers for its coordinator: the last two that it was given, in memory alone.

use bytes::Bytes;
use parking_lot::{Mutex, MutexGuard};
use proto::{CheckpointError, open_checkpoint};

/// The last two checkpoints, each of them whole.
#[derive(Debug, Default)]
pub(super) struct WorldMemory(Mutex<KeptWorlds>);

/// The checkpoints of a node; empty where there is none.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct KeptWorlds {
    pub newest: Bytes,
    pub previous: Bytes,
}

impl WorldMemory {
    /// Keeps a checkpoint and the one before. The newest once more changes nothing. One that is too long or not whole is refused,
    /// and those before stay.
    pub fn keep(&self, checkpoint: &[u8]) -> Result<(), CheckpointError> {
        open_checkpoint(checkpoint)?;
        // A copy: what was received may be a small part of a large buffer.
        let newest = Bytes::copy_from_slice(checkpoint);
        let mut kept = self.locked();
        if kept.newest == newest {
            return Ok(());
        }
        let previous = std::mem::take(&mut kept.newest);
        *kept = KeptWorlds { newest, previous };
        Ok(())
    }

    /// What it remembers.
    pub fn kept(&self) -> KeptWorlds {
        self.locked().clone()
    }

    fn locked(&self) -> MutexGuard<'_, KeptWorlds> {
        self.0.lock()
    }
}

#[cfg(test)]
mod tests {
    use proto::{MAX_CHECKPOINT_BYTES, seal_checkpoint};

    use super::*;

    #[test]
    fn the_last_two_whole_checkpoints_are_kept_and_no_other() {
        let memory = WorldMemory::default();
        assert_eq!(memory.kept(), KeptWorlds::default());
        let sealed = |text: &str| Bytes::from(seal_checkpoint(text.as_bytes()).expect("short"));
        let (first, second, third) = (sealed("first"), sealed("second"), sealed("third"));
        memory.keep(&first).expect("whole");
        assert_eq!(memory.kept(), KeptWorlds { newest: first, previous: Bytes::new() });
        memory.keep(&second).expect("whole");
        memory.keep(&third).expect("whole");
        let kept = KeptWorlds { newest: third, previous: second.clone() };
        assert_eq!(memory.kept(), kept);
        memory.keep(&kept.newest).expect("whole");
        assert_eq!(memory.kept(), kept, "the same once more");
        memory.keep(&second[..second.len() / 2]).expect_err("cut in half");
        let long = memory.keep(&vec![0; MAX_CHECKPOINT_BYTES + 1]).expect_err("too long");
        assert_eq!(long.to_string(), "a checkpoint of 1048577 bytes, expected at most 1048576");
        assert_eq!(memory.kept(), kept, "a refused checkpoint replaces none");
    }
}
