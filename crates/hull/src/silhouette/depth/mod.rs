//! How deep inside a silhouette every block of pixels lies: what lets a search skip what cannot matter.
//!
//! A cell is a square of pixels; it is full if all of its pixels are ones. A cell's level counts how often
//! the full cells can be eroded before it goes: by its eight neighbours, then four, and so on, so that what
//! is known to be full around a cell of some level is an octagon.

#[cfg(target_arch = "x86_64")]
mod avx512;

use super::bitmap::{BitMap, STRIP};
use crate::vector::VectorPath;

/// The neighbours that each erosion looks at: eight, four, eight, four, four, and again. The octagon is
/// then nearly a disc.
pub(super) const BY_EIGHT: [bool; 5] = [true, false, true, false, false];

/// Erosions stop here: a cell deeper than that is deep enough.
const MAX_LEVEL: usize = 120;
/// What is read beyond a level when a word is.
const PADDING: usize = 3;
/// The level of a cell without any ones.
const EMPTY: u8 = u8::MAX;
/// Binary digits of a level.
const DIGITS: usize = 7;

/// Cells of two pixels a side for small images, where few pixels decide, up to eight for large ones, where
/// there are many: two to this.
fn cell_shift(longer_side_pixels: u32) -> u32 {
    match longer_side_pixels {
        0..=960 => 1,
        961..=2400 => 2,
        _ => 3,
    }
}

/// The level of every cell of a bit map.
#[derive(Clone, Debug)]
pub struct Depth {
    /// Pixels of a cell's side are two to this.
    shift: u32,
    /// First column and row of cells, in cells.
    left: i32,
    top: i32,
    columns: usize,
    rows: usize,
    /// Row by row: 0 is not full, and so is everything beyond; [`EMPTY`] is all zeros. A word can be read
    /// at the last one.
    levels: Vec<u8>,
    /// Ones where a cell is not full, over the same cells.
    not_full: BitMap,
    /// Ones where a cell holds a one.
    not_empty: BitMap,
    clear_squared: [i32; 256],
    /// The same, its root.
    clear_pixels: [f32; 256],
}

impl Depth {
    /// The cells of a map of an image whose longer side has so many pixels.
    pub fn new(map: &BitMap, longer_side_pixels: u32) -> Depth {
        let shift = cell_shift(longer_side_pixels);
        let side = 1 << shift;
        // Whole strips of cells, so that they are as easy to shift as pixels.
        let left = (map.left() >> shift).div_euclid(STRIP) * STRIP;
        let top = map.top() >> shift;
        let columns = ((map.right() >> shift) - left) as usize;
        let rows = map.rows() >> shift;
        let full = cells_where(map, shift, (left, top), (columns, rows), u32::MAX, |a, b| a & b);
        let some = cells_where(map, shift, (left, top), (columns, rows), 0, |a, b| a | b);
        let levels = levels(&full, &some, (left, top), (columns, rows));
        let not_full = not_full(&full, map, shift);
        let clear_squared = clear_squared(side);
        let clear_pixels = clear_squared.map(|squared| (squared as f32).sqrt().next_down().max(0.0));
        Depth {
            shift,
            left,
            top,
            columns,
            rows,
            levels,
            not_full,
            not_empty: some,
            clear_squared,
            clear_pixels,
        }
    }

    /// Pixels of a cell's side are two to this.
    #[inline]
    pub(crate) fn shift(&self) -> u32 {
        self.shift
    }

    /// Ones where a cell is not full; its columns and rows are cells.
    #[inline]
    pub(crate) fn not_full(&self) -> &BitMap {
        &self.not_full
    }

    /// Ones where a cell holds a one, likewise.
    #[inline]
    pub(crate) fn not_empty(&self) -> &BitMap {
        &self.not_empty
    }

    /// The level of the cell that holds a pixel.
    #[inline(always)]
    pub(crate) fn level(&self, column: i32, row: i32) -> u8 {
        let column = ((column >> self.shift) - self.left) as u32 as usize;
        let row = ((row >> self.shift) - self.top) as u32 as usize;
        if column < self.columns && row < self.rows { self.levels[row * self.columns + column] } else { 0 }
    }

    /// No zero is nearer to a pixel than this, squared pixels.
    #[inline(always)]
    pub(crate) fn clear_squared(&self, column: i32, row: i32) -> i32 {
        self.clear_squared[usize::from(self.level(column, row))]
    }

    /// No zero is nearer to a pixel than this, pixels.
    #[inline(always)]
    pub(crate) fn clear_pixels(&self, column: i32, row: i32) -> f32 {
        self.clear_pixels[usize::from(self.level(column, row))]
    }

    /// [`Self::clear_pixels`] of many pixels.
    #[inline(always)]
    pub(crate) fn look_up(&self, column: &[i32], row: &[i32], clear_pixels: &mut [f32], path: VectorPath) {
        #[cfg(target_arch = "x86_64")]
        if path == VectorPath::Avx512 {
            #[allow(unsafe_code, reason = "the path was asked whether it is available when it was chosen")]
            return unsafe { avx512::look_up(self, column, row, clear_pixels) };
        }
        let _ = path;
        for ((clear, &column), &row) in clear_pixels.iter_mut().zip(column).zip(row) {
            *clear = self.clear_pixels(column, row);
        }
    }

    /// Heap memory, bytes.
    pub fn heap_bytes(&self) -> usize {
        self.levels.capacity() + self.not_full.heap_bytes() + self.not_empty.heap_bytes()
    }
}

/// Ones where the bits of a cell, put together by `both`, are one, with a strip or a row of zeros on every
/// side: what shifts in from there is not full.
fn cells_where(
    map: &BitMap,
    shift: u32,
    (left, top): (i32, i32),
    (columns, rows): (usize, usize),
    neutral: u32,
    both: impl Fn(u32, u32) -> u32,
) -> BitMap {
    let first = (left - STRIP, top - 1);
    let end = (left + columns as i32 + STRIP, top + rows as i32 + 1);
    let mut full = BitMap::over(first, end, false, false);
    let side = 1usize << shift;
    let (full_left, full_rows, above) = (full.left(), full.rows(), (top - full.top()) as usize);
    let words = full.words_mut();
    for strip in 0..map.strips() {
        let column = ((map.left() + strip as i32 * STRIP) >> shift) - full_left;
        let (full_strip, bit) = (column as usize / 32, column as usize % 32);
        let cells = &mut words[full_strip * full_rows + above..][..rows];
        for (cells, rows) in cells.iter_mut().zip(map.strip(strip).chunks_exact(side)) {
            let mut all = rows.iter().fold(neutral, |all, &word| both(all, word));
            let mut step = 1;
            while step < side {
                all = both(all, all >> step);
                step *= 2;
            }
            *cells |= gathered(all, shift) << bit;
        }
    }
    full
}

/// Ones where a cell holds a zero of the map, and beyond it if that is all zeros.
fn not_full(full: &BitMap, map: &BitMap, shift: u32) -> BitMap {
    let mut cells =
        BitMap::over((full.left(), full.top()), (full.right(), full.bottom()), !map.beyond(), false);
    for row in map.top() >> shift..map.bottom() >> shift {
        cells.set(row, map.left() >> shift, map.right() >> shift, true);
    }
    cells.words_mut().iter_mut().zip(full.words()).for_each(|(cells, full)| *cells &= !full);
    cells
}

/// Every `2^shift`-th bit, side by side.
fn gathered(bits: u32, shift: u32) -> u32 {
    match shift {
        1 => {
            let bits = bits & 0x5555_5555;
            let bits = (bits | bits >> 1) & 0x3333_3333;
            let bits = (bits | bits >> 2) & 0x0f0f_0f0f;
            let bits = (bits | bits >> 4) & 0x00ff_00ff;
            (bits | bits >> 8) & 0xffff
        }
        2 => {
            let bits = bits & 0x1111_1111;
            let bits = (bits | bits >> 3) & 0x0303_0303;
            let bits = (bits | bits >> 6) & 0x000f_000f;
            (bits | bits >> 12) & 0xff
        }
        _ => {
            let bits = bits & 0x0101_0101;
            let bits = (bits | bits >> 7) & 0x0003_0003;
            (bits | bits >> 14) & 0xf
        }
    }
}

/// How many erosions every full cell survives, and one more.
fn levels(full: &BitMap, some: &BitMap, (left, top): (i32, i32), (columns, rows): (usize, usize)) -> Vec<u8> {
    let first = (((left - full.left()) / STRIP) as usize, (top - full.top()) as usize);
    let (strips, height) = (full.strips(), full.rows());
    let mut alive = full.words().to_vec();
    let mut next = alive.clone();
    // Binary counters of 32 cells side by side.
    let mut digits = vec![0u32; DIGITS * alive.len()];
    for level in 0..MAX_LEVEL {
        count(&mut digits, &alive);
        let any = erode(&alive, &mut next, (strips, height), BY_EIGHT[level % BY_EIGHT.len()]);
        std::mem::swap(&mut alive, &mut next);
        if !any {
            break;
        }
    }
    let length = alive.len();
    let mut levels = vec![0u8; columns * rows + PADDING];
    for (row, levels) in levels.chunks_exact_mut(columns).take(rows).enumerate() {
        for (strip, levels) in levels.chunks_mut(32).enumerate() {
            let at = (strip + first.0) * height + row + first.1;
            let some = some.words()[at];
            let planes: [u32; DIGITS] = std::array::from_fn(|digit| digits[digit * length + at]);
            for (bit, level) in (0u32..).zip(levels) {
                let mut value = 0;
                for (digit, plane) in planes.iter().enumerate() {
                    value |= (plane >> bit & 1) << digit;
                }
                *level = if some >> bit & 1 == 0 { EMPTY } else { value as u8 };
            }
        }
    }
    levels
}

/// Adds one to the counters of the cells that are alive.
fn count(digits: &mut [u32], alive: &[u32]) {
    let length = alive.len();
    let mut digits = digits.chunks_exact_mut(length);
    let mut planes: [&mut [u32]; DIGITS] = std::array::from_fn(|_| digits.next().unwrap_or_default());
    for at in 0..length {
        let mut carry = alive[at];
        for plane in &mut planes {
            let bits = plane[at];
            plane[at] = bits ^ carry;
            carry &= bits;
        }
    }
}

/// Keeps the cells whose neighbours are all alive; false if there are none.
fn erode(alive: &[u32], next: &mut [u32], (strips, rows): (usize, usize), by_eight: bool) -> bool {
    next.fill(0);
    let mut any = 0;
    for strip in 0..strips {
        let at = strip * rows;
        let here = &alive[at..at + rows];
        // The strips at the sides and the rows at the ends are empty.
        let (Some(before), Some(after)) = (
            strip.checked_sub(1).map(|strip| &alive[strip * rows..][..rows]),
            alive.get(at + rows..at + 2 * rows),
        ) else {
            continue;
        };
        let across = |row: usize| here[row] << 1 | before[row] >> 31;
        let back = |row: usize| here[row] >> 1 | after[row] << 31;
        for row in 1..rows - 1 {
            let sides = across(row) & back(row);
            let ends = here[row - 1] & here[row + 1];
            let mut kept = here[row] & sides & ends;
            if by_eight {
                kept &= across(row - 1) & back(row - 1) & across(row + 1) & back(row + 1);
            }
            next[at + row] = kept;
            any |= kept;
        }
    }
    any != 0
}

/// For every level the least squared distance, in pixels, from a pixel of such a cell to one of a cell
/// that is not known to be full.
pub(super) fn clear_squared(side: i32) -> [i32; 256] {
    let gap = |cells: i32| if cells == 0 { 0 } else { (cells - 1) * side + 1 };
    let (mut reach, mut diagonal) = (0, 0);
    let mut table = [0; 256];
    for level in 1..=MAX_LEVEL {
        if level >= 2 {
            let by_eight = BY_EIGHT[(level - 2) % BY_EIGHT.len()];
            reach += 1;
            diagonal += if by_eight { 2 } else { 1 };
        }
        // Along an axis, or beyond the slanted side: the cells (i, d + 1 − i).
        let straight = gap(reach + 1) * gap(reach + 1);
        let slanted = (0..=reach)
            .filter(|&i| diagonal + 1 - i <= reach)
            .map(|i| gap(i) * gap(i) + gap(diagonal + 1 - i) * gap(diagonal + 1 - i));
        table[level] = slanted.fold(straight, i32::min);
    }
    table
}

#[cfg(test)]
mod tests {
    use super::super::Silhouette;
    use super::super::tests::random_mask;
    use super::*;
    use crate::camera::Pixel;
    use proptest::prelude::*;

    #[test]
    fn a_square_is_as_deep_as_its_octagons_fit() {
        let mask = vec![1; 64 * 64];
        let map = BitMap::foreground(&Silhouette::from_mask(64, 64, &mask).expect("size"), 1);
        let depth = Depth::new(&map, 1920);
        assert_eq!((depth.level(0, 0), depth.level(4, 4), depth.level(-1, 5)), (1, 2, EMPTY));
        assert_eq!(depth.clear_pixels(-1, 5), 0.0);
        assert_eq!(depth.level(32, 32), 8, "sixteen cells across");
        // Beyond the slanted side of the octagon the nearest cells are (5, 6), 17 and 21 pixels away.
        assert_eq!(depth.clear_squared(32, 32), 17 * 17 + 21 * 21);
    }

    proptest! {
        #[test]
        fn no_zero_is_nearer_than_a_level_says(
            width in 1u32..200, height in 1u32..120, seed in any::<u64>(), size in 0u32..3,
            pad in 0u32..20,
        ) {
            let silhouette =
                Silhouette::from_mask(width, height, &random_mask(width, height, seed)).expect("size");
            let map = BitMap::foreground(&silhouette, pad);
            let depth = Depth::new(&map, 640 << (2 * size));
            for row in (-3..height as i32 + 3).step_by(7) {
                for column in (-3..width as i32 + 3).step_by(5) {
                    let clear = i64::from(depth.clear_squared(column, row));
                    let reach = (clear as f64).sqrt() as i32 + 1;
                    for y in row - reach..=row + reach {
                        for x in column - reach..=column + reach {
                            let squared = i64::from(x - column).pow(2) + i64::from(y - row).pow(2);
                            let one = map.get(Pixel { column: x, row: y });
                            prop_assert!(one || squared >= clear, "{column} {row}: {squared} < {clear}");
                        }
                    }
                    for path in VectorPath::ALL.into_iter().filter(|path| path.is_available()) {
                        let mut clear_pixels = [0.0];
                        depth.look_up(&[column], &[row], &mut clear_pixels, path);
                        prop_assert_eq!(clear_pixels[0], depth.clear_pixels(column, row));
                    }
                    let cell = Pixel { column: column >> depth.shift(), row: row >> depth.shift() };
                    if map.get(Pixel { column, row }) {
                        prop_assert_eq!(depth.not_full().get(cell), depth.level(column, row) == 0);
                    } else {
                        prop_assert!(depth.clear_squared(column, row) == 0);
                    }
                }
            }
        }
    }
}
