//! The search among cells, for starts deep inside.

#[cfg(target_arch = "x86_64")]
use super::avx512;
use super::bits::{highest, lowest};
use super::{Best, CellPlace, EdgePixel, NOWHERE, Place, REACH, ROWS, bits_beside, by_rows, words_around};
use crate::camera::Pixel;
use crate::silhouette::{BitMap, Index};
use crate::vector::VectorPath;

/// A search among cells that finds nothing nearer than so many of them falls back on rows of words.
const CELLS_SEEN: i32 = 31;

/// Searches cells first. What is found within [`CELLS_SEEN`] of them is certain.
#[inline(always)]
pub(super) fn far<const ONES: bool>(
    index: &Index,
    start: Pixel,
    limit: i32,
    path: VectorPath,
) -> Option<EdgePixel> {
    let shift = index.depth().shift();
    let cells = Cells::around::<ONES>(index, start);
    let seen = CELLS_SEEN << shift;
    let mut rows = CellRows::default();
    cells.scan(limit.min(seen * seen - 1), &mut rows, path);
    let mut best = Best { squared: rows.limit, row: i32::MAX, column: i32::MAX };
    for row in rows.nearest_first() {
        if row.least_squared <= best.squared {
            look_into::<ONES>(index.map(), start, row, shift, &mut best, path);
        }
    }
    if best.row != i32::MAX {
        let pixel = Pixel { column: best.column, row: best.row };
        return Some(EdgePixel { pixel, squared: i64::from(best.squared) });
    }
    if limit < seen * seen { None } else { by_rows(index.map(), start, limit, ONES) }
}

/// The cells around a pixel.
struct Cells<'a> {
    /// Those that hold what is looked for.
    holding: &'a BitMap,
    start: CellPlace,
}

/// A row of cells with the gaps in pixels to the nearest that are not full, on either side.
#[derive(Clone, Copy, Default)]
struct CellRow {
    /// Its first row of pixels, from the start's.
    first_row: i32,
    /// Squared rows between it and the start.
    rows_squared: i32,
    gap_left: i32,
    gap_right: i32,
    /// Nothing of it is nearer, squared.
    least_squared: i32,
}

/// Rows of cells that may hold the nearest pixel, and no pixel need be looked at beyond the limit.
struct CellRows {
    rows: [CellRow; 2 * CELLS_SEEN as usize + 2 * ROWS],
    count: usize,
    limit: i32,
}

impl Default for CellRows {
    fn default() -> CellRows {
        CellRows { rows: [CellRow::default(); 2 * CELLS_SEEN as usize + 2 * ROWS], count: 0, limit: 0 }
    }
}

impl CellRows {
    /// The rows that may count: the one with the least bound, then all. Most of these are beyond what is found there.
    #[inline(always)]
    fn nearest_first(&self) -> impl Iterator<Item = &CellRow> {
        let rows = &self.rows[..self.count];
        let mut nearest = 0;
        for at in 1..rows.len() {
            if rows[at].least_squared < rows[nearest].least_squared {
                nearest = at;
            }
        }
        // The nearest is offered twice, which changes nothing.
        rows.get(nearest).into_iter().chain(rows)
    }
}

impl<'a> Cells<'a> {
    fn around<const ONES: bool>(index: &'a Index, start: Pixel) -> Cells<'a> {
        let shift = index.depth().shift();
        let holding = if ONES { index.depth().not_empty() } else { index.depth().not_full() };
        let cell = Place::of(holding, start.column >> shift, start.row >> shift);
        let mask = (1 << shift) - 1;
        let start = CellPlace { cell, shift, across: start.column & mask, down: start.row & mask };
        Cells { holding, start }
    }

    /// Notes the rows of cells that are not farther than the limit, which every cell found brings down.
    #[inline(always)]
    fn scan(&self, limit: i32, found: &mut CellRows, path: VectorPath) {
        found.limit = limit;
        let last = self.holding.rows() as i32 - ROWS as i32;
        let centred = (self.start.cell.row - ROWS as i32 / 2).min(last).max(0);
        self.scan_rows(path, centred, centred, centred + ROWS as i32, found);
        let (mut above, mut below) = (centred, centred + ROWS as i32);
        let gap = |row: i32| self.rows_to(row).pow(2);
        loop {
            if above > 0 && gap(above - 1) <= found.limit {
                let first = (above - ROWS as i32).max(0);
                self.scan_rows(path, first, first, above, found);
                above = first;
            } else if below < self.holding.rows() as i32 && gap(below) <= found.limit {
                let first = below.min(last);
                self.scan_rows(path, first, below, first + ROWS as i32, found);
                below = first + ROWS as i32;
            } else {
                break;
            }
        }
    }

    /// Rows of pixels between the start and a row of cells.
    fn rows_to(&self, row: i32) -> i32 {
        let cells = row - self.start.cell.row;
        match cells {
            0 => 0,
            1.. => (cells << self.start.shift) - self.start.down,
            _ => ((-cells - 1) << self.start.shift) + self.start.down + 1,
        }
    }

    /// The gaps in pixels to the nearest cell that is not full on the left and on the right of sixteen rows
    /// of cells, and the squared distance within which each row has a pixel for certain.
    #[inline(always)]
    fn gaps(&self, path: VectorPath, first: i32) -> ([i32; ROWS], [i32; ROWS], [i32; ROWS]) {
        #[cfg(target_arch = "x86_64")]
        if path == VectorPath::Avx512 {
            let words = words_around(self.holding, &self.start.cell, first);
            #[allow(unsafe_code, reason = "the path was asked whether it is available when it was chosen")]
            return unsafe { avx512::gaps(words, &self.start, first) };
        }
        let _ = path;
        let side = 1 << self.start.shift;
        // The maps of cells are padded, so that they have sixteen rows.
        let (left, right) = bits_beside::<ROWS, true>(self.holding, &self.start.cell, first);
        let (mut gaps_left, mut gaps_right, mut most) = ([0i32; ROWS], [0i32; ROWS], [0i32; ROWS]);
        for at in 0..ROWS {
            let (left, right) = (left[at], right[at]);
            let cells_left = 31 - highest(left);
            let cells_right = lowest(right, 0);
            let gap_left = (cells_left << self.start.shift) + self.start.across + 1;
            let gap_right = ((cells_right << self.start.shift) - self.start.across).max(0);
            // The cell below or above the start has columns on both sides of it.
            let gap_left = if left == 0 { NOWHERE } else { gap_left };
            let gap_left = if right & 1 != 0 { 1 } else { gap_left };
            let gap_right = if right == 0 { NOWHERE } else { gap_right };
            let cells = first + at as i32 - self.start.cell.row;
            let after = (cells << self.start.shift) - self.start.down;
            let before = self.start.down + 1 - ((cells + 1) << self.start.shift);
            let rows = after.max(before).max(0);
            let widest = gap_left.min(gap_right) + side - 1;
            gaps_left[at] = gap_left;
            gaps_right[at] = gap_right;
            most[at] = widest * widest + (rows + side - 1) * (rows + side - 1);
        }
        (gaps_left, gaps_right, most)
    }

    /// Looks at sixteen rows of cells from `first` and notes those of `from..to`.
    #[inline(always)]
    fn scan_rows(&self, path: VectorPath, first: i32, from: i32, to: i32, found: &mut CellRows) {
        let (gaps_left, gaps_right, most) = self.gaps(path, first);
        let least_most = most.iter().fold(i32::MAX, |least, &most| least.min(most));
        found.limit = found.limit.min(least_most);
        let (mut rows_squared, mut least_squared) = ([0; ROWS], [0; ROWS]);
        let CellPlace { cell, shift, down, .. } = &self.start;
        for at in 0..ROWS {
            let cells = first + at as i32 - cell.row;
            let after = (cells << shift) - down;
            let before = down + 1 - ((cells + 1) << shift);
            let rows = after.max(before).max(0);
            let gap = gaps_left[at].min(gaps_right[at]);
            rows_squared[at] = rows * rows;
            least_squared[at] = rows * rows + gap * gap;
        }
        let mut near = 0u32;
        for (at, &least) in least_squared.iter().enumerate() {
            near |= u32::from(least <= found.limit) << at;
        }
        near &= (u32::MAX << (from - first)) & (u32::MAX >> (32 - (to - first)));
        while near != 0 {
            let at = near.trailing_zeros() as usize;
            near &= near - 1;
            found.rows[found.count] = CellRow {
                first_row: ((first + at as i32 - cell.row) << shift) - down,
                rows_squared: rows_squared[at],
                gap_left: gaps_left[at],
                gap_right: gaps_right[at],
                least_squared: least_squared[at],
            };
            found.count += 1;
        }
    }
}

/// Looks at the pixels of a row of cells, outward from the nearest cells that are not full.
#[inline(always)]
fn look_into<const ONES: bool>(
    map: &BitMap,
    start: Pixel,
    row: &CellRow,
    shift: u32,
    best: &mut Best,
    path: VectorPath,
) {
    for (gap, leftward) in [(row.gap_left, true), (row.gap_right, false)] {
        let mut gap = gap;
        while gap < NOWHERE && row.rows_squared + gap * gap <= best.squared {
            // 32 columns from the gap on, away from the start.
            let column = if leftward { start.column - gap + 1 } else { start.column + gap };
            let place = Place::of(map, column, start.row + row.first_row);
            if place.strip > map.strips() {
                break;
            }
            match shift {
                1 => window::<2, ONES>(map, start, &place, gap, leftward, best),
                2 => window::<4, ONES>(map, start, &place, gap, leftward, best),
                #[cfg(target_arch = "x86_64")]
                _ if path == VectorPath::Avx512 => {
                    eight_rows::<ONES>(map, start, &place, gap, leftward, best);
                }
                _ => window::<8, ONES>(map, start, &place, gap, leftward, best),
            }
            gap += REACH;
        }
    }
}

/// Offers the nearest zeros of so many rows in the 32 columns beside the place.
#[inline(always)]
fn window<const COUNT: usize, const ONES: bool>(
    map: &BitMap,
    start: Pixel,
    place: &Place,
    gap: i32,
    leftward: bool,
    best: &mut Best,
) {
    if place.row < 0 || place.row as usize + COUNT > map.rows() {
        return;
    }
    let (left, right) = bits_beside::<COUNT, ONES>(map, place, place.row);
    let mut squares = [0i32; COUNT];
    let mut gaps = [0i32; COUNT];
    let first_row = place.row + map.top() - start.row;
    for at in 0..COUNT {
        let found = if leftward { left[at] } else { right[at] };
        let more = if leftward { 31 - highest(left[at]) } else { lowest(right[at], 0) };
        let away = gap + more;
        let down = first_row + at as i32;
        let squared = away * away + down * down;
        squares[at] = if found == 0 { i32::MAX } else { squared };
        gaps[at] = away;
    }
    let least = squares.iter().fold(i32::MAX, |least, &squared| least.min(squared));
    if least > best.squared {
        return;
    }
    let mut are_least = 0u32;
    for (at, &squared) in squares.iter().enumerate() {
        are_least |= u32::from(squared == least) << at;
    }
    // Of rows that are as near the first wins.
    let at = are_least.trailing_zeros() as usize % COUNT;
    let column = if leftward { start.column - gaps[at] } else { start.column + gaps[at] };
    best.offer(least, start.row + first_row + at as i32, column);
}

/// [`window`] of eight rows with AVX-512.
#[cfg(target_arch = "x86_64")]
#[inline(always)]
fn eight_rows<const ONES: bool>(
    map: &BitMap,
    start: Pixel,
    place: &Place,
    gap: i32,
    leftward: bool,
    best: &mut Best,
) {
    if place.row < 0 || place.row as usize + 8 > map.rows() {
        return;
    }
    let words = words_around(map, place, place.row);
    let first_row = place.row + map.top() - start.row;
    #[allow(unsafe_code, reason = "the path was asked whether it is available when it was chosen")]
    let (least, row, away) =
        unsafe { avx512::eight_rows::<ONES>(words, place.bit, gap, leftward, first_row) };
    if least <= best.squared {
        let column = if leftward { start.column - away } else { start.column + away };
        best.offer(least, start.row + first_row + row, column);
    }
}
