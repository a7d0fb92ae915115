//! Bytes as they are, compressed, or as places in a short table, whichever is smallest; the first byte says
//! which.

use bytes::Bytes;

use super::ConvertError;
use super::bulk::Field;

const PLAIN: u8 = 0;
const LZ4: u8 = 1;
const TABLE: u8 = 2;

/// Below this LZ4 finds nothing worth its tokens.
const LEAST_BYTES: usize = 24;

/// Packs bytes; nothing stays nothing.
pub(super) fn pack(plain: &[u8]) -> Bytes {
    if plain.is_empty() {
        return Bytes::new();
    }
    let stored = store(plain, PLAIN, LZ4);
    match table(plain).filter(|table| table.len() < stored.len()) {
        Some(table) => table.into(),
        None => stored.into(),
    }
}

/// The bytes as a table of those that occur, and four bits for each; `None` if they are too many.
fn table(plain: &[u8]) -> Option<Vec<u8>> {
    let mut place = [u8::MAX; 256];
    let mut values = Vec::with_capacity(16);
    for &byte in plain {
        let place = &mut place[usize::from(byte)];
        if *place == u8::MAX {
            *place = values.len() as u8;
            values.push(byte);
        }
        if values.len() > 16 {
            return None;
        }
    }
    let mut bytes = Vec::with_capacity(6 + values.len() + plain.len().div_ceil(2));
    bytes.push(TABLE);
    bytes.extend_from_slice(&(plain.len() as u32).to_le_bytes());
    bytes.push(values.len() as u8);
    bytes.extend_from_slice(&values);
    let at = |byte: u8| place[usize::from(byte)];
    bytes.extend(plain.chunks(2).map(|two| at(two[0]) | two.get(1).map_or(0, |&byte| at(byte) << 4)));
    Some(bytes)
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
        Some((&TABLE, table)) => from_table(table, most, field),
        Some((tag, _)) => Err(field.value(format!("is packed in way {tag}, expected 0 to 2"))),
    }
}

fn from_table(bytes: &[u8], most: usize, field: Field) -> Result<Vec<u8>, ConvertError> {
    let wrong = || field.value("holds a table that is none");
    let (length, rest) = bytes.split_first_chunk::<4>().ok_or_else(wrong)?;
    let length = u32::from_le_bytes(*length) as usize;
    let (&values, rest) = rest.split_first().ok_or_else(wrong)?;
    let (values, codes) = rest.split_at_checked(usize::from(values)).ok_or_else(wrong)?;
    if length > most {
        return Err(too_long(length, most, field));
    }
    field.check_length(codes.len(), length.div_ceil(2))?;
    let code = |at: usize| codes[at / 2] >> (at % 2 * 4) & 15;
    (0..length).map(|at| values.get(usize::from(code(at))).copied().ok_or_else(wrong)).collect()
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
        fn bytes_come_back(
            plain in proptest::collection::vec(any::<u8>(), 0..400), different in 1u8..40,
        ) {
            let plain: Vec<u8> = plain.iter().map(|b| (b % different).wrapping_mul(83)).collect();
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
    fn a_few_different_bytes_take_half() {
        let plain: Vec<u8> =
            (0..750u32).map(|at| ((at * at).wrapping_mul(2_654_435_761) >> 28) as u8 * 4).collect();
        assert_eq!(pack(&plain).len(), 1 + 4 + 1 + 16 + 375);
    }

    #[test]
    fn what_repeats_shrinks() {
        assert!(pack(&[7; 5000]).len() < 60);
    }
}
