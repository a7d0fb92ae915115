//! Sixteen levels in one gather, and what they say in one permutation each. It is unsafe: cells are compared with the
//! sides first, and the levels are padded by what a word reads beyond the last.

use std::arch::x86_64::*;

use super::{BEYOND, PADDING, Surroundings};

#[allow(unsafe_code, reason = "gathers, loads and stores within bounds as said above")]
#[inline]
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl")]
pub(super) fn look_up<const N: usize>(
    around: &Surroundings,
    column: &[i32; N],
    row: &[i32; N],
    clear: &mut [i32; N],
    within: &mut [i32; N],
) {
    const { assert!(N.is_multiple_of(16)) };
    assert!(around.levels.len() >= around.columns * around.rows + PADDING);
    let shift = _mm_cvtsi32_si128(around.shift as i32);
    let (left, top) = (_mm512_set1_epi32(around.left), _mm512_set1_epi32(around.top));
    let columns = _mm512_set1_epi32(around.columns as i32);
    let rows = _mm512_set1_epi32(around.rows as i32);
    // SAFETY: whole arrays of sixteen.
    let (clear_squared, within_squared) = unsafe {
        (
            _mm512_loadu_si512(around.clear_squared.as_ptr().cast()),
            _mm512_loadu_si512(around.within_squared.as_ptr().cast()),
        )
    };
    for at in (0..N).step_by(16) {
        // SAFETY: sixteen are left.
        let (x, y) = unsafe {
            (
                _mm512_loadu_si512(column.as_ptr().add(at).cast()),
                _mm512_loadu_si512(row.as_ptr().add(at).cast()),
            )
        };
        let x = _mm512_sub_epi32(_mm512_sra_epi32(x, shift), left);
        let y = _mm512_sub_epi32(_mm512_sra_epi32(y, shift), top);
        let is_cell = _mm512_cmplt_epu32_mask(x, columns) & _mm512_cmplt_epu32_mask(y, rows);
        let cell = _mm512_add_epi32(_mm512_mullo_epi32(y, columns), x);
        // SAFETY: lanes within the sides index levels.
        let level = unsafe {
            let beyond = _mm512_set1_epi32(i32::from(BEYOND));
            _mm512_mask_i32gather_epi32::<1>(beyond, is_cell, cell, around.levels.as_ptr().cast())
        };
        // A permutation reads the lowest four bits of each lane: those of a level.
        let nearest = _mm512_permutexvar_epi32(level, clear_squared);
        let farthest = _mm512_permutexvar_epi32(level, within_squared);
        // SAFETY: sixteen are left.
        unsafe {
            _mm512_storeu_si512(clear.as_mut_ptr().add(at).cast(), nearest);
            _mm512_storeu_si512(within.as_mut_ptr().add(at).cast(), farthest);
        }
    }
}
