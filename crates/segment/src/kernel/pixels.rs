//! The bytes of a few rows in each layout: are 64 pixels surely background, and what are their channels?
//!
//! Everything here is inlined into a caller that was compiled for some vector path.

use crate::layout::{Format, Layout, Sampling};
use crate::metric::{Channels, Metric};

/// Pixels that are looked at together: the bits of one word.
pub(crate) const BLOCK: usize = 64;

/// Rows of a frame that share their colour samples: one, or two in 4:2:0.
pub(crate) trait Group: Copy {
    /// True if the colour samples of a block are within reach of the mean's.
    fn colour_is_calm(self, mean: Self, block: usize, reach: [u8; 2]) -> bool;
    /// True if the rest of a block's bytes of one row is.
    fn line_is_calm(self, mean: Self, line: usize, block: usize, reach: [u8; 2]) -> bool;
    /// The channels of a block; beyond the row's end they are those of zero bytes.
    fn channels(self, metric: Metric, line: usize, block: usize) -> Channels;
}

/// RGB triples.
#[derive(Clone, Copy)]
pub(crate) struct Triples<'a>(&'a [u8]);

/// Brightness alone.
#[derive(Clone, Copy)]
pub(crate) struct Grey<'a>(&'a [u8]);

/// Planes; each colour sample is for `1 << ACROSS` columns.
#[derive(Clone, Copy)]
pub(crate) struct Planes<'a, const ACROSS: usize> {
    luma: [&'a [u8]; 2],
    u: &'a [u8],
    v: &'a [u8],
}

/// Brightness, and pairs of colour for two columns.
#[derive(Clone, Copy)]
pub(crate) struct Pairs<'a> {
    luma: [&'a [u8]; 2],
    pairs: &'a [u8],
}

/// Packed quadruples; brightness comes first or second.
#[derive(Clone, Copy)]
pub(crate) struct Packed<'a, const FIRST: usize>(&'a [u8]);

/// The bytes of one group of rows, in its layout.
#[derive(Clone, Copy)]
pub(crate) enum Rows<'a> {
    Triples(Triples<'a>),
    Grey(Grey<'a>),
    Planes444(Planes<'a, 0>),
    Planes422(Planes<'a, 1>),
    Planes411(Planes<'a, 2>),
    Pairs(Pairs<'a>),
    LumaFirst(Packed<'a, 0>),
    LumaSecond(Packed<'a, 1>),
}

/// Rows of a frame that share their colour samples.
pub(crate) fn lines_per_group(format: Format) -> usize {
    format.shifts().map_or(1, |(_, down)| 1 << down)
}

/// A group of rows of a frame; `bytes` must be a frame of the format. The last group may have fewer lines
/// than others: the line it lacks is empty.
pub(crate) fn rows(format: Format, bytes: &[u8], group: usize) -> Rows<'_> {
    let (first_bytes, colour_bytes) = format.plane_bytes();
    let (first, colour) = bytes.split_at(first_bytes);
    let row_bytes = format.first_row_bytes();
    let first_row = |row: usize| first.get(row * row_bytes..(row + 1) * row_bytes).unwrap_or_default();
    let across = format.shifts().map_or(0, |(across, _)| across);
    let samples = format.columns().div_ceil(1 << across);
    let (u, v) = colour.split_at(colour_bytes);
    let sample_row = |plane: &'_ [u8]| -> std::ops::Range<usize> {
        let start = (group * samples).min(plane.len());
        start..(start + samples).min(plane.len())
    };
    let lines = lines_per_group(format);
    let luma = [first_row(group * lines), if lines == 2 { first_row(2 * group + 1) } else { &[] }];
    match format.layout() {
        Layout::Rgb => Rows::Triples(Triples(luma[0])),
        Layout::Planar(Sampling::Mono, _) => Rows::Grey(Grey(luma[0])),
        Layout::Planar(sampling, _) => {
            let (u, v) = (&u[sample_row(u)], &v[sample_row(v)]);
            match sampling {
                Sampling::C444 => Rows::Planes444(Planes { luma, u, v }),
                Sampling::C411 => Rows::Planes411(Planes { luma, u, v }),
                _ => Rows::Planes422(Planes { luma, u, v }),
            }
        }
        Layout::Nv12(_) => {
            let start = 2 * group * samples;
            Rows::Pairs(Pairs { luma, pairs: &colour[start..start + 2 * samples] })
        }
        Layout::Yuyv(_) => Rows::LumaFirst(Packed(luma[0])),
        Layout::Uyvy(_) => Rows::LumaSecond(Packed(luma[0])),
    }
}

impl Group for Triples<'_> {
    #[inline(always)]
    fn colour_is_calm(self, _: Self, _: usize, _: [u8; 2]) -> bool {
        true
    }

    #[inline(always)]
    fn line_is_calm(self, mean: Self, _: usize, block: usize, reach: [u8; 2]) -> bool {
        is_calm::<{ 3 * BLOCK }>(self.0, mean.0, block, [reach[0]; 2])
    }

    #[inline(always)]
    fn channels(self, _: Metric, _: usize, block: usize) -> Channels {
        let bytes = chunk::<{ 3 * BLOCK }>(self.0, block);
        let mut channels = [[0; BLOCK]; 3];
        for lane in 0..BLOCK {
            channels[0][lane] = i16::from(bytes[3 * lane]);
            channels[1][lane] = i16::from(bytes[3 * lane + 1]);
            channels[2][lane] = i16::from(bytes[3 * lane + 2]);
        }
        channels
    }
}

impl Group for Grey<'_> {
    #[inline(always)]
    fn colour_is_calm(self, _: Self, _: usize, _: [u8; 2]) -> bool {
        true
    }

    #[inline(always)]
    fn line_is_calm(self, mean: Self, _: usize, block: usize, reach: [u8; 2]) -> bool {
        is_calm::<BLOCK>(self.0, mean.0, block, [reach[0]; 2])
    }

    #[inline(always)]
    fn channels(self, metric: Metric, _: usize, block: usize) -> Channels {
        let grey = [128; BLOCK];
        mixed(metric, chunk::<BLOCK>(self.0, block), grey, grey)
    }
}

impl<const ACROSS: usize> Group for Planes<'_, ACROSS> {
    #[inline(always)]
    fn colour_is_calm(self, mean: Self, block: usize, reach: [u8; 2]) -> bool {
        let reach = [reach[1]; 2];
        match ACROSS {
            0 => {
                is_calm::<BLOCK>(self.u, mean.u, block, reach)
                    && is_calm::<BLOCK>(self.v, mean.v, block, reach)
            }
            1 => is_calm::<32>(self.u, mean.u, block, reach) && is_calm::<32>(self.v, mean.v, block, reach),
            _ => is_calm::<16>(self.u, mean.u, block, reach) && is_calm::<16>(self.v, mean.v, block, reach),
        }
    }

    #[inline(always)]
    fn line_is_calm(self, mean: Self, line: usize, block: usize, reach: [u8; 2]) -> bool {
        is_calm::<BLOCK>(self.luma[line], mean.luma[line], block, [reach[0]; 2])
    }

    #[inline(always)]
    fn channels(self, metric: Metric, line: usize, block: usize) -> Channels {
        let (u, v) = match ACROSS {
            0 => (chunk::<BLOCK>(self.u, block), chunk::<BLOCK>(self.v, block)),
            1 => (twice(chunk(self.u, block)), twice(chunk(self.v, block))),
            _ => (four_times(chunk(self.u, block)), four_times(chunk(self.v, block))),
        };
        mixed(metric, chunk::<BLOCK>(self.luma[line], block), u, v)
    }
}

impl Group for Pairs<'_> {
    #[inline(always)]
    fn colour_is_calm(self, mean: Self, block: usize, reach: [u8; 2]) -> bool {
        is_calm::<BLOCK>(self.pairs, mean.pairs, block, [reach[1]; 2])
    }

    #[inline(always)]
    fn line_is_calm(self, mean: Self, line: usize, block: usize, reach: [u8; 2]) -> bool {
        is_calm::<BLOCK>(self.luma[line], mean.luma[line], block, [reach[0]; 2])
    }

    #[inline(always)]
    fn channels(self, metric: Metric, line: usize, block: usize) -> Channels {
        let (u, v) = apart(chunk(self.pairs, block));
        mixed(metric, chunk::<BLOCK>(self.luma[line], block), u, v)
    }
}

impl<const FIRST: usize> Group for Packed<'_, FIRST> {
    #[inline(always)]
    fn colour_is_calm(self, _: Self, _: usize, _: [u8; 2]) -> bool {
        true
    }

    #[inline(always)]
    fn line_is_calm(self, mean: Self, _: usize, block: usize, [first, others]: [u8; 2]) -> bool {
        let reach = if FIRST == 0 { [first, others] } else { [others, first] };
        is_calm::<{ 2 * BLOCK }>(self.0, mean.0, block, reach)
    }

    #[inline(always)]
    fn channels(self, metric: Metric, _: usize, block: usize) -> Channels {
        let bytes = chunk::<{ 2 * BLOCK }>(self.0, block);
        let (mut luma, mut pairs) = ([0; BLOCK], [0; BLOCK]);
        for ((luma, colour), two) in luma.iter_mut().zip(&mut pairs).zip(bytes.as_chunks::<2>().0) {
            (*luma, *colour) = (two[FIRST], two[1 - FIRST]);
        }
        let (u, v) = apart(pairs);
        mixed(metric, luma, u, v)
    }
}

/// Are all bytes of a block within reach of the mean's? Even bytes have the first reach, odd ones the other.
#[inline(always)]
fn is_calm<const BYTES: usize>(row: &[u8], mean: &[u8], block: usize, reach: [u8; 2]) -> bool {
    let at = block * BYTES;
    let (row, mean) = (row.get(at..).unwrap_or_default(), mean.get(at..).unwrap_or_default());
    match (row.first_chunk::<BYTES>(), mean.first_chunk::<BYTES>()) {
        (Some(row), Some(mean)) if BYTES < BLOCK => excess(row, mean, reach) == [0; BYTES],
        (Some(row), Some(mean)) => {
            let parts = row.as_chunks::<BLOCK>().0.iter().zip(mean.as_chunks::<BLOCK>().0);
            let mut any = [0; BLOCK];
            for (row, mean) in parts {
                let part = excess(row, mean, reach);
                any.iter_mut().zip(part).for_each(|(any, part)| *any |= part);
            }
            any == [0; BLOCK]
        }
        // The end of a row.
        _ => row.iter().zip(mean).enumerate().all(|(at, (row, mean))| row.abs_diff(*mean) <= reach[at % 2]),
    }
}

/// How far each byte is beyond its reach.
#[inline(always)]
fn excess<const BYTES: usize>(row: &[u8; BYTES], mean: &[u8; BYTES], reach: [u8; 2]) -> [u8; BYTES] {
    let pattern = [reach; BLOCK / 2];
    let pattern = pattern.as_flattened();
    let mut excess = [0; BYTES];
    for (lane, excess) in excess.iter_mut().enumerate() {
        *excess = row[lane].abs_diff(mean[lane]).saturating_sub(pattern[lane]);
    }
    excess
}

/// The bytes of a block, zero beyond the row's end.
#[inline(always)]
fn chunk<const BYTES: usize>(row: &[u8], block: usize) -> [u8; BYTES] {
    let mut bytes = [0; BYTES];
    let at = (block * BYTES).min(row.len());
    let rest = &row[at..];
    if let Some(whole) = rest.get(..BYTES) {
        bytes.copy_from_slice(whole);
    } else {
        bytes[..rest.len()].copy_from_slice(rest);
    }
    bytes
}

/// Each sample for two columns; multiplications, because compilers see vectors in them.
#[inline(always)]
fn twice(samples: [u8; BLOCK / 2]) -> [u8; BLOCK] {
    let mut out = [0; BLOCK];
    for (two, sample) in out.as_chunks_mut().0.iter_mut().zip(samples) {
        *two = (u16::from(sample) * 0x101).to_le_bytes();
    }
    out
}

/// Each sample for four columns.
#[inline(always)]
fn four_times(samples: [u8; BLOCK / 4]) -> [u8; BLOCK] {
    let mut out = [0; BLOCK];
    for (four, sample) in out.as_chunks_mut().0.iter_mut().zip(samples) {
        *four = (u32::from(sample) * 0x0101_0101).to_le_bytes();
    }
    out
}

/// Pairs for two columns, taken apart.
#[inline(always)]
fn apart(pairs: [u8; BLOCK]) -> ([u8; BLOCK], [u8; BLOCK]) {
    let (mut u, mut v) = ([0; BLOCK], [0; BLOCK]);
    let out = u.as_chunks_mut().0.iter_mut().zip(v.as_chunks_mut().0);
    for ((u, v), &pair) in out.zip(pairs.as_chunks().0) {
        let pair = u16::from_le_bytes(pair);
        *u = ((pair & 0xff) * 0x101).to_le_bytes();
        *v = ((pair >> 8) * 0x101).to_le_bytes();
    }
    (u, v)
}

#[inline(always)]
fn mixed(metric: Metric, luma: [u8; BLOCK], u: [u8; BLOCK], v: [u8; BLOCK]) -> Channels {
    let mut channels = [[0; BLOCK]; 3];
    for lane in 0..BLOCK {
        let [grey, u, v] = metric.channels([luma[lane], u[lane], v[lane]]);
        channels[0][lane] = grey;
        channels[1][lane] = u;
        channels[2][lane] = v;
    }
    channels
}
