//! The world that a node remembers for its coordinator: the newest it was given, in memory alone.

use std::sync::{Mutex, MutexGuard, PoisonError};

use bytes::Bytes;
use proto::{CheckpointError, open_checkpoint};

/// One checkpoint at most, and that a whole one.
#[derive(Debug, Default)]
pub(super) struct WorldMemory(Mutex<Bytes>);

impl WorldMemory {
    /// Keeps a checkpoint in the place of the one before. One that is too long or not whole is refused, and the one
    /// before stays.
    pub fn keep(&self, checkpoint: &[u8]) -> Result<(), CheckpointError> {
        open_checkpoint(checkpoint)?;
        // A copy: what was received may be a small part of a large buffer.
        *self.newest_kept() = Bytes::copy_from_slice(checkpoint);
        Ok(())
    }

    /// The newest; empty if there is none.
    pub fn newest(&self) -> Bytes {
        self.newest_kept().clone()
    }

    fn newest_kept(&self) -> MutexGuard<'_, Bytes> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use proto::{MAX_CHECKPOINT_BYTES, seal_checkpoint};

    use super::*;

    #[test]
    fn the_newest_whole_checkpoint_is_kept_and_no_other() {
        let memory = WorldMemory::default();
        assert!(memory.newest().is_empty());
        let sealed = |text: &str| Bytes::from(seal_checkpoint(text.as_bytes()).expect("short"));
        let (first, second) = (sealed("first"), sealed("second"));
        memory.keep(&first).expect("whole");
        memory.keep(&second).expect("whole");
        assert_eq!(memory.newest(), second);
        memory.keep(&second[..second.len() / 2]).expect_err("cut in half");
        let long = memory.keep(&vec![0; MAX_CHECKPOINT_BYTES + 1]).expect_err("too long");
        assert_eq!(long.to_string(), "a checkpoint of 1048577 bytes, expected at most 1048576");
        assert_eq!(memory.newest(), second, "what was refused takes nothing's place");
    }
}
