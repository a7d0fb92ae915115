//! Some of `n` things: a bit a thing, or the lengths of runs, whichever is shorter; and LZ4 where that is
//! shorter still. The first byte says which.

use std::ops::Range;

use bytes::Bytes;

use super::ConvertError;
use super::bulk::Field;
use super::packed::{decompress, store};

const BITS: u8 = 0;
const BITS_LZ4: u8 = 1;
const RUNS: u8 = 2;
const RUNS_LZ4: u8 = 3;

/// Those of some things that are taken, as a choice.
pub(super) fn choice<T>(things: &[T], is_taken: impl Fn(&T) -> bool) -> Bytes {
    let (eights, rest) = things.as_chunks::<8>();
    let mut bits: Vec<u8> = Vec::with_capacity(things.len().div_ceil(8));
    bits.extend(eights.iter().map(|eight| byte_of(eight.each_ref().map(&is_taken))));
    if !rest.is_empty() {
        bits.push(byte_of(std::array::from_fn(|at| rest.get(at).is_some_and(&is_taken))));
    }
    from_bits(&bits, things.len())
}

/// Eight bits, the first lowest.
fn byte_of(taken: [bool; 8]) -> u8 {
    // Each byte's lowest bit is moved to its place in the highest byte; no two meet on the way.
    (u64::from_le_bytes(taken.map(u8::from)).wrapping_mul(0x0102_0408_1020_4080) >> 56) as u8
}

/// The choice out of `count` things of which a bit each says whether it is taken.
fn from_bits(bits: &[u8], count: usize) -> Bytes {
    match runs(bits, count) {
        Some(lengths) => store(&lengths, RUNS, RUNS_LZ4).into(),
        None => store(bits, BITS, BITS_LZ4).into(),
    }
}

/// Lengths by turns: left out, taken, left out, …; `None` if they are no shorter than the bits.
fn runs(bits: &[u8], count: usize) -> Option<Vec<u8>> {
    let mut lengths = Vec::with_capacity(bits.len());
    let (mut written, mut is_taking) = (0, false);
    for (index, &byte) in bits.iter().enumerate() {
        // Bits that differ from the one before.
        let mut changes = byte ^ (byte << 1 | u8::from(is_taking));
        while changes != 0 {
            let at = index * 8 + changes.trailing_zeros() as usize;
            push_number(&mut lengths, at - written);
            (written, is_taking) = (at, !is_taking);
            changes &= changes - 1;
        }
        if lengths.len() >= bits.len() {
            return None;
        }
    }
    if is_taking {
        push_number(&mut lengths, count - written);
    }
    (lengths.len() < bits.len()).then_some(lengths)
}

/// Collects things taken, in any order.
#[derive(Clone, Debug, Default)]
pub(super) struct ChoiceWriter {
    bits: Vec<u8>,
}

impl ChoiceWriter {
    /// Takes a thing.
    pub fn take(&mut self, index: usize) {
        let byte = index / 8;
        if byte >= self.bits.len() {
            self.bits.resize(byte + 1, 0);
        }
        self.bits[byte] |= 1 << (index % 8);
    }

    /// The choice out of `count` things; empties the writer.
    pub fn finish(&mut self, count: usize) -> Bytes {
        self.bits.resize(count.div_ceil(8), 0);
        let bytes = from_bits(&self.bits, count);
        self.bits.clear();
        bytes
    }
}

/// Calls `take` with every run of things taken of `count`, ascending. `count` must be trusted.
pub(super) fn read_choice(
    bytes: &[u8],
    count: usize,
    field: Field,
    take: impl FnMut(Range<usize>),
) -> Result<(), ConvertError> {
    let (&tag, rest) = bytes.split_first().ok_or_else(|| field.value("is empty, expected a choice"))?;
    let length = count.div_ceil(8);
    // Runs are sent only where they are shorter than bits.
    let held = match tag {
        BITS_LZ4 | RUNS_LZ4 => Some(decompress(rest, length, field)?),
        BITS | RUNS => None,
        other => return Err(field.value(format!("is a choice in way {other}, expected 0 to 3"))),
    };
    let plain = held.as_deref().unwrap_or(rest);
    if tag == RUNS || tag == RUNS_LZ4 {
        return read_runs(plain, count, field, take);
    }
    field.check_length(plain.len(), length)?;
    read_bits(plain, count, field, take)
}

/// The runs of ones, those that go on in the next 64 bits in two.
fn read_bits(
    plain: &[u8],
    count: usize,
    field: Field,
    mut take: impl FnMut(Range<usize>),
) -> Result<(), ConvertError> {
    for (at, chunk) in plain.chunks(8).enumerate() {
        let mut eight = [0; 8];
        eight[..chunk.len()].copy_from_slice(chunk);
        let (mut bits, mut from) = (u64::from_le_bytes(eight), at * 64);
        while bits != 0 {
            let gap = bits.trailing_zeros();
            let length = (bits >> gap).trailing_ones();
            let run = from + gap as usize..from + (gap + length) as usize;
            if run.end > count {
                return Err(field.value(format!("takes thing {} of {count}", run.start.max(count))));
            }
            from = run.end;
            take(run);
            // Both together shift by 64 at most.
            bits = (bits >> gap).checked_shr(length).unwrap_or(0);
        }
    }
    Ok(())
}

fn read_runs(
    plain: &[u8],
    count: usize,
    field: Field,
    mut take: impl FnMut(Range<usize>),
) -> Result<(), ConvertError> {
    let mut rest = plain;
    let mut at = 0;
    while !rest.is_empty() {
        let from = at + take_number(&mut rest, field)?;
        let length = take_number(&mut rest, field)?;
        if length == 0 || from + length > count {
            return Err(field.value(format!("takes {length} things from {from} of {count}")));
        }
        at = from + length;
        take(from..at);
    }
    Ok(())
}

pub(super) fn push_number(bytes: &mut Vec<u8>, mut number: usize) {
    while number >= 0x80 {
        bytes.push(number as u8 | 0x80);
        number >>= 7;
    }
    bytes.push(number as u8);
}

/// A number of at most 32 bits.
#[inline]
pub(super) fn take_number(rest: &mut &[u8], field: Field) -> Result<usize, ConvertError> {
    match rest.split_first() {
        // Most are short.
        Some((&byte, left)) if byte < 0x80 => {
            *rest = left;
            Ok(usize::from(byte))
        }
        _ => take_long_number(rest, field),
    }
}

fn take_long_number(rest: &mut &[u8], field: Field) -> Result<usize, ConvertError> {
    let mut number = 0u64;
    for shift in [0, 7, 14, 21, 28] {
        let (&byte, left) = rest.split_first().ok_or_else(|| field.value("ends within a number"))?;
        *rest = left;
        number |= u64::from(byte & 0x7f) << shift;
        if byte < 0x80 {
            break;
        }
        if shift == 28 {
            return Err(field.value("holds a number of more than 32 bits"));
        }
    }
    u32::try_from(number)
        .map(|number| number as usize)
        .map_err(|_| field.value("holds a number of more than 32 bits"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const FIELD: Field = Field("Test", "field");

    fn there_and_back(taken: &[bool]) -> (usize, Vec<bool>) {
        let mut writer = ChoiceWriter::default();
        // A writer is used again and again.
        writer.take(3);
        writer.finish(10);
        taken.iter().enumerate().filter(|(_, taken)| **taken).for_each(|(index, _)| writer.take(index));
        let bytes = writer.finish(taken.len());
        assert_eq!(choice(taken, |&taken| taken), bytes, "both ways to write it");
        let mut back = vec![false; taken.len()];
        read_choice(&bytes, taken.len(), FIELD, |run| back[run].fill(true)).expect("valid");
        (bytes.len(), back)
    }

    proptest! {
        #[test]
        fn choices_come_back(
            runs in proptest::collection::vec((any::<bool>(), 1usize..90), 0..30),
            noise in proptest::collection::vec(any::<bool>(), 0..300),
        ) {
            let runs = runs.into_iter().flat_map(|(taken, length)| vec![taken; length]);
            let taken: Vec<bool> = runs.chain(noise).collect();
            let (length, back) = there_and_back(&taken);
            prop_assert_eq!(&back, &taken);
            prop_assert!(length <= 1 + taken.len().div_ceil(8));
        }

        #[test]
        fn any_bytes_choose_ascending_things_or_nothing(
            tag in 0u8..5, bytes in proptest::collection::vec(any::<u8>(), 0..40), count in 0usize..400,
        ) {
            let bytes: Vec<u8> = std::iter::once(tag).chain(bytes).collect();
            let mut taken = Vec::new();
            let read = read_choice(&bytes, count, FIELD, |run| taken.extend(run));
            prop_assert!(taken.is_sorted_by(|a, b| a < b));
            prop_assert!(taken.iter().all(|&index| index < count));
            drop(read);
        }
    }

    #[test]
    fn a_few_runs_of_many_things_are_a_few_bytes() {
        let taken: Vec<bool> = (0..15_000).map(|index| (4000..4300).contains(&index)).collect();
        assert_eq!(there_and_back(&taken).0, 1 + 2 + 2);
        assert_eq!(there_and_back(&[]), (1, vec![]));
    }
}
