//! A silhouette as compact bytes: run deltas as variable-length integers, then an LZ4 block.
//!
//! ```text
//! u32 width | u32 height | u32 raw length | LZ4 block of: per row  count, then per run  gap, length − 1
//! ```
//! `gap` is the distance from the end of the run before (less one after the first, since runs do not
//! touch). Integers are little-endian; the counts are LEB128.

use thiserror::Error;

use super::{Run, Silhouette, SilhouetteBuilder, SilhouetteError};

const HEADER_BYTES: usize = 12;

/// Why bytes are no silhouette.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum DecodeError {
    /// The bytes end too early.
    #[error("silhouette bytes end after {found} bytes, expected more")]
    Truncated {
        /// Bytes given, or raw bytes after decompression.
        found: usize,
    },
    /// Bytes are left over after the last row.
    #[error("{left} bytes left after the last row")]
    Trailing {
        /// Number of bytes left.
        left: usize,
    },
    /// Another size than the camera's.
    #[error("silhouette of {} x {} pixels, expected {} x {}", found.0, found.1, expected.0, expected.1)]
    Size {
        /// Width and height claimed.
        found: (u32, u32),
        /// Width and height expected.
        expected: (u32, u32),
    },
    /// The claimed raw length cannot be.
    #[error("silhouette claims {claimed} raw bytes, at most {limit} are possible")]
    Claim {
        /// Raw bytes claimed.
        claimed: usize,
        /// The most that this size and these bytes can hold.
        limit: usize,
    },
    /// LZ4 says no.
    #[error("silhouette does not decompress: {0}")]
    Compression(String),
    /// An integer is too long.
    #[error("a number of row {row} is larger than any column")]
    Number {
        /// Index of the row.
        row: u32,
    },
    /// Runs that make no silhouette.
    #[error(transparent)]
    Runs(#[from] SilhouetteError),
}

impl Silhouette {
    /// The compact bytes.
    pub fn encode(&self) -> Vec<u8> {
        let mut raw = Vec::with_capacity(self.run_count() * 3 + self.height() as usize);
        for row in 0..self.height() {
            let runs = self.row(row);
            push_number(&mut raw, runs.len() as u32);
            let mut after = 0;
            for (index, run) in runs.iter().enumerate() {
                push_number(&mut raw, u32::from(run.start) - after - u32::from(index > 0));
                push_number(&mut raw, u32::from(run.end - run.start) - 1);
                after = u32::from(run.end);
            }
        }
        let mut bytes = Vec::with_capacity(HEADER_BYTES + raw.len() / 2);
        for number in [self.width(), self.height(), raw.len() as u32] {
            bytes.extend_from_slice(&number.to_le_bytes());
        }
        bytes.extend_from_slice(&lz4_flex::block::compress(&raw));
        bytes
    }

    /// The silhouette of compact bytes from an untrusted sender, which must be of the expected size.
    /// Memory stays within what `expected` and the length of `bytes` allow, whatever they claim.
    pub fn decode(bytes: &[u8], expected: (u32, u32)) -> Result<Silhouette, DecodeError> {
        if bytes.len() < HEADER_BYTES {
            return Err(DecodeError::Truncated { found: bytes.len() });
        }
        let word = |at: usize| u32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]]);
        let found = (word(0), word(4));
        if found != expected {
            return Err(DecodeError::Size { found, expected });
        }
        let builder = SilhouetteBuilder::new(found.0, found.1)?;
        let block = &bytes[HEADER_BYTES..];
        let claimed = word(8) as usize;
        // Every second pixel a run is the worst row: two numbers of up to three bytes a run. And LZ4
        // never shrinks more than 255 to 1.
        let worst_row = 3 + 6 * (found.0 as usize / 2 + 1);
        let limit = (worst_row * found.1 as usize).min(block.len().saturating_mul(255) + 64);
        if claimed > limit {
            return Err(DecodeError::Claim { claimed, limit });
        }
        let raw = lz4_flex::block::decompress(block, claimed)
            .map_err(|error| DecodeError::Compression(error.to_string()))?;
        rows_from_raw(&raw, builder)
    }
}

fn rows_from_raw(raw: &[u8], mut builder: SilhouetteBuilder) -> Result<Silhouette, DecodeError> {
    let (width, height) = (builder.width, builder.height);
    let mut reader = Reader { raw, at: 0 };
    let mut runs: Vec<Run> = Vec::new();
    for row in 0..height {
        runs.clear();
        let count = reader.number(row)?;
        if count > width / 2 + 1 {
            return Err(DecodeError::Number { row });
        }
        let mut after = 0;
        for index in 0..count {
            let start = after + reader.number(row)? + u32::from(index > 0);
            let end = start + reader.number(row)? + 1;
            if end > width {
                return Err(SilhouetteError::Run { row, start, end, after, width }.into());
            }
            runs.push(Run { start: start as u16, end: end as u16 });
            after = end;
        }
        builder.push_runs(&runs)?;
    }
    if reader.at != raw.len() {
        return Err(DecodeError::Trailing { left: raw.len() - reader.at });
    }
    Ok(builder.finish()?)
}

fn push_number(bytes: &mut Vec<u8>, mut number: u32) {
    while number >= 0x80 {
        bytes.push(number as u8 | 0x80);
        number >>= 7;
    }
    bytes.push(number as u8);
}

struct Reader<'a> {
    raw: &'a [u8],
    at: usize,
}

impl Reader<'_> {
    /// The next number, at most 21 bits long.
    fn number(&mut self, row: u32) -> Result<u32, DecodeError> {
        let mut number = 0;
        for shift in [0, 7, 14] {
            let byte = *self.raw.get(self.at).ok_or(DecodeError::Truncated { found: self.raw.len() })?;
            self.at += 1;
            number |= u32::from(byte & 0x7f) << shift;
            if byte < 0x80 {
                return Ok(number);
            }
        }
        Err(DecodeError::Number { row })
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{drawn, random_mask};
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn each_way_to_lie_has_its_name() {
        let good = drawn(&["..##.#", "######", "......"]);
        let bytes = good.encode();
        assert_eq!(Silhouette::decode(&bytes, (6, 3)), Ok(good));
        assert!(matches!(Silhouette::decode(&bytes, (6, 4)), Err(DecodeError::Size { .. })));
        assert!(matches!(Silhouette::decode(&bytes[..5], (6, 3)), Err(DecodeError::Truncated { .. })));
        let mut claim = bytes.clone();
        claim[8..12].copy_from_slice(&u32::MAX.to_le_bytes());
        assert!(matches!(Silhouette::decode(&claim, (6, 3)), Err(DecodeError::Claim { .. })));
        let pack = |raw: &[u8]| {
            let mut bytes = vec![6, 0, 0, 0, 3, 0, 0, 0, raw.len() as u8, 0, 0, 0];
            bytes.extend(lz4_flex::block::compress(raw));
            Silhouette::decode(&bytes, (6, 3))
        };
        assert!(matches!(pack(&[0, 0]), Err(DecodeError::Truncated { .. })), "a row is missing");
        assert!(matches!(pack(&[0, 0, 0, 0]), Err(DecodeError::Trailing { left: 1 })));
        assert!(matches!(pack(&[1, 4, 2, 0, 0]), Err(DecodeError::Runs(_))), "a run leaves the image");
        assert!(matches!(pack(&[200, 1, 0, 0]), Err(DecodeError::Number { row: 0 })), "more runs than fit");
        assert!(matches!(pack(&[1, 0xff, 0xff, 0xff, 0, 0, 0]), Err(DecodeError::Number { row: 0 })));
    }

    proptest! {
        #[test]
        fn silhouettes_survive_the_bytes(width in 1u32..300, height in 1u32..30, seed in any::<u64>()) {
            let silhouette =
                Silhouette::from_mask(width, height, &random_mask(width, height, seed)).expect("size");
            prop_assert_eq!(Silhouette::decode(&silhouette.encode(), (width, height)), Ok(silhouette));
        }

        #[test]
        fn any_bytes_are_answered_without_panic(mut bytes in proptest::collection::vec(any::<u8>(), 0..200)) {
            if bytes.len() >= 12 {
                bytes[..12].copy_from_slice(&[9, 0, 0, 0, 7, 0, 0, 0, 40, 0, 0, 0]);
            }
            let _ = Silhouette::decode(&bytes, (9, 7));
        }

        #[test]
        fn a_flipped_byte_never_makes_an_invalid_silhouette(seed in any::<u64>(), at in 0usize..400, bit in 0u8..8) {
            let silhouette = Silhouette::from_mask(64, 32, &random_mask(64, 32, seed)).expect("size");
            let mut bytes = silhouette.encode();
            let at = at % bytes.len();
            bytes[at] ^= 1 << bit;
            if let Ok(other) = Silhouette::decode(&bytes, (64, 32)) {
                prop_assert_eq!(Silhouette::from_mask(64, 32, &other.to_mask()), Ok(other));
            }
        }
    }
}
