//! Which grey values are foreground.

use super::error::Found;
use super::{Foreground, MaskError, Sample};

/// Pixels that are compared at once.
const BLOCK: usize = 64;
/// An edge has more values than that up to half, and more over it.
const LEAST_OF_AN_EDGE: usize = 4;
/// Up to so many different values an image may consist of labels.
const MOST_LABELS: usize = 64;
/// Flat regions between background and foreground that fill this share of a soft mask are further labels.
const LABEL_SHARE: usize = 50;
/// Background of many greys is mostly within this share of all values from 0, and foreground from the largest one: as
/// video of limited range (16 to 235) is, and pictures of a bright wall are not.
const EXTREME_SHARE: u32 = 8;

/// What is farther than one of so many parts of the way from background and from foreground is in doubt.
const DOUBTFUL_MARGIN: u32 = 8;
/// Of a mask less than one of so many parts of the foreground is in doubt, edges apart: limbs that moved fast.
const DOUBTFUL_SHARE: usize = 10;
/// Fewer pixels in doubt than one of so many are no clothes.
const LEAST_DOUBTFUL: usize = 500;
/// The half of a soft edge is at most one of so many parts of the image's width, or so many pixels.
const EDGE_SHARE: usize = 40;
const LEAST_EDGE_PIXELS: usize = 8;

/// Background, shadow and foreground of background subtraction.
const SHADOWS: [u32; 3] = [0, 127, 255];

/// Refuses alpha of three values as flat regions: what is half transparent is no shadow.
pub(super) fn check_half_transparent<S: Sample>(alpha: &[S]) -> Result<(), MaskError> {
    let has_others = alpha.iter().any(|&value| !SHADOWS.contains(&value.into()));
    let has_all = || SHADOWS.iter().all(|shadow| alpha.iter().any(|&value| value.into() == *shadow));
    if has_others || !has_all() { Ok(()) } else { Err(MaskError::Labels(Found::new(SHADOWS))) }
}

/// The value from which on pixels are foreground, and what foreground of the film is if this mask tells. It is `known` if
/// a mask before has told.
pub(super) fn threshold<S: Sample>(
    values: &[S],
    width: usize,
    is_lossy: bool,
    known: Option<Foreground>,
) -> Result<(S, Option<Foreground>), MaskError> {
    let max: u32 = S::MAX.into();
    let is_dim = |value: u32| value <= noise(max) && is_scattered(values, width);
    let is_shadow = |value: u32| max == 255 && value == SHADOWS[1];
    let background = Ok((S::of(max / 2 + 1), None));
    match (known, threshold_of_one(values, width, is_lossy)) {
        // Noise, a shadow without a person, and soft edges at the image's border.
        (Some(Foreground::OverHalf), Ok((_, Some(Foreground::Value(value)))))
            if is_shadow(value) || is_dim(value) =>
        {
            background
        }
        (Some(Foreground::OverHalf), Err(MaskError::OneSide { are_dark: true, .. }))
            if is_scattered(values, width) =>
        {
            background
        }
        // Neither tells what foreground of a film is.
        (None, Ok((from, Some(Foreground::Value(value))))) if is_shadow(value) || is_dim(value) => {
            Ok((from, None))
        }
        (Some(Foreground::Value(before)), Err(MaskError::ConstantGrey { value, .. })) if value == before => {
            Ok((S::of(1), None))
        }
        (Some(before), Ok((_, Some(found)))) if found != before => {
            Err(MaskError::OtherForeground { found, before })
        }
        (_, found) => found,
    }
}

/// The same of a mask by itself. All background says nothing about foreground.
fn threshold_of_one<S: Sample>(
    values: &[S],
    width: usize,
    is_lossy: bool,
) -> Result<(S, Option<Foreground>), MaskError> {
    let max: u32 = S::MAX.into();
    let counts = histogram(values);
    let present: Vec<u32> = (0..=max).filter(|&value| counts[value as usize] > 0).collect();
    let (least, most) = (present[0], present[present.len() - 1]);
    let half = max / 2;
    let over_half = (S::of(half + 1), Some(Foreground::OverHalf));
    match present[..] {
        [0] => Ok((S::of(1), None)),
        [value] if value == max => Ok(over_half),
        [value] => Err(MaskError::ConstantGrey { value, max }),
        // A lossy format makes such a pair of noise.
        [0, value] if !is_lossy && value <= half => Ok((S::of(1), Some(Foreground::Value(value)))),
        _ if most == max && least >= max - noise(max) => Ok(over_half),
        _ if most <= half || least > half => {
            Err(MaskError::OneSide { found: Found::new(present), half, are_dark: most <= half })
        }
        [_, _] => Ok(over_half),
        // Background subtraction of OpenCV marks the shadow of a person as 127.
        _ if present == SHADOWS && max == 255 && !is_lossy => Ok(over_half),
        _ => Greys::new(&counts, present, is_lossy).check(values, width).map(|()| over_half),
    }
}

/// Whether few of the pixels that are not 0 are inside a flat region.
fn is_scattered<S: Sample>(values: &[S], width: usize) -> bool {
    let (mut flat, mut count) = (0, 0);
    for (index, _) in values.iter().enumerate().filter(|&(_, &value)| value.into() > 0) {
        count += 1;
        flat += usize::from(is_interior(values, width, index));
    }
    4 * flat <= count
}

/// How far from the largest value, or from 0, a value is the same with noise.
pub(super) fn noise(max: u32) -> u32 {
    max / 32
}

/// How many pixels have each value. Masks consist of long runs: most blocks are of one value.
fn histogram<S: Sample>(values: &[S]) -> Vec<usize> {
    let mut counts = vec![0; S::MAX.into() as usize + 1];
    for block in values.chunks(BLOCK) {
        if is_uniform(block) {
            counts[block[0].into() as usize] += block.len();
        } else {
            block.iter().for_each(|&value| counts[value.into() as usize] += 1);
        }
    }
    counts
}

/// Whether all values are the same; without a branch a value, so that it is compiled to vector instructions.
fn is_uniform<S: Sample>(block: &[S]) -> bool {
    block.iter().fold(true, |is_uniform, &value| is_uniform & (value == block[0]))
}

/// Three or more values on both sides of half.
struct Greys<'a> {
    /// How many pixels have each value.
    counts: &'a [usize],
    present: Vec<u32>,
    /// The most common values up to half and over it.
    low: u32,
    high: u32,
    /// What is no farther from one of these is the same with noise.
    noise: u32,
    /// Lossless, and of few values.
    has_few_values: bool,
    may_be_labels: bool,
}

impl Greys<'_> {
    fn new(counts: &[usize], present: Vec<u32>, is_lossy: bool) -> Greys<'_> {
        let max = counts.len() as u32 - 1;
        let half = max / 2;
        let most_common = |from: u32, to: u32| (from..=to).max_by_key(|&value| counts[value as usize]);
        let (low, high) = (most_common(0, half).unwrap_or(0), most_common(half + 1, max).unwrap_or(max));
        let noise = noise(max);
        // Labels are small numbers, beside which 255 stands alone. Noise is at both extremes, and edges have values
        // on both sides of half.
        let is_noisy = present.iter().any(|&value| value != high && value.abs_diff(high) <= noise);
        let dark = present.iter().filter(|&&value| value <= half).count();
        let has_edges = dark > LEAST_OF_AN_EDGE && present.len() - dark > LEAST_OF_AN_EDGE;
        let has_few_values = !is_lossy && present.len() <= MOST_LABELS;
        let may_be_labels = has_few_values && !is_noisy && !has_edges;
        let noise = if may_be_labels { 0 } else { noise };
        Greys { counts, present, low, high, noise, has_few_values, may_be_labels }
    }

    /// Refuses labels and pictures. Of a mask, what lies between background and foreground is the slope of an edge.
    fn check<S: Sample>(&self, values: &[S], width: usize) -> Result<(), MaskError> {
        let (mut between, mut interior) = (0, 0);
        let mut flat_counts = vec![0; self.counts.len()];
        let is_between = |value: S| {
            let grey: u32 = value.into();
            grey.abs_diff(self.low) > self.noise && grey.abs_diff(self.high) > self.noise
        };
        for (block, from) in values.chunks(BLOCK).zip((0..).step_by(BLOCK)) {
            if is_uniform(block) && !is_between(block[0]) {
                continue;
            }
            for (index, &value) in (from..).zip(block).filter(|(_, value)| is_between(**value)) {
                between += 1;
                interior += usize::from(is_interior(values, width, index));
                flat_counts[value.into() as usize] += usize::from(!is_on_a_slope(values, width, index));
            }
        }
        let is_label =
            |(&flat, &count): (&usize, &usize)| flat * LABEL_SHARE >= values.len() && 2 * flat > count;
        let flat: usize = flat_counts.iter().sum();
        let has_small_labels = self.has_few_values && interior * LABEL_SHARE >= values.len();
        let has_label = has_small_labels || flat_counts.iter().zip(self.counts).any(is_label);
        let labels = || Err(MaskError::Labels(Found::new(&self.present)));
        if self.may_be_labels && 2 * flat > between {
            return labels();
        }
        if 2 * between > values.len() {
            let between_percent = (100 * between / values.len()) as u32;
            return Err(MaskError::Picture { between_percent, low: self.low, high: self.high });
        }
        if has_label {
            return labels();
        }
        self.check_doubtful(values, width)?;
        let max = self.counts.len() as u32 - 1;
        let most = max / EXTREME_SHARE;
        if self.low > most || self.high < max - most {
            return Err(MaskError::Peaks { low: self.low, high: self.high, max });
        }
        Ok(())
    }
}

impl Greys<'_> {
    /// Refuses a person cut out in grey, whose dark clothes would be background. A soft edge lies between background and
    /// foreground: both are near each of its pixels.
    fn check_doubtful<S: Sample>(&self, values: &[S], width: usize) -> Result<(), MaskError> {
        let margin = (self.high - self.low) / DOUBTFUL_MARGIN;
        let sum = |from: u32, to: u32| (from..to).map(|value| self.counts[value as usize]).sum::<usize>();
        let max = self.counts.len() as u32 - 1;
        let (doubtful, foreground) = (sum(self.low + margin, self.high - margin), sum(max / 2 + 1, max + 1));
        let is_much =
            |pixels: usize| DOUBTFUL_SHARE * pixels > foreground && LEAST_DOUBTFUL * pixels > values.len();
        if !is_much(doubtful) {
            return Ok(());
        }
        let reach = LEAST_EDGE_PIXELS.max(width / EDGE_SHARE);
        let near = |is: &dyn Fn(u32) -> bool| {
            near_any(values.iter().map(|&value| is(value.into())).collect(), width, reach)
        };
        let by_low = near(&|value| value < self.low + margin);
        let by_high = near(&|value| value >= self.high - margin);
        let is_lone = |(&value, by): (&S, (&bool, &bool))| {
            let grey: u32 = value.into();
            (self.low + margin..self.high - margin).contains(&grey) && !(*by.0 && *by.1)
        };
        let lone = values.iter().zip(by_low.iter().zip(&by_high)).filter(|pixel| is_lone(*pixel)).count();
        if !is_much(lone) {
            return Ok(());
        }
        let percent = (100 * lone / foreground.max(1)) as u32;
        Err(MaskError::Doubtful { percent, low: self.low, high: self.high })
    }
}

/// Of each pixel, whether one that `is` lies no farther than `reach` pixels across and down.
fn near_any(is: Vec<bool>, width: usize, reach: usize) -> Vec<bool> {
    let mut across = is;
    across.chunks_mut(width).for_each(|row| spread(row, 1, reach));
    let last = across.len() - width;
    for column in 0..width {
        spread(&mut across[column..=last + column], width, reach);
    }
    across
}

/// Spreads what is true so far to both sides, among every `step`-th of the pixels.
fn spread(line: &mut [bool], step: usize, reach: usize) {
    let places = || (0..line.len()).step_by(step);
    let whole: Vec<bool> = places().map(|place| line[place]).collect();
    let mut to_last = vec![usize::MAX; whole.len()];
    let mut last = None;
    for (index, &is) in whole.iter().enumerate() {
        last = if is { Some(index) } else { last };
        to_last[index] = last.map_or(usize::MAX, |last| index - last);
    }
    let mut next = None;
    for (index, &is) in whole.iter().enumerate().rev() {
        next = if is { Some(index) } else { next };
        let to_next = next.map_or(usize::MAX, |next| next - index);
        line[index * step] = to_next.min(to_last[index]) <= reach;
    }
}

/// Whether a pixel has a darker and a brighter one around it.
fn is_on_a_slope<S: Sample>(values: &[S], width: usize, index: usize) -> bool {
    let value = values[index];
    let (mut has_darker, mut has_brighter) = (false, false);
    for near in neighbours(values, width, index) {
        has_darker |= near < value;
        has_brighter |= near > value;
    }
    has_darker && has_brighter
}

/// Whether a pixel and all around it have one value: ringing has no such pixels, nor has an edge that is enlarged twice.
fn is_interior<S: Sample>(values: &[S], width: usize, index: usize) -> bool {
    neighbours(values, width, index).all(|near| near == values[index])
}

/// A pixel and those around it.
fn neighbours<S: Sample>(values: &[S], width: usize, index: usize) -> impl Iterator<Item = S> {
    let (row, column) = (index / width, index % width);
    (row.saturating_sub(1)..=row + 1).flat_map(move |near_row| {
        let from = near_row * width + column.saturating_sub(1);
        let to = near_row * width + (column + 2).min(width);
        values.get(from..to).unwrap_or_default().iter().copied()
    })
}
