//! The background pixel nearest to a point's pixel (paper §4.2, point b; spec §3.1).
//!
//! The paper grows square windows in steps, at the speed d_max / d; here each camera answers exactly, and
//! the cost hardly depends on the size of the image. Near the start sixteen rows of 64 columns are looked
//! at together. Farther away the same is done with cells, and only those cells are looked into that may
//! hold the nearest pixel.

use crate::camera::Pixel;
use crate::silhouette::{BitMap, Index};

/// A background pixel and its squared distance in pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct EdgePixel {
    /// Where.
    pub pixel: Pixel,
    /// Squared pixel distance from the start.
    pub squared: i64,
}

/// Rows that are looked at together.
const ROWS: usize = 16;
/// Columns that are looked at on either side.
const REACH: i32 = 32;
/// What lies nearer than the first column that is not looked at, squared.
const SEEN_SQUARED: i32 = REACH * REACH;
/// A search among cells that finds nothing nearer than so many of them falls back on rows of words.
const CELLS_SEEN: i32 = 31;
/// Farther than this, pixels, no image reaches.
const FAR_SQUARED: i64 = 1 << 30;

/// The zero bit of the index's map at the least squared distance from `start`, not farther than
/// `limit_squared`; ties go to the smaller row, then the smaller column. `start` must lie within the map,
/// which must hold every zero that could be nearest.
#[inline(always)]
pub fn nearest_edge(index: &Index, start: Pixel, limit_squared: i64) -> Option<EdgePixel> {
    let limit = limit_squared.min(FAR_SQUARED) as i32;
    let clear = index.depth().clear_squared(start.column, start.row);
    if clear > limit {
        return None;
    }
    if clear < SEEN_SQUARED / 2 || limit < SEEN_SQUARED {
        let found = near(index.map(), start, limit);
        if found.is_some() || limit < SEEN_SQUARED {
            return found;
        }
    }
    far(index, start, limit)
}

/// The best so far. It is ranked by squared distance, row and column.
#[derive(Clone, Copy)]
struct Best {
    squared: i32,
    row: i32,
    column: i32,
}

impl Best {
    fn offer(&mut self, squared: i32, row: i32, column: i32) {
        if (squared, row, column) < (self.squared, self.row, self.column) {
            *self = Best { squared, row, column };
        }
    }
}

/// Searches within [`REACH`] columns; `None` if nothing is nearer than that and within the limit.
#[inline(always)]
fn near(map: &BitMap, start: Pixel, limit: i32) -> Option<EdgePixel> {
    let limit = limit.min(SEEN_SQUARED - 1);
    // A squared distance, and below it row and column: the least key is the nearest, ties included.
    let mut best = (limit as u32 + 1) << 14;
    let place = Place::of(map, start.column, start.row);
    let last = map.rows() as i32 - ROWS as i32;
    let centred = (place.row - ROWS as i32 / 2).min(last).max(0);
    best = best.min(key_of_rows(map, &place, centred));
    let (mut above, mut below) = (centred, centred + ROWS as i32);
    loop {
        let reach = |row: i32| ((row - place.row) * (row - place.row)) as u32;
        let squared = best >> 14;
        if above > 0 && reach(above - 1) <= squared {
            above = (above - ROWS as i32).max(0);
            best = best.min(key_of_rows(map, &place, above));
        } else if below < map.rows() as i32 && reach(below) <= squared {
            let first = below.min(last);
            below = first + ROWS as i32;
            best = best.min(key_of_rows(map, &place, first));
        } else {
            break;
        }
    }
    let squared = (best >> 14) as i32;
    (squared <= limit).then(|| EdgePixel {
        pixel: Pixel {
            column: start.column + (best & 127) as i32 - 64,
            row: start.row + (best >> 7 & 127) as i32 - 64,
        },
        squared: i64::from(squared),
    })
}

/// A pixel within a map.
struct Place {
    strip: usize,
    bit: u32,
    row: i32,
}

impl Place {
    #[inline(always)]
    fn of(map: &BitMap, column: i32, row: i32) -> Place {
        let column = column - map.left();
        Place { strip: column as usize / 32, bit: column as u32 % 32, row: row - map.top() }
    }
}

/// The least key of the zeros in sixteen rows from `first` within [`REACH`] columns of the place.
#[inline(always)]
fn key_of_rows(map: &BitMap, place: &Place, first: i32) -> u32 {
    let (left, right) = zeros_beside::<ROWS>(map, place, first);
    let mut keys = [0u32; ROWS];
    for at in 0..ROWS {
        // One to 33, zero to 32: beyond the last column there is nothing to be found.
        let gap_left = left[at].leading_zeros() + 1;
        let gap_right = 31u32.wrapping_sub((right[at] & right[at].wrapping_neg()).leading_zeros());
        let gap_right = if right[at] == 0 { 40 } else { gap_right };
        let is_left = gap_left <= gap_right;
        let gap = if is_left { gap_left } else { gap_right };
        let column = if is_left { 64 - gap_left } else { 64 + gap_right };
        let down = (first + at as i32 - place.row) as u32;
        // Rows too far to be told in seven bits have keys that are too large anyway.
        let squared = down.wrapping_mul(down).wrapping_add(gap * gap);
        keys[at] = squared << 14 | (down.wrapping_add(64) & 127) << 7 | column;
    }
    keys.iter().fold(u32::MAX, |least, &key| least.min(key))
}

/// For each of so many rows, the zeros of the 32 columns before the place's and of the 32 from it on.
#[inline(always)]
fn zeros_beside<const COUNT: usize>(map: &BitMap, place: &Place, first: i32) -> ([u32; COUNT], [u32; COUNT]) {
    let missing = [if map.beyond() { u32::MAX } else { 0 }; COUNT];
    let words = |strip: usize| -> &[u32; COUNT] {
        let at = strip.wrapping_mul(map.rows()).wrapping_add(first as usize);
        let inside = strip < map.strips();
        let words = map.words().get(at..).and_then(|words| words.first_chunk());
        words.filter(|_| inside).unwrap_or(&missing)
    };
    let (before, here, after) =
        (words(place.strip.wrapping_sub(1)), words(place.strip), words(place.strip + 1));
    let (mut left, mut right) = ([0u32; COUNT], [0u32; COUNT]);
    let bit = place.bit;
    for at in 0..COUNT {
        // A shift by 32 is none: shift by one first.
        left[at] = !(before[at] >> bit | here[at] << 1 << (31 - bit));
        right[at] = !(here[at] >> bit | after[at] << 1 << (31 - bit));
    }
    (left, right)
}

/// Searches cells first. What is found within [`CELLS_SEEN`] of them is certain.
#[inline(always)]
fn far(index: &Index, start: Pixel, limit: i32) -> Option<EdgePixel> {
    let shift = index.depth().shift();
    let cells = Cells::around(index, start);
    let seen = CELLS_SEEN << shift;
    let mut rows = CellRows::default();
    cells.scan(limit.min(seen * seen - 1), &mut rows);
    let mut best = Best { squared: rows.limit, row: i32::MAX, column: i32::MAX };
    for row in rows.nearest_first() {
        look_into(index.map(), start, row, shift, &mut best);
    }
    if best.row != i32::MAX {
        let pixel = Pixel { column: best.column, row: best.row };
        return Some(EdgePixel { pixel, squared: i64::from(best.squared) });
    }
    if limit < seen * seen { None } else { by_rows(index.map(), start, limit) }
}

/// A pixel among cells.
struct Cells<'a> {
    not_full: &'a BitMap,
    shift: u32,
    place: Place,
    /// Where in its cell the pixel is.
    across: i32,
    down: i32,
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

/// Farther than any pixel that counts.
const NOWHERE: i32 = 1 << 14;

impl CellRow {
    fn least_squared(&self) -> i32 {
        let gap = self.gap_left.min(self.gap_right);
        self.rows_squared + gap * gap
    }
}

impl CellRows {
    /// The rows that count, the one with the least bound first.
    fn nearest_first(&mut self) -> impl Iterator<Item = &CellRow> {
        let limit = self.limit;
        let rows = &mut self.rows[..self.count];
        let mut kept = 0;
        for at in 0..rows.len() {
            if rows[at].least_squared() <= limit {
                rows[kept] = rows[at];
                kept += 1;
            }
        }
        let rows = &mut rows[..kept];
        rows.sort_unstable_by_key(CellRow::least_squared);
        rows.iter()
    }
}

impl<'a> Cells<'a> {
    fn around(index: &'a Index, start: Pixel) -> Cells<'a> {
        let (shift, not_full) = (index.depth().shift(), index.depth().not_full());
        let place = Place::of(not_full, start.column >> shift, start.row >> shift);
        let mask = (1 << shift) - 1;
        Cells { not_full, shift, place, across: start.column & mask, down: start.row & mask }
    }

    /// Notes the rows of cells that are not farther than the limit, which every cell found brings down.
    #[inline(always)]
    fn scan(&self, limit: i32, found: &mut CellRows) {
        found.limit = limit;
        let last = self.not_full.rows() as i32 - ROWS as i32;
        let centred = (self.place.row - ROWS as i32 / 2).min(last).max(0);
        self.scan_rows(centred, centred, centred + ROWS as i32, found);
        let (mut above, mut below) = (centred, centred + ROWS as i32);
        let gap = |row: i32| self.rows_to(row).pow(2);
        loop {
            if above > 0 && gap(above - 1) <= found.limit {
                let first = (above - ROWS as i32).max(0);
                self.scan_rows(first, first, above, found);
                above = first;
            } else if below < self.not_full.rows() as i32 && gap(below) <= found.limit {
                let first = below.min(last);
                self.scan_rows(first, below, first + ROWS as i32, found);
                below = first + ROWS as i32;
            } else {
                break;
            }
        }
    }

    /// Rows of pixels between the start and a row of cells.
    fn rows_to(&self, row: i32) -> i32 {
        let cells = row - self.place.row;
        match cells {
            0 => 0,
            1.. => (cells << self.shift) - self.down,
            _ => ((-cells - 1) << self.shift) + self.down + 1,
        }
    }

    /// Looks at sixteen rows of cells from `first` and notes those of `from..to`.
    #[inline(always)]
    fn scan_rows(&self, first: i32, from: i32, to: i32, found: &mut CellRows) {
        let side = 1 << self.shift;
        // The maps of cells are padded, so that they have sixteen rows.
        let (left, right) = zeros_beside::<ROWS>(self.not_full, &self.place, first);
        let (mut gaps_left, mut gaps_right, mut most) = ([0i32; ROWS], [0i32; ROWS], [0i32; ROWS]);
        for at in 0..ROWS {
            // Here ones are what is looked for.
            let (left, right) = (!left[at], !right[at]);
            let cells_left = left.leading_zeros() as i32;
            let cells_right = 31 - (right & right.wrapping_neg()).leading_zeros() as i32;
            let gap_left = (cells_left << self.shift) + self.across + 1;
            let gap_right = ((cells_right << self.shift) - self.across).max(0);
            // The cell below or above the start has columns on both sides of it.
            let gap_left = if left == 0 { NOWHERE } else { gap_left };
            let gap_left = if right & 1 != 0 { 1 } else { gap_left };
            let gap_right = if right == 0 { NOWHERE } else { gap_right };
            let cells = first + at as i32 - self.place.row;
            let after = (cells << self.shift) - self.down;
            let before = self.down + 1 - ((cells + 1) << self.shift);
            let rows = after.max(before).max(0);
            let widest = gap_left.min(gap_right) + side - 1;
            gaps_left[at] = gap_left;
            gaps_right[at] = gap_right;
            most[at] = widest * widest + (rows + side - 1) * (rows + side - 1);
        }
        let least_most = most.iter().fold(i32::MAX, |least, &most| least.min(most));
        found.limit = found.limit.min(least_most);
        for row in from..to {
            let at = (row - first) as usize;
            let rows = self.rows_to(row);
            let cell_row = CellRow {
                first_row: ((row - self.place.row) << self.shift) - self.down,
                rows_squared: rows * rows,
                gap_left: gaps_left[at],
                gap_right: gaps_right[at],
            };
            if cell_row.least_squared() <= found.limit {
                found.rows[found.count] = cell_row;
                found.count += 1;
            }
        }
    }
}

/// Looks at the pixels of a row of cells, outward from the nearest cells that are not full.
#[inline(always)]
fn look_into(map: &BitMap, start: Pixel, row: &CellRow, shift: u32, best: &mut Best) {
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
                1 => window::<2>(map, start, &place, gap, leftward, best),
                2 => window::<4>(map, start, &place, gap, leftward, best),
                _ => window::<8>(map, start, &place, gap, leftward, best),
            }
            gap += REACH;
        }
    }
}

/// Offers the nearest zeros of so many rows in the 32 columns beside the place.
#[inline(always)]
fn window<const COUNT: usize>(
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
    let (left, right) = zeros_beside::<COUNT>(map, place, place.row);
    let mut squares = [0i32; COUNT];
    let mut gaps = [0i32; COUNT];
    let first_row = place.row + map.top() - start.row;
    for at in 0..COUNT {
        let zeros = if leftward { left[at] } else { right[at] };
        let lowest = 31 - (right[at] & right[at].wrapping_neg()).leading_zeros() as i32;
        let more = if leftward { left[at].leading_zeros() as i32 } else { lowest };
        let away = gap + more;
        let down = first_row + at as i32;
        let squared = away * away + down * down;
        squares[at] = if zeros == 0 { i32::MAX } else { squared };
        gaps[at] = away;
    }
    let least = squares.iter().fold(i32::MAX, |least, &squared| least.min(squared));
    if least > best.squared {
        return;
    }
    for at in 0..COUNT {
        if squares[at] == least {
            let column = if leftward { start.column - gaps[at] } else { start.column + gaps[at] };
            best.offer(least, start.row + first_row + at as i32, column);
        }
    }
}

/// The same row by row over the whole map: for what lies farther than cells are looked at.
fn by_rows(map: &BitMap, start: Pixel, limit: i32) -> Option<EdgePixel> {
    let mut best = Best { squared: limit, row: i32::MAX, column: i32::MAX };
    for distance in 0.. {
        let (above, below) = (start.row - distance, start.row + distance);
        let in_map = |row: i32| row >= map.top() && row < map.bottom();
        if distance * distance > best.squared || !(in_map(above) || in_map(below)) {
            break;
        }
        for row in [above, below].into_iter().filter(|&row| in_map(row)) {
            for strip in 0..map.strips() {
                let zeros = !map.strip(strip)[(row - map.top()) as usize];
                let first = map.left() + strip as i32 * 32;
                offer_nearest(zeros, first, row, start, &mut best);
            }
        }
    }
    let pixel = Pixel { column: best.column, row: best.row };
    (best.row != i32::MAX).then_some(EdgePixel { pixel, squared: i64::from(best.squared) })
}

/// Offers the zeros of a word that are nearest on either side.
fn offer_nearest(zeros: u32, first: i32, row: i32, start: Pixel, best: &mut Best) {
    let here = (start.column - first).clamp(-1, 32);
    let before = if here < 0 { 0 } else { zeros & ((1u64 << (here + 1).min(32)) - 1) as u32 };
    let after = zeros & !before;
    let down = row - start.row;
    let mut offer = |column: i32| {
        let across = column - start.column;
        best.offer(across * across + down * down, row, column);
    };
    if before != 0 {
        offer(first + 31 - before.leading_zeros() as i32);
    }
    if after != 0 {
        offer(first + after.trailing_zeros() as i32);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::silhouette::Silhouette;
    use crate::silhouette::tests::{drawn, random_mask};
    use proptest::prelude::*;

    fn brute(map: &BitMap, start: Pixel, limit: i64) -> Option<EdgePixel> {
        let rows = map.top()..map.bottom();
        rows.flat_map(|row| (map.left()..map.right()).map(move |column| Pixel { column, row }))
            .filter(|&pixel| !map.get(pixel))
            .map(|pixel| EdgePixel {
                pixel,
                squared: i64::from(pixel.column - start.column).pow(2)
                    + i64::from(pixel.row - start.row).pow(2),
            })
            .filter(|edge| edge.squared <= limit)
            .min_by_key(|edge| (edge.squared, edge.pixel.row, edge.pixel.column))
    }

    #[test]
    fn ties_go_up_then_left() {
        let index = Index::foreground(&drawn(&["#####", "#####", "#####"]), 1);
        let edge = nearest_edge(&index, Pixel { column: 2, row: 1 }, i64::MAX).expect("the border");
        assert_eq!((edge.pixel, edge.squared), (Pixel { column: 2, row: -1 }, 4));
        let index = Index::foreground(&drawn(&["#####", "#.#.#", "#####"]), 1);
        let edge = nearest_edge(&index, Pixel { column: 2, row: 1 }, i64::MAX).expect("holes");
        assert_eq!((edge.pixel, edge.squared), (Pixel { column: 1, row: 1 }, 1));
    }

    /// A start in the foreground, or anywhere if there is none.
    fn start(map: &BitMap, across: f64, down: f64) -> Pixel {
        let column = map.left() + (f64::from(map.right() - map.left()) * across) as i32;
        let row = map.top() + (f64::from(map.bottom() - map.top()) * down) as i32;
        let rows = (row..map.bottom()).chain(map.top()..row);
        let mut pixels = rows.map(|row| Pixel { column, row });
        pixels.find(|&pixel| map.get(pixel)).unwrap_or(Pixel { column, row })
    }

    fn limits() -> impl Strategy<Value = i64> {
        prop_oneof![Just(i64::MAX), 0i64..900, 900i64..70_000]
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(300))]
        #[test]
        fn it_is_the_brute_minimum_ties_included(
            width in 1u32..260, height in 1u32..60, seed in any::<u64>(), across in 0.0..1.0f64,
            down in 0.0..1.0f64, invert in any::<bool>(), limit in limits(), size in 0u32..3,
        ) {
            let mut mask = random_mask(width, height, seed);
            if invert {
                mask.iter_mut().for_each(|pixel| *pixel = 255 - *pixel);
            }
            let map = BitMap::foreground(&Silhouette::from_mask(width, height, &mask).expect("size"), 3);
            let start = start(&map, across, down);
            let expected = brute(&map, start, limit);
            prop_assert_eq!(nearest_edge(&Index::new(map, 640 << (2 * size)), start, limit), expected);
        }

        #[test]
        fn it_is_so_far_from_every_edge(
            holes in proptest::collection::vec((0i32..900, 0i32..700, 1i32..30), 0..12),
            across in 0.0..1.0f64, down in 0.0..1.0f64, limit in limits(), size in 0u32..3,
            nothing_beyond in any::<bool>(),
        ) {
            let image = crate::silhouette::PixelRect { left: 0, top: 0, right: 900, bottom: 700 };
            let mut map = BitMap::filled(image, 1, nothing_beyond, nothing_beyond);
            for row in 0..700 {
                map.set(row, 0, 900, true);
            }
            for &(left, top, side) in &holes {
                for row in top..(top + side).min(700) {
                    map.set(row, left, (left + side).min(900), false);
                }
            }
            let start = start(&map, across, down);
            let expected = brute(&map, start, limit);
            prop_assert_eq!(nearest_edge(&Index::new(map, 640 << (2 * size)), start, limit), expected);
        }
    }
}
