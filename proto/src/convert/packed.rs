//! Bytes as they are, or compressed where that is smaller; the first byte says which.

use bytes::Bytes;

use super::ConvertError;
use super::bulk::Field;

const PLAIN: u8 = 0;
const LZ4: u8 = 1;

/// Below this LZ4 finds nothing worth its tokens.
const LEAST_BYTES: usize = 24;

/// Packs bytes; nothing stays nothing.
pub(super) fn pack(plain: &[u8]) -> Bytes {
    if plain.is_empty() {
        return Bytes::new();
    }
    store(plain, PLAIN, LZ4).into()
}

/// The bytes behind `tag`, or compressed behind `tag_lz4` if that is shorter.
pub(super) fn store(plain: &[u8], tag: u8, tag_lz4: u8) -> Vec<u8> {
    if plain.len() >= LEAST_BYTES {
        let room = lz4_flex::block::get_maximum_output_size(plain.len());
        let mut bytes = vec![0; 1 + room];
        bytes[0] = tag_lz4;
        // It cannot fail with so much room; if it does, the bytes go as they are.
        if let Ok(length) = lz4_flex::block::compress_into(plain, &mut bytes[1..])
            && length < plain.len()
        {
            bytes.truncate(1 + length);
            return bytes;
        }
    }
    let mut bytes = Vec::with_capacity(1 + plain.len());
    bytes.push(tag);
    bytes.extend_from_slice(plain);
    bytes
}

/// What [`pack`] packed, if it is exactly so long.
pub(super) fn unpack_exactly(bytes: &[u8], length: usize, field: Field) -> Result<Vec<u8>, ConvertError> {
    let plain = unpack_at_most(bytes, length, field)?;
    field.check_length(plain.len(), length)?;
    Ok(plain)
}

/// What [`pack`] packed, of at most so many bytes.
pub(super) fn unpack_at_most(bytes: &[u8], most: usize, field: Field) -> Result<Vec<u8>, ConvertError> {
    match bytes.split_first() {
        None => Ok(Vec::new()),
        Some((&PLAIN, plain)) if plain.len() <= most => Ok(plain.to_vec()),
        Some((&PLAIN, plain)) => Err(too_long(plain.len(), most, field)),
        Some((&LZ4, block)) => decompress(block, most, field),
        Some((tag, _)) => Err(field.value(format!("is packed in way {tag}, expected 0 or 1"))),
    }
}

/// An LZ4 block of at most `most` bytes. LZ4 shrinks to a 255th at best, so what is set aside is bounded by
/// what was sent, too.
pub(super) fn decompress(block: &[u8], most: usize, field: Field) -> Result<Vec<u8>, ConvertError> {
    let mut plain = vec![0; most.min(block.len().saturating_mul(255))];
    let length = lz4_flex::block::decompress_into(block, &mut plain)
        .map_err(|error| field.value(format!("does not decompress: {error}")))?;
    plain.truncate(length);
    Ok(plain)
}

fn too_long(found: usize, most: usize, field: Field) -> ConvertError {
    field.value(format!("holds {found} bytes, expected at most {most}"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const FIELD: Field = Field("Test", "field");

    proptest! {
        #[test]
        fn bytes_come_back(plain in proptest::collection::vec(0u8..4, 0..400), wild: bool) {
            let plain: Vec<u8> = plain.iter().map(|b| if wild { b.wrapping_mul(83) } else { *b }).collect();
            let packed = pack(&plain);
            prop_assert!(packed.len() <= plain.len() + 1);
            prop_assert_eq!(unpack_exactly(&packed, plain.len(), FIELD), Ok(plain.clone()));
            if !plain.is_empty() {
                prop_assert!(unpack_exactly(&packed, plain.len() - 1, FIELD).is_err());
                prop_assert!(unpack_exactly(&packed, plain.len() + 1, FIELD).is_err());
            }
        }

        #[test]
        fn any_bytes_unpack_within_the_limit_or_not(
            bytes in proptest::collection::vec(any::<u8>(), 0..60), most in 0usize..300,
        ) {
            if let Ok(plain) = unpack_at_most(&bytes, most, FIELD) {
                prop_assert!(plain.len() <= most);
            }
        }
    }

    #[test]
    fn what_repeats_shrinks() {
        assert!(pack(&[7; 5000]).len() < 60);
    }
}
