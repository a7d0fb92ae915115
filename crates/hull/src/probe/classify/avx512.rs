//! The same for sixteen points at once: sketches lie in registers, and the points that are kept are
//! compressed to the front. Loads and stores through pointers are unsafe: vectors written to the front
//! never pass those read.

use std::arch::x86_64::*;

use super::{BLOCK, Block};
use crate::silhouette::ROWS;
use crate::view::sieve::{Sieve, SieveLens, Sums};

/// Sixteen numbers.
const LANES: usize = 16;

/// Words of a sketch in registers.
struct Bits([__m512i; 4]);

#[allow(unsafe_code, reason = "loads and stores through pointers, within bounds as said above")]
#[target_feature(enable = "avx512f,avx512dq,avx512vl,avx512bw,avx2,popcnt")]
pub(super) fn sift(block: &mut Block, sieve: &Sieve, sums: &Sums, doubt: u32) {
    match sieve.lens() {
        None => keep(block, sieve, sums, doubt, |s, t| (s, t, 0xffff, 0)),
        Some(lens) => keep(block, sieve, sums, doubt, |s, t| bent(lens, s, t)),
    }
}

#[allow(unsafe_code, reason = "loads and stores through pointers, within bounds as said above")]
#[inline]
#[target_feature(enable = "avx512f,avx512dq,avx512vl,avx512bw,avx2,popcnt")]
fn keep(
    block: &mut Block,
    sieve: &Sieve,
    sums: &Sums,
    doubt: u32,
    lens: impl Fn(__m512, __m512) -> (__m512, __m512, __mmask16, __mmask16),
) {
    const { assert!(BLOCK.is_multiple_of(LANES)) };
    let some = Bits::of(&sieve.sketch.some);
    let full = Bits::of(&sieve.sketch.full);
    let of = |number: f32| _mm512_set1_ps(number);
    let doubt = _mm512_set1_epi32(doubt as i32);
    let mut kept = 0;
    let mut at = 0;
    while at < block.len {
        // SAFETY: `at` is a multiple of sixteen below the length, and so is the block's.
        let (x, y, z, tag) = unsafe {
            (
                _mm512_loadu_ps(block.x.as_ptr().add(at)),
                _mm512_loadu_ps(block.y.as_ptr().add(at)),
                _mm512_loadu_ps(block.z.as_ptr().add(at)),
                _mm512_loadu_si512(block.tag.as_ptr().add(at).cast()),
            )
        };
        let sum = |r: [f32; 4]| {
            _mm512_fmadd_ps(of(r[0]), x, _mm512_fmadd_ps(of(r[1]), y, _mm512_fmadd_ps(of(r[2]), z, of(r[3]))))
        };
        let depth = sum(sums.rows[2]);
        let inverse = _mm512_div_ps(of(1.0), depth);
        let (s, t) = (_mm512_mul_ps(sum(sums.rows[0]), inverse), _mm512_mul_ps(sum(sums.rows[1]), inverse));
        let (s, t, near, beyond) = lens(s, t);
        let certain = near & _mm512_cmp_ps_mask::<_CMP_GT_OQ>(depth, of(sums.certain));
        let unseen = beyond | _mm512_cmp_ps_mask::<_CMP_LE_OQ>(depth, of(sums.behind));
        let floor = |number: __m512| {
            _mm512_cvt_roundps_epi32::<{ _MM_FROUND_TO_NEG_INF | _MM_FROUND_NO_EXC }>(number)
        };
        let (column, row) = (floor(s), floor(t));
        let left_over = block.len - at;
        let lanes = if left_over >= LANES { 0xffff } else { (1u16 << left_over) - 1 };
        let unknown = !certain & !unseen;
        let on_some = certain & some.ones(column, row);
        let keep = lanes & (on_some | unknown);
        let told = on_some & full.ones(column, row);
        let tag = _mm512_mask_or_epi32(tag, !told, tag, doubt);
        // SAFETY: `kept` never passes `at`, so that whole vectors stay within the block.
        unsafe {
            _mm512_storeu_ps(block.x.as_mut_ptr().add(kept), _mm512_maskz_compress_ps(keep, x));
            _mm512_storeu_ps(block.y.as_mut_ptr().add(kept), _mm512_maskz_compress_ps(keep, y));
            _mm512_storeu_ps(block.z.as_mut_ptr().add(kept), _mm512_maskz_compress_ps(keep, z));
            let tag = _mm512_maskz_compress_epi32(keep, tag);
            _mm512_storeu_si512(block.tag.as_mut_ptr().add(kept).cast(), tag);
        }
        kept += keep.count_ones() as usize;
        at += LANES;
    }
    block.len = kept;
}

impl Bits {
    #[allow(unsafe_code, reason = "loads of an array that is as long")]
    #[inline]
    #[target_feature(enable = "avx512f,avx512dq,avx512vl,avx512bw,avx2")]
    fn of(words: &[u32; ROWS]) -> Bits {
        const { assert!(ROWS == 4 * LANES) };
        // SAFETY: four vectors are the whole array.
        Bits(std::array::from_fn(|at| unsafe { _mm512_loadu_si512(words.as_ptr().add(at * LANES).cast()) }))
    }

    /// Which lanes are ones; none beyond the sketch.
    #[inline]
    #[target_feature(enable = "avx512f,avx512dq,avx512vl,avx512bw,avx2")]
    fn ones(&self, column: __m512i, row: __m512i) -> __mmask16 {
        let [a, b, c, d] = self.0;
        let second = _mm512_test_epi32_mask(row, _mm512_set1_epi32(32));
        let upper = _mm512_permutex2var_epi32(a, row, b);
        let lower = _mm512_permutex2var_epi32(c, row, d);
        let words = _mm512_mask_blend_epi32(second, upper, lower);
        // Shifts by more than there are bits leave none.
        let bits = _mm512_srlv_epi32(words, column);
        let within = _mm512_cmplt_epu32_mask(row, _mm512_set1_epi32(ROWS as i32));
        _mm512_mask_test_epi32_mask(within, bits, _mm512_set1_epi32(1))
    }
}

/// Through the lens: where, which lanes are certain, and which see nothing.
#[inline]
#[target_feature(enable = "avx512f,avx512dq,avx512vl,avx512bw,avx2")]
fn bent(lens: &SieveLens, x: __m512, y: __m512) -> (__m512, __m512, __mmask16, __mmask16) {
    let of = |number: f32| _mm512_set1_ps(number);
    let mul = |a: __m512, b: __m512| _mm512_mul_ps(a, b);
    let sum = |a: __m512, b: __m512, c: __m512| _mm512_fmadd_ps(a, b, c);
    let [k1, k2, p1, p2, k3] = lens.coefficients;
    let [fx, skew, cx, fy, cy] = lens.affine;
    let squared = sum(x, x, mul(y, y));
    let c = sum(squared, sum(squared, sum(squared, of(k3), of(k2)), of(k1)), of(1.0));
    let xy = mul(mul(x, y), of(2.0));
    let twice = |a: __m512| mul(of(2.0), a);
    let across = sum(c, x, sum(of(p1), xy, mul(of(p2), sum(twice(x), x, squared))));
    let down = sum(c, y, sum(of(p2), xy, mul(of(p1), sum(twice(y), y, squared))));
    let certain = _mm512_cmp_ps_mask::<_CMP_LT_OQ>(squared, of(lens.certain));
    let unseen = _mm512_cmp_ps_mask::<_CMP_GT_OQ>(squared, of(lens.unseen));
    (sum(of(fx), across, sum(of(skew), down, of(cx))), sum(of(fy), down, of(cy)), certain, unseen)
}
