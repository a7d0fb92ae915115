//! Foreground or not, 64 pixels at a time, in integers (Cheung et al. 2000).

use crate::layout::{Layout, Range};
use crate::metric::{Channels, Metric};
use crate::settings::SegmentSettings;

use super::pixels::BLOCK;

/// Shares of brightness are in units of 1/1024.
const SHARE_ONE: f64 = 1024.0;

/// Pixels whose angles are looked at together.
const PART: usize = 16;

/// Two thresholds on the distance from the background, and between them the angle.
#[derive(Clone, Copy, Debug)]
pub(crate) struct DifferenceTest {
    metric: Metric,
    high: u8,
    cosine_squared: u64,
    darkest: u32,
    brightest: u32,
    dark_squared: u32,
}

impl DifferenceTest {
    pub(crate) fn new(settings: &SegmentSettings, metric: Metric) -> DifferenceTest {
        let cosine_one = f64::from(1 << metric.cosine_bits);
        DifferenceTest {
            metric,
            high: settings.high.round() as u8,
            cosine_squared: (settings.shadow_cosine.powi(2) * cosine_one).round() as u64,
            darkest: (settings.shadow_darkest * SHARE_ONE).round() as u32,
            brightest: (settings.glow_brightest * SHARE_ONE).round() as u32,
            dark_squared: settings.dark.powi(2).round() as u32 * metric.unit,
        }
    }

    pub(crate) fn metric(&self) -> Metric {
        self.metric
    }

    /// The bits of the foreground pixels of a block: `low` is each pixel's low threshold.
    #[inline(always)]
    pub(crate) fn foreground(&self, frame: &Channels, mean: &Channels, low: &[u8; BLOCK]) -> u64 {
        let mut classes = [0u8; BLOCK];
        let mut any = 0;
        let unit = self.metric.unit;
        for lane in 0..BLOCK {
            let apart = |c: usize| i32::from(frame[c][lane]) - i32::from(mean[c][lane]);
            let distance = self.metric.square([apart(0), apart(1), apart(2)]);
            let (low, high) = (u32::from(low[lane]), u32::from(low[lane].max(self.high)));
            let class = u8::from(distance > unit * low * low) + u8::from(distance > unit * high * high);
            classes[lane] = class;
            any |= class;
        }
        if any == 0 {
            return 0;
        }
        let sure = bits(classes.map(|class| class >> 1));
        let between = bits(classes.map(|class| class & 1));
        if between == 0 {
            return sure;
        }
        sure | (between & !self.shadows(frame, mean, between))
    }

    /// Bits of pixels of the background's own colour, darker but not black, or a little brighter; at least
    /// of those asked for.
    #[inline(always)]
    fn shadows(&self, frame: &Channels, mean: &Channels, asked: u64) -> u64 {
        let mut shadows = 0;
        for part in 0..BLOCK / PART {
            if (asked >> (PART * part)) & ((1 << PART) - 1) == 0 {
                continue;
            }
            let mut found = [0u8; PART];
            for (lane, found) in found.iter_mut().enumerate() {
                let at = PART * part + lane;
                let of = |channels: &Channels, c: usize| i32::from(channels[c][at]);
                let colour = [of(frame, 0), of(frame, 1), of(frame, 2)];
                let background = [of(mean, 0), of(mean, 1), of(mean, 2)];
                *found = u8::from(self.is_shadow(colour, background));
            }
            shadows |= part_bits(found) << (PART * part);
        }
        shadows
    }

    #[inline(always)]
    fn is_shadow(&self, colour: [i32; 3], background: [i32; 3]) -> bool {
        let (own, back) = (self.metric.square(colour), self.metric.square(background));
        let [a, b, c] = self.metric.weights;
        let both =
            a * colour[0] * background[0] + b * colour[1] * background[1] + c * colour[2] * background[2];
        // Opposite colours have no shadow in common.
        let both = u64::from(both.max(0) as u32);
        let (own_wide, back_wide) = (u64::from(own), u64::from(back));
        let share = both << 10;
        let lit =
            (share >= u64::from(self.darkest) * back_wide) & (share <= u64::from(self.brightest) * back_wide);
        let aligned =
            (both * both) << self.metric.cosine_bits >= self.cosine_squared * (own_wide * back_wide);
        (own >= self.dark_squared) & (back >= self.dark_squared) & lit & aligned
    }
}

/// The chroma key: the share of green in red + green + blue is one linear form of the channels.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ChromaTest {
    metric: Metric,
    factors: [i32; 3],
}

impl ChromaTest {
    pub(crate) fn new(settings: &SegmentSettings, layout: Layout) -> ChromaTest {
        let share = settings.green_share;
        // Green less its share of all three; on YUV, grey is a third of all three.
        let form = match layout.range() {
            None => [-share, 1.0 - share, -share],
            Some(range) => {
                let (luma, chroma) = match range {
                    Range::Full => (1.0, 1.0),
                    Range::Limited => (255.0 / 219.0, 255.0 / 224.0),
                };
                let green = [-0.344_136 - 0.475_955, -0.714_136 - 0.229_289];
                [luma * (1.0 - 3.0 * share), chroma * green[0], chroma * green[1]]
            }
        };
        ChromaTest {
            metric: Metric::of(layout),
            factors: form.map(|factor| (factor * SHARE_ONE).round() as i32),
        }
    }

    pub(crate) fn metric(&self) -> Metric {
        self.metric
    }

    /// The bits of pixels that are not green, of a block.
    #[inline(always)]
    pub(crate) fn foreground(&self, frame: &Channels) -> u64 {
        let mut classes = [0u8; BLOCK];
        for (lane, class) in classes.iter_mut().enumerate() {
            let green: i32 = (0..3).map(|c| self.factors[c] * i32::from(frame[c][lane])).sum();
            *class = u8::from(green < 0);
        }
        bits(classes)
    }
}

/// The low bits of 64 bytes.
#[inline(always)]
fn bits(bytes: [u8; BLOCK]) -> u64 {
    let mut word = 0;
    for (part, bytes) in bytes.as_chunks::<PART>().0.iter().enumerate() {
        word |= part_bits(*bytes) << (PART * part);
    }
    word
}

#[inline(always)]
fn part_bits(bytes: [u8; PART]) -> u64 {
    let mut bits = 0;
    for (part, eight) in bytes.chunks_exact(8).enumerate() {
        let mut lanes = [0; 8];
        lanes.copy_from_slice(eight);
        // The multiplication gathers the low bit of each byte in the top byte.
        bits |= (u64::from_le_bytes(lanes).wrapping_mul(0x0102_0408_1020_4080) >> 56) << (8 * part);
    }
    bits
}
