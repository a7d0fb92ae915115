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
    let numbers = numbers.into_iter();
    let mut bytes = Vec::with_capacity(4 * numbers.size_hint().0);
    numbers.for_each(|number| bytes.extend_from_slice(&number.to_le_bytes()));
    bytes.into()
}

pub(super) fn pack_f64(numbers: impl IntoIterator<Item = f64>) -> Bytes {
    let numbers = numbers.into_iter();
    let mut bytes = Vec::with_capacity(8 * numbers.size_hint().0);
    numbers.for_each(|number| bytes.extend_from_slice(&number.to_le_bytes()));
    bytes.into()
}

/// Numbers of `N` bytes each.
#[inline]
pub(super) fn unpack<const N: usize, T>(
    bytes: &[u8],
    count: usize,
    field: Field,
    read: impl Fn([u8; N]) -> T,
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
    // All at once, without branches; which one it is matters only if there is one.
    let are_finite = triples.as_flattened().iter().fold(true, |all, number| all & number.is_finite());
    if are_finite {
        return Ok(triples);
    }
    let wrong = triples.as_flattened().iter().find(|number| !number.is_finite()).copied();
    Err(field.value(format!("holds {}, expected finite numbers", wrong.unwrap_or_default())))
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

#[cfg(test)]
mod tests {
    use super::*;

    const FIELD: Field = Field("Test", "field");

    #[test]
    fn wrong_lengths_and_numbers_are_named() {
        let error = unpack_f32x3(&[0; 13], FIELD).expect_err("13 bytes");
        assert_eq!(error.to_string(), "Test.field holds 13 bytes, expected 12");
        let nan = pack_f32([0.0, f32::NAN, 0.0]);
        let error = unpack_f32x3(&nan, FIELD).expect_err("NaN");
        assert_eq!(error.to_string(), "Test.field: holds NaN, expected finite numbers");
    }
}
