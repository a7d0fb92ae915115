//! The places of a word's ones by the exponents of floats: x86 counts zeros in vectors with AVX-512 alone, and loops around
//! these vectorise without it.

/// How much more than it means an exponent is.
const BIAS: i32 = 127;
const FRACTION_BITS: u32 = 23;

/// The place of the highest one; −1 of nothing.
#[inline(always)]
pub(super) fn highest(word: u32) -> i32 {
    // Without the lowest bit it is no negative integer, and without the one below the highest it is not rounded up.
    let half = word >> 1;
    let half = half & !(half >> 1);
    let exponent = ((half as i32) as f32).to_bits() >> FRACTION_BITS;
    if half == 0 { word as i32 - 1 } else { exponent as i32 - BIAS + 1 }
}

/// The place of the lowest one; of nothing `none`.
#[inline(always)]
pub(super) fn lowest(word: u32, none: i32) -> i32 {
    let alone = word & word.wrapping_neg();
    // The highest bit alone is a negative integer.
    let exponent = ((alone as i32) as f32).to_bits() >> FRACTION_BITS & 0xff;
    if word == 0 { none } else { exponent as i32 - BIAS }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn check(word: u32) {
        assert_eq!(highest(word), 31 - word.leading_zeros() as i32, "{word:#x}");
        let expected = if word == 0 { 40 } else { word.trailing_zeros() as i32 };
        assert_eq!(lowest(word, 40), expected, "{word:#x}");
    }

    #[test]
    fn every_place_is_found_beside_ones_and_beside_zeros() {
        check(0);
        for place in 0..32 {
            for word in [1 << place, u32::MAX << place, u32::MAX >> place, !(1 << place)] {
                check(word);
            }
        }
    }

    proptest! {
        #[test]
        fn places_are_those_that_counting_zeros_gives(word in any::<u32>(), keep in any::<u32>(), shift in 0u32..32) {
            check(word);
            check((word & keep) >> shift);
        }
    }
}
