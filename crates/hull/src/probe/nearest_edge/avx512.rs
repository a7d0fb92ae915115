//! The same with sixteen rows, or eight, in one vector. Loads are from arrays of that length, and the
//! functions are called only where the processor has the instructions.

use std::arch::x86_64::*;

use super::{CellPlace, NOWHERE, Place, ROWS};

/// What no gap within reach is as wide as.
const NO_GAP: i32 = 40;

/// The zeros, or the ones, before the place's column and from it on.
#[inline]
#[target_feature(enable = "avx512f,avx512bw,avx512cd,avx512vl")]
fn bits_beside<const ONES: bool>([before, here, after]: [&[u32; ROWS]; 3], bit: u32) -> (__m512i, __m512i) {
    #[allow(unsafe_code, reason = "loads of whole arrays of sixteen words")]
    let load = |words: &[u32; ROWS]| unsafe { _mm512_loadu_si512(words.as_ptr().cast()) };
    let (before, here, after) = (load(before), load(here), load(after));
    let right_by = _mm_cvtsi32_si128(bit as i32);
    let left_by = _mm_cvtsi32_si128(32 - bit as i32);
    let left = _mm512_or_si512(_mm512_srl_epi32(before, right_by), _mm512_sll_epi32(here, left_by));
    let right = _mm512_or_si512(_mm512_srl_epi32(here, right_by), _mm512_sll_epi32(after, left_by));
    if ONES {
        return (left, right);
    }
    let ones = _mm512_set1_epi32(-1);
    (_mm512_xor_si512(left, ones), _mm512_xor_si512(right, ones))
}

/// The places of the lowest ones; [`NO_GAP`] where there are none.
#[inline]
#[target_feature(enable = "avx512f,avx512bw,avx512cd,avx512vl")]
fn lowest(bits: __m512i) -> __m512i {
    let single = _mm512_and_si512(bits, _mm512_sub_epi32(_mm512_setzero_si512(), bits));
    let place = _mm512_sub_epi32(_mm512_set1_epi32(31), _mm512_lzcnt_epi32(single));
    _mm512_mask_mov_epi32(_mm512_set1_epi32(NO_GAP), _mm512_test_epi32_mask(bits, bits), place)
}

/// See [`super::key_of_rows`].
#[inline]
#[target_feature(enable = "avx512f,avx512bw,avx512cd,avx512vl")]
pub(super) fn key_of_rows<const ONES: bool>(words: [&[u32; ROWS]; 3], place: &Place, first: i32) -> u32 {
    let (left, right) = bits_beside::<ONES>(words, place.bit);
    let gap_left = _mm512_add_epi32(_mm512_lzcnt_epi32(left), _mm512_set1_epi32(1));
    let gap_right = lowest(right);
    let is_left = _mm512_cmple_epu32_mask(gap_left, gap_right);
    let gap = _mm512_min_epu32(gap_left, gap_right);
    let centre = _mm512_set1_epi32(64);
    let column = _mm512_add_epi32(centre, gap_right);
    let column = _mm512_mask_sub_epi32(column, is_left, centre, gap_left);
    let rows = _mm512_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
    let down = _mm512_add_epi32(_mm512_set1_epi32(first - place.row), rows);
    // Both fit sixteen bits: their squares are summed at once.
    let pair = _mm512_mask_blend_epi16(0x5555_5555, _mm512_slli_epi32::<16>(gap), down);
    let squared = _mm512_madd_epi16(pair, pair);
    let row = _mm512_and_si512(_mm512_add_epi32(down, centre), _mm512_set1_epi32(127));
    let key = _mm512_or_si512(_mm512_slli_epi32::<14>(squared), _mm512_slli_epi32::<7>(row));
    _mm512_reduce_min_epu32(_mm512_or_si512(key, column))
}

/// See `Cells::gaps`.
#[inline]
#[target_feature(enable = "avx512f,avx512bw,avx512cd,avx512vl,avx512dq")]
pub(super) fn gaps(
    words: [&[u32; ROWS]; 3],
    start: &CellPlace,
    first: i32,
) -> ([i32; ROWS], [i32; ROWS], [i32; ROWS]) {
    let (left, right) = bits_beside::<true>(words, start.cell.bit);
    let one = _mm512_set1_epi32(1);
    let shift = _mm_cvtsi32_si128(start.shift as i32);
    let side = 1 << start.shift;
    let nowhere = _mm512_set1_epi32(NOWHERE);
    let zero = _mm512_setzero_si512();
    let across = _mm512_set1_epi32(start.across);
    let pixels_left = _mm512_sll_epi32(_mm512_lzcnt_epi32(left), shift);
    let gap_left = _mm512_add_epi32(_mm512_add_epi32(pixels_left, across), one);
    let gap_left = _mm512_mask_mov_epi32(nowhere, _mm512_test_epi32_mask(left, left), gap_left);
    let gap_left = _mm512_mask_mov_epi32(gap_left, _mm512_test_epi32_mask(right, one), one);
    let pixels_right = _mm512_sub_epi32(_mm512_sll_epi32(lowest(right), shift), across);
    let gap_right = _mm512_max_epi32(pixels_right, zero);
    let gap_right = _mm512_mask_mov_epi32(nowhere, _mm512_test_epi32_mask(right, right), gap_right);
    let rows = _mm512_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
    let cell = _mm512_add_epi32(_mm512_set1_epi32(first - start.cell.row), rows);
    let first_row = _mm512_sub_epi32(_mm512_sll_epi32(cell, shift), _mm512_set1_epi32(start.down));
    // The rows between: of a cell below its first row, of one above the start less its last.
    let above = _mm512_sub_epi32(_mm512_set1_epi32(1 - side), first_row);
    let between = _mm512_max_epi32(_mm512_max_epi32(first_row, above), zero);
    let most = _mm512_set1_epi32(side - 1);
    let widest = _mm512_add_epi32(_mm512_min_epi32(gap_left, gap_right), most);
    let tallest = _mm512_add_epi32(between, most);
    let squared = _mm512_add_epi32(_mm512_mullo_epi32(widest, widest), _mm512_mullo_epi32(tallest, tallest));
    let (mut lefts, mut rights, mut mosts) = ([0; ROWS], [0; ROWS], [0; ROWS]);
    let store = |array: &mut [i32; ROWS], vector| {
        #[allow(unsafe_code, reason = "stores of whole arrays of sixteen words")]
        unsafe {
            _mm512_storeu_si512(array.as_mut_ptr().cast(), vector);
        }
    };
    store(&mut lefts, gap_left);
    store(&mut rights, gap_right);
    store(&mut mosts, squared);
    (lefts, rights, mosts)
}

/// Of eight rows the zero, or the one, nearest to the start, as squared distance, row of the eight and columns away; ties
/// go to the smaller row. Its squared distance is [`i32::MAX`] if there is none.
#[inline]
#[target_feature(enable = "avx512f,avx512bw,avx512cd,avx512vl,avx512dq")]
pub(super) fn eight_rows<const ONES: bool>(
    [before, here, after]: [&[u32; 8]; 3],
    bit: u32,
    gap: i32,
    leftward: bool,
    first_row: i32,
) -> (i32, i32, i32) {
    #[allow(unsafe_code, reason = "loads of whole arrays of eight words")]
    let load = |words: &[u32; 8]| unsafe { _mm256_loadu_si256(words.as_ptr().cast()) };
    let (low, high) = if leftward { (load(before), load(here)) } else { (load(here), load(after)) };
    let bits = _mm256_or_si256(
        _mm256_srl_epi32(low, _mm_cvtsi32_si128(bit as i32)),
        _mm256_sll_epi32(high, _mm_cvtsi32_si128(32 - bit as i32)),
    );
    let zeros = if ONES { bits } else { _mm256_xor_si256(bits, _mm256_set1_epi32(-1)) };
    let single = _mm256_and_si256(zeros, _mm256_sub_epi32(_mm256_setzero_si256(), zeros));
    let more = if leftward {
        _mm256_lzcnt_epi32(zeros)
    } else {
        _mm256_sub_epi32(_mm256_set1_epi32(31), _mm256_lzcnt_epi32(single))
    };
    let away = _mm256_add_epi32(_mm256_set1_epi32(gap), more);
    let rows = _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7);
    let down = _mm256_add_epi32(_mm256_set1_epi32(first_row), rows);
    let squared = _mm256_add_epi32(_mm256_mullo_epi32(away, away), _mm256_mullo_epi32(down, down));
    let found = _mm256_test_epi32_mask(zeros, zeros);
    if found == 0 {
        return (i32::MAX, 0, 0);
    }
    let squared = _mm256_mask_mov_epi32(_mm256_set1_epi32(i32::MAX), found, squared);
    let half = _mm_min_epi32(_mm256_castsi256_si128(squared), _mm256_extracti128_si256::<1>(squared));
    let quarter = _mm_min_epi32(half, _mm_shuffle_epi32::<0b01_00_11_10>(half));
    let least = _mm_min_epi32(quarter, _mm_shuffle_epi32::<0b10_11_00_01>(quarter));
    let least = _mm_cvtsi128_si32(least);
    let row = _mm256_cmpeq_epi32_mask(squared, _mm256_set1_epi32(least)).trailing_zeros();
    // The column follows from the squared distance and the row, but this is simpler.
    let away = _mm256_permutevar8x32_epi32(away, _mm256_set1_epi32(row as i32));
    (least, row as i32, _mm256_cvtsi256_si32(away))
}
