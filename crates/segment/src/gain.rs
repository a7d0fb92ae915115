//! The change of exposure between the model and a frame.
//!
//! Per channel (or over all), the median over scattered pixels of the ratio between frame and model, in RGB
//! whatever the layout. The person covers less than half of the image, so the median is a ratio of background
//! pixels. It is estimated from the frame alone, so that a frame's silhouette does not depend on the frames
//! before it.

use crate::convert::rgb_at;
use crate::layout::{Format, Range};
use crate::metric::{Channels, Metric};
use crate::settings::GainMode;

/// Gains are in units of 1/1024.
const ONE: usize = 1024;

/// Frames more than four times as bright as the model, or under a quarter, are not compensated.
const BINS: usize = 4 * ONE;

/// Stretches of neighbouring pixels that are looked at, each within a line or two of a cache, and their
/// length. The median of 4096 is good to a thousandth.
const STRETCHES: usize = 256;
const STRETCH: usize = 16;

/// Gains closer to one than this are left alone: four levels at white, well under any threshold.
const STILL: usize = ONE / 64;

/// Ratios of darker levels are too coarse, those of brighter ones hit the ceiling.
const USABLE: std::ops::RangeInclusive<u8> = 32..=235;

/// Fractional bits of the factors that a frame's channels are multiplied by.
const FACTOR_BITS: u32 = 12;

/// Estimates the gains of frames over one model.
#[derive(Clone, Debug)]
pub(crate) struct Gains {
    mode: GainMode,
    format: Format,
    samples: Vec<Sample>,
    histogram: Vec<u32>,
}

/// A pixel that is looked at: where, and per channel the ratio of one level; 0 if the model's level is of
/// no use.
#[derive(Clone, Copy, Debug)]
struct Sample {
    column: u16,
    row: u16,
    per_level: [u32; 3],
}

/// What a frame's channels are multiplied by to be as the model would have seen them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Correction {
    /// Row by row; `None` if nothing changed.
    matrix: Option<[[i32; 3]; 3]>,
    gains: [usize; 3],
}

impl Correction {
    /// Nothing changed.
    pub(crate) const NONE: Correction = Correction { matrix: None, gains: [ONE; 3] };

    fn new(gains: [usize; 3], format: Format) -> Correction {
        if gains == [ONE; 3] {
            return Correction::NONE;
        }
        let by = gains.map(|gain| ONE as f64 / gain as f64);
        let rows = match format.layout().range() {
            None => [[by[0], 0.0, 0.0], [0.0, by[1], 0.0], [0.0, 0.0, by[2]]],
            Some(range) => on_grey(range, by),
        };
        let fixed = |factor: f64| (factor * f64::from(1 << FACTOR_BITS)).round() as i32;
        Correction { matrix: Some(rows.map(|row| row.map(fixed))), gains }
    }

    pub(crate) fn is_none(&self) -> bool {
        self.matrix.is_none()
    }

    /// How much brighter than the model the frame is: red, green, blue.
    pub(crate) fn gains(&self) -> [f64; 3] {
        self.gains.map(|gain| gain as f64 / ONE as f64)
    }

    /// The channels as the model would have seen them.
    #[inline(always)]
    pub(crate) fn apply(&self, channels: &mut Channels, metric: Metric) {
        let Some(matrix) = self.matrix else { return };
        // A frame has no level above white, so a darker model's white cannot be told from brighter.
        let most = if metric.unit == 1 { 255 } else { i32::from(i16::MAX) };
        for lane in 0..channels[0].len() {
            let colour = [channels[0][lane], channels[1][lane], channels[2][lane]].map(i32::from);
            for (c, row) in matrix.iter().enumerate() {
                let sum = row[0] * colour[0] + row[1] * colour[1] + row[2] * colour[2];
                let level = (sum + (1 << (FACTOR_BITS - 1))) >> FACTOR_BITS;
                channels[c][lane] = level.min(most) as i16;
            }
        }
    }
}

/// Factors of red, green and blue as a matrix on grey, u and v.
fn on_grey(range: Range, by: [f64; 3]) -> [[f64; 3]; 3] {
    // Limited ranges stretch brightness and colour a little differently.
    let stretch = match range {
        Range::Full => 1.0,
        Range::Limited => 219.0 / 224.0,
    };
    // Red, green and blue are grey plus these shares of u and v.
    let to_rgb = [
        [-0.475_955, 1.402 - 0.229_289],
        [-0.344_136 - 0.475_955, -0.714_136 - 0.229_289],
        [1.772 - 0.475_955, -0.229_289],
    ];
    let from_rgb =
        [[1.0 / 3.0, 1.0 / 3.0, 1.0 / 3.0], [-0.168_736, -0.331_264, 0.5], [0.5, -0.418_688, -0.081_312]];
    let in_rgb = |c: usize, channel: usize| match channel {
        0 => by[c],
        channel => by[c] * to_rgb[c][channel - 1],
    };
    let mut rows = [[0.0; 3]; 3];
    for (out, row) in rows.iter_mut().enumerate() {
        for (channel, factor) in row.iter_mut().enumerate() {
            *factor = (0..3).map(|c| from_rgb[out][c] * in_rgb(c, channel)).sum();
        }
    }
    let [grey, u, v] = &mut rows;
    grey[1..].iter_mut().for_each(|factor| *factor *= stretch);
    u[0] /= stretch;
    v[0] /= stretch;
    rows
}

impl Gains {
    /// For frames of that format over a model's mean frame.
    pub(crate) fn new(mode: GainMode, format: Format, mean: &[u8]) -> Gains {
        let samples = if mode == GainMode::Off { Vec::new() } else { places(format) };
        let per_level = |level: u8| {
            let usable = USABLE.contains(&level);
            if usable { ((ONE << 16) / usize::from(level)) as u32 } else { 0 }
        };
        let samples = samples.into_iter().map(|(column, row)| Sample {
            // Sides have at most 14 bits.
            column: column as u16,
            row: row as u16,
            per_level: rgb_at(mean, format, column, row).map(per_level),
        });
        let samples = samples.filter(|sample| sample.per_level != [0; 3]).collect();
        Gains { mode, format, samples, histogram: vec![0; 3 * BINS] }
    }

    /// What a frame, of the format, must be multiplied by.
    pub(crate) fn estimate(&mut self, bytes: &[u8]) -> Correction {
        if self.mode == GainMode::Off {
            return Correction::NONE;
        }
        self.histogram.fill(0);
        let together = self.mode == GainMode::Brightness;
        for sample in &self.samples {
            let colour = rgb_at(bytes, self.format, usize::from(sample.column), usize::from(sample.row));
            for (c, (level, per_level)) in colour.into_iter().zip(sample.per_level).enumerate() {
                let ratio = (usize::from(level) * per_level as usize + (1 << 15)) >> 16;
                if per_level != 0 && USABLE.contains(&level) && ratio < BINS {
                    let bins = if together { 0 } else { c * BINS };
                    self.histogram[bins + ratio] += 1;
                }
            }
        }
        let gain = |c: usize| median(&self.histogram[c * BINS..(c + 1) * BINS]);
        let gains = if together { [gain(0); 3] } else { [gain(0), gain(1), gain(2)] };
        Correction::new(gains, self.format)
    }
}

/// Columns and rows of the pixels that are looked at, evenly over the image.
fn places(format: Format) -> Vec<(usize, usize)> {
    let (columns, pixels) = (format.columns(), format.pixels());
    let step = (pixels / STRETCHES).max(STRETCH);
    let stretch = |start: usize| (start..start + STRETCH).map(move |at| (at % columns, at / columns));
    let places = (0..STRETCHES).map(|at| at * step).take_while(|start| start + STRETCH <= pixels);
    places.flat_map(stretch).collect()
}

/// The median gain, or one if there is little to go by or it is nearly one.
fn median(bins: &[u32]) -> usize {
    let count: u32 = bins.iter().sum();
    let mut below = 0;
    let median = bins.iter().position(|&bin| {
        below += bin;
        2 * below >= count
    });
    match median {
        // Too few pixels in range (a black or burnt frame) say nothing of the exposure.
        Some(median) if count >= 16 && median >= ONE / 4 && median.abs_diff(ONE) > STILL => median,
        _ => ONE,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::convert::from_rgb;
    use crate::layout::Sampling;
    use crate::layout::tests::LAYOUTS;

    fn format(layout: Layout) -> Format {
        Format::new(layout, 200, 200).expect("size")
    }

    use crate::layout::Layout;

    #[test]
    fn a_darker_frame_with_a_person_in_it_is_measured_in_every_layout() {
        let mean: Vec<u8> = (0..3 * 40_000usize).map(|at| 60 + (at / 600 % 50 * 3) as u8).collect();
        let share = [0.8, 0.8, 0.9];
        let frame: Vec<u8> = (0..mean.len())
            .map(|at| if at < mean.len() / 3 { 5 } else { (f64::from(mean[at]) * share[at % 3]) as u8 })
            .collect();
        for layout in
            LAYOUTS.into_iter().filter(|layout| !matches!(layout, Layout::Planar(Sampling::Mono, _)))
        {
            let (mut model, mut bytes) = (Vec::new(), Vec::new());
            from_rgb(&mean, format(layout), &mut model);
            from_rgb(&frame, format(layout), &mut bytes);
            let correction = Gains::new(GainMode::Colour, format(layout), &model).estimate(&bytes);
            let gains = correction.gains();
            let good = gains.iter().zip(share).all(|(gain, share)| (gain - share).abs() < 0.02);
            assert!(good, "{layout:?}: {gains:?}");
        }
    }

    #[test]
    fn corrected_channels_are_those_of_the_corrected_colour() {
        for layout in [Layout::Rgb, Layout::Nv12(Range::Full), Layout::Nv12(Range::Limited)] {
            let metric = Metric::of(layout);
            let correction = Correction::new([819, 922, 1229], format(layout));
            let seen = [0.8, 0.9, 1.2];
            let colour = [150.0, 120.0, 90.0];
            let bytes = |rgb: [f64; 3]| {
                let mut bytes = Vec::new();
                let rgb = rgb.map(|level| level.round() as u8);
                from_rgb(&rgb.repeat(4), Format::new(layout, 2, 2).expect("size"), &mut bytes);
                let at = Format::new(layout, 2, 2).expect("size").channels(0, 0);
                let (u, v) = at.1.expect("colour");
                metric.channels([bytes[at.0], bytes[u], bytes[v]])
            };
            let expected = bytes(colour);
            let mut channels = bytes(std::array::from_fn(|c| colour[c] * seen[c])).map(|level| [level; 64]);
            correction.apply(&mut channels, metric);
            let worst = (0..3).map(|c| channels[c][9].abs_diff(expected[c])).max();
            assert!(worst <= Some(2), "{layout:?}: {:?} {expected:?}", channels.map(|lanes| lanes[9]));
        }
    }

    #[test]
    fn off_and_black_frames_change_nothing() {
        let mean = vec![100; 3 * 40_000];
        for (mode, level) in [(GainMode::Off, 50), (GainMode::Brightness, 0), (GainMode::Colour, 101)] {
            let correction = Gains::new(mode, format(Layout::Rgb), &mean).estimate(&vec![level; 3 * 40_000]);
            assert_eq!(correction, Correction::NONE);
        }
    }
}
