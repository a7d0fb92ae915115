//! One bit per pixel, and the openings and closings done on it in vectors of pixels.

use std::ops::Range;

use hull::VectorPath;
use hull::silhouette::Run;

use crate::kernel::Work;

/// Words of the widest row, and one of zeros before and after.
const ROW_ROOM: usize = hull::camera::MAX_SIDE_PIXELS as usize / 64 + 2;

/// An image of bits, rows padded to whole words; padding bits are never set.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct BitImage {
    width: usize,
    words_per_row: usize,
    words: Vec<u64>,
}

/// A part of an image outside of which no pixel is set.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Area {
    pub(crate) rows: Range<usize>,
    /// Of each row.
    pub(crate) words: Range<usize>,
}

impl Area {
    pub(crate) fn is_empty(&self) -> bool {
        self.rows.is_empty() || self.words.is_empty()
    }

    /// Wider by so many pixels to all sides, as far as the image goes.
    fn grown(&self, px: usize, image: &BitImage) -> Area {
        let words = px.div_ceil(64);
        Area {
            rows: self.rows.start.saturating_sub(px)..(self.rows.end + px).min(image.height()),
            words: self.words.start.saturating_sub(words)..(self.words.end + words).min(image.words_per_row),
        }
    }
}

impl BitImage {
    /// All pixels unset.
    pub(crate) fn new(width: u32, height: u32) -> BitImage {
        let words_per_row = (width as usize).div_ceil(64);
        BitImage { width: width as usize, words_per_row, words: vec![0; words_per_row * height as usize] }
    }

    fn height(&self) -> usize {
        self.words.len() / self.words_per_row
    }

    /// All words, row by row.
    pub(crate) fn words_mut(&mut self) -> &mut [u64] {
        &mut self.words
    }

    /// The columns of an area.
    pub(crate) fn columns(&self, area: &Area) -> Range<u32> {
        64 * area.words.start as u32..(64 * area.words.end).min(self.width) as u32
    }

    /// The words of a row within an area.
    fn row(&self, row: usize, area: &Area) -> &[u64] {
        let start = row * self.words_per_row;
        &self.words[start + area.words.start..start + area.words.end]
    }

    fn row_mut(&mut self, row: usize, area: &Area) -> &mut [u64] {
        let start = row * self.words_per_row;
        &mut self.words[start + area.words.start..start + area.words.end]
    }

    /// Sets or clears the pixels of a run.
    pub(crate) fn set_run(&mut self, row: usize, run: Run, value: bool) {
        let words = &mut self.words[row * self.words_per_row..][..self.words_per_row];
        for (at, bits) in run_words(run) {
            words[at] = if value { words[at] | bits } else { words[at] & !bits };
        }
    }

    /// Number of pixels set within a run.
    pub(crate) fn count_run(&self, row: usize, run: Run) -> u32 {
        let words = &self.words[row * self.words_per_row..][..self.words_per_row];
        run_words(run).map(|(at, bits)| (words[at] & bits).count_ones()).sum()
    }

    /// Flips every pixel of an area.
    pub(crate) fn invert(&mut self, area: &Area) {
        let used = self.width % 64;
        let ends = area.words.end == self.words_per_row && used > 0;
        for row in area.rows.clone() {
            let words = self.row_mut(row, area);
            words.iter_mut().for_each(|word| *word = !*word);
            if let (true, Some(last)) = (ends, words.last_mut()) {
                *last &= (1 << used) - 1;
            }
        }
    }

    /// Takes over the pixels of an image of the same size.
    pub(crate) fn copy_from(&mut self, other: &BitImage) {
        self.words.copy_from_slice(&other.words);
    }

    /// The smallest area that holds all pixels set, and their number.
    pub(crate) fn extent(&self, path: VectorPath) -> (Area, u64) {
        Extent { image: self }.run_on(path)
    }

    /// Appends the runs of a row within an area, left to right.
    pub(crate) fn row_runs(&self, row: usize, area: &Area, runs: &mut Vec<Run>) {
        let mut open: Option<u16> = None;
        for (at, &word) in self.row(row, area).iter().enumerate() {
            // Images are at most 16,384 pixels wide, so columns fit.
            let base = 64 * (area.words.start + at);
            let mut bit = 0;
            while bit < 64 {
                let rest = if open.is_some() { !word } else { word } >> bit;
                if rest == 0 {
                    break;
                }
                bit += rest.trailing_zeros() as usize;
                let column = (base + bit) as u16;
                open = match open {
                    Some(start) => {
                        runs.push(Run { start, end: column });
                        None
                    }
                    None => Some(column),
                };
            }
        }
        if let Some(start) = open {
            runs.push(Run { start, end: self.columns(area).end as u16 });
        }
    }

    /// Keeps what squares of `side` pixels, wholly on the image, can cover; all that is set must be in the
    /// area.
    pub(crate) fn open(&mut self, side: usize, area: &Area, path: VectorPath) {
        if side > 1 && !area.is_empty() {
            Morph { image: self, area, side, erodes: true }.run_on(path);
        }
    }

    /// Fills what squares of `side` background pixels, wholly on the image, cannot cover. All that is set
    /// must be in the area; all that is set then is in the area that is given back.
    pub(crate) fn close(&mut self, side: usize, area: Area, path: VectorPath) -> Area {
        if side <= 1 || area.is_empty() {
            return area;
        }
        // A margin as wide as the square is all that squares beside the foreground need; and what no
        // square covers between foreground and image border lies within it, too: but for an image on which no square
        // has room at all.
        let has_room = self.width >= side && self.height() >= side;
        let whole = Area { rows: 0..self.height(), words: 0..self.words_per_row };
        let area = if has_room { area.grown(side, self) } else { whole };
        self.invert(&area);
        Morph { image: self, area: &area, side, erodes: true }.run_on(path);
        self.invert(&area);
        area
    }

    /// Grows every pixel of an area to a square of `side` pixels, down and to the right, and gives the area
    /// that holds them.
    pub(crate) fn grow(&mut self, side: usize, area: &Area, path: VectorPath) -> Area {
        let area = area.grown(side, self);
        if side > 1 && !area.is_empty() {
            Morph { image: self, area: &area, side, erodes: false }.run_on(path);
        }
        area
    }
}

struct Extent<'a> {
    image: &'a BitImage,
}

impl Work for Extent<'_> {
    type Output = (Area, u64);

    #[inline(always)]
    fn run(self) -> (Area, u64) {
        let image = self.image;
        let (mut rows, mut count) = (0..0, 0);
        let mut columns = [0u64; ROW_ROOM];
        for (at, row) in image.words.chunks_exact(image.words_per_row).enumerate() {
            if row.iter().fold(0, |any, word| any | word) == 0 {
                continue;
            }
            rows = if rows.is_empty() { at..at + 1 } else { rows.start..at + 1 };
            count += row.iter().map(|word| u64::from(word.count_ones())).sum::<u64>();
            columns.iter_mut().zip(row).for_each(|(all, word)| *all |= word);
        }
        let first = columns.iter().position(|&all| all != 0).unwrap_or(0);
        let end = columns.iter().rposition(|&all| all != 0).map_or(0, |last| last + 1);
        (Area { rows, words: first..end }, count)
    }
}

/// Erosion (if asked for) and dilation by a square. A pixel stays if the square that begins at it, to the
/// right and below, is set; then it sets that square. Beyond the area nothing is set, and nothing gets set.
struct Morph<'a> {
    image: &'a mut BitImage,
    area: &'a Area,
    side: usize,
    erodes: bool,
}

impl Work for Morph<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Morph { image, area, side, erodes } = self;
        let (mut from, mut to) = ([0; ROW_ROOM], [0; ROW_ROOM]);
        if erodes {
            for row in area.rows.clone() {
                along_row(image.row_mut(row, area), side, &mut from, &mut to, true);
            }
            for shift in doubling(side) {
                for row in area.rows.clone() {
                    image.onto_row(row, (row + shift < area.rows.end).then_some(row + shift), area, true);
                }
            }
        }
        for shift in doubling(side) {
            for row in area.rows.clone().skip(shift).rev() {
                image.onto_row(row, Some(row - shift), area, false);
            }
        }
        let used = image.width % 64;
        let padded = area.words.end == image.words_per_row && used > 0;
        for row in area.rows.clone() {
            let words = image.row_mut(row, area);
            along_row(words, side, &mut from, &mut to, false);
            if let (true, Some(last)) = (padded, words.last_mut()) {
                *last &= (1 << used) - 1;
            }
        }
    }
}

impl BitImage {
    /// Lets only those pixels stay that are set in the other row, too, or adds that row's; `None` is a
    /// row of zeros.
    #[inline(always)]
    fn onto_row(&mut self, row: usize, other: Option<usize>, area: &Area, both: bool) {
        let Some(other) = other else {
            if both {
                self.row_mut(row, area).fill(0);
            }
            return;
        };
        let (low, high) = (row.min(other), row.max(other));
        let (above, below) = self.words.split_at_mut(high * self.words_per_row);
        let above = &mut above[low * self.words_per_row..][area.words.clone()];
        let below = &mut below[area.words.clone()];
        let (here, there) = if row == low { (above, below) } else { (below, above) };
        for (here, there) in here.iter_mut().zip(there) {
            *here = if both { *here & *there } else { *here | *there };
        }
    }
}

/// Erodes a row with what follows, or dilates it over what follows, in two buffers that stay zero before
/// and after it.
#[inline(always)]
fn along_row(row: &mut [u64], side: usize, from: &mut [u64], to: &mut [u64], erodes: bool) {
    if row.iter().fold(0, |any, word| any | word) == 0 {
        return;
    }
    let (mut from, mut to) = (&mut from[..row.len() + 2], &mut to[..row.len() + 2]);
    from[1..=row.len()].copy_from_slice(row);
    (from[row.len() + 1], to[row.len() + 1]) = (0, 0);
    for shift in doubling(side) {
        for at in 1..=row.len() {
            let there = if erodes {
                from[at] >> shift | from[at + 1] << (64 - shift)
            } else {
                from[at] << shift | from[at - 1] >> (64 - shift)
            };
            to[at] = if erodes { from[at] & there } else { from[at] | there };
        }
        std::mem::swap(&mut from, &mut to);
    }
    row.copy_from_slice(&from[1..=row.len()]);
}

/// The words that hold a run, and its bits in each.
fn run_words(run: Run) -> impl Iterator<Item = (usize, u64)> {
    let (start, end) = (usize::from(run.start), usize::from(run.end));
    (start / 64..end.div_ceil(64)).map(move |at| {
        let from = start.max(64 * at) - 64 * at;
        let to = end.min(64 * at + 64) - 64 * at;
        (at, (u64::MAX >> (64 - (to - from))) << from)
    })
}

/// Shifts that, one after the other, spread over `side` neighbours: 1, 2, 4, …, and the rest. None is as
/// long as a word.
#[inline(always)]
fn doubling(side: usize) -> impl Iterator<Item = usize> {
    let mut covered = 1;
    std::iter::from_fn(move || {
        let shift = covered.min(side - covered).min(63);
        covered += shift;
        (shift > 0).then_some(shift)
    })
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use proptest::prelude::*;

    /// An image from pixels, one byte each, 0 or 1.
    pub(crate) fn image(width: usize, mask: &[u8]) -> BitImage {
        let mut image = BitImage::new(width as u32, (mask.len() / width) as u32);
        for (at, _) in mask.iter().enumerate().filter(|(_, pixel)| **pixel == 1) {
            let column = (at % width) as u16;
            image.set_run(at / width, Run { start: column, end: column + 1 }, true);
        }
        image
    }

    /// All of an image.
    pub(crate) fn whole(image: &BitImage) -> Area {
        Area { rows: 0..image.height(), words: 0..image.words_per_row }
    }

    impl BitImage {
        pub(crate) fn count(&self) -> u64 {
            self.extent(VectorPath::Portable).1
        }
    }

    fn opened(width: usize, mask: &[u8], side: usize) -> Vec<u8> {
        let height = mask.len() / width;
        let mut out = vec![0; mask.len()];
        for top in 0..(height + 1).saturating_sub(side) {
            for left in 0..(width + 1).saturating_sub(side) {
                let square = || {
                    (top..top + side).flat_map(|row| (left..left + side).map(move |col| row * width + col))
                };
                if square().all(|at| mask[at] == 1) {
                    square().for_each(|at| out[at] = 1);
                }
            }
        }
        out
    }

    fn noise(count: usize, seed: u64, one_in: u64) -> Vec<u8> {
        let mut state = seed | 1;
        let mut pixel = || {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            u8::from(!state.is_multiple_of(one_in))
        };
        (0..count).map(|_| pixel()).collect()
    }

    proptest! {
        #[test]
        fn opening_is_the_union_of_squares_and_closing_its_mirror(
            width in 1usize..200, height in 1usize..40, side in 1usize..9, seed in any::<u64>(),
            left in 0usize..150, top in 0usize..30, path in 0usize..3,
        ) {
            let path = VectorPath::ALL[path];
            let mut mask = noise(width * height, seed, 4);
            let mut bits = image(width, &mask);
            let area = bits.extent(path).0;
            bits.open(side, &area, path);
            prop_assert_eq!(&bits, &image(width, &opened(width, &mask, side)));
            // Foreground that keeps away from some of the image's borders.
            mask.iter_mut().enumerate().for_each(|(at, pixel)| {
                *pixel &= u8::from(at % width >= left && at / width >= top && at % 5 < 3);
            });
            let inverse: Vec<u8> = mask.iter().map(|&pixel| 1 - pixel).collect();
            let closed: Vec<u8> = opened(width, &inverse, side).iter().map(|&pixel| 1 - pixel).collect();
            let mut bits = image(width, &mask);
            let area = bits.extent(path).0;
            let area = bits.close(side, area, path);
            // Nothing is set: nothing to close, even where no square would fit.
            let expected = if mask.contains(&1) { closed } else { mask };
            prop_assert_eq!(&bits, &image(width, &expected));
            let extent = bits.extent(path).0;
            prop_assert!(extent.is_empty() || area.rows.start <= extent.rows.start
                && area.rows.end >= extent.rows.end && area.words.start <= extent.words.start
                && area.words.end >= extent.words.end);
        }

        #[test]
        fn growing_sets_squares(
            width in 1usize..300, height in 1usize..12, side in 1usize..200, at in 0usize..3600, path in 0usize..3,
        ) {
            let path = VectorPath::ALL[path];
            let mut mask = vec![0; width * height];
            let at = at % mask.len();
            mask[at] = 1;
            let mut bits = image(width, &mask);
            let area = bits.extent(path).0;
            bits.grow(side, &area, path);
            let (column, row) = (at % width, at / width);
            let grown: Vec<u8> = (0..mask.len()).map(|at| {
                let within = |from: usize, at: usize| (from..from + side).contains(&at);
                u8::from(within(column, at % width) && within(row, at / width))
            }).collect();
            prop_assert_eq!(&bits, &image(width, &grown));
        }

        #[test]
        fn runs_and_bits_say_the_same(mask in prop::collection::vec(0u8..2, 1..300)) {
            let bits = image(mask.len(), &mask);
            let mut runs = Vec::new();
            bits.row_runs(0, &bits.extent(VectorPath::Portable).0, &mut runs);
            let mut again = BitImage::new(mask.len() as u32, 1);
            runs.iter().for_each(|&run| again.set_run(0, run, true));
            prop_assert_eq!(&again, &bits);
            prop_assert_eq!(bits.count(), mask.iter().map(|&pixel| u64::from(pixel)).sum::<u64>());
            prop_assert!(runs.windows(2).all(|pair| pair[0].end < pair[1].start));
            runs.iter().for_each(|&run| assert_eq!(bits.count_run(0, run), u32::from(run.end - run.start)));
            runs.iter().for_each(|&run| again.set_run(0, run, false));
            prop_assert_eq!(again.count(), 0);
        }
    }
}
