//! How far the foreground is from everything around it, coarsely: what lets a search from outside be short, or none.
//!
//! A cell is a square of pixels. A cell's level counts how often the cells that hold foreground must grow until they reach
//! it: by their eight neighbours, then four, and so on, so that they grow to octagons.

#[cfg(target_arch = "x86_64")]
mod avx512;

use super::depth::{BY_EIGHT, clear_squared};
use super::{BitMap, Index};
use crate::vector::VectorPath;

/// Cells around those of the silhouette's rectangle.
const MARGIN: i32 = 7;
/// Cells grow so often.
const MOST: usize = 8;
/// The level of cells that are not reached then.
const NOT_REACHED: u8 = MOST as u8 + 1;
/// The level of everything beyond the cells.
const BEYOND: u8 = MOST as u8 + 2;
/// Room for so many levels, which one vector holds.
const LEVELS: usize = 16;
/// What is read beyond a level when a word is.
const PADDING: usize = 3;
/// The longer side of an image has no more cells than this, or the largest cells.
const CELLS: u32 = 240;
/// The side of the largest, two to this.
const MOST_SHIFT: u32 = 5;

/// The level of every cell in and around a silhouette.
#[derive(Clone, Debug)]
pub struct Surroundings {
    /// Pixels of a cell's side are two to this.
    shift: u32,
    /// First column and row of cells, in cells.
    left: i32,
    top: i32,
    columns: usize,
    rows: usize,
    /// Row by row.
    levels: Vec<u8>,
    clear_squared: [i32; LEVELS],
    within_squared: [i32; LEVELS],
}

impl Surroundings {
    /// Around the ones of an index over an image whose longer side has so many pixels.
    pub fn new(index: &Index, longer_side_pixels: u32) -> Surroundings {
        let (map, depth) = (index.map(), index.depth());
        let wanted = (0..MOST_SHIFT).find(|&shift| CELLS << shift >= longer_side_pixels);
        let shift = wanted.unwrap_or(MOST_SHIFT).max(depth.shift());
        let (left, top) = ((map.left() >> shift) - MARGIN, (map.top() >> shift) - MARGIN);
        let columns = (((map.right() - 1) >> shift) + MARGIN + 1 - left) as usize;
        let rows = (((map.bottom() - 1) >> shift) + MARGIN + 1 - top) as usize;
        let mut grown = Grown::new(columns, rows);
        grown.take(depth.not_empty(), shift - depth.shift(), (left, top));
        let mut levels = vec![NOT_REACHED; columns * rows + PADDING];
        grown.mark(&mut levels, 0);
        for level in 1..=MOST {
            grown.grow(BY_EIGHT[(level - 1) % BY_EIGHT.len()]);
            grown.mark(&mut levels, level as u8);
        }
        let side = 1 << shift;
        let clear = clear_squared(side);
        let mut squared: [i32; LEVELS] = std::array::from_fn(|level| clear[level]);
        squared[usize::from(BEYOND)] = (MARGIN * side + 1) * (MARGIN * side + 1);
        let within_squared = within_squared(side);
        Surroundings { shift, left, top, columns, rows, levels, clear_squared: squared, within_squared }
    }

    /// [`Self::between_squared`] of many pixels.
    #[inline(always)]
    pub(crate) fn look_up<const N: usize>(
        &self,
        column: &[i32; N],
        row: &[i32; N],
        clear: &mut [i32; N],
        within: &mut [i32; N],
        path: VectorPath,
    ) {
        #[cfg(target_arch = "x86_64")]
        if path == VectorPath::Avx512 {
            #[allow(unsafe_code, reason = "the path was asked whether it is available when it was chosen")]
            return unsafe { avx512::look_up(self, column, row, clear, within) };
        }
        let _ = path;
        for at in 0..N {
            (clear[at], within[at]) = self.between_squared(column[at], row[at]);
        }
    }

    /// No foreground is nearer to a pixel than the first, and some is as near as the second, squared pixels.
    #[inline(always)]
    pub(crate) fn between_squared(&self, column: i32, row: i32) -> (i32, i32) {
        let column = ((column >> self.shift) - self.left) as u32 as usize;
        let row = ((row >> self.shift) - self.top) as u32 as usize;
        let is_cell = column < self.columns && row < self.rows;
        let level = if is_cell { self.levels[row * self.columns + column] } else { BEYOND };
        let level = usize::from(level).min(LEVELS - 1);
        (self.clear_squared[level], self.within_squared[level])
    }
}

/// The squared distance within which every pixel of a cell of a level has a one.
fn within_squared(side: i32) -> [i32; LEVELS] {
    let (mut reach, mut eights) = (0, 0);
    std::array::from_fn(|level| {
        if level > MOST {
            return i32::MAX;
        }
        if level > 0 {
            reach += 1;
            eights += i32::from(BY_EIGHT[(level - 1) % BY_EIGHT.len()]);
        }
        // The corners of the octagon are farthest.
        let (far, near) = ((reach + 1) * side - 1, (eights + 1) * side - 1);
        far * far + near * near
    })
}

/// A bit a cell, row by row, with a row of zeros above and below.
struct Grown {
    columns: usize,
    rows: usize,
    /// Words of a row.
    width: usize,
    words: Vec<u64>,
    before: Vec<u64>,
}

impl Grown {
    fn new(columns: usize, rows: usize) -> Grown {
        let width = columns.div_ceil(64);
        let words = vec![0; width * (rows + 2)];
        Grown { columns, rows, width, before: words.clone(), words }
    }

    /// Sets the cells that hold ones of finer cells, two to `shift` of them a side.
    fn take(&mut self, fine: &BitMap, shift: u32, (left, top): (i32, i32)) {
        for strip in 0..fine.strips() {
            let first = fine.left() + 32 * strip as i32;
            for (row, &word) in (fine.top()..).zip(fine.strip(strip)) {
                let mut bits = word;
                while bits != 0 {
                    let column = ((first + bits.trailing_zeros() as i32) >> shift) - left;
                    // The others of the same cell.
                    let end = ((column + left + 1) << shift) - first;
                    bits &= if end < 32 { u32::MAX << end } else { 0 };
                    let at = ((row >> shift) - top + 1) as usize * self.width + column as usize / 64;
                    self.words[at] |= 1 << (column % 64);
                }
            }
        }
    }

    /// Gives cells that are new since the last growth a level.
    fn mark(&mut self, levels: &mut [u8], level: u8) {
        for row in 0..self.rows {
            for word in 0..self.width {
                let at = (row + 1) * self.width + word;
                let mut bits = self.words[at] & !self.before[at];
                while bits != 0 {
                    let column = 64 * word + bits.trailing_zeros() as usize;
                    bits &= bits - 1;
                    if column < self.columns {
                        levels[row * self.columns + column] = level;
                    }
                }
            }
        }
    }

    fn grow(&mut self, by_eight: bool) {
        std::mem::swap(&mut self.words, &mut self.before);
        let (old, width) = (&self.before, self.width);
        for at in width..(self.rows + 1) * width {
            let column = at % width;
            let level = |at: usize| {
                let left = if column > 0 { old[at - 1] >> 63 } else { 0 };
                let right = if column + 1 < width { old[at + 1] << 63 } else { 0 };
                old[at] | old[at] << 1 | old[at] >> 1 | left | right
            };
            let (above, below) = (at - width, at + width);
            let beside = if by_eight { level(above) | level(below) } else { old[above] | old[below] };
            self.words[at] = level(at) | beside;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Pixel;
    use crate::silhouette::Silhouette;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_nearest_foreground_is_between_what_a_level_says(
            things in proptest::collection::vec((0i32..380, 0i32..280, 1i32..20, 1i32..20), 0..6),
            places in proptest::collection::vec((-150i32..550, -150i32..450), 60), longer in 100u32..9000,
        ) {
            let mut mask = vec![0u8; 400 * 300];
            for &(left, top, across, down) in &things {
                for row in top..top + down {
                    mask[(row * 400 + left) as usize..][..across as usize].fill(255);
                }
            }
            let silhouette = Silhouette::from_mask(400, 300, &mask).expect("size");
            let index = Index::new(BitMap::foreground(&silhouette, 1), longer);
            let around = Surroundings::new(&index, longer);
            for (column, row) in places {
                let pixels = (0..300).flat_map(|row| (0..400).map(move |column| Pixel { column, row }));
                let squared = |pixel: Pixel| (pixel.column - column).pow(2) + (pixel.row - row).pow(2);
                let nearest = pixels.filter(|&pixel| index.map().get(pixel)).map(squared).min();
                let (clear, within) = around.between_squared(column, row);
                match nearest {
                    Some(nearest) => prop_assert!((clear..=within).contains(&nearest), "{clear} {nearest} {within}"),
                    None => prop_assert_eq!(within, i32::MAX),
                }
            }
        }
    }
}
