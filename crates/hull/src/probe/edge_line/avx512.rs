//! The same with sixteen rows in one vector. Loads through pointers are unsafe: lanes of rows that the map does not have
//! are masked.

use std::arch::x86_64::*;

use crate::camera::Pixel;
use crate::probe::edge_normal::{PLACES, Sum};
use crate::silhouette::{BitMap, STRIP};

/// See [`super::Disc::background`]; `half_by_row` says how many pixels each row of the disc has on either side of the
/// middle, and is filled up with negative numbers to a multiple of sixteen.
#[inline]
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx512vpopcntdq")]
pub(super) fn background(candidates: &BitMap, centre: Pixel, half_by_row: &[i32]) -> (Sum, i32) {
    let (blocks, _) = half_by_row.as_chunks::<16>();
    let radius = half_by_row.iter().fold(0, |most, &half| most.max(half));
    let (zero, ones) = (_mm512_setzero_si512(), _mm512_set1_epi32(-1));
    let last = _mm512_set1_epi32(STRIP - 1);
    let beyond = _mm512_set1_epi32(-i32::from(candidates.beyond()));
    let lanes = _mm512_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
    let rows = _mm512_set1_epi32(candidates.rows() as i32);
    let (mut across, mut down, mut all) = (zero, zero, zero);
    let strips = (centre.column - radius).div_euclid(STRIP)..=(centre.column + radius).div_euclid(STRIP);
    for (block, half) in blocks.iter().enumerate() {
        #[allow(unsafe_code, reason = "a load of sixteen numbers")]
        let half = unsafe { _mm512_loadu_si512(half.as_ptr().cast()) };
        let from_centre = 16 * block as i32 - radius;
        let first_row = (centre.row + from_centre).wrapping_sub(candidates.top());
        let row = _mm512_add_epi32(_mm512_set1_epi32(first_row), lanes);
        let in_map = _mm512_cmplt_epu32_mask(row, rows);
        let in_disc = _mm512_cmpge_epi32_mask(half, zero);
        let mut in_row = zero;
        for strip in strips.clone() {
            let base = strip * STRIP;
            let middle = _mm512_set1_epi32(centre.column - base);
            let from = _mm512_max_epi32(_mm512_sub_epi32(middle, half), zero);
            let to = _mm512_min_epi32(_mm512_add_epi32(middle, half), last);
            // Shifts by as much as a word has bits leave nothing.
            let mask = _mm512_and_si512(
                _mm512_sllv_epi32(ones, from),
                _mm512_srlv_epi32(ones, _mm512_sub_epi32(last, to)),
            );
            let in_strips = strip.wrapping_sub(candidates.left() / STRIP) as usize;
            let words = if in_strips < candidates.strips() {
                let strip = candidates.strip(in_strips).as_ptr().cast::<i32>();
                #[allow(unsafe_code, reason = "lanes beyond the strip's rows are not read")]
                unsafe {
                    _mm512_mask_loadu_epi32(beyond, in_map, strip.wrapping_offset(first_row as isize))
                }
            } else {
                beyond
            };
            let zeros = _mm512_maskz_andnot_epi32(in_disc, words, mask);
            let count = _mm512_popcnt_epi32(zeros);
            in_row = _mm512_add_epi32(in_row, count);
            let before = _mm512_mullo_epi32(count, _mm512_set1_epi32(base - centre.column));
            across = _mm512_add_epi32(across, _mm512_add_epi32(places(zeros), before));
        }
        let row = _mm512_add_epi32(_mm512_set1_epi32(from_centre), lanes);
        down = _mm512_add_epi32(down, _mm512_mullo_epi32(in_row, row));
        all = _mm512_add_epi32(all, in_row);
    }
    let sum = Sum { across: _mm512_reduce_add_epi32(across), down: _mm512_reduce_add_epi32(down) };
    (sum, _mm512_reduce_add_epi32(all))
}

/// The sums of the places of the ones.
#[inline]
#[target_feature(enable = "avx512f,avx512vpopcntdq")]
fn places(ones: __m512i) -> __m512i {
    let count = |bits: u32| _mm512_popcnt_epi32(_mm512_and_si512(ones, _mm512_set1_epi32(bits as i32)));
    let twice = |sum: __m512i, bits: u32| _mm512_add_epi32(_mm512_add_epi32(sum, sum), count(bits));
    let [first, rest @ ..] = PLACES;
    rest.into_iter().fold(count(first), twice)
}
