//! Sixteen bits in one gather. It is unsafe: pixels are compared with the sides first.

use std::arch::x86_64::*;

use super::BitMap;

#[allow(unsafe_code, reason = "gathers and loads within bounds as said above")]
#[inline]
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl")]
pub(super) fn look_up<const N: usize>(map: &BitMap, column: &[i32; N], row: &[i32; N], bits: &mut [bool; N]) {
    const { assert!(N.is_multiple_of(16)) };
    assert!(map.words.len() >= map.strips * map.rows);
    let (left, top) = (_mm512_set1_epi32(map.left), _mm512_set1_epi32(map.top));
    let columns = _mm512_set1_epi32(map.strips as i32 * 32);
    let rows = _mm512_set1_epi32(map.rows as i32);
    let beyond = _mm512_set1_epi32(-i32::from(map.beyond));
    let one = _mm512_set1_epi32(1);
    for at in (0..N).step_by(16) {
        // SAFETY: sixteen are left.
        let (x, y) = unsafe {
            (
                _mm512_loadu_si512(column.as_ptr().add(at).cast()),
                _mm512_loadu_si512(row.as_ptr().add(at).cast()),
            )
        };
        let (x, y) = (_mm512_sub_epi32(x, left), _mm512_sub_epi32(y, top));
        let in_map = _mm512_cmplt_epu32_mask(x, columns) & _mm512_cmplt_epu32_mask(y, rows);
        let word = _mm512_add_epi32(_mm512_mullo_epi32(_mm512_srli_epi32::<5>(x), rows), y);
        // SAFETY: lanes within the sides index words.
        let words =
            unsafe { _mm512_mask_i32gather_epi32::<4>(beyond, in_map, word, map.words.as_ptr().cast()) };
        let bit = _mm512_srlv_epi32(words, _mm512_and_si512(x, _mm512_set1_epi32(31)));
        let found = _mm512_test_epi32_mask(bit, one);
        for (lane, bit) in bits[at..at + 16].iter_mut().enumerate() {
            *bit = found >> lane & 1 != 0;
        }
    }
}
