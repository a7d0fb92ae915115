//! Packed little-endian numbers and bits.

use bytes::Bytes;

use super::ConvertError;

/// Where a packed field stands, for errors.
#[derive(Clone, Copy)]
pub(super) struct Field(pub &'static str, pub &'static str);

impl Field {
    pub fn value(self, what: impl Into<String>) -> ConvertError {
        ConvertError::Value { message: self.0, field: self.1, what: what.into() }
    }

    pub fn check_length(self, found: usize, expected: usize) -> Result<(), ConvertError> {
        if found == expected {
            return Ok(());
        }
        Err(ConvertError::Length { message: self.0, field: self.1, found, expected })
    }
}

pub(super) fn pack_f32(numbers: impl IntoIterator<Item = f32>) -> Bytes {
    numbers.into_iter().flat_map(f32::to_le_bytes).collect::<Vec<u8>>().into()
}

pub(super) fn pack_f64(numbers: impl IntoIterator<Item = f64>) -> Bytes {
    numbers.into_iter().flat_map(f64::to_le_bytes).collect::<Vec<u8>>().into()
}

/// Numbers of `N` bytes each.
pub(super) fn unpack<const N: usize, T>(
    bytes: &[u8],
    count: usize,
    field: Field,
    read: fn([u8; N]) -> T,
) -> Result<Vec<T>, ConvertError> {
    field.check_length(bytes.len(), count.saturating_mul(N))?;
    Ok(bytes.as_chunks::<N>().0.iter().map(|&chunk| read(chunk)).collect())
}

/// Finite `f32` triples.
pub(super) fn unpack_f32x3(bytes: &[u8], field: Field) -> Result<Vec<[f32; 3]>, ConvertError> {
    field.check_length(bytes.len(), bytes.len() / 12 * 12)?;
    let triple = |c: &[u8; 12]| {
        let number = |at: usize| f32::from_le_bytes([c[at], c[at + 1], c[at + 2], c[at + 3]]);
        [number(0), number(4), number(8)]
    };
    let triples: Vec<[f32; 3]> = bytes.as_chunks::<12>().0.iter().map(triple).collect();
    match triples.iter().flatten().find(|number| !number.is_finite()) {
        Some(number) => Err(field.value(format!("holds {number}, expected finite numbers"))),
        None => Ok(triples),
    }
}

/// Finite `f64` triples.
pub(super) fn unpack_f64x3(bytes: &[u8], field: Field) -> Result<Vec<[f64; 3]>, ConvertError> {
    field.check_length(bytes.len(), bytes.len() / 24 * 24)?;
    let numbers = unpack(bytes, bytes.len() / 8, field, f64::from_le_bytes)?;
    match numbers.iter().find(|number| !number.is_finite()) {
        Some(number) => Err(field.value(format!("holds {number}, expected finite numbers"))),
        None => Ok(numbers.as_chunks::<3>().0.to_vec()),
    }
}

pub(super) fn pack_bits(bits: impl ExactSizeIterator<Item = bool>) -> Bytes {
    let mut bytes = vec![0u8; bits.len().div_ceil(8)];
    for (index, bit) in bits.enumerate() {
        bytes[index / 8] |= u8::from(bit) << (index % 8);
    }
    bytes.into()
}

pub(super) fn unpack_bits(bytes: &[u8], count: usize, field: Field) -> Result<Vec<bool>, ConvertError> {
    field.check_length(bytes.len(), count.div_ceil(8))?;
    Ok((0..count).map(|index| bytes[index / 8] >> (index % 8) & 1 != 0).collect())
}

/// Ascending indices as LEB128 distances, each less one after the first.
pub(super) fn pack_indices(indices: &[u32]) -> Bytes {
    let mut bytes = Vec::with_capacity(indices.len() + 4);
    let mut next = 0;
    for &index in indices {
        let mut gap = index - next;
        while gap >= 0x80 {
            bytes.push(gap as u8 | 0x80);
            gap >>= 7;
        }
        bytes.push(gap as u8);
        next = index + 1;
    }
    bytes.into()
}

/// Ascending indices below `limit`.
pub(super) fn unpack_indices(bytes: &[u8], limit: usize, field: Field) -> Result<Vec<u32>, ConvertError> {
    let mut indices = Vec::with_capacity(bytes.len());
    let (mut next, mut gap, mut shift) = (0u64, 0u64, 0);
    for &byte in bytes {
        gap |= u64::from(byte & 0x7f) << shift;
        if byte >= 0x80 {
            shift += 7;
            if shift > 28 {
                return Err(field.value("holds a number of more than 32 bits"));
            }
            continue;
        }
        let index = next + gap;
        if index >= limit as u64 {
            return Err(field.value(format!("holds index {index} of {limit} points")));
        }
        indices.push(index as u32);
        (next, gap, shift) = (index + 1, 0, 0);
    }
    if shift != 0 {
        return Err(field.value("ends within a number"));
    }
    Ok(indices)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const FIELD: Field = Field("Test", "field");

    proptest! {
        #[test]
        fn indices_and_bits_come_back(picks in proptest::collection::vec(any::<bool>(), 0..900)) {
            let indices: Vec<u32> = (0..).zip(&picks).filter(|(_, pick)| **pick).map(|(at, _)| at).collect();
            let back = unpack_indices(&pack_indices(&indices), picks.len(), FIELD);
            prop_assert_eq!(back, Ok(indices));
            let bits = pack_bits(picks.iter().copied());
            prop_assert_eq!(unpack_bits(&bits, picks.len(), FIELD), Ok(picks));
        }

        #[test]
        fn any_bytes_are_indices_below_the_limit_or_an_error(
            bytes in proptest::collection::vec(any::<u8>(), 0..40), limit in 0usize..5000,
        ) {
            if let Ok(indices) = unpack_indices(&bytes, limit, FIELD) {
                prop_assert!(indices.is_sorted_by(|a, b| a < b));
                prop_assert!(indices.iter().all(|&index| (index as usize) < limit));
            }
        }
    }

    #[test]
    fn wrong_lengths_and_numbers_are_named() {
        let error = unpack_f32x3(&[0; 13], FIELD).expect_err("13 bytes");
        assert_eq!(error.to_string(), "Test.field holds 13 bytes, expected 12");
        let nan = pack_f32([0.0, f32::NAN, 0.0]);
        let error = unpack_f32x3(&nan, FIELD).expect_err("NaN");
        assert_eq!(error.to_string(), "Test.field: holds NaN, expected finite numbers");
    }
}
