//! How far two colours are from each other, in every layout's own channels.
//!
//! Distances are those of RGB: on RGB itself Euclidean, on YUV the form that the matrix BT.601 makes of
//! it. With u and v about 128 and the grey g = (red + green + blue) / 3, which is linear in y, u, v, the
//! square of an RGB distance is 3 dg² + 2.58 du² + 2.32 dv² (a term of −0.16 du dv is left out). Lengths
//! and angles of colours are those of the same form, so thresholds mean the same in every layout.

use crate::layout::{Layout, Range, Sampling};

/// Three channels of 64 neighbouring pixels, origin at black and grey.
pub(crate) type Channels = [[i16; 64]; 3];

/// The form of one layout, in integers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Metric {
    /// What the channels' squares count.
    pub(crate) weights: [i32; 3],
    /// The weight of one squared RGB level.
    pub(crate) unit: u32,
    /// Bits of a squared cosine, so that its product with two squared lengths stays within 64.
    pub(crate) cosine_bits: u32,
    /// The bytes of black.
    pub(crate) offsets: [i16; 3],
    /// What u and v add to y to make it grey, in units of 1/128.
    pub(crate) grey: [i16; 2],
}

impl Metric {
    pub(crate) fn of(layout: Layout) -> Metric {
        let metric = match layout.range() {
            None => Metric { weights: [1; 3], unit: 1, cosine_bits: 20, offsets: [0; 3], grey: [0; 2] },
            Some(Range::Full) => Metric::yuv([48, 41, 37], 0, [61, 29]),
            Some(Range::Limited) => Metric::yuv([65, 53, 48], 16, [60, 29]),
        };
        match layout {
            Layout::Planar(Sampling::Mono, _) => Metric { weights: [metric.weights[0], 0, 0], ..metric },
            _ => metric,
        }
    }

    fn yuv(weights: [i32; 3], black: i16, grey: [i16; 2]) -> Metric {
        Metric { weights, unit: 16, cosine_bits: 16, offsets: [black, 128, 128], grey }
    }

    /// The form without its mixed terms, on channels as they are: what independent noise adds up to. Without
    /// rounding, so that sums of squares over a clip can be compared with squares of sums.
    pub(crate) fn of_noise(self) -> Metric {
        let [first, u, v] = self.weights;
        let with_grey = |weight: i32, share: i16| weight + first * i32::from(share).pow(2) / (128 * 128);
        let weights = [first, with_grey(u, self.grey[0]), with_grey(v, self.grey[1])];
        Metric { weights, grey: [0; 2], ..self }
    }

    /// How far each channel may be off (the first, the other two) so that the distance is surely not above
    /// `low` levels: most background is recognised so, byte by byte.
    pub(crate) fn reach(self, low: u8) -> [u8; 2] {
        let most = u32::from(low).pow(2) * self.unit;
        let fits = |first: u32| {
            let others = self.others(first);
            let mixed = self.grey.iter().map(|share| u32::from(share.unsigned_abs())).sum::<u32>() * others;
            // Two greys are rounded: their shares of colour may differ by one more.
            let grey = first + if mixed > 0 { mixed / 128 + 1 } else { 0 };
            let [a, b, c] = self.weights.map(i32::unsigned_abs);
            a * grey * grey + (b + c) * others * others <= most
        };
        let first = (1..=u32::from(low)).take_while(|&first| fits(first)).last().unwrap_or(0);
        [first as u8, self.others(first) as u8]
    }

    /// Noise of colour is less than that of brightness, where a sample is the mean of several pixels.
    fn others(self, first: u32) -> u32 {
        if self.unit == 1 { first } else { first.div_ceil(2) }
    }

    /// The square of a colour's length, or of a difference's.
    #[inline(always)]
    pub(crate) fn square(self, colour: [i32; 3]) -> u32 {
        // Weights are not negative.
        let [a, b, c] = self.weights;
        (a * colour[0] * colour[0] + b * colour[1] * colour[1] + c * colour[2] * colour[2]) as u32
    }

    /// Bytes as channels, of one pixel.
    #[inline(always)]
    pub(crate) fn channels(self, bytes: [u8; 3]) -> [i16; 3] {
        let [first, second, third] = bytes;
        let [a, b, c] = self.offsets;
        let (second, third) = (i16::from(second) - b, i16::from(third) - c);
        let grey = (self.grey[0] * second + self.grey[1] * third + 64) >> 7;
        let grey = if self.unit == 1 { 0 } else { grey };
        [i16::from(first) - a + grey, second, third]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::convert::rgb_of_yuv;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn distances_on_yuv_are_those_on_rgb(
            a in prop::array::uniform3(60u8..190), d in prop::array::uniform3(-30i16..30), full: bool,
        ) {
            let range = if full { Range::Full } else { Range::Limited };
            let metric = Metric::of(Layout::Nv12(range));
            let near = |(a, d): (u8, i16)| (i16::from(a) + d / 2) as u8;
            // Colours in the middle of the cube, which no rounding clips.
            let [y, u, v] = a.map(|level| 110 + level / 8);
            let a = [y, u, v];
            let b = [near((y, d[0])), near((u, d[1])), near((v, d[2]))];
            let (ra, rb) = (rgb_of_yuv(range, a), rgb_of_yuv(range, b));
            let expected: f64 = (0..3).map(|c| f64::from(ra[c]) - f64::from(rb[c])).map(|d| d * d).sum();
            let (ca, cb) = (metric.channels(a), metric.channels(b));
            let difference = std::array::from_fn(|c| i32::from(ca[c]) - i32::from(cb[c]));
            let found = f64::from(metric.square(difference)) / f64::from(metric.unit);
            // Each colour is rounded twice: in RGB by half a level a channel, together at most √3 of a distance, and
            // its grey by half a level, together at most √(65/16). The form itself is 4 % off at most.
            prop_assert!((found.sqrt() - expected.sqrt()).abs() < 3.75 + 0.04 * expected.sqrt(),
                "{found} {expected} {a:?} {b:?}");
        }

        #[test]
        fn what_is_within_reach_is_not_above_the_threshold(
            low in 1u8..=255, a in any::<[u8; 3]>(), share in prop::array::uniform3(-128i32..=128), layout in 0usize..3,
        ) {
            let layout = [Layout::Rgb, Layout::Nv12(Range::Full), Layout::Yuyv(Range::Limited)][layout];
            let metric = Metric::of(layout);
            let [first, others] = metric.reach(low);
            let reach = [first, others, others].map(i32::from);
            let b: [u8; 3] = std::array::from_fn(|c| (i32::from(a[c]) + reach[c] * share[c] / 128).clamp(0, 255) as u8);
            let (ca, cb) = (metric.channels(a), metric.channels(b));
            let difference = std::array::from_fn(|c| i32::from(ca[c]) - i32::from(cb[c]));
            prop_assert!(metric.square(difference) <= metric.unit * u32::from(low).pow(2));
        }
    }
}
