//! A silhouette in a few thousand cells, small enough for the registers of a processor: most points can be
//! told inside or outside by it.

use super::bitmap::bits_within;
use super::{BitMap, PixelRect};

/// Cells across: the bits of a word.
pub(crate) const COLUMNS: usize = 32;
/// Cells down.
pub(crate) const ROWS: usize = 64;
/// Cells across and down.
pub(crate) const SIDES: [usize; 2] = [COLUMNS, ROWS];
/// A place known to so many pixels, or to this share of a cell, has the class of the cell that it seems to lie in.
const MARGIN_PIXELS: f64 = 1.0 / 16.0;
const MARGIN_CELLS: f64 = 1.0 / 48.0;
/// What a cell's border grows by is a little more than the margin, for rounding.
const GROWN: f64 = 1.0 + 1e-6;

/// What a cell says: all is foreground.
pub(crate) const ALL: u8 = 0;
/// Some may be.
pub(crate) const SOME: u8 = 1;
/// Nothing is; much more than the others.
pub(crate) const NONE: u8 = 64;

/// In place of a cell: a place where nothing is foreground.
pub(crate) const UNSEEN: u32 = (COLUMNS * ROWS) as u32;
/// In place of a cell: an unknown place.
pub(crate) const UNKNOWN: u32 = UNSEEN + 1;
/// So many codes, of cells and others; a power of two.
pub(crate) const CODES: usize = 2 * COLUMNS * ROWS;

/// Cells over the rectangle around a silhouette, those of the border without foreground. What one says holds for all pixels within
/// the margin of it; beyond the rectangle, and as far around it, nothing is foreground.
#[derive(Clone, Debug)]
pub(crate) struct Sketch {
    /// Image coordinates of the first cell's first corner.
    pub origin: [f64; 2],
    /// Cells per pixel.
    pub scale: [f64; 2],
    /// A place known to so many pixels has the class of the cell that it seems to lie in.
    pub margin_pixels: [f64; 2],
    /// Ones where there may be foreground.
    pub some: [u32; ROWS],
    /// Ones where there is nothing else.
    pub full: [u32; ROWS],
    /// The same for each cell, row by row: [`NONE`], [`ALL`] or [`SOME`].
    pub codes: [u8; CODES],
}

impl Sketch {
    /// The cells of a map whose ones lie within a rectangle.
    pub fn new(map: &BitMap, bounds: Option<PixelRect>) -> Sketch {
        let rect = bounds.unwrap_or(PixelRect { left: 0, top: 0, right: 1, bottom: 1 });
        let (origin_u, scale_u, margin_u) = axis(rect.left, rect.right, COLUMNS);
        let (origin_v, scale_v, margin_v) = axis(rect.top, rect.bottom, ROWS);
        let mut sketch = Sketch {
            origin: [origin_u, origin_v],
            scale: [scale_u, scale_v],
            margin_pixels: [margin_u, margin_v],
            some: [0; ROWS],
            full: [0; ROWS],
            codes: [NONE; CODES],
        };
        sketch.codes[UNKNOWN as usize] = SOME;
        if bounds.is_some() {
            sketch.fill(map);
        }
        sketch
    }

    /// The pixels of a map along an axis that are within the margin of a cell.
    fn span(&self, axis: usize, cell: usize, map_first: i32, map_end: i32) -> Span {
        let margin = self.margin_pixels[axis] * GROWN;
        let border = |cell: usize| self.origin[axis] + cell as f64 / self.scale[axis] + 0.5;
        let within =
            |border: f64| ((border.floor() as i32).clamp(map_first, map_end - 1) - map_first) as usize;
        Span { first: within(border(cell) - margin), last: within(border(cell + 1) + margin) }
    }

    fn fill(&mut self, map: &BitMap) {
        let columns: [Span; COLUMNS] =
            std::array::from_fn(|column| self.span(0, column, map.left(), map.right()));
        let mut any = vec![0; map.strips()];
        let mut all = vec![0; map.strips()];
        for row in 0..ROWS {
            let rows = self.span(1, row, map.top(), map.bottom());
            for (strip, (any, all)) in any.iter_mut().zip(&mut all).enumerate() {
                let words = &map.strip(strip)[rows.first..=rows.last];
                (*any, *all) = words.iter().fold((0, u32::MAX), |(any, all), &word| (any | word, all & word));
            }
            let (mut some, mut full) = (0, 0);
            for (bit, column) in columns.iter().enumerate() {
                let (is_some, is_full) = column.any_and_all(&any, &all);
                some |= u32::from(is_some) << bit;
                full |= u32::from(is_full) << bit;
            }
            (self.some[row], self.full[row]) = (some, full);
            let codes = self.codes[row * COLUMNS..][..COLUMNS].iter_mut();
            for (bit, code) in codes.enumerate() {
                let (is_some, is_full) = (some >> bit & 1, full >> bit & 1);
                *code = if is_full == 1 {
                    ALL
                } else if is_some == 1 {
                    SOME
                } else {
                    NONE
                };
            }
        }
    }
}

/// Where the cells along an axis begin, how many there are to a pixel, and their margin.
fn axis(first: u32, end: u32, cells: usize) -> (f64, f64, f64) {
    // Cells of the border are empty, and hold the margin beyond the silhouette.
    let scale = (cells - 2) as f64 / (f64::from(end - first) + 4.0 * MARGIN_PIXELS);
    let scale = scale * (1.0 - 4.0 * MARGIN_CELLS / (cells - 2) as f64);
    let margin = MARGIN_PIXELS.max(MARGIN_CELLS / scale);
    (f64::from(first) - 0.5 - 2.0 * margin - 1.0 / scale, scale, margin)
}

/// Pixels of a map, the last one included, counted from its border.
struct Span {
    first: usize,
    last: usize,
}

impl Span {
    /// Whether a bit among these is one in the first words, and whether all are in the second.
    fn any_and_all(&self, any: &[u32], all: &[u32]) -> (bool, bool) {
        let (mut some, mut missing) = (0, 0);
        for strip in self.first / 32..=self.last / 32 {
            let mask = bits_within(strip, self.first, self.last);
            some |= any[strip] & mask;
            missing |= !all[strip] & mask;
        }
        (some != 0, missing == 0)
    }
}

#[cfg(test)]
mod tests {
    use super::super::Silhouette;
    use super::super::tests::random_mask;
    use super::*;
    use crate::camera::Pixel;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn what_a_cell_says_holds_within_the_margin(
            width in 1u32..300, height in 1u32..300, seed in any::<u64>(),
            places in prop::collection::vec((0.0f64..1.0, 0.0f64..1.0), 400),
        ) {
            let silhouette =
                Silhouette::from_mask(width, height, &random_mask(width, height, seed)).expect("size");
            let map = BitMap::foreground(&silhouette, 1);
            let sketch = Sketch::new(&map, silhouette.bounds());
            for (along, down) in places {
                let u = along * (f64::from(width) + 4.0) - 2.5;
                let v = down * (f64::from(height) + 4.0) - 2.5;
                let s = ((u - sketch.origin[0]) * sketch.scale[0]).floor();
                let t = ((v - sketch.origin[1]) * sketch.scale[1]).floor();
                let (column, row) = (s as i32, t as i32);
                let is_cell = (0..COLUMNS as i32).contains(&column) && (0..ROWS as i32).contains(&row);
                let code = if is_cell { sketch.codes[row as usize * COLUMNS + column as usize] } else { NONE };
                if is_cell {
                    let bit = |words: &[u32; ROWS]| words[row as usize] >> column & 1;
                    prop_assert_eq!((bit(&sketch.some), bit(&sketch.full)), match code {
                        NONE => (0, 0),
                        ALL => (1, 1),
                        _ => (1, 0),
                    });
                }
                for (du, dv) in [(0.0, 0.0), (1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)] {
                    let pixel = Pixel::holding(u + du * sketch.margin_pixels[0], v + dv * sketch.margin_pixels[1]);
                    let is_foreground = map.get(pixel);
                    prop_assert!(code == SOME || (code == ALL) == is_foreground, "{u} {v}: {code}");
                }
            }
        }
    }

    #[test]
    fn nothing_is_seen_of_nothing_and_borders_are_empty() {
        let nothing = Silhouette::from_mask(9, 9, &[0; 81]).expect("size");
        let sketch = Sketch::new(&BitMap::foreground(&nothing, 1), nothing.bounds());
        assert!(sketch.some.iter().chain(&sketch.full).all(|&word| word == 0));
        let all = Silhouette::from_mask(90, 90, &[1; 8100]).expect("size");
        let sketch = Sketch::new(&BitMap::foreground(&all, 1), all.bounds());
        assert_eq!((sketch.some[0], sketch.some[ROWS - 1]), (0, 0));
        assert_eq!((sketch.some[1], sketch.full[2]), (u32::MAX >> 2 << 1, u32::MAX >> 4 << 2));
        assert_eq!(sketch.codes[UNKNOWN as usize], SOME);
        assert_eq!(sketch.codes[UNSEEN as usize], NONE);
    }
}
