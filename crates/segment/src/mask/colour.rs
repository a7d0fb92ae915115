//! Colours as greys: of greys, and of black with one other colour.

use std::fmt;

use super::error::{Found, LISTED};
use super::{MaskError, Sample, grey};

/// More colours than that, all nearly grey, come of video and not of a palette.
const MOST_OF_A_PALETTE: usize = 64;
/// How far apart the channels of a grey may be, as shares of the largest value: of video in lossless images, and of
/// lossy formats.
const VIDEO_SPREAD: u32 = 21;
const LOSSY_SPREAD: u32 = 8;
/// The same of white whose channels differ by rounding.
const NOISE_SPREAD: u32 = 64;

/// Red, green and blue.
#[derive(Clone, Copy, PartialEq, Eq)]
struct Colour<S>([S; 3]);

impl<S: Sample> Colour<S> {
    fn of(pixel: &[S]) -> Colour<S> {
        Colour([pixel[0], pixel[1], pixel[2]])
    }

    fn channels(self) -> [u32; 3] {
        self.0.map(Into::into)
    }

    fn is_black(self) -> bool {
        self.channels() == [0; 3]
    }

    fn spread(self) -> u32 {
        let [red, green, blue] = self.channels();
        red.max(green).max(blue) - red.min(green).min(blue)
    }

    /// Its brightness (BT.709), exact for greys.
    fn luma(self) -> S {
        let [red, green, blue] = self.channels();
        S::of((2126 * red + 7152 * green + 722 * blue) / 10_000)
    }
}

impl<S: Sample> fmt::Display for Colour<S> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let digits = if S::MAX.into() > 0xff { 4 } else { 2 };
        f.write_str("#")?;
        self.channels().iter().try_for_each(|channel| write!(f, "{channel:0digits$x}"))
    }
}

/// Whether white is among the colours, and all that are no greys are black or white with noise. Of a palette of classes
/// they are not.
fn is_white_with_noise<S: Sample>(colours: &[Colour<S>]) -> bool {
    let max: u32 = S::MAX.into();
    let noise = grey::noise(max);
    let is_white = |colour: &Colour<S>| colour.channels().iter().all(|&channel| channel >= max - noise);
    let is_black = |colour: &Colour<S>| colour.channels().iter().all(|&channel| channel <= noise);
    let is_noise = |colour: &Colour<S>| colour.spread() == 0 || is_white(colour) || is_black(colour);
    colours.iter().any(is_white) && colours.iter().all(is_noise)
}

/// A plane of greys that says the same as the first three of `channels` samples a pixel.
pub(super) fn greys<S: Sample>(samples: &[S], channels: usize, is_lossy: bool) -> Result<Vec<S>, MaskError> {
    let colours = || samples.chunks_exact(channels).map(Colour::of);
    let max: u32 = S::MAX.into();
    let mut seen: Vec<Colour<S>> = Vec::new();
    let (mut last, mut spread) = (None, 0);
    for colour in colours() {
        if last == Some(colour) {
            continue;
        }
        last = Some(colour);
        spread = spread.max(colour.spread());
        if seen.len() <= MOST_OF_A_PALETTE && !seen.contains(&colour) {
            seen.push(colour);
        }
        // Of a picture in colours no more needs to be seen.
        if spread > max / LOSSY_SPREAD && seen.len() > LISTED {
            break;
        }
    }
    let greys_spread = match is_lossy {
        true => max / LOSSY_SPREAD,
        false if seen.len() > MOST_OF_A_PALETTE => max / VIDEO_SPREAD,
        false if is_white_with_noise(&seen) => max / NOISE_SPREAD,
        false => 0,
    };
    if spread <= greys_spread {
        return Ok(colours().map(Colour::luma).collect());
    }
    match seen[..] {
        [colour] => Err(MaskError::ConstantColour(Found::new([colour]))),
        [one, other] if !is_lossy && (one.is_black() || other.is_black()) => {
            Ok(colours().map(|colour| if colour.is_black() { S::of(0) } else { S::MAX }).collect())
        }
        _ => Err(MaskError::Colours(Found::new(seen))),
    }
}
