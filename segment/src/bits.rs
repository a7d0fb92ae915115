//! One bit per pixel, and the openings and closings done on it 64 pixels at a time.

use hull::silhouette::Run;

/// An image of bits, rows padded to whole words; padding bits are never set.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct BitImage {
    width: usize,
    words_per_row: usize,
    words: Vec<u64>,
}

impl BitImage {
    /// All pixels unset.
    pub(crate) fn new(width: u32, height: u32) -> BitImage {
        let words_per_row = (width as usize).div_ceil(64);
        BitImage { width: width as usize, words_per_row, words: vec![0; words_per_row * height as usize] }
    }

    /// Replaces a row by its pixels, one byte each, 0 or 1.
    pub(crate) fn set_row(&mut self, row: usize, pixels: &[u8]) {
        debug_assert_eq!(pixels.len(), self.width);
        let words = &mut self.words[row * self.words_per_row..][..self.words_per_row];
        for (word, pixels) in words.iter_mut().zip(pixels.chunks(64)) {
            *word = 0;
            for (byte, eight) in pixels.chunks(8).enumerate() {
                let mut lanes = [0; 8];
                lanes[..eight.len()].copy_from_slice(eight);
                // The multiplication gathers the low bit of each byte in the top byte.
                let bits = u64::from_le_bytes(lanes).wrapping_mul(0x0102_0408_1020_4080) >> 56;
                *word |= bits << (8 * byte);
            }
        }
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

    /// Clears every pixel that is set in `other`, of the same size.
    pub(crate) fn clear_where(&mut self, other: &BitImage) {
        for (word, other) in self.words.iter_mut().zip(&other.words) {
            *word &= !other;
        }
    }

    /// Flips every pixel.
    pub(crate) fn invert(&mut self) {
        for word in &mut self.words {
            *word = !*word;
        }
        self.clear_padding();
    }

    fn clear_padding(&mut self) {
        let used = self.width % 64;
        if used == 0 {
            return;
        }
        for row in self.words.chunks_exact_mut(self.words_per_row) {
            row[self.words_per_row - 1] &= (1 << used) - 1;
        }
    }

    /// Takes over the pixels of an image of the same size.
    pub(crate) fn copy_from(&mut self, other: &BitImage) {
        self.words.copy_from_slice(&other.words);
    }

    /// Grows every pixel to a square of `side` pixels, down and to the right.
    pub(crate) fn grow(&mut self, side: usize) {
        self.dilate(side);
        self.clear_padding();
    }

    /// Number of pixels set.
    pub(crate) fn count(&self) -> u64 {
        self.words.iter().map(|word| u64::from(word.count_ones())).sum()
    }

    /// Appends the runs of a row, left to right.
    pub(crate) fn row_runs(&self, row: usize, runs: &mut Vec<Run>) {
        let words = &self.words[row * self.words_per_row..][..self.words_per_row];
        let mut open: Option<u16> = None;
        for (at, &word) in words.iter().enumerate() {
            // Images are at most 65,535 pixels wide, so columns fit.
            let base = 64 * at;
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
            runs.push(Run { start, end: self.width as u16 });
        }
    }

    /// Keeps what squares of `side` pixels, wholly on the image, can cover.
    pub(crate) fn open(&mut self, side: usize) {
        if side > 1 {
            self.erode(side);
            self.dilate(side);
        }
    }

    /// Fills what squares of `side` background pixels, wholly on the image, cannot cover.
    pub(crate) fn close(&mut self, side: usize) {
        if side > 1 {
            self.invert();
            self.open(side);
            self.invert();
        }
    }

    /// A pixel stays if the square that begins at it (to the right and below) is set.
    fn erode(&mut self, side: usize) {
        for row in self.words.chunks_exact_mut(self.words_per_row) {
            for shift in doubling(side) {
                for at in 0..row.len() {
                    row[at] &= bits_after(row, at, shift);
                }
            }
        }
        for shift in doubling(side) {
            let ahead = shift * self.words_per_row;
            let end = self.words.len().saturating_sub(ahead);
            for at in 0..end {
                self.words[at] &= self.words[at + ahead];
            }
            self.words[end..].fill(0);
        }
    }

    /// A pixel sets the square that begins at it.
    fn dilate(&mut self, side: usize) {
        for row in self.words.chunks_exact_mut(self.words_per_row) {
            for shift in doubling(side) {
                for at in (0..row.len()).rev() {
                    row[at] |= bits_before(row, at, shift);
                }
            }
        }
        for shift in doubling(side) {
            let behind = shift * self.words_per_row;
            for at in (behind..self.words.len()).rev() {
                self.words[at] |= self.words[at - behind];
            }
        }
    }
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

/// Shifts that, one after the other, spread over `side` neighbours: 1, 2, 4, …, and the rest.
fn doubling(side: usize) -> impl Iterator<Item = usize> {
    let mut covered = 1;
    std::iter::from_fn(move || {
        let shift = covered.min(side - covered);
        covered += shift;
        (shift > 0).then_some(shift)
    })
}

/// The word whose bit 0 is `shift` pixels after bit 0 of word `at`.
fn bits_after(row: &[u64], at: usize, shift: usize) -> u64 {
    let (words, bits) = (shift / 64, shift % 64);
    let get = |at: usize| row.get(at).copied().unwrap_or(0);
    let low = get(at + words) >> bits;
    if bits == 0 { low } else { low | get(at + words + 1) << (64 - bits) }
}

/// The word whose bit 0 is `shift` pixels before bit 0 of word `at`.
fn bits_before(row: &[u64], at: usize, shift: usize) -> u64 {
    let (words, bits) = (shift / 64, shift % 64);
    let get = |back: usize| at.checked_sub(back).map_or(0, |at| row[at]);
    let high = get(words) << bits;
    if bits == 0 { high } else { high | get(words + 1) >> (64 - bits) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn image(width: usize, mask: &[u8]) -> BitImage {
        let mut image = BitImage::new(width as u32, (mask.len() / width) as u32);
        mask.chunks(width).enumerate().for_each(|(row, pixels)| image.set_row(row, pixels));
        image
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

    proptest! {
        #[test]
        fn opening_is_the_union_of_squares_and_closing_its_mirror(
            width in 1usize..150, height in 1usize..20, side in 1usize..9, seed in any::<u64>(),
        ) {
            let mut state = seed | 1;
            let mask: Vec<u8> = (0..width * height).map(|_| {
                state ^= state << 13;
                state ^= state >> 7;
                state ^= state << 17;
                u8::from(!state.is_multiple_of(4))
            }).collect();
            let mut bits = image(width, &mask);
            bits.open(side);
            prop_assert_eq!(&bits, &image(width, &opened(width, &mask, side)));
            let inverse: Vec<u8> = mask.iter().map(|&pixel| 1 - pixel).collect();
            let closed: Vec<u8> = opened(width, &inverse, side).iter().map(|&pixel| 1 - pixel).collect();
            let mut bits = image(width, &inverse);
            bits.invert();
            bits.close(side);
            prop_assert_eq!(&bits, &image(width, &closed));
        }

        #[test]
        fn runs_and_bits_say_the_same(mask in prop::collection::vec(0u8..2, 1..300)) {
            let bits = image(mask.len(), &mask);
            let mut runs = Vec::new();
            bits.row_runs(0, &mut runs);
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
