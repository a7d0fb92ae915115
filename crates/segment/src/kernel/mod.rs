//! From bytes to foreground bits: one pass over the frame, 64 pixels at a time.
//!
//! Most blocks are background, and to know it takes no colours: if every byte is within reach of the
//! model's ([`Metric::reach`]), no pixel's distance is above its low threshold. That reads the frame and
//! the model once, byte by byte, whatever the layout, and is bound by memory. The other blocks are taken apart
//! into channels and tested pixel by pixel, still in vectors.

mod path;
mod pixels;
mod test;

use std::sync::Arc;

pub(crate) use path::Work;
pub(crate) use test::{ChromaTest, DifferenceTest};

use crate::gain::Correction;
use crate::layout::Format;
use crate::metric::{Channels, Metric};
pub(crate) use pixels::BLOCK;
use pixels::{Group, Rows, lines_per_group, rows};

/// Blocks of the widest row.
const MAX_BLOCKS: usize = hull::camera::MAX_SIDE_PIXELS as usize / BLOCK;

/// The empty room as the kernels read it.
#[derive(Clone, Debug)]
pub(crate) struct Background {
    /// A frame.
    mean: Arc<[u8]>,
    /// Low thresholds, rows padded to whole blocks.
    low: Vec<u8>,
    /// What is surely background, a group of rows and a block at a time.
    reach: Vec<[u8; 2]>,
}

/// Which test a frame is put to.
#[derive(Clone, Debug)]
pub(crate) enum Test {
    Difference(DifferenceTest, Background),
    Chroma(ChromaTest),
}

impl Background {
    /// From a mean frame and the low threshold of every pixel.
    pub(crate) fn new(format: Format, mean: Arc<[u8]>, thresholds: &[u8]) -> Background {
        let blocks = format.columns().div_ceil(BLOCK);
        let lines = lines_per_group(format);
        let metric = Metric::of(format.layout());
        let reaches: Vec<[u8; 2]> = (0..=255).map(|low| metric.reach(low)).collect();
        let mut low = vec![u8::MAX; blocks * BLOCK * format.rows()];
        for (padded, row) in
            low.chunks_exact_mut(blocks * BLOCK).zip(thresholds.chunks_exact(format.columns()))
        {
            padded[..row.len()].copy_from_slice(row);
        }
        let mut reach = Vec::with_capacity(blocks * format.rows().div_ceil(lines));
        for group in low.chunks(lines * blocks * BLOCK) {
            for block in 0..blocks {
                let least = group.chunks_exact(BLOCK).skip(block).step_by(blocks).flatten().min();
                reach.push(reaches[usize::from(least.copied().unwrap_or(0))]);
            }
        }
        Background { mean, low, reach }
    }
}

/// Some groups of rows of a frame, to be tested.
pub(crate) struct Band<'a> {
    pub(crate) format: Format,
    pub(crate) bytes: &'a [u8],
    pub(crate) test: &'a Test,
    pub(crate) correction: Correction,
    /// The first group; there are as many as the words hold.
    pub(crate) first_group: usize,
    /// A bit for every pixel, rows of whole words.
    pub(crate) words: &'a mut [u64],
}

/// Splits the words of an image into about equal bands of whole groups, at most so many.
pub(crate) fn bands(
    format: Format,
    words: &mut [u64],
    count: usize,
) -> impl Iterator<Item = (usize, &mut [u64])> {
    let lines = lines_per_group(format);
    let words_per_group = lines * format.columns().div_ceil(BLOCK);
    let groups = format.rows().div_ceil(lines).div_ceil(count.max(1));
    words.chunks_mut(groups * words_per_group).enumerate().map(move |(band, words)| (band * groups, words))
}

impl Work for Band<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Band { format, bytes, test, correction, first_group, words } = self;
        let words_per_group = lines_per_group(format) * format.columns().div_ceil(BLOCK);
        for (at, words) in words.chunks_mut(words_per_group).enumerate() {
            let group = first_group + at;
            let frame = rows(format, bytes, group);
            match test {
                Test::Chroma(test) => keyed(format, frame, *test, words),
                Test::Difference(test, background) => {
                    let mean = rows(format, &background.mean, group);
                    let blocks = format.columns().div_ceil(BLOCK);
                    let part = Part {
                        last_block: last_block(format.columns()),
                        low: &background.low[group * words_per_group * BLOCK..][..words.len() * BLOCK],
                        reach: &background.reach[group * blocks..][..blocks],
                        test,
                        correction: &correction,
                    };
                    compared(&part, frame, mean, words);
                }
            }
        }
    }
}

/// What a group of rows is compared with, beside the mean.
struct Part<'a> {
    /// The pixels of a row's last block.
    last_block: u64,
    low: &'a [u8],
    reach: &'a [[u8; 2]],
    test: &'a DifferenceTest,
    correction: &'a Correction,
}

#[inline(always)]
fn compared(part: &Part, frame: Rows, mean: Rows, words: &mut [u64]) {
    match (frame, mean) {
        (Rows::Triples(frame), Rows::Triples(mean)) => part.compare(frame, mean, words),
        (Rows::Grey(frame), Rows::Grey(mean)) => part.compare(frame, mean, words),
        (Rows::Planes444(frame), Rows::Planes444(mean)) => part.compare(frame, mean, words),
        (Rows::Planes422(frame), Rows::Planes422(mean)) => part.compare(frame, mean, words),
        (Rows::Planes411(frame), Rows::Planes411(mean)) => part.compare(frame, mean, words),
        (Rows::Pairs(frame), Rows::Pairs(mean)) => part.compare(frame, mean, words),
        (Rows::LumaFirst(frame), Rows::LumaFirst(mean)) => part.compare(frame, mean, words),
        (Rows::LumaSecond(frame), Rows::LumaSecond(mean)) => part.compare(frame, mean, words),
        // Both are rows of one format.
        _ => words.fill(0),
    }
}

impl Part<'_> {
    #[inline(always)]
    fn compare<G: Group>(&self, frame: G, mean: G, words: &mut [u64]) {
        let blocks = self.reach.len();
        let metric = self.test.metric();
        let mut colour_is_calm = [false; MAX_BLOCKS];
        if self.correction.is_none() {
            for (block, (calm, &reach)) in colour_is_calm.iter_mut().zip(self.reach).enumerate() {
                *calm = frame.colour_is_calm(mean, block, reach);
            }
        }
        for (line, words) in words.chunks_exact_mut(blocks).enumerate() {
            let looked = self.reach.iter().zip(&colour_is_calm);
            for (block, (word, (&reach, &calm))) in words.iter_mut().zip(looked).enumerate() {
                if calm && frame.line_is_calm(mean, line, block, reach) {
                    *word = 0;
                    continue;
                }
                let mut channels = frame.channels(metric, line, block);
                self.correction.apply(&mut channels, metric);
                let start = (line * blocks + block) * BLOCK;
                let mut low = [0; BLOCK];
                low.copy_from_slice(&self.low[start..start + BLOCK]);
                let real = if block + 1 == blocks { self.last_block } else { u64::MAX };
                *word = real & self.test.foreground(&channels, &mean.channels(metric, line, block), &low);
            }
        }
    }
}

/// The pixels of the last block of a row.
#[inline(always)]
fn last_block(width: usize) -> u64 {
    u64::MAX >> (width.wrapping_neg() % BLOCK)
}

#[inline(always)]
fn keyed(format: Format, frame: Rows, test: ChromaTest, words: &mut [u64]) {
    let width = format.columns();
    match frame {
        Rows::Triples(rows) => key(width, rows, test, words),
        Rows::Grey(rows) => key(width, rows, test, words),
        Rows::Planes444(rows) => key(width, rows, test, words),
        Rows::Planes422(rows) => key(width, rows, test, words),
        Rows::Planes411(rows) => key(width, rows, test, words),
        Rows::Pairs(rows) => key(width, rows, test, words),
        Rows::LumaFirst(rows) => key(width, rows, test, words),
        Rows::LumaSecond(rows) => key(width, rows, test, words),
    }
}

#[inline(always)]
fn key<G: Group>(width: usize, frame: G, test: ChromaTest, words: &mut [u64]) {
    let blocks = width.div_ceil(BLOCK);
    for (line, words) in words.chunks_exact_mut(blocks).enumerate() {
        for (block, word) in words.iter_mut().enumerate() {
            *word = test.foreground(&frame.channels(test.metric(), line, block));
        }
        words[blocks - 1] &= last_block(width);
    }
}

/// The channels of one row of a frame, padded to whole blocks, in a metric of its layout.
pub(crate) fn row_channels(metric: Metric, format: Format, bytes: &[u8], row: usize, out: &mut [Channels]) {
    fn fill<G: Group>(rows: G, metric: Metric, line: usize, out: &mut [Channels]) {
        for (block, channels) in out.iter_mut().enumerate() {
            *channels = rows.channels(metric, line, block);
        }
    }
    let lines = lines_per_group(format);
    let line = row % lines;
    match rows(format, bytes, row / lines) {
        Rows::Triples(rows) => fill(rows, metric, line, out),
        Rows::Grey(rows) => fill(rows, metric, line, out),
        Rows::Planes444(rows) => fill(rows, metric, line, out),
        Rows::Planes422(rows) => fill(rows, metric, line, out),
        Rows::Planes411(rows) => fill(rows, metric, line, out),
        Rows::Pairs(rows) => fill(rows, metric, line, out),
        Rows::LumaFirst(rows) => fill(rows, metric, line, out),
        Rows::LumaSecond(rows) => fill(rows, metric, line, out),
    }
}
