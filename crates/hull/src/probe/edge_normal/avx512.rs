//! The same with sixteen rows in one vector. Loads through pointers are unsafe: lanes of rows that the map
//! does not have are masked.

use std::arch::x86_64::*;

use super::window_columns;
use crate::camera::Pixel;
use crate::silhouette::BitMap;

/// See [`super::sum_of_background`]: columns and rows.
#[inline]
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx512vpopcntdq")]
pub(super) fn sum_of_background(candidates: &BitMap, centre: Pixel, k: i32) -> (i32, i32) {
    let (beyond, ones) = (_mm512_set1_epi32(-i32::from(candidates.beyond())), _mm512_set1_epi32(-1));
    let lanes = _mm512_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
    let rows = _mm512_set1_epi32(candidates.rows() as i32);
    let (mut across, mut down) = (_mm512_setzero_si512(), _mm512_setzero_si512());
    for first in (-k..=k).step_by(16) {
        let first_row = centre.row + first - candidates.top();
        let row = _mm512_add_epi32(_mm512_set1_epi32(first_row), lanes);
        let in_map = _mm512_cmplt_epu32_mask(row, rows);
        let from_centre = _mm512_add_epi32(_mm512_set1_epi32(first), lanes);
        let in_window = _mm512_cmple_epi32_mask(from_centre, _mm512_set1_epi32(k));
        let mut in_row = _mm512_setzero_si512();
        for (strip, mask, columns) in window_columns(candidates, centre, k) {
            let is_strip = strip >= 0 && (strip as usize) < candidates.strips();
            let words = if is_strip {
                let strip = candidates.strip(strip as usize).as_ptr().cast::<i32>();
                #[allow(unsafe_code, reason = "lanes beyond the strip's rows are not read")]
                unsafe {
                    _mm512_mask_loadu_epi32(beyond, in_map, strip.wrapping_offset(first_row as isize))
                }
            } else {
                beyond
            };
            let mask = _mm512_maskz_set1_epi32(in_window, mask as i32);
            let zeros = _mm512_and_si512(_mm512_xor_si512(words, ones), mask);
            let count = _mm512_popcnt_epi32(zeros);
            in_row = _mm512_add_epi32(in_row, count);
            let before = _mm512_mullo_epi32(count, _mm512_set1_epi32(columns));
            across = _mm512_add_epi32(across, _mm512_add_epi32(places(zeros), before));
        }
        down = _mm512_add_epi32(down, _mm512_mullo_epi32(in_row, from_centre));
    }
    (_mm512_reduce_add_epi32(across), _mm512_reduce_add_epi32(down))
}

/// The sums of the places of the ones.
#[inline]
#[target_feature(enable = "avx512f,avx512vpopcntdq")]
fn places(ones: __m512i) -> __m512i {
    let count = |bits: u32| _mm512_popcnt_epi32(_mm512_and_si512(ones, _mm512_set1_epi32(bits as i32)));
    let twice = |sum: __m512i, bits: u32| _mm512_add_epi32(_mm512_add_epi32(sum, sum), count(bits));
    let [first, rest @ ..] = super::PLACES;
    rest.into_iter().fold(count(first), twice)
}
