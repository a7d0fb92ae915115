//! The silhouette's 2D normal at an edge pixel (paper §4.2): the average of the vectors to the
//! background pixels of a window, from sums over words.

#[cfg(target_arch = "x86_64")]
mod avx512;

use std::ops::Range;

use nalgebra::Vector2;

use crate::camera::Pixel;
use crate::silhouette::{BitMap, STRIP};
use crate::vector::VectorPath;

/// The sum of the vectors from `centre` to every zero bit of the (2k + 1)² window around it, pixels.
/// The average has the same direction.
#[inline(always)]
pub fn sum_of_background(candidates: &BitMap, centre: Pixel, k: u32, path: VectorPath) -> Vector2<f64> {
    let k = k as i32;
    #[cfg(target_arch = "x86_64")]
    if path == VectorPath::Avx512 {
        #[allow(unsafe_code, reason = "the path was asked whether it is available when it was chosen")]
        let (across, down) = unsafe { avx512::sum_of_background(candidates, centre, k) };
        return Vector2::new(f64::from(across), f64::from(down));
    }
    let _ = path;
    let (top, bottom) = (centre.row - k, centre.row + k + 1);
    let (above, below) = (top.max(candidates.top()), bottom.min(candidates.bottom()));
    let mut sum = Sum::default();
    for (strip, mask, across) in window_columns(candidates, centre, k) {
        if strip < 0 || strip as usize >= candidates.strips() || above >= below {
            sum.add_same(candidates.beyond(), mask, across, top - centre.row..bottom - centre.row);
            continue;
        }
        sum.add_same(candidates.beyond(), mask, across, top - centre.row..above - centre.row);
        sum.add_same(candidates.beyond(), mask, across, below - centre.row..bottom - centre.row);
        let first = (above - candidates.top()) as usize;
        let words = &candidates.strip(strip as usize)[first..first + (below - above) as usize];
        sum.add(words, mask, across, above - centre.row);
    }
    Vector2::new(f64::from(sum.across), f64::from(sum.down))
}

/// The strips of a window, which the map need not have: the columns that count, and where they begin from
/// the centre.
#[inline(always)]
fn window_columns(
    candidates: &BitMap,
    centre: Pixel,
    k: i32,
) -> impl Iterator<Item = (i32, u32, i32)> + use<> {
    let (left, right) = (centre.column - k - candidates.left(), centre.column + k + 1 - candidates.left());
    let centre = centre.column - candidates.left();
    (left.div_euclid(STRIP)..=(right - 1).div_euclid(STRIP)).map(move |strip| {
        let base = strip * STRIP;
        let (from, to) = ((left - base).max(0), (right - base).min(STRIP));
        (strip, (u32::MAX << from) & (u32::MAX >> (STRIP - to)), base - centre)
    })
}

/// Columns and rows of zeros, from the centre.
#[derive(Default)]
pub(super) struct Sum {
    pub across: i32,
    pub down: i32,
}

impl Sum {
    /// Adds the zeros under the mask in words of consecutive rows; bit 0 is `across` from the centre, the
    /// first row `down`.
    #[inline(always)]
    pub fn add(&mut self, words: &[u32], mask: u32, across: i32, down: i32) {
        for (row, &word) in (down..).zip(words) {
            let zeros = !word & mask;
            let count = zeros.count_ones() as i32;
            self.across += across * count + places(zeros);
            self.down += row * count;
        }
    }

    /// Adds the zeros of words of consecutive rows, each under a mask of its own, and returns how many there are. Bit 0 is
    /// `across` from the centre, the first row `down`.
    #[inline(always)]
    pub fn add_rows<const ROWS: usize>(
        &mut self,
        words: &[u32; ROWS],
        masks: &[u32; ROWS],
        across: i32,
        down: i32,
    ) -> i32 {
        let mut all = 0;
        for at in 0..ROWS {
            let (count, places) = count_and_places(!words[at] & masks[at]);
            self.across += across * count + places;
            self.down += (down + at as i32) * count;
            all += count;
        }
        all
    }

    /// The same for rows beyond the map.
    fn add_same(&mut self, value: bool, mask: u32, across: i32, rows: Range<i32>) {
        let word = if value { u32::MAX } else { 0 };
        rows.for_each(|row| self.add(&[word], mask, across, row));
    }
}

/// The places of a word that have each binary digit, the highest first.
pub(super) const PLACES: [u32; 5] = [0xffff_0000, 0xff00_ff00, 0xf0f0_f0f0, 0xcccc_cccc, 0xaaaa_aaaa];

/// How many ones there are, and the sum of their places. By sums of ever wider fields, of which the upper of two adds its
/// width to the place of each of its ones: x86 counts ones in vectors with AVX-512 alone.
#[inline(always)]
fn count_and_places(ones: u32) -> (i32, i32) {
    let upper = ones >> 1 & 0x5555_5555;
    let (count, places) = ((ones & 0x5555_5555) + upper, upper);
    let halves = |fields: u32, width: u32, mask: u32| (fields & mask, fields >> width & mask);
    let join = |(count, places): (u32, u32), width: u32, mask: u32| {
        let ((count, upper), (places, more)) = (halves(count, width, mask), halves(places, width, mask));
        (count + upper, places + more + width * upper)
    };
    let pairs = join((count, places), 2, 0x3333_3333);
    let bytes = join(pairs, 4, 0x0f0f_0f0f);
    let sixteen = join(bytes, 8, 0x00ff_00ff);
    let (count, places) = join(sixteen, 16, 0xffff);
    (count as i32, places as i32)
}

/// The sum of the places of the ones.
#[inline(always)]
fn places(ones: u32) -> i32 {
    PLACES.iter().fold(0, |sum, bits| 2 * sum + (ones & bits).count_ones() as i32)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::silhouette::Silhouette;
    use crate::silhouette::tests::{drawn, random_mask};
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn ones_are_counted_and_their_places_summed(ones in any::<u32>(), keep in any::<u32>()) {
            for ones in [ones, ones & keep, ones | keep, 0, u32::MAX] {
                let expected = (ones.count_ones() as i32, places(ones));
                prop_assert_eq!(count_and_places(ones), expected);
                prop_assert_eq!(expected.1, (0..32).filter(|place| ones >> place & 1 != 0).sum::<i32>());
            }
        }
    }

    #[test]
    fn a_straight_edge_has_a_straight_normal() {
        let map = BitMap::foreground(&drawn(&["#####.....", "#####.....", "#####....."]), 3);
        let sum = sum_of_background(&map, Pixel { column: 5, row: 1 }, 1, VectorPath::best());
        assert_eq!(sum, Vector2::new(3.0, 0.0));
    }

    proptest! {
        #[test]
        fn sums_over_words_are_sums_over_pixels(
            width in 1u32..200, height in 1u32..60, seed in any::<u64>(), column in -3i32..203,
            row in -3i32..63, k in 1u32..40,
        ) {
            let silhouette =
                Silhouette::from_mask(width, height, &random_mask(width, height, seed)).expect("size");
            let map = BitMap::foreground(&silhouette, 1);
            let (column, row) = (column.min(width as i32), row.min(height as i32));
            let reach = k as i32;
            let mut expected = Vector2::zeros();
            for dy in -reach..=reach {
                for dx in -reach..=reach {
                    if !map.get(Pixel { column: column + dx, row: row + dy }) {
                        expected += Vector2::new(f64::from(dx), f64::from(dy));
                    }
                }
            }
            for path in VectorPath::ALL.into_iter().filter(|path| path.is_available()) {
                prop_assert_eq!(sum_of_background(&map, Pixel { column, row }, k, path), expected);
            }
        }
    }
}
