//! One bit per pixel over a rectangle: what the probes look things up in.
//!
//! The bits lie in strips 32 columns wide, each stored row by row: the words of neighbouring rows are
//! neighbours in memory, so that one load brings 32 columns of many rows.

#[cfg(target_arch = "x86_64")]
mod avx512;

use super::{PixelRect, Silhouette};
use crate::camera::Pixel;
use crate::vector::VectorPath;

/// Columns of a strip: the bits of a word.
pub(crate) const STRIP: i32 = 32;

/// Rows come in multiples of this, so that no square of pixels that is looked at as one is cut.
const ROWS: i32 = 8;
/// So many rows are looked at together.
const LEAST_ROWS: usize = 16;

/// One bit per pixel of a rectangle of whole strips; pixels beyond it all have the same value.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BitMap {
    left: i32,
    top: i32,
    strips: usize,
    rows: usize,
    words: Vec<u32>,
    beyond: bool,
}

impl BitMap {
    /// A map over at least the rectangle grown by `pad` pixels, all bits `value`; beyond it `beyond`.
    pub fn filled(rect: PixelRect, pad: u32, value: bool, beyond: bool) -> BitMap {
        let pad = pad as i32;
        let corner = |column: u32, row: u32, grow: i32| (column as i32 + grow, row as i32 + grow);
        BitMap::over(corner(rect.left, rect.top, -pad), corner(rect.right, rect.bottom, pad), value, beyond)
    }

    /// A map over at least the pixels from `first` up to `end` (column, row), all bits `value`.
    pub(crate) fn over(first: (i32, i32), end: (i32, i32), value: bool, beyond: bool) -> BitMap {
        let (left, top) = (first.0.div_euclid(STRIP) * STRIP, first.1.div_euclid(ROWS) * ROWS);
        let strips = ((end.0 - left) as usize).div_ceil(STRIP as usize);
        let rows = ((end.1 - top) as usize).next_multiple_of(ROWS as usize).max(LEAST_ROWS);
        let words = vec![if value { u32::MAX } else { 0 }; strips * rows];
        BitMap { left, top, strips, rows, words, beyond }
    }

    /// The foreground of a silhouette as ones, with zeros at least `pad` pixels around and beyond.
    pub fn foreground(silhouette: &Silhouette, pad: u32) -> BitMap {
        let nothing = PixelRect { left: 0, top: 0, right: 1, bottom: 1 };
        let mut map = BitMap::filled(silhouette.bounds().unwrap_or(nothing), pad, false, false);
        map.add(silhouette);
        map
    }

    /// Sets the bits of a silhouette's foreground, which must lie within the rectangle.
    pub fn add(&mut self, silhouette: &Silhouette) {
        let Some(bounds) = silhouette.bounds() else { return };
        for row in bounds.top..bounds.bottom {
            for run in silhouette.row(row) {
                self.set(row as i32, i32::from(run.start), i32::from(run.end), true);
            }
        }
    }

    /// Sets the bits of columns `start..end` of a row, all within the rectangle.
    pub fn set(&mut self, row: i32, start: i32, end: i32, value: bool) {
        let row = (row - self.top) as usize;
        let (start, end) = ((start - self.left) as usize, (end - self.left) as usize);
        if start >= end {
            return;
        }
        let (first, last) = (start / 32, (end - 1) / 32);
        for strip in first..=last {
            let mask = bits_within(strip, start, end - 1);
            let bits = &mut self.words[strip * self.rows + row];
            if value { *bits |= mask } else { *bits &= !mask }
        }
    }

    /// The bit of a pixel.
    #[inline(always)]
    pub fn get(&self, pixel: Pixel) -> bool {
        let column = pixel.column.wrapping_sub(self.left) as u32 as usize;
        let row = pixel.row.wrapping_sub(self.top) as u32 as usize;
        if column < self.strips * 32 && row < self.rows {
            self.words[column / 32 * self.rows + row] >> (column % 32) & 1 != 0
        } else {
            self.beyond
        }
    }

    /// The bits of many pixels.
    #[inline(always)]
    pub(crate) fn look_up<const N: usize>(
        &self,
        column: &[i32; N],
        row: &[i32; N],
        bits: &mut [bool; N],
        path: VectorPath,
    ) {
        #[cfg(target_arch = "x86_64")]
        if path == VectorPath::Avx512 {
            #[allow(unsafe_code, reason = "the path was asked whether it is available when it was chosen")]
            return unsafe { avx512::look_up(self, column, row, bits) };
        }
        let _ = path;
        for at in 0..N {
            bits[at] = self.get(Pixel { column: column[at], row: row[at] });
        }
    }

    /// So many rows of 32 columns, from a pixel on.
    #[inline(always)]
    pub(crate) fn words_from<const COUNT: usize>(&self, corner: Pixel) -> [u32; COUNT] {
        let strip = corner.column.div_euclid(STRIP).wrapping_sub(self.left / STRIP);
        let bit = corner.column.rem_euclid(STRIP);
        let row = corner.row.wrapping_sub(self.top);
        let before: [u32; COUNT] = self.rows_from(strip, row);
        let after: [u32; COUNT] = self.rows_from(strip.wrapping_add(1), row);
        // A shift by 32 is none: shift by one first.
        std::array::from_fn(|at: usize| before[at] >> bit | after[at] << 1 << (STRIP - 1 - bit))
    }

    /// So many rows of a strip; both may lie beyond the rectangle.
    #[inline(always)]
    fn rows_from<const COUNT: usize>(&self, strip: i32, row: i32) -> [u32; COUNT] {
        let mut words = [if self.beyond { u32::MAX } else { 0 }; COUNT];
        if strip as u32 as usize >= self.strips {
            return words;
        }
        let strip = self.strip(strip as usize);
        match strip.get(row as u32 as usize..).and_then(|words| words.first_chunk()) {
            Some(found) => *found,
            None => {
                for (at, word) in words.iter_mut().enumerate() {
                    *word = *strip.get((row + at as i32) as u32 as usize).unwrap_or(word);
                }
                words
            }
        }
    }

    /// True if all bits between two pixels, both included, are ones; false if the rectangle does not hold
    /// them all.
    #[inline(always)]
    pub fn all_ones(&self, a: Pixel, b: Pixel) -> bool {
        let (left, right) = (a.column.min(b.column) - self.left, a.column.max(b.column) - self.left);
        let (top, bottom) = (a.row.min(b.row) - self.top, a.row.max(b.row) - self.top);
        if left < 0 || top < 0 || right as usize >= self.strips * 32 || bottom as usize >= self.rows {
            return false;
        }
        let (first, last) = (left as usize / 32, right as usize / 32);
        (first..=last).all(|strip| {
            let mask = bits_within(strip, left as usize, right as usize);
            let words = &self.strip(strip)[top as usize..=bottom as usize];
            words.iter().fold(u32::MAX, |all, &word| all & word) & mask == mask
        })
    }

    /// The value of the pixels beyond the rectangle.
    pub fn beyond(&self) -> bool {
        self.beyond
    }

    /// First row of the rectangle, a multiple of eight.
    pub fn top(&self) -> i32 {
        self.top
    }

    /// First column of the rectangle, a multiple of the width of a strip.
    pub fn left(&self) -> i32 {
        self.left
    }

    /// Row after the last.
    pub fn bottom(&self) -> i32 {
        self.top + self.rows as i32
    }

    /// Column after the last.
    pub fn right(&self) -> i32 {
        self.left + self.strips as i32 * STRIP
    }

    /// How many rows there are.
    #[inline]
    pub(crate) fn rows(&self) -> usize {
        self.rows
    }

    /// How many strips there are.
    #[inline]
    pub(crate) fn strips(&self) -> usize {
        self.strips
    }

    /// The words of a strip, one a row from the top; bit `b` is column `left + 32 strip + b`.
    #[inline(always)]
    pub(crate) fn strip(&self, strip: usize) -> &[u32] {
        &self.words[strip * self.rows..][..self.rows]
    }

    /// All words, strip after strip.
    #[inline(always)]
    pub(crate) fn words(&self) -> &[u32] {
        &self.words
    }

    /// All words, to be changed.
    pub(crate) fn words_mut(&mut self) -> &mut [u32] {
        &mut self.words
    }

    /// Heap memory, bytes.
    pub fn heap_bytes(&self) -> usize {
        self.words.capacity() * 4
    }
}

/// The bits of a strip that are in a row's columns from the first to the last.
#[inline(always)]
pub(super) fn bits_within(strip: usize, first: usize, last: usize) -> u32 {
    let mut bits = u32::MAX;
    if strip == first / 32 {
        bits &= u32::MAX << (first % 32);
    }
    if strip == last / 32 {
        bits &= u32::MAX >> (31 - last % 32);
    }
    bits
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::silhouette::tests::random_mask;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn bits_runs_and_mask_say_the_same(width in 1u32..200, height in 1u32..40, seed in any::<u64>()) {
            let silhouette =
                Silhouette::from_mask(width, height, &random_mask(width, height, seed)).expect("size");
            let map = BitMap::foreground(&silhouette, 3);
            for row in -5..height as i32 + 5 {
                for column in -70..width as i32 + 70 {
                    prop_assert_eq!(map.get(Pixel { column, row }), silhouette.contains(column, row));
                }
            }
        }

        #[test]
        fn all_ones_is_every_bit(
            seed in any::<u64>(), a in (-40i32..140, -4i32..30), b in (-40i32..140, -4i32..30),
        ) {
            let silhouette = Silhouette::from_mask(100, 25, &random_mask(100, 25, seed)).expect("size");
            let map = BitMap::foreground(&silhouette, 1);
            let pixel = |(column, row)| Pixel { column, row };
            let columns = a.0.min(b.0)..=a.0.max(b.0);
            let every = (a.1.min(b.1)..=a.1.max(b.1))
                .all(|row| columns.clone().all(|column| map.get(Pixel { column, row })));
            prop_assert_eq!(map.all_ones(pixel(a), pixel(b)), every);
        }
    }

    #[test]
    fn set_and_clear_across_words() {
        let mut map = BitMap::filled(PixelRect { left: 0, top: 0, right: 200, bottom: 2 }, 1, false, true);
        map.set(1, 60, 130, true);
        map.set(1, 70, 71, false);
        let ones: Vec<i32> = (-1..201).filter(|&column| map.get(Pixel { column, row: 1 })).collect();
        assert_eq!(ones, (60..130).filter(|&column| column != 70).collect::<Vec<_>>());
        assert!(map.get(Pixel { column: 0, row: 99 }), "beyond");
    }
}
