//! The silhouette: the foreground of one camera at one frame, full resolution, stored as runs.

mod bitmap;
mod bytes;
mod depth;
mod index;
mod sketch;
mod surroundings;

pub use bitmap::BitMap;
pub(crate) use bitmap::STRIP;
pub use bytes::DecodeError;
pub use depth::Depth;
pub use index::Index;
pub(crate) use sketch::{CODES, COLUMNS, NONE, ROWS, SIDES as SKETCH_SIDES, Sketch, UNKNOWN, UNSEEN};
pub(crate) use surroundings::Surroundings;

use thiserror::Error;

use crate::camera::MAX_SIDE_PIXELS;

/// Foreground pixels `start..end` of one row.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Run {
    /// First foreground column.
    pub start: u16,
    /// First column after it.
    pub end: u16,
}

/// Pixels `left..right` × `top..bottom`, never empty.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PixelRect {
    /// First column.
    pub left: u32,
    /// First row.
    pub top: u32,
    /// Column after the last.
    pub right: u32,
    /// Row after the last.
    pub bottom: u32,
}

impl PixelRect {
    /// The smallest rectangle that holds both.
    pub fn union(self, other: PixelRect) -> PixelRect {
        PixelRect {
            left: self.left.min(other.left),
            top: self.top.min(other.top),
            right: self.right.max(other.right),
            bottom: self.bottom.max(other.bottom),
        }
    }
}

/// Why rows make no silhouette.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum SilhouetteError {
    /// A side is zero or too large.
    #[error("silhouette of {width} x {height}, expected 1 to {MAX_SIDE_PIXELS} pixels a side")]
    Size {
        /// Pixels across.
        width: u32,
        /// Pixels down.
        height: u32,
    },
    /// A row's runs are empty, out of order, touching, or off the image.
    #[error("row {row} holds run {start}..{end} after column {after} in an image {width} wide")]
    Run {
        /// Index of the row.
        row: u32,
        /// First column of the offending run.
        start: u32,
        /// Column after it.
        end: u32,
        /// The end of the run before it.
        after: u32,
        /// Pixels across.
        width: u32,
    },
    /// A mask of the wrong length, or the wrong number of rows.
    #[error("{found} given, expected {expected}")]
    Length {
        /// Pixels or rows given.
        found: usize,
        /// Pixels or rows expected.
        expected: usize,
    },
}

/// The foreground of one camera at one frame: runs per row with row offsets, on the camera's own
/// (distorted) pixels. Runs of a row are sorted, not empty, and do not touch.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Silhouette {
    width: u32,
    height: u32,
    row_offsets: Vec<u32>,
    runs: Vec<Run>,
    bounds: Option<PixelRect>,
    area: u64,
}

/// Builds a silhouette row by row, from the top.
#[derive(Clone, Debug)]
pub struct SilhouetteBuilder {
    width: u32,
    height: u32,
    row_offsets: Vec<u32>,
    runs: Vec<Run>,
}

impl SilhouetteBuilder {
    /// Starts an image of that size.
    pub fn new(width: u32, height: u32) -> Result<SilhouetteBuilder, SilhouetteError> {
        if !(1..=MAX_SIDE_PIXELS).contains(&width) || !(1..=MAX_SIDE_PIXELS).contains(&height) {
            return Err(SilhouetteError::Size { width, height });
        }
        let mut row_offsets = Vec::with_capacity(height as usize + 1);
        row_offsets.push(0);
        Ok(SilhouetteBuilder { width, height, row_offsets, runs: Vec::new() })
    }

    /// Adds the next row from its pixels, foreground where not zero.
    pub fn push_mask_row(&mut self, mask: &[u8]) -> Result<(), SilhouetteError> {
        if mask.len() != self.width as usize {
            return Err(SilhouetteError::Length { found: mask.len(), expected: self.width as usize });
        }
        let mut column = 0;
        while let Some(start) = mask[column..].iter().position(|&pixel| pixel != 0).map(|at| column + at) {
            let end = mask[start..].iter().position(|&pixel| pixel == 0).map_or(mask.len(), |at| start + at);
            self.runs.push(Run { start: start as u16, end: end as u16 });
            column = end;
        }
        self.end_row()
    }

    /// Adds the next row from its runs.
    pub fn push_runs(&mut self, runs: &[Run]) -> Result<(), SilhouetteError> {
        let mut after = None;
        for run in runs {
            let (start, end) = (u32::from(run.start), u32::from(run.end));
            if after.is_some_and(|after| start <= after) || end <= start || end > self.width {
                let row = self.row_offsets.len() as u32 - 1;
                let after = after.unwrap_or(0);
                return Err(SilhouetteError::Run { row, start, end, after, width: self.width });
            }
            after = Some(end);
        }
        self.runs.extend_from_slice(runs);
        self.end_row()
    }

    fn end_row(&mut self) -> Result<(), SilhouetteError> {
        if self.row_offsets.len() > self.height as usize {
            let (found, expected) = (self.row_offsets.len(), self.height as usize);
            return Err(SilhouetteError::Length { found, expected });
        }
        self.row_offsets.push(self.runs.len() as u32);
        Ok(())
    }

    /// The silhouette, if all rows were given.
    pub fn finish(self) -> Result<Silhouette, SilhouetteError> {
        let rows = self.row_offsets.len() - 1;
        if rows != self.height as usize {
            return Err(SilhouetteError::Length { found: rows, expected: self.height as usize });
        }
        let mut silhouette = Silhouette {
            width: self.width,
            height: self.height,
            row_offsets: self.row_offsets,
            runs: self.runs,
            bounds: None,
            area: 0,
        };
        for row in 0..silhouette.height {
            let runs = silhouette.row(row);
            let (Some(first), Some(last)) = (runs.first(), runs.last()) else { continue };
            let extent = PixelRect {
                left: u32::from(first.start),
                top: row,
                right: u32::from(last.end),
                bottom: row + 1,
            };
            let area: u64 = runs.iter().map(|run| u64::from(run.end - run.start)).sum();
            silhouette.bounds = Some(silhouette.bounds.map_or(extent, |bounds| bounds.union(extent)));
            silhouette.area += area;
        }
        Ok(silhouette)
    }
}

impl Silhouette {
    /// From one byte per pixel, row by row, foreground where not zero.
    pub fn from_mask(width: u32, height: u32, mask: &[u8]) -> Result<Silhouette, SilhouetteError> {
        let mut builder = SilhouetteBuilder::new(width, height)?;
        let expected = width as usize * height as usize;
        if mask.len() != expected {
            return Err(SilhouetteError::Length { found: mask.len(), expected });
        }
        for row in mask.chunks_exact(width as usize) {
            builder.push_mask_row(row)?;
        }
        builder.finish()
    }

    /// A silhouette without foreground.
    pub fn empty(width: u32, height: u32) -> Result<Silhouette, SilhouetteError> {
        let mut builder = SilhouetteBuilder::new(width, height)?;
        for _ in 0..height {
            builder.push_runs(&[])?;
        }
        builder.finish()
    }

    /// Pixels across.
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Pixels down.
    pub fn height(&self) -> u32 {
        self.height
    }

    /// The runs of a row, left to right; `row` must be under the height.
    pub fn row(&self, row: u32) -> &[Run] {
        let row = row as usize;
        &self.runs[self.row_offsets[row] as usize..self.row_offsets[row + 1] as usize]
    }

    /// All runs, top to bottom.
    pub fn run_count(&self) -> usize {
        self.runs.len()
    }

    /// The bounding rectangle of the foreground, `None` without any (paper §4.1).
    pub fn bounds(&self) -> Option<PixelRect> {
        self.bounds
    }

    /// Foreground pixels.
    pub fn area(&self) -> u64 {
        self.area
    }

    /// True if the pixel is foreground; pixels off the image are not.
    pub fn contains(&self, column: i32, row: i32) -> bool {
        if row < 0 || row as u32 >= self.height || column < 0 || column as u32 >= self.width {
            return false;
        }
        let runs = self.row(row as u32);
        let next = runs.partition_point(|run| i32::from(run.start) <= column);
        next > 0 && column < i32::from(runs[next - 1].end)
    }

    /// One byte per pixel, row by row: 255 is foreground.
    pub fn to_mask(&self) -> Vec<u8> {
        let width = self.width as usize;
        let mut mask = vec![0; width * self.height as usize];
        for (row, pixels) in mask.chunks_exact_mut(width).enumerate() {
            for run in self.row(row as u32) {
                pixels[usize::from(run.start)..usize::from(run.end)].fill(255);
            }
        }
        mask
    }

    /// Heap memory, bytes.
    pub fn heap_bytes(&self) -> usize {
        self.runs.capacity() * size_of::<Run>() + self.row_offsets.capacity() * 4
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use proptest::prelude::*;

    /// A silhouette drawn as text, `#` is foreground.
    pub(crate) fn drawn(rows: &[&str]) -> Silhouette {
        let mask: Vec<u8> = rows.iter().flat_map(|row| row.bytes()).map(|c| u8::from(c == b'#')).collect();
        Silhouette::from_mask(rows[0].len() as u32, rows.len() as u32, &mask).expect("rows of one length")
    }

    #[test]
    fn a_drawn_mask_becomes_runs_bounds_and_area() {
        let silhouette = drawn(&["......", ".##.#.", ".####.", "......"]);
        assert_eq!(silhouette.row(1), [Run { start: 1, end: 3 }, Run { start: 4, end: 5 }]);
        assert_eq!(silhouette.area(), 7);
        assert_eq!(silhouette.bounds(), Some(PixelRect { left: 1, top: 1, right: 5, bottom: 3 }));
        assert!(silhouette.contains(4, 1) && !silhouette.contains(3, 1) && !silhouette.contains(-1, 1));
    }

    #[test]
    fn rows_that_lie_are_refused() {
        let mut builder = SilhouetteBuilder::new(8, 1).expect("size");
        for bad in [[(3, 3), (4, 5)], [(4, 6), (5, 7)], [(1, 2), (2, 3)], [(1, 2), (7, 9)]] {
            let runs = bad.map(|(start, end)| Run { start, end });
            assert!(matches!(builder.push_runs(&runs), Err(SilhouetteError::Run { .. })), "{bad:?}");
        }
        assert!(builder.clone().finish().is_err(), "a row is missing");
        builder.push_runs(&[]).expect("an empty row");
        assert!(builder.push_runs(&[]).is_err(), "a row too many");
        assert!(SilhouetteBuilder::new(0, 3).is_err());
        assert!(Silhouette::from_mask(2, 2, &[0; 5]).is_err());
    }

    proptest! {
        #[test]
        fn runs_and_mask_say_the_same(width in 1u32..40, height in 1u32..20, seed in any::<u64>()) {
            let mask = random_mask(width, height, seed);
            let silhouette = Silhouette::from_mask(width, height, &mask).expect("size");
            prop_assert_eq!(silhouette.to_mask(), mask.clone());
            for row in 0..height as i32 {
                for column in 0..width as i32 {
                    let foreground = mask[row as usize * width as usize + column as usize] != 0;
                    prop_assert_eq!(silhouette.contains(column, row), foreground);
                }
            }
        }
    }

    /// Blobs with holes and salt noise, 0 or 255.
    pub(crate) fn random_mask(width: u32, height: u32, seed: u64) -> Vec<u8> {
        let mut state = seed | 1;
        let mut next = move || {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            state
        };
        let mut mask = vec![0u8; width as usize * height as usize];
        for blob in 0..6 {
            let (cx, cy) = ((next() % u64::from(width)) as i64, (next() % u64::from(height)) as i64);
            let radius = (next() % u64::from(2 + width.min(height) / 3)) as i64;
            for row in 0..i64::from(height) {
                for column in 0..i64::from(width) {
                    if (row - cy).pow(2) + (column - cx).pow(2) <= radius * radius {
                        mask[(row * i64::from(width) + column) as usize] =
                            if blob % 4 == 3 { 0 } else { 255 };
                    }
                }
            }
        }
        for _ in 0..mask.len() / 60 {
            let at = (next() % mask.len() as u64) as usize;
            mask[at] = 255 - mask[at];
        }
        mask
    }
}
