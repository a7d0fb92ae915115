//! How a world travels to the nodes that keep it: a head that says what it is and how long, what the coordinator wrote,
//! and the digest of all before it. Nodes check that it is whole; what is in it only the coordinator knows.
//!
//! Bytes, little-endian: `HTWORLD\n`, the version (u32), the length of the contents (u32), the contents, and the BLAKE3
//! digest (32 bytes) of all that.

use thiserror::Error;

/// The longest checkpoint, all of it: a thousand bodies take a fifth.
pub const MAX_CHECKPOINT_BYTES: usize = 1 << 20;

const MAGIC: [u8; 8] = *b"HTWORLD\n";
const VERSION: u32 = 1;
const HEAD_BYTES: usize = 16;
const DIGEST_BYTES: usize = 32;
const MAX_CONTENT_BYTES: usize = MAX_CHECKPOINT_BYTES - HEAD_BYTES - DIGEST_BYTES;

/// Why bytes are no checkpoint. Every message is one line.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum CheckpointError {
    /// It does not begin as one.
    #[error("no checkpoint of a world: it begins otherwise")]
    Magic,
    /// Another version of the format.
    #[error("a checkpoint of version {found}, expected {VERSION}")]
    Version {
        /// The version that was found.
        found: u32,
    },
    /// More than any checkpoint has.
    #[error("a checkpoint of {found} bytes, expected at most {MAX_CHECKPOINT_BYTES}")]
    TooLong {
        /// Bytes, or what its head announces.
        found: u64,
    },
    /// Fewer or more bytes than it says.
    #[error("a checkpoint of {found} bytes, expected {expected}")]
    Length {
        /// Bytes found.
        found: usize,
        /// Bytes expected.
        expected: usize,
    },
    /// Bytes have changed.
    #[error("a checkpoint whose digest is wrong: its bytes have changed")]
    Digest,
}

/// The checkpoint with these contents.
pub fn seal_checkpoint(contents: &[u8]) -> Result<Vec<u8>, CheckpointError> {
    let too_long = CheckpointError::TooLong { found: (contents.len() + HEAD_BYTES + DIGEST_BYTES) as u64 };
    let length = u32::try_from(contents.len()).map_err(|_| too_long.clone())?;
    if contents.len() > MAX_CONTENT_BYTES {
        return Err(too_long);
    }
    let mut bytes = Vec::with_capacity(contents.len() + HEAD_BYTES + DIGEST_BYTES);
    bytes.extend_from_slice(&MAGIC);
    bytes.extend_from_slice(&VERSION.to_le_bytes());
    bytes.extend_from_slice(&length.to_le_bytes());
    bytes.extend_from_slice(contents);
    let digest = blake3::hash(&bytes);
    bytes.extend_from_slice(digest.as_bytes());
    Ok(bytes)
}

/// The contents of a checkpoint, if it is whole.
pub fn open_checkpoint(bytes: &[u8]) -> Result<&[u8], CheckpointError> {
    if bytes.len() > MAX_CHECKPOINT_BYTES {
        return Err(CheckpointError::TooLong { found: bytes.len() as u64 });
    }
    let cut = |expected| CheckpointError::Length { found: bytes.len(), expected };
    let begins = bytes.len().min(MAGIC.len());
    if bytes[..begins] != MAGIC[..begins] {
        return Err(CheckpointError::Magic);
    }
    let least = cut(HEAD_BYTES + DIGEST_BYTES);
    let (_, rest) = bytes.split_first_chunk::<8>().ok_or_else(|| least.clone())?;
    let (version, rest) = rest.split_first_chunk::<4>().ok_or_else(|| least.clone())?;
    let version = u32::from_le_bytes(*version);
    if version != VERSION {
        return Err(CheckpointError::Version { found: version });
    }
    let (length, rest) = rest.split_first_chunk::<4>().ok_or(least)?;
    let length = u32::from_le_bytes(*length);
    let announced = u64::from(length) + (HEAD_BYTES + DIGEST_BYTES) as u64;
    // Compared as it was announced, before anything is made of it.
    let expected = usize::try_from(announced).ok().filter(|&bytes| bytes <= MAX_CHECKPOINT_BYTES);
    let expected = expected.ok_or(CheckpointError::TooLong { found: announced })?;
    if bytes.len() != expected {
        return Err(cut(expected));
    }
    let (before, digest) = bytes.split_at(expected - DIGEST_BYTES);
    if blake3::hash(before).as_bytes() != digest {
        return Err(CheckpointError::Digest);
    }
    Ok(&rest[..length as usize])
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn sealed() -> Vec<u8> {
        seal_checkpoint(b"a world").expect("short")
    }

    #[test]
    fn what_was_sealed_is_opened() {
        assert_eq!(open_checkpoint(&sealed()), Ok(&b"a world"[..]));
        assert_eq!(open_checkpoint(&seal_checkpoint(b"").expect("short")), Ok(&b""[..]));
        let most = vec![7; MAX_CONTENT_BYTES];
        let bytes = seal_checkpoint(&most).expect("just short enough");
        assert_eq!((bytes.len(), open_checkpoint(&bytes)), (MAX_CHECKPOINT_BYTES, Ok(&most[..])));
    }

    #[test]
    fn a_world_beyond_the_bound_is_not_sealed() {
        let error = seal_checkpoint(&vec![0; MAX_CONTENT_BYTES + 1]).expect_err("too long").to_string();
        assert_eq!(error, "a checkpoint of 1048577 bytes, expected at most 1048576");
    }

    #[test]
    fn a_checkpoint_cut_in_half_is_refused() {
        let bytes = sealed();
        for end in 8..bytes.len() {
            let error = open_checkpoint(&bytes[..end]).expect_err("cut");
            let expected = if end < HEAD_BYTES { HEAD_BYTES + DIGEST_BYTES } else { bytes.len() };
            assert_eq!(error, CheckpointError::Length { found: end, expected });
        }
        assert!(open_checkpoint(&[]).is_err());
        let half = open_checkpoint(&bytes[..bytes.len() / 2]).expect_err("cut").to_string();
        assert_eq!(half, "a checkpoint of 27 bytes, expected 55");
    }

    #[test]
    fn a_checkpoint_with_more_behind_it_is_refused() {
        let mut bytes = sealed();
        bytes.push(0);
        assert_eq!(open_checkpoint(&bytes), Err(CheckpointError::Length { found: 56, expected: 55 }));
        let error = open_checkpoint(&vec![0; MAX_CHECKPOINT_BYTES + 1]).expect_err("too long");
        assert_eq!(error, CheckpointError::TooLong { found: 1_048_577 });
    }

    #[test]
    fn another_version_is_refused_by_its_number() {
        let mut bytes = sealed();
        bytes[8] = 2;
        assert_eq!(
            open_checkpoint(&bytes).expect_err("newer").to_string(),
            "a checkpoint of version 2, expected 1"
        );
    }

    #[test]
    fn something_else_is_refused() {
        let mut bytes = sealed();
        bytes[0] = b'h';
        assert_eq!(open_checkpoint(&bytes), Err(CheckpointError::Magic));
        assert_eq!(open_checkpoint(b"PNG"), Err(CheckpointError::Magic));
    }

    #[test]
    fn four_announced_gigabytes_are_refused_before_anything_is_made_of_them() {
        let mut bytes = sealed();
        bytes[12..16].copy_from_slice(&u32::MAX.to_le_bytes());
        assert_eq!(
            open_checkpoint(&bytes).expect_err("too long").to_string(),
            "a checkpoint of 4294967343 bytes, expected at most 1048576"
        );
    }

    #[test]
    fn a_wrong_digest_is_refused() {
        let mut bytes = sealed();
        bytes[20] ^= 1;
        assert_eq!(open_checkpoint(&bytes), Err(CheckpointError::Digest));
    }

    proptest! {
        #[test]
        fn bytes_that_were_changed_are_always_refused(
            contents in proptest::collection::vec(any::<u8>(), 0..300),
            changes in proptest::collection::vec((any::<proptest::sample::Index>(), 1..=255u8), 1..4),
        ) {
            let whole = seal_checkpoint(&contents).expect("short");
            let mut bytes = whole.clone();
            for (place, by) in changes {
                let place = place.index(bytes.len());
                bytes[place] ^= by;
            }
            // Two changes at one place may undo each other.
            prop_assert_eq!(open_checkpoint(&bytes).is_ok(), bytes == whole);
        }

        #[test]
        fn any_bytes_are_opened_or_refused(bytes in proptest::collection::vec(any::<u8>(), 0..200)) {
            prop_assert!(open_checkpoint(&bytes).is_err());
        }
    }
}
