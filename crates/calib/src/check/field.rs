//! Signed distance to a silhouette's outline, in pixels: positive outside, negative inside.
//!
//! Exact (Euclidean, between pixel centres, less half a pixel) at grid points `spacing` pixels apart
//! over the silhouette's rectangle with a margin, bilinear between them.

use hull::Silhouette;
use hull::silhouette::PixelRect;

/// The distance field of one silhouette.
#[derive(Clone, Debug)]
pub(crate) struct Field {
    bounds: PixelRect,
    left: f64,
    top: f64,
    spacing: f64,
    columns: usize,
    rows: usize,
    distances_px: Vec<f32>,
}

impl Field {
    /// The field of a silhouette, `None` if it has no foreground.
    pub(crate) fn new(silhouette: &Silhouette, spacing_px: u32, margin_px: u32) -> Option<Field> {
        let bounds = silhouette.bounds()?;
        let (spacing, margin) = (i64::from(spacing_px), i64::from(margin_px));
        let (left, top) = (i64::from(bounds.left) - margin, i64::from(bounds.top) - margin);
        let across = i64::from(bounds.right - bounds.left) + 2 * margin;
        let down = i64::from(bounds.bottom - bounds.top) + 2 * margin;
        let columns = (across / spacing + 2) as usize;
        let rows = (down / spacing + 2) as usize;
        let grid_columns: Vec<i64> = (0..columns as i64).map(|a| left + a * spacing).collect();
        let grid_rows: Vec<i64> = (0..rows as i64).map(|b| top + b * spacing).collect();
        let mut distances_px = vec![0f32; columns * rows];
        let reach = RowReach::new(silhouette, bounds, &grid_columns);
        let mut envelope = Envelope::default();
        for a in 0..columns {
            // A grid point is foreground or background, so one of the two distances is zero.
            envelope.build(reach.first_row, reach.to_foreground(a));
            for (b, &row) in grid_rows.iter().enumerate() {
                let squared = envelope.squared_distance(row);
                if squared > 0.0 {
                    distances_px[b * columns + a] = (squared.sqrt() - 0.5) as f32;
                }
            }
            envelope.build(reach.first_row, reach.to_background(a));
            let within = |row: &i64| (i64::from(bounds.top)..i64::from(bounds.bottom)).contains(row);
            for (b, &row) in grid_rows.iter().enumerate().filter(|(_, row)| within(row)) {
                let squared = envelope.squared_distance(row);
                if squared > 0.0 {
                    distances_px[b * columns + a] = (0.5 - squared.sqrt()) as f32;
                }
            }
        }
        let spacing = spacing as f64;
        Some(Field { bounds, left: left as f64, top: top as f64, spacing, columns, rows, distances_px })
    }

    /// A field that knows only the silhouette's rectangle: zero within it.
    pub(super) fn of_rectangle(silhouette: &Silhouette) -> Option<Field> {
        let bounds = silhouette.bounds()?;
        let distances_px = Vec::new();
        Some(Field { bounds, left: 0.0, top: 0.0, spacing: 1.0, columns: 1, rows: 1, distances_px })
    }

    /// The signed distance at image coordinates; beyond the margin, the distance to the silhouette's
    /// rectangle, which is not more than the true one.
    #[inline]
    pub(crate) fn distance_px(&self, u: f64, v: f64) -> f64 {
        let x = (u - self.left) / self.spacing;
        let y = (v - self.top) / self.spacing;
        if !(x >= 0.0 && y >= 0.0 && x < (self.columns - 1) as f64 && y < (self.rows - 1) as f64) {
            let b = &self.bounds;
            let dx = (f64::from(b.left) - u).max(u - f64::from(b.right - 1)).max(0.0);
            let dy = (f64::from(b.top) - v).max(v - f64::from(b.bottom - 1)).max(0.0);
            return (dx * dx + dy * dy).sqrt();
        }
        let (column, row) = (x as usize, y as usize);
        let (fx, fy) = (x - column as f64, y - row as f64);
        let at = row * self.columns + column;
        let upper = &self.distances_px[at..at + 2];
        let lower = &self.distances_px[at + self.columns..at + self.columns + 2];
        let mix = |pair: &[f32]| f64::from(pair[0]) * (1.0 - fx) + f64::from(pair[1]) * fx;
        mix(upper) * (1.0 - fy) + mix(lower) * fy
    }
}

/// The distance to a silhouette at a moment between two frames: the fields of both, mixed.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Blend<'a> {
    pub(crate) before: &'a Field,
    pub(crate) after: &'a Field,
    /// How far the moment is from the first to the second, 0 to 1.
    pub(crate) share: f64,
}

impl<'a> Blend<'a> {
    /// The silhouette of one frame.
    pub(crate) fn still(field: &'a Field) -> Blend<'a> {
        Blend { before: field, after: field, share: 0.0 }
    }

    /// The signed distance at image coordinates.
    #[inline]
    pub(crate) fn distance_px(&self, u: f64, v: f64) -> f64 {
        let before = self.before.distance_px(u, v);
        if self.share == 0.0 {
            return before;
        }
        before + self.share * (self.after.distance_px(u, v) - before)
    }

    /// How the distance at image coordinates changes from the first frame to the second, pixels.
    pub(crate) fn change_px(&self, u: f64, v: f64) -> f64 {
        self.after.distance_px(u, v) - self.before.distance_px(u, v)
    }
}

const NOWHERE: u32 = u32::MAX;

/// Per grid column and image row, how far along the row the nearest foreground and background lie.
struct RowReach {
    first_row: i64,
    rows: usize,
    foreground: Vec<u32>,
    background: Vec<u32>,
}

impl RowReach {
    /// Rows of the rectangle with one background row on each side; off the image is background.
    fn new(silhouette: &Silhouette, bounds: PixelRect, grid_columns: &[i64]) -> RowReach {
        let first_row = i64::from(bounds.top) - 1;
        let rows = (bounds.bottom - bounds.top) as usize + 2;
        let mut foreground = vec![NOWHERE; rows * grid_columns.len()];
        let mut background = vec![0; rows * grid_columns.len()];
        for row in bounds.top..bounds.bottom {
            let runs = silhouette.row(row);
            let at_row = (i64::from(row) - first_row) as usize;
            let mut next = 0;
            for (a, &column) in grid_columns.iter().enumerate() {
                while next < runs.len() && i64::from(runs[next].end) <= column {
                    next += 1;
                }
                let at = a * rows + at_row;
                let before = next.checked_sub(1).map(|last| column - (i64::from(runs[last].end) - 1));
                let after = runs.get(next).map(|run| i64::from(run.start) - column);
                if let Some(after) = after.filter(|&after| after <= 0) {
                    let end = i64::from(runs[next].end) - column;
                    foreground[at] = 0;
                    background[at] = (1 - after).min(end) as u32;
                } else if let Some(least) = before.into_iter().chain(after).min() {
                    foreground[at] = least as u32;
                }
            }
        }
        RowReach { first_row, rows, foreground, background }
    }

    fn to_foreground(&self, a: usize) -> &[u32] {
        &self.foreground[a * self.rows..(a + 1) * self.rows]
    }

    fn to_background(&self, a: usize) -> &[u32] {
        &self.background[a * self.rows..(a + 1) * self.rows]
    }
}

/// The lower envelope of parabolas `(y − row)² + reach²`, one per row.
#[derive(Default)]
struct Envelope {
    /// Row, squared reach, and the y from which this parabola is the lowest.
    pieces: Vec<(f64, f64, f64)>,
}

impl Envelope {
    fn build(&mut self, first_row: i64, reach: &[u32]) {
        self.pieces.clear();
        for (index, &reach) in reach.iter().enumerate().filter(|&(_, &reach)| reach != NOWHERE) {
            let row = (first_row + index as i64) as f64;
            let height = f64::from(reach) * f64::from(reach);
            let mut from = f64::NEG_INFINITY;
            while let Some(&(other, other_height, other_from)) = self.pieces.last() {
                from = (height + row * row - other_height - other * other) / (2.0 * (row - other));
                if from > other_from {
                    break;
                }
                self.pieces.pop();
                from = f64::NEG_INFINITY;
            }
            self.pieces.push((row, height, from));
        }
    }

    fn squared_distance(&self, row: i64) -> f64 {
        let y = row as f64;
        let next = self.pieces.partition_point(|piece| piece.2 <= y).max(1) - 1;
        let (row, height, _) = self.pieces[next];
        (y - row) * (y - row) + height
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Distances by comparing with every pixel, a frame of background included.
    fn slow_distance(silhouette: &Silhouette, column: i32, row: i32) -> f64 {
        let inside = silhouette.contains(column, row);
        let mut least = i32::MAX;
        for y in -1..=silhouette.height() as i32 {
            for x in -1..=silhouette.width() as i32 {
                if silhouette.contains(x, y) != inside {
                    least = least.min((x - column).pow(2) + (y - row).pow(2));
                }
            }
        }
        let distance = f64::from(least).sqrt() - 0.5;
        if inside { -distance } else { distance }
    }

    proptest! {
        #[test]
        fn grid_points_hold_the_distance_found_by_looking_everywhere(
            mask in proptest::collection::vec(prop::bool::weighted(0.6), 14 * 11), spacing in 1u32..4,
        ) {
            let bytes: Vec<u8> = mask.iter().map(|&on| u8::from(on)).collect();
            let silhouette = Silhouette::from_mask(14, 11, &bytes).expect("size");
            prop_assume!(silhouette.bounds().is_some());
            let field = Field::new(&silhouette, spacing, 5).expect("has foreground");
            let (left, top) = (field.left as i32, field.top as i32);
            for b in 0..(field.rows - 1) as i32 {
                for a in 0..(field.columns - 1) as i32 {
                    let (x, y) = (left + a * spacing as i32, top + b * spacing as i32);
                    let expected = slow_distance(&silhouette, x, y);
                    let found = field.distance_px(f64::from(x), f64::from(y));
                    prop_assert!((found - expected).abs() < 1e-5, "{x} {y}: {found}, not {expected}");
                }
            }
        }
    }

    #[test]
    fn far_points_are_as_far_as_the_rectangle() {
        let silhouette = Silhouette::from_mask(3, 3, &[0, 0, 0, 0, 1, 0, 0, 0, 0]).expect("size");
        let field = Field::new(&silhouette, 1, 2).expect("has foreground");
        assert!((field.distance_px(31.0, 41.0) - 50.0).abs() < 1e-12);
        assert!(Field::new(&Silhouette::empty(3, 3).expect("size"), 1, 2).is_none());
    }
}
