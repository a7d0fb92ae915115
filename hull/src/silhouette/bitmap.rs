//! One bit per pixel over a rectangle: what the probes look things up in.

use super::{PixelRect, Silhouette};
use crate::camera::Pixel;

/// One bit per pixel of a rectangle whose left side is a multiple of 64; pixels beyond it all have
/// the same value.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BitMap {
    left: i32,
    top: i32,
    words_per_row: usize,
    rows: usize,
    words: Vec<u64>,
    beyond: bool,
}

impl BitMap {
    /// A map over at least the rectangle grown by `pad` pixels, all bits `value`; beyond it `beyond`.
    pub fn filled(rect: PixelRect, pad: u32, value: bool, beyond: bool) -> BitMap {
        let pad = pad as i32;
        let left = (rect.left as i32 - pad).div_euclid(64) * 64;
        let right = rect.right as i32 + pad;
        let top = rect.top as i32 - pad;
        let words_per_row = ((right - left) as usize).div_ceil(64);
        let rows = (rect.bottom as i32 + pad - top) as usize;
        let words = vec![if value { u64::MAX } else { 0 }; words_per_row * rows];
        BitMap { left, top, words_per_row, rows, words, beyond }
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
        let base = (row - self.top) as usize * self.words_per_row;
        let (start, end) = ((start - self.left) as usize, (end - self.left) as usize);
        if start >= end {
            return;
        }
        let (first, last) = (start / 64, (end - 1) / 64);
        for word in first..=last {
            let mut mask = u64::MAX;
            if word == first {
                mask &= u64::MAX << (start % 64);
            }
            if word == last {
                mask &= u64::MAX >> (63 - (end - 1) % 64);
            }
            let bits = &mut self.words[base + word];
            if value { *bits |= mask } else { *bits &= !mask }
        }
    }

    /// The bit of a pixel.
    #[inline]
    pub fn get(&self, pixel: Pixel) -> bool {
        match self.address(pixel.column, pixel.row) {
            Some(address) => self.bit(address),
            None => self.beyond,
        }
    }

    /// Where the rectangle holds a pixel's bit, counted in bits.
    #[inline]
    pub fn address(&self, column: i32, row: i32) -> Option<usize> {
        let (column, row) = (column.wrapping_sub(self.left) as u32, row.wrapping_sub(self.top) as u32);
        let within = (column as usize) < self.words_per_row * 64 && (row as usize) < self.rows;
        within.then(|| row as usize * self.words_per_row * 64 + column as usize)
    }

    /// The bit at an address.
    #[inline]
    pub fn bit(&self, address: usize) -> bool {
        self.words[address / 64] >> (address % 64) & 1 != 0
    }

    /// True if all bits between two pixels, both included, are ones; false if the rectangle does not hold
    /// them all.
    pub fn all_ones(&self, a: Pixel, b: Pixel) -> bool {
        let (left, right) = (a.column.min(b.column) - self.left, a.column.max(b.column) - self.left);
        let (top, bottom) = (a.row.min(b.row) - self.top, a.row.max(b.row) - self.top);
        if left < 0 || top < 0 || right as usize >= self.words_per_row * 64 || bottom as usize >= self.rows {
            return false;
        }
        let (first, last) = (left as usize / 64, right as usize / 64);
        let (head, tail) = (u64::MAX << (left % 64), u64::MAX >> (63 - right % 64));
        (top as usize..=bottom as usize).all(|row| {
            let words = &self.words[row * self.words_per_row..][..self.words_per_row];
            if first == last {
                return !words[first] & head & tail == 0;
            }
            !words[first] & head == 0
                && !words[last] & tail == 0
                && words[first + 1..last].iter().all(|&word| word == u64::MAX)
        })
    }

    /// First row of the rectangle.
    pub fn top(&self) -> i32 {
        self.top
    }

    /// First column of the rectangle, a multiple of 64.
    pub fn left(&self) -> i32 {
        self.left
    }

    /// Row after the last.
    pub fn bottom(&self) -> i32 {
        self.top + self.rows as i32
    }

    /// Column after the last.
    pub fn right(&self) -> i32 {
        self.left + (self.words_per_row * 64) as i32
    }

    /// The words of a row within the rectangle; bit `b` of word `w` is column `left + 64 w + b`.
    #[inline]
    pub fn row_words(&self, row: i32) -> &[u64] {
        let base = (row - self.top) as usize * self.words_per_row;
        &self.words[base..base + self.words_per_row]
    }

    /// Heap memory, bytes.
    pub fn heap_bytes(&self) -> usize {
        self.words.capacity() * 8
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::random_mask;
    use super::*;
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
