//! The same with eight points at once: one gather brings their bits, and those that are kept are
//! compressed to the front. A gather and stores through pointers are unsafe: indices are compared with
//! the map's sides first, and vectors written to the front never pass those read.

use std::arch::x86_64::*;

use super::{BLOCK, BitMap, Block, Frame};
use crate::silhouette::{EMPTY, Index};

/// A map of more words is not looked at before its cells: they stay in the nearest caches.
const SMALL_WORDS: usize = 1 << 14;

#[target_feature(enable = "avx512f,avx512dq,avx512vl,avx512bw,avx2,popcnt")]
pub(super) fn keep_foreground(block: &mut Block, frame: &Frame, index: &Index, number: usize) {
    if index.map().words().len() <= SMALL_WORDS || number >= 32 {
        let bits = Bits::of(index.map());
        keep::<false>(block, frame, 0, |column, row, lanes| (bits.foreground(column, row, lanes), 0));
    } else {
        let cells = Cells::of(index);
        keep::<true>(block, frame, 1 << number, |column, row, lanes| cells.foreground(column, row, lanes));
        block.has_doubts = true;
    }
}

/// Keeps the points whose lanes are told, and notes a doubt about those whose lanes are told apart.
#[allow(unsafe_code, reason = "loads and stores through pointers, within bounds as said above")]
#[inline]
#[target_feature(enable = "avx512f,avx512dq,avx512vl,avx512bw,avx2,popcnt")]
fn keep<const DOUBTS: bool>(
    block: &mut Block,
    frame: &Frame,
    doubt: u32,
    foreground: impl Fn(__m256i, __m256i, __mmask8) -> (__mmask8, __mmask8),
) {
    const { assert!(BLOCK.is_multiple_of(8)) };
    let mut kept = 0;
    let mut at = 0;
    while at < block.len {
        // SAFETY: `at` is a multiple of eight below the length, and so is the block's.
        let (x, y, z, place) = unsafe {
            (
                _mm512_loadu_pd(block.x.as_ptr().add(at)),
                _mm512_loadu_pd(block.y.as_ptr().add(at)),
                _mm512_loadu_pd(block.z.as_ptr().add(at)),
                _mm256_loadu_si256(block.place.as_ptr().add(at).cast()),
            )
        };
        let (seen, column, row) = pixels(frame, x, y, z);
        let left_over = block.len - at;
        let lanes = if left_over >= 8 { 0xff } else { (1u8 << left_over) - 1 };
        let (certain, doubtful) = foreground(column, row, seen & lanes);
        let keep = certain | doubtful;
        // SAFETY: `kept` never passes `at`, so that whole vectors stay within the block.
        unsafe {
            _mm512_storeu_pd(block.x.as_mut_ptr().add(kept), _mm512_maskz_compress_pd(keep, x));
            _mm512_storeu_pd(block.y.as_mut_ptr().add(kept), _mm512_maskz_compress_pd(keep, y));
            _mm512_storeu_pd(block.z.as_mut_ptr().add(kept), _mm512_maskz_compress_pd(keep, z));
            let place = _mm256_maskz_compress_epi32(keep, place);
            _mm256_storeu_si256(block.place.as_mut_ptr().add(kept).cast(), place);
            let doubts = _mm256_loadu_si256(block.doubts.as_ptr().add(at).cast());
            let doubts = if DOUBTS {
                let doubt = _mm256_maskz_set1_epi32(doubtful, doubt as i32);
                _mm256_or_si256(doubts, doubt)
            } else {
                doubts
            };
            let doubts = _mm256_maskz_compress_epi32(keep, doubts);
            _mm256_storeu_si256(block.doubts.as_mut_ptr().add(kept).cast(), doubts);
        }
        kept += keep.count_ones() as usize;
        at += 8;
    }
    block.len = kept;
}

/// A map's bits.
struct Bits {
    left: __m256i,
    top: __m256i,
    columns: __m256i,
    rows: __m256i,
    words: *const i32,
}

impl Bits {
    #[inline]
    #[target_feature(enable = "avx512f,avx512dq,avx512vl,avx512bw,avx2")]
    fn of(map: &BitMap) -> Bits {
        Bits {
            left: _mm256_set1_epi32(map.left()),
            top: _mm256_set1_epi32(map.top()),
            columns: _mm256_set1_epi32(map.right() - map.left()),
            rows: _mm256_set1_epi32(map.rows() as i32),
            words: map.words().as_ptr().cast(),
        }
    }

    /// Which of the lanes are ones.
    #[allow(unsafe_code, reason = "a gather within bounds as said above")]
    #[inline]
    #[target_feature(enable = "avx512f,avx512dq,avx512vl,avx512bw,avx2")]
    fn foreground(&self, column: __m256i, row: __m256i, lanes: __mmask8) -> __mmask8 {
        let column = _mm256_sub_epi32(column, self.left);
        let row = _mm256_sub_epi32(row, self.top);
        let within =
            lanes & _mm256_cmplt_epu32_mask(column, self.columns) & _mm256_cmplt_epu32_mask(row, self.rows);
        let word = _mm256_add_epi32(_mm256_mullo_epi32(_mm256_srli_epi32::<5>(column), self.rows), row);
        let zero = _mm256_setzero_si256();
        // SAFETY: lanes that are within the map's sides index its words; the others are masked.
        let bits = unsafe { _mm256_mmask_i32gather_epi32::<4>(zero, within, word, self.words) };
        let bits = _mm256_srlv_epi32(bits, _mm256_and_si256(column, _mm256_set1_epi32(31)));
        _mm256_test_epi32_mask(bits, _mm256_set1_epi32(1))
    }
}

/// A map's cells.
struct Cells {
    shift: __m128i,
    left: __m256i,
    top: __m256i,
    columns: __m256i,
    rows: __m256i,
    levels: *const i32,
}

impl Cells {
    #[inline]
    #[target_feature(enable = "avx512f,avx512dq,avx512vl,avx512bw,avx2")]
    fn of(index: &Index) -> Cells {
        let (shift, [left, top], [columns, rows], levels) = index.depth().cells();
        Cells {
            shift: _mm_cvtsi32_si128(shift as i32),
            left: _mm256_set1_epi32(left),
            top: _mm256_set1_epi32(top),
            columns: _mm256_set1_epi32(columns as i32),
            rows: _mm256_set1_epi32(rows as i32),
            levels: levels.as_ptr().cast(),
        }
    }

    /// Which of the lanes are in full cells, and which in cells that have ones and zeros.
    #[allow(unsafe_code, reason = "a gather within bounds as said above")]
    #[inline]
    #[target_feature(enable = "avx512f,avx512dq,avx512vl,avx512bw,avx2")]
    fn foreground(&self, column: __m256i, row: __m256i, lanes: __mmask8) -> (__mmask8, __mmask8) {
        let column = _mm256_sub_epi32(_mm256_sra_epi32(column, self.shift), self.left);
        let row = _mm256_sub_epi32(_mm256_sra_epi32(row, self.shift), self.top);
        let within =
            lanes & _mm256_cmplt_epu32_mask(column, self.columns) & _mm256_cmplt_epu32_mask(row, self.rows);
        let cell = _mm256_add_epi32(_mm256_mullo_epi32(row, self.columns), column);
        let empty = _mm256_set1_epi32(i32::from(EMPTY));
        // SAFETY: lanes that are within the sides index levels, which are padded by a word.
        let level = unsafe { _mm256_mmask_i32gather_epi32::<1>(empty, within, cell, self.levels) };
        let level = _mm256_and_si256(level, _mm256_set1_epi32(255));
        let some = within & _mm256_cmpneq_epi32_mask(level, empty);
        let full = some & _mm256_test_epi32_mask(level, level);
        (full, some & !full)
    }
}

/// The pixels of eight points, and which of them are seen: the operations of [`Frame::pixel`] in their
/// order.
#[inline]
#[target_feature(enable = "avx512f,avx512dq,avx512vl,avx512bw,avx2")]
fn pixels(frame: &Frame, x: __m512d, y: __m512d, z: __m512d) -> (__mmask8, __m256i, __m256i) {
    let of = |number: f64| _mm512_set1_pd(number);
    let add = |a: __m512d, b: __m512d| _mm512_add_pd(a, b);
    let mul = |a: __m512d, b: __m512d| _mm512_mul_pd(a, b);
    let along =
        |r: [f64; 3], t: f64| add(add(add(mul(of(r[0]), x), mul(of(r[1]), y)), mul(of(r[2]), z)), of(t));
    let [tx, ty, tz] = frame.translation;
    let xc = along(frame.rotation[0], tx);
    let yc = along(frame.rotation[1], ty);
    let zc = along(frame.rotation[2], tz);
    let mut seen = _mm512_cmp_pd_mask::<_CMP_GT_OQ>(zc, _mm512_setzero_pd());
    let inverse_depth = _mm512_div_pd(of(1.0), zc);
    let (mut xn, mut yn) = (mul(xc, inverse_depth), mul(yc, inverse_depth));
    if !frame.straight {
        let [k1, k2, p1, p2, k3] = frame.lens;
        let radius_squared = add(mul(xn, xn), mul(yn, yn));
        seen &= _mm512_cmp_pd_mask::<_CMP_LT_OQ>(radius_squared, of(frame.max_radius_squared));
        let inner = add(of(k2), mul(radius_squared, of(k3)));
        let middle = add(of(k1), mul(radius_squared, inner));
        let c = add(of(1.0), mul(radius_squared, middle));
        let xy = mul(xn, yn);
        let twice = |a: __m512d| mul(of(2.0), a);
        let across = add(radius_squared, mul(twice(xn), xn));
        let down = add(radius_squared, mul(twice(yn), yn));
        let bent = add(add(mul(c, xn), mul(of(2.0 * p1), xy)), mul(of(p2), across));
        yn = add(add(mul(c, yn), mul(of(p1), down)), mul(of(2.0 * p2), xy));
        xn = bent;
    }
    let [fx, skew, cx, fy, cy] = frame.affine;
    let half = of(0.5);
    let u = add(add(add(mul(of(fx), xn), mul(of(skew), yn)), of(cx)), half);
    let v = add(add(mul(of(fy), yn), of(cy)), half);
    // Numbers too large for an integer become the least one, which is on no map.
    let floor = |a: __m512d| _mm512_cvttpd_epi32(_mm512_roundscale_pd::<9>(a));
    (seen, floor(u), floor(v))
}
