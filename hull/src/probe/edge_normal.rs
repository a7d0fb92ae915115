//! The silhouette's 2D normal at an edge pixel (paper §4.2): the average of the vectors to the
//! background pixels of a window, from sums over runs of zeros.

use nalgebra::Vector2;

use crate::camera::Pixel;
use crate::silhouette::BitMap;

/// The sum of the vectors from `centre` to every zero bit of the (2k + 1)² window around it, pixels.
/// The average has the same direction.
pub fn sum_of_background(candidates: &BitMap, centre: Pixel, k: u32) -> Vector2<f64> {
    let k = k as i32;
    let (mut across, mut down) = (0i64, 0i64);
    for row in centre.row - k..=centre.row + k {
        let (sum, count) = zeros_of_row(candidates, row, centre.column - k, centre.column + k + 1);
        across += sum - count * i64::from(centre.column);
        down += count * i64::from(row - centre.row);
    }
    Vector2::new(across as f64, down as f64)
}

/// The sum of columns and the number of zeros among columns `start..end` of a row.
fn zeros_of_row(map: &BitMap, row: i32, start: i32, end: i32) -> (i64, i64) {
    if row < map.top() || row >= map.bottom() || start < map.left() || end > map.right() {
        return zeros_beyond(map, row, start, end);
    }
    let words = map.row_words(row);
    let (mut sum, mut count) = (0, 0);
    let (from, to) = ((start - map.left()) as usize, (end - map.left()) as usize);
    for (word, &bits) in words.iter().enumerate().take((to - 1) / 64 + 1).skip(from / 64) {
        let base = word * 64;
        let mut zeros = !bits;
        if base < from {
            zeros &= u64::MAX << (from - base);
        }
        if to - base < 64 {
            zeros &= (1 << (to - base)) - 1;
        }
        let first_column = i64::from(map.left()) + base as i64;
        while zeros != 0 {
            let begin = zeros.trailing_zeros();
            let length = (!(zeros >> begin)).trailing_zeros();
            let (begin_i64, length_i64) = (i64::from(begin), i64::from(length));
            sum += length_i64 * (first_column + begin_i64) + length_i64 * (length_i64 - 1) / 2;
            count += length_i64;
            let done = begin + length;
            zeros = if done == 64 { 0 } else { zeros & (u64::MAX << done) };
        }
    }
    (sum, count)
}

/// The same for the rare window that leaves the map.
fn zeros_beyond(map: &BitMap, row: i32, start: i32, end: i32) -> (i64, i64) {
    let zeros = (start..end).filter(|&column| !map.get(Pixel { column, row }));
    zeros.fold((0, 0), |(sum, count), column| (sum + i64::from(column), count + 1))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::silhouette::Silhouette;
    use crate::silhouette::tests::{drawn, random_mask};
    use proptest::prelude::*;

    #[test]
    fn a_straight_edge_has_a_straight_normal() {
        let map = BitMap::foreground(&drawn(&["#####.....", "#####.....", "#####....."]), 3);
        let sum = sum_of_background(&map, Pixel { column: 5, row: 1 }, 1);
        assert_eq!(sum, Vector2::new(3.0, 0.0));
    }

    proptest! {
        #[test]
        fn sums_over_runs_are_sums_over_pixels(
            width in 1u32..200, height in 1u32..60, seed in any::<u64>(), column in -3i32..203,
            row in -3i32..63, k in 1u32..40,
        ) {
            let silhouette =
                Silhouette::from_mask(width, height, &random_mask(width, height, seed)).expect("size");
            let map = BitMap::foreground(&silhouette, k + 1);
            let (column, row) = (column.min(width as i32), row.min(height as i32));
            let reach = k as i32;
            let mut expected = Vector2::zeros();
            for dy in -reach..=reach {
                for dx in -reach..=reach {
                    if !map.get(Pixel { column: column + dx, row: row + dy }) {
                        expected += Vector2::new(f64::from(dx), f64::from(dy));
                    }
                }
            }
            prop_assert_eq!(sum_of_background(&map, Pixel { column, row }, k), expected);
        }
    }
}
