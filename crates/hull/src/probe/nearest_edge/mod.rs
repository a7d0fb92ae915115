//! The background pixel nearest to a point's pixel (paper §4.2, point b; spec §3.1).
//!
//! The paper grows square windows in steps, at the speed d_max / d; here each camera answers exactly, and
//! the cost hardly depends on the size of the image. Near the start sixteen rows of 64 columns are looked
//! at together. Farther away the same is done with cells, and only those cells are looked into that may
//! hold the nearest pixel.

#[cfg(target_arch = "x86_64")]
mod avx512;
mod bits;
mod cells;

use crate::camera::Pixel;
use crate::silhouette::{BitMap, Index, STRIP};
use crate::vector::VectorPath;
use bits::{highest, lowest};

/// A background pixel and its squared distance in pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct EdgePixel {
    /// Its column and row.
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
/// Farther than this, pixels, no image reaches.
const FAR_SQUARED: i64 = 1 << 30;

/// The zero bit of the index's map at the least squared distance from `start`, not farther than
/// `limit_squared`; ties go to the smaller row, then the smaller column. `start` must lie within the map,
/// which must hold every zero that could be nearest.
#[inline(always)]
pub fn nearest_edge(index: &Index, start: Pixel, limit_squared: i64, path: VectorPath) -> Option<EdgePixel> {
    let limit = limit_squared.min(FAR_SQUARED) as i32;
    let clear = index.depth().clear_squared(start.column, start.row);
    if clear > limit {
        return None;
    }
    if clear < SEEN_SQUARED / 2 || limit < SEEN_SQUARED {
        let found = near::<false>(index.map(), start, limit, path);
        if found.is_some() || limit < SEEN_SQUARED {
            return found;
        }
    }
    cells::far::<false>(index, start, limit, path)
}

/// The one bit of the index's map at the least squared distance from `start`, not farther than `limit_squared`; ties as
/// above. `start` may lie anywhere; no one bit may be nearer to it than `clear_squared`.
#[inline(always)]
pub fn nearest_foreground(
    index: &Index,
    start: Pixel,
    clear_squared: i32,
    limit_squared: i64,
    path: VectorPath,
) -> Option<EdgePixel> {
    let limit = limit_squared.min(FAR_SQUARED) as i32;
    let map = index.map();
    // What the start is beside holds nothing.
    let beside = |first: i32, start: i32, end: i32| (first - start).max(start - end + 1).max(0);
    let across = beside(map.left(), start.column, map.right());
    let down = beside(map.top(), start.row, map.bottom());
    let farthest = across.max(down);
    if i64::from(farthest) * i64::from(farthest) > i64::from(limit) {
        return None;
    }
    if farthest < REACH && (clear_squared < SEEN_SQUARED / 2 || limit < SEEN_SQUARED) {
        let found = near::<true>(map, start, limit, path);
        if found.is_some() || limit < SEEN_SQUARED {
            return found;
        }
    }
    cells::far::<true>(index, start, limit, path)
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
fn near<const ONES: bool>(map: &BitMap, start: Pixel, limit: i32, path: VectorPath) -> Option<EdgePixel> {
    let limit = limit.min(SEEN_SQUARED - 1);
    // A squared distance, and below it row and column: the least key is the nearest, ties included.
    let mut best = (limit as u32 + 1) << 14;
    let place = Place::of(map, start.column, start.row);
    let last = map.rows() as i32 - ROWS as i32;
    let centred = (place.row - ROWS as i32 / 2).min(last).max(0);
    best = best.min(key_of_rows::<ONES>(map, &place, path, centred));
    let (mut above, mut below) = (centred, centred + ROWS as i32);
    loop {
        let reach = |row: i32| ((row - place.row) * (row - place.row)) as u32;
        let squared = best >> 14;
        if above > 0 && reach(above - 1) <= squared {
            above = (above - ROWS as i32).max(0);
            best = best.min(key_of_rows::<ONES>(map, &place, path, above));
        } else if below < map.rows() as i32 && reach(below) <= squared {
            let first = below.min(last);
            below = first + ROWS as i32;
            best = best.min(key_of_rows::<ONES>(map, &place, path, first));
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

/// A pixel within a map, or beside it.
struct Place {
    strip: usize,
    bit: u32,
    row: i32,
}

/// A pixel among square cells of pixels.
struct CellPlace {
    /// Its cell.
    cell: Place,
    /// The side of a cell is two to this power.
    shift: u32,
    /// Where in its cell the pixel is.
    across: i32,
    down: i32,
}

/// A gap to nothing: farther than any pixel that counts.
const NOWHERE: i32 = 1 << 14;

impl Place {
    #[inline(always)]
    fn of(map: &BitMap, column: i32, row: i32) -> Place {
        let column = column - map.left();
        Place { strip: (column >> 5) as usize, bit: column as u32 % 32, row: row - map.top() }
    }
}

/// The least key of the zeros, or of the ones, in sixteen rows from `first` within [`REACH`] columns of the place.
#[inline(always)]
fn key_of_rows<const ONES: bool>(map: &BitMap, place: &Place, path: VectorPath, first: i32) -> u32 {
    #[cfg(target_arch = "x86_64")]
    if path == VectorPath::Avx512 {
        #[allow(unsafe_code, reason = "the path was asked whether it is available when it was chosen")]
        return unsafe { avx512::key_of_rows::<ONES>(words_around(map, place, first), place, first) };
    }
    let _ = path;
    let (left, right) = bits_beside::<ROWS, ONES>(map, place, first);
    let mut keys = [0u32; ROWS];
    for at in 0..ROWS {
        // One to 33, zero to 32: beyond the last column there is nothing to be found.
        let gap_left = (32 - highest(left[at])) as u32;
        let gap_right = lowest(right[at], 40) as u32;
        let is_left = gap_left <= gap_right;
        let gap = if is_left { gap_left } else { gap_right };
        let column = if is_left { 64 - gap_left } else { 64 + gap_right };
        let down = (first + at as i32 - place.row) as u32;
        // Rows that do not fit in seven bits have keys that are too large anyway.
        let squared = down.wrapping_mul(down).wrapping_add(gap * gap);
        keys[at] = squared << 14 | (down.wrapping_add(64) & 127) << 7 | column;
    }
    keys.iter().fold(u32::MAX, |least, &key| least.min(key))
}

/// So many rows of the strip before the place's, of its own, and of the one after.
#[inline(always)]
fn words_around<'a, const COUNT: usize>(map: &'a BitMap, place: &Place, first: i32) -> [&'a [u32; COUNT]; 3] {
    let missing = if map.beyond() { &[u32::MAX; COUNT] } else { &[0; COUNT] };
    let here = place.strip.wrapping_mul(map.rows()).wrapping_add(first as usize);
    let words = |strip: usize, at: usize| -> &[u32; COUNT] {
        let words = map.words().get(at..).and_then(|words| words.first_chunk());
        words.filter(|_| strip < map.strips()).unwrap_or(missing)
    };
    [
        words(place.strip.wrapping_sub(1), here.wrapping_sub(map.rows())),
        words(place.strip, here),
        words(place.strip.wrapping_add(1), here.wrapping_add(map.rows())),
    ]
}

/// For each of so many rows, the zeros, or the ones, of the 32 columns before the place's and of the 32 from it on.
#[inline(always)]
fn bits_beside<const COUNT: usize, const ONES: bool>(
    map: &BitMap,
    place: &Place,
    first: i32,
) -> ([u32; COUNT], [u32; COUNT]) {
    let flip = if ONES { 0 } else { u32::MAX };
    let [before, here, after] = words_around::<COUNT>(map, place, first);
    let (mut left, mut right) = ([0u32; COUNT], [0u32; COUNT]);
    let bit = place.bit;
    for at in 0..COUNT {
        // A shift by 32 is none: shift by one first.
        left[at] = (before[at] >> bit | here[at] << 1 << (31 - bit)) ^ flip;
        right[at] = (here[at] >> bit | after[at] << 1 << (31 - bit)) ^ flip;
    }
    (left, right)
}

/// The zeros, or the ones, of the whole map row by row: for what lies farther than cells are looked at.
#[inline(always)]
fn by_rows(map: &BitMap, start: Pixel, limit: i32, finds_ones: bool) -> Option<EdgePixel> {
    let flip = if finds_ones { u32::MAX } else { 0 };
    let mut best = Best { squared: limit, row: i32::MAX, column: i32::MAX };
    let mut reach = best.squared.isqrt();
    let strips = map.strips() as i32;
    // What the start is beside holds nothing.
    let beside = |first: i32, start: i32, end: i32| (first - start).max(start - end + 1).max(0);
    let first = beside(map.top(), start.row, map.bottom());
    if first.max(beside(map.left(), start.column, map.left() + strips * STRIP)) > reach {
        return None;
    }
    for distance in first.. {
        let (above, below) = (start.row - distance, start.row + distance);
        let in_map = |row: i32| row >= map.top() && row < map.bottom();
        if distance > reach || above < map.top() && below >= map.bottom() {
            break;
        }
        for row in [above, below].into_iter().filter(|&row| in_map(row)) {
            let strip_at = |column: i32| ((column - map.left()) / STRIP).clamp(0, strips - 1) as usize;
            for strip in strip_at(start.column - reach)..=strip_at(start.column + reach) {
                let zeros = !map.strip(strip)[(row - map.top()) as usize] ^ flip;
                if zeros != 0 {
                    offer_nearest(zeros, map.left() + strip as i32 * STRIP, row, start, &mut best);
                }
            }
            if best.squared < reach * reach {
                reach = best.squared.isqrt();
            }
        }
    }
    let pixel = Pixel { column: best.column, row: best.row };
    (best.row != i32::MAX).then_some(EdgePixel { pixel, squared: i64::from(best.squared) })
}

/// Offers the zeros of a word that are nearest on either side.
#[inline(always)]
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
        brute_of(map, start, limit, false)
    }

    fn brute_of(map: &BitMap, start: Pixel, limit: i64, bit: bool) -> Option<EdgePixel> {
        let rows = map.top()..map.bottom();
        rows.flat_map(|row| (map.left()..map.right()).map(move |column| Pixel { column, row }))
            .filter(|&pixel| map.get(pixel) == bit)
            .map(|pixel| EdgePixel {
                pixel,
                squared: i64::from(pixel.column - start.column).pow(2)
                    + i64::from(pixel.row - start.row).pow(2),
            })
            .filter(|edge| edge.squared <= limit)
            .min_by_key(|edge| (edge.squared, edge.pixel.row, edge.pixel.column))
    }

    /// What every path finds.
    fn nearest_edge(index: &Index, start: Pixel, limit: i64) -> Option<EdgePixel> {
        let found = super::nearest_edge(index, start, limit, VectorPath::Portable);
        for path in VectorPath::ALL.into_iter().filter(|path| path.is_available()) {
            assert_eq!(super::nearest_edge(index, start, limit, path), found, "{path:?}");
        }
        found
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
        fn the_nearest_foreground_is_the_brute_minimum_too(
            width in 1u32..260, height in 1u32..60, seed in any::<u64>(), across in -1.0..2.0f64,
            down in -3.0..4.0f64, limit in limits(), size in 0u32..3,
        ) {
            let silhouette = Silhouette::from_mask(width, height, &random_mask(width, height, seed)).expect("size");
            let map = BitMap::foreground(&silhouette, 1);
            let start = Pixel { column: (f64::from(width) * across) as i32, row: (f64::from(height) * down) as i32 };
            let expected = brute_of(&map, start, limit, true);
            let index = Index::new(map, 640 << (2 * size));
            for path in VectorPath::ALL.into_iter().filter(|path| path.is_available()) {
                prop_assert_eq!(nearest_foreground(&index, start, 0, limit, path), expected, "{:?}", path);
            }
        }

        #[test]
        fn the_nearest_foreground_far_away_is_too(
            things in proptest::collection::vec((0i32..880, 0i32..680, 1i32..20, 1i32..20), 1..9),
            column in -300i32..1200, row in -300i32..1000, limit in limits(), size in 0u32..3,
        ) {
            let mut mask = vec![0u8; 900 * 700];
            for &(left, top, across, down) in &things {
                for row in top..top + down {
                    mask[(row * 900 + left) as usize..][..across as usize].fill(255);
                }
            }
            let map = BitMap::foreground(&Silhouette::from_mask(900, 700, &mask).expect("size"), 1);
            let start = Pixel { column, row };
            let expected = brute_of(&map, start, limit, true);
            let index = Index::new(map, 640 << (2 * size));
            for path in VectorPath::ALL.into_iter().filter(|path| path.is_available()) {
                prop_assert_eq!(nearest_foreground(&index, start, 0, limit, path), expected, "{:?}", path);
            }
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
