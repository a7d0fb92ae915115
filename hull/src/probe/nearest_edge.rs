//! The background pixel nearest to a point's pixel (paper §4.2, point b; spec §3.1).
//!
//! The paper grows square windows in steps, at the speed d_max / d; here each camera answers exactly,
//! row by row outward, whole words at a time.

use crate::camera::Pixel;
use crate::silhouette::BitMap;

/// A background pixel and its squared distance in pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct EdgePixel {
    /// Where.
    pub pixel: Pixel,
    /// Squared pixel distance from the start.
    pub squared: i64,
}

/// The zero bit of `candidates` at the least squared distance from `start`, not farther than
/// `limit_squared`; ties go to the smaller row, then the smaller column. `start` must lie within the
/// map, which must hold every zero that could be nearest.
pub fn nearest_edge(candidates: &BitMap, start: Pixel, limit_squared: i64) -> Option<EdgePixel> {
    let mut best = EdgePixel { pixel: Pixel { column: i32::MAX, row: i32::MAX }, squared: limit_squared };
    let mut found = false;
    for distance in 0.. {
        let rows_squared = i64::from(distance) * i64::from(distance);
        let (above, below) = (start.row - distance, start.row + distance);
        let above_is_in = above >= candidates.top();
        let below_is_in = below < candidates.bottom();
        if rows_squared > best.squared || !(above_is_in || below_is_in) {
            break;
        }
        let rows = [above_is_in.then_some(above), (below_is_in && distance > 0).then_some(below)];
        for row in rows.into_iter().flatten() {
            let words = candidates.row_words(row);
            let reach = best.squared - rows_squared;
            let near = nearest_zero_of_row(words, start.column - candidates.left(), reach);
            let Some(column) = near.map(|column| column + candidates.left()) else { continue };
            let gap = i64::from(column - start.column);
            let edge = EdgePixel { pixel: Pixel { column, row }, squared: rows_squared + gap * gap };
            let wins = edge.squared < best.squared
                || edge.squared == best.squared && (!found || row < best.pixel.row);
            if wins {
                (best, found) = (edge, true);
            }
        }
    }
    found.then_some(best)
}

/// The column of the zero bit nearest to `column`, at a squared gap of at most `reach`; the left one
/// wins a tie.
fn nearest_zero_of_row(words: &[u64], column: i32, reach: i64) -> Option<i32> {
    let (word, bit) = ((column >> 6) as usize, (column & 63) as u32);
    let left = zero_at_or_before(words, word, bit, column, reach);
    let right_reach = left.map_or(reach, |left| i64::from(column - left).pow(2) - 1);
    if right_reach < 0 {
        return left;
    }
    zero_at_or_after(words, word, bit, column, right_reach).or(left)
}

fn zero_at_or_before(words: &[u64], word: usize, bit: u32, column: i32, reach: i64) -> Option<i32> {
    let mut zeros = !words[word] & (u64::MAX >> (63 - bit));
    let mut word = word;
    loop {
        if zeros != 0 {
            let at = word as i32 * 64 + 63 - zeros.leading_zeros() as i32;
            return (i64::from(column - at).pow(2) <= reach).then_some(at);
        }
        let next_gap = i64::from(column - word as i32 * 64 + 1);
        if word == 0 || next_gap * next_gap > reach {
            return None;
        }
        word -= 1;
        zeros = !words[word];
    }
}

fn zero_at_or_after(words: &[u64], word: usize, bit: u32, column: i32, reach: i64) -> Option<i32> {
    let mut zeros = !words[word] & (u64::MAX << bit);
    let mut word = word;
    loop {
        if zeros != 0 {
            let at = word as i32 * 64 + zeros.trailing_zeros() as i32;
            return (i64::from(at - column).pow(2) <= reach).then_some(at);
        }
        word += 1;
        let next_gap = i64::from(word as i32 * 64 - column);
        if word >= words.len() || next_gap * next_gap > reach {
            return None;
        }
        zeros = !words[word];
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
        let map = BitMap::foreground(&drawn(&["#####", "#####", "#####"]), 1);
        let edge = nearest_edge(&map, Pixel { column: 2, row: 1 }, i64::MAX).expect("the border");
        assert_eq!((edge.pixel, edge.squared), (Pixel { column: 2, row: -1 }, 4));
        let map = BitMap::foreground(&drawn(&["#####", "#.#.#", "#####"]), 1);
        let edge = nearest_edge(&map, Pixel { column: 2, row: 1 }, i64::MAX).expect("holes");
        assert_eq!((edge.pixel, edge.squared), (Pixel { column: 1, row: 1 }, 1));
    }

    proptest! {
        #[test]
        fn it_is_the_brute_minimum_ties_included(
            width in 1u32..260, height in 1u32..60, seed in any::<u64>(), across in 0.0..1.0f64,
            down in 0.0..1.0f64, invert in any::<bool>(), limit in prop_oneof![Just(i64::MAX), 0i64..900],
        ) {
            let mut mask = random_mask(width, height, seed);
            if invert {
                mask.iter_mut().for_each(|pixel| *pixel = 255 - *pixel);
            }
            let map = BitMap::foreground(&Silhouette::from_mask(width, height, &mask).expect("size"), 3);
            let start = Pixel {
                column: (map.left() + ((map.right() - map.left()) as f64 * across) as i32),
                row: (map.top() + ((map.bottom() - map.top()) as f64 * down) as i32),
            };
            prop_assert_eq!(nearest_edge(&map, start, limit), brute(&map, start, limit));
        }
    }
}
