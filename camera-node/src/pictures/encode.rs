//! Colours to JPEGs. Pure: a part of a frame and a silhouette in, bytes out.
//!
//! A crop shows the foreground without its outermost pixels, which are mixed with what is behind; its colours
//! are spread a little way outwards, so that a viewer that samples at the very edge finds no fringe, and the rest
//! is their mean, which costs next to nothing.

use hull::Silhouette;
use hull::silhouette::PixelRect;
use jpeg_encoder::{ColorType, Encoder, SamplingFactor};
use segment::{CROP_GRID, to_rgb};

use super::colour_ring::Colour;

/// How far the foreground's colours are spread, pixels of the camera.
const SPREAD_PIXELS: u32 = 8;
/// Spread at least, pixels of the JPEG: a colour sample is two of them wide.
const LEAST_SPREAD: u8 = 2;
/// Sides of crops are multiples of this many pixels of the JPEG: its blocks.
const BLOCK_PIXELS: u32 = 8;

/// A JPEG and what it shows.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct EncodedImage {
    /// Left, top, width and height in the camera's own pixels.
    pub crop: [u32; 4],
    pub jpeg: Vec<u8>,
}

/// The whole image; `None` if only a part was kept.
pub(super) fn whole(colour: &Colour, scale_log2: u32, quality: u8) -> Option<EncodedImage> {
    if !colour.is_whole {
        return None;
    }
    let (width, height) = (colour.format.width(), colour.format.height());
    let mut rgb = Vec::new();
    to_rgb(&colour.bytes, colour.format, &mut rgb);
    let mut cells = Cells::new(width, height, scale_log2);
    for row in 0..height {
        cells.add(row, 0, &rgb[3 * (row * width) as usize..3 * ((row + 1) * width) as usize]);
    }
    Some(EncodedImage { crop: [0, 0, width, height], jpeg: cells.into_rgb().jpeg(quality)? })
}

/// The foreground; `None` if there is none, or its colours were not kept.
pub(super) fn crop(
    colour: &Colour,
    silhouette: &Silhouette,
    scale_log2: u32,
    quality: u8,
) -> Option<EncodedImage> {
    let bounds = silhouette.bounds()?;
    let (rgb, shown) = foreground_rgb(colour, bounds)?;
    let [left, top, width, height] = aligned(bounds, (silhouette.width(), silhouette.height()), scale_log2);
    let mut cells = Cells::new(width, height, scale_log2);
    let mut erosion = Erosion::default();
    for is_eroded in [true, false] {
        for row in bounds.top..bounds.bottom {
            let runs = if is_eroded { erosion.row(silhouette, row) } else { erosion.plain(silhouette, row) };
            for &(start, end) in runs {
                let at =
                    |column: u32| 3 * ((row - shown.top) * (shown.right - shown.left) + column - shown.left);
                cells.add(row - top, start - left, &rgb[at(start) as usize..at(end) as usize]);
            }
        }
        // A foreground that is nowhere three pixels wide is shown as it is.
        if cells.has_any() {
            break;
        }
    }
    cells.average();
    cells.spread(((SPREAD_PIXELS >> scale_log2) as u8).max(LEAST_SPREAD));
    Some(EncodedImage { crop: [left, top, width, height], jpeg: cells.into_filled().jpeg(quality)? })
}

/// The bounds as RGB, and where that lies; `None` if they were not kept.
fn foreground_rgb(colour: &Colour, bounds: PixelRect) -> Option<(Vec<u8>, PixelRect)> {
    let relative = |side: u32, begin: u32| side.checked_sub(begin);
    let left = relative(bounds.left, colour.left)? / CROP_GRID * CROP_GRID;
    let top = relative(bounds.top, colour.top)? / CROP_GRID * CROP_GRID;
    let (right, bottom) = (relative(bounds.right, colour.left)?, relative(bounds.bottom, colour.top)?);
    if right > colour.format.width() || bottom > colour.format.height() {
        return None;
    }
    let (mut part, mut rgb) = (Vec::new(), Vec::new());
    let format = colour.format.crop(&colour.bytes, [left, top, right - left, bottom - top], &mut part);
    to_rgb(&part, format, &mut rgb);
    let shown = PixelRect {
        left: colour.left + left,
        top: colour.top + top,
        right: colour.left + right,
        bottom: colour.top + bottom,
    };
    Some((rgb, shown))
}

/// The bounds with room for what is spread, in whole blocks of the JPEG where the image does not end before:
/// left, top, width, height.
fn aligned(bounds: PixelRect, (width, height): (u32, u32), scale_log2: u32) -> [u32; 4] {
    let block = BLOCK_PIXELS << scale_log2;
    let begin = |side: u32| side.saturating_sub(SPREAD_PIXELS) / block * block;
    let end = |side: u32, most: u32| (side + SPREAD_PIXELS).next_multiple_of(block).min(most);
    let (left, top) = (begin(bounds.left), begin(bounds.top));
    [left, top, end(bounds.right, width) - left, end(bounds.bottom, height) - top]
}

/// A silhouette's rows without their outermost pixels.
#[derive(Default)]
struct Erosion {
    runs: Vec<(u32, u32)>,
    other: Vec<(u32, u32)>,
}

impl Erosion {
    fn plain(&mut self, silhouette: &Silhouette, row: u32) -> &[(u32, u32)] {
        self.runs.clear();
        self.runs.extend(silhouette.row(row).iter().map(|run| (u32::from(run.start), u32::from(run.end))));
        &self.runs
    }

    /// Pixels whose four neighbours are foreground; beyond the image all is.
    fn row(&mut self, silhouette: &Silhouette, row: u32) -> &[(u32, u32)] {
        let width = silhouette.width();
        let narrowed = |(start, end): (u32, u32)| {
            let start = if start == 0 { 0 } else { start + 1 };
            let end = if end == width { end } else { end - 1 };
            (start < end).then_some((start, end))
        };
        let runs = silhouette.row(row).iter().map(|run| (u32::from(run.start), u32::from(run.end)));
        self.runs.clear();
        self.runs.extend(runs.filter_map(narrowed));
        let below = (row + 1 < silhouette.height()).then_some(row + 1);
        for neighbour in [row.checked_sub(1), below].into_iter().flatten() {
            self.other.clear();
            let mut theirs = silhouette.row(neighbour).iter().peekable();
            for &(start, end) in &self.runs {
                while let Some(run) = theirs.peek() {
                    let both = (start.max(u32::from(run.start)), end.min(u32::from(run.end)));
                    if both.0 < both.1 {
                        self.other.push(both);
                    }
                    if u32::from(run.end) >= end {
                        break;
                    }
                    theirs.next();
                }
            }
            std::mem::swap(&mut self.runs, &mut self.other);
        }
        &self.runs
    }
}

/// Pixels of a JPEG in the making: sums of the camera's pixels that each holds.
struct Cells {
    scale_log2: u32,
    width: usize,
    height: usize,
    sums: Vec<[u32; 3]>,
    counts: Vec<u32>,
    /// Cells from the nearest that has a colour of its own; [`FAR`] if there is none near.
    distance: Vec<u8>,
}

const FAR: u8 = u8::MAX;

/// Red, green, blue.
struct Rgb {
    width: usize,
    height: usize,
    bytes: Vec<u8>,
}

impl Cells {
    fn new(width: u32, height: u32, scale_log2: u32) -> Cells {
        let side = |pixels: u32| pixels.div_ceil(1 << scale_log2) as usize;
        let (width, height) = (side(width), side(height));
        Cells {
            scale_log2,
            width,
            height,
            sums: vec![[0; 3]; width * height],
            counts: vec![0; width * height],
            distance: Vec::new(),
        }
    }

    /// Adds pixels of a row from a column on.
    fn add(&mut self, row: u32, column: u32, rgb: &[u8]) {
        let first = (row >> self.scale_log2) as usize * self.width;
        for (column, pixel) in (column..).zip(rgb.chunks_exact(3)) {
            let cell = first + (column >> self.scale_log2) as usize;
            for (sum, &level) in self.sums[cell].iter_mut().zip(pixel) {
                *sum += u32::from(level);
            }
            self.counts[cell] += 1;
        }
    }

    fn has_any(&self) -> bool {
        self.counts.iter().any(|&count| count > 0)
    }

    /// Sums to colours.
    fn average(&mut self) {
        for (sum, &count) in self.sums.iter_mut().zip(&self.counts) {
            if count > 1 {
                *sum = sum.map(|level| (level + count / 2) / count);
            }
        }
    }

    /// Gives cells without a colour that of one near: along rows, then along columns.
    fn spread(&mut self, reach: u8) {
        self.distance = self.counts.iter().map(|&count| if count > 0 { 0 } else { FAR }).collect();
        let (width, height) = (self.width, self.height);
        for row in 0..height {
            let first = row * width;
            (first + 1..first + width).for_each(|cell| self.take_over(cell - 1, cell, reach));
            (first..first + width - 1).rev().for_each(|cell| self.take_over(cell + 1, cell, reach));
        }
        (width..width * height).for_each(|cell| self.take_over(cell - width, cell, reach));
        (0..width * (height - 1)).rev().for_each(|cell| self.take_over(cell + width, cell, reach));
    }

    fn take_over(&mut self, from: usize, cell: usize, reach: u8) {
        let distance = self.distance[from];
        if distance < reach && distance + 1 < self.distance[cell] {
            self.distance[cell] = distance + 1;
            self.sums[cell] = self.sums[from];
        }
    }

    /// What no colour has reached is the mean of those that cells have of their own.
    fn into_filled(mut self) -> Rgb {
        let (mut total, mut count) = ([0u64; 3], 0u64);
        for (colour, _) in self.sums.iter().zip(&self.distance).filter(|(_, distance)| **distance == 0) {
            total.iter_mut().zip(colour).for_each(|(total, &level)| *total += u64::from(level));
            count += 1;
        }
        let mean = total.map(|total| (total / count.max(1)) as u32);
        for (colour, _) in self.sums.iter_mut().zip(&self.distance).filter(|(_, distance)| **distance == FAR)
        {
            *colour = mean;
        }
        self.colours()
    }

    /// Every cell has a colour.
    fn into_rgb(mut self) -> Rgb {
        self.average();
        self.colours()
    }

    fn colours(self) -> Rgb {
        let bytes = self.sums.iter().flat_map(|colour| colour.map(|level| level.min(255) as u8)).collect();
        Rgb { width: self.width, height: self.height, bytes }
    }
}

impl Rgb {
    fn jpeg(&self, quality: u8) -> Option<Vec<u8>> {
        let mut jpeg = Vec::with_capacity(self.bytes.len() / 8 + 1024);
        let mut encoder = Encoder::new(&mut jpeg, quality);
        encoder.set_sampling_factor(SamplingFactor::F_2_2);
        let encoded = encoder.encode(&self.bytes, self.width as u16, self.height as u16, ColorType::Rgb);
        // Sides are at most 16,384 pixels and the bytes as many as they make: nothing can be wrong.
        encoded.inspect_err(|error| tracing::error!("no JPEG: {error}")).ok()?;
        Some(jpeg)
    }
}
