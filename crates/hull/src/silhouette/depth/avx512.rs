//! Sixteen levels in one gather. It is unsafe: cells are compared with the sides first, and the levels
//! are padded by what a word reads beyond the last.

use std::arch::x86_64::*;

use super::{Depth, PADDING};

#[allow(unsafe_code, reason = "gathers, loads and stores within bounds as said above")]
#[inline]
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl")]
pub(super) fn look_up(depth: &Depth, column: &[i32], row: &[i32], clear_pixels: &mut [f32]) {
    assert!(row.len() == column.len() && clear_pixels.len() == column.len());
    assert!(depth.levels.len() >= depth.columns * depth.rows + PADDING);
    let shift = _mm_cvtsi32_si128(depth.shift as i32);
    let (left, top) = (_mm512_set1_epi32(depth.left), _mm512_set1_epi32(depth.top));
    let columns = _mm512_set1_epi32(depth.columns as i32);
    let rows = _mm512_set1_epi32(depth.rows as i32);
    for at in (0..column.len()).step_by(16) {
        let left_over = column.len() - at;
        let lanes = if left_over >= 16 { u16::MAX } else { (1 << left_over) - 1 };
        // SAFETY: masked lanes are not read.
        let (x, y) = unsafe {
            (
                _mm512_maskz_loadu_epi32(lanes, column.as_ptr().add(at)),
                _mm512_maskz_loadu_epi32(lanes, row.as_ptr().add(at)),
            )
        };
        let x = _mm512_sub_epi32(_mm512_sra_epi32(x, shift), left);
        let y = _mm512_sub_epi32(_mm512_sra_epi32(y, shift), top);
        let within = lanes & _mm512_cmplt_epu32_mask(x, columns) & _mm512_cmplt_epu32_mask(y, rows);
        let cell = _mm512_add_epi32(_mm512_mullo_epi32(y, columns), x);
        // SAFETY: lanes within the sides index levels; the table holds all that a byte can be.
        let clear = unsafe {
            let zero = _mm512_setzero_si512();
            let levels = depth.levels.as_ptr().cast::<i32>();
            let level = _mm512_mask_i32gather_epi32::<1>(zero, within, cell, levels);
            let level = _mm512_and_si512(level, _mm512_set1_epi32(255));
            _mm512_i32gather_ps::<4>(level, depth.clear_pixels.as_ptr())
        };
        // SAFETY: masked lanes are not written.
        unsafe { _mm512_mask_storeu_ps(clear_pixels.as_mut_ptr().add(at), lanes, clear) };
    }
}
