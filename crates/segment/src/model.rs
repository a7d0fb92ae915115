//! The empty room: mean colour and deviation per pixel, learnt once and then frozen.

use std::sync::Arc;

use thiserror::Error;

use crate::convert::{from_rgb, to_rgb};
use crate::kernel::{BLOCK, row_channels};
use crate::layout::{Format, Layout};
use crate::metric::{Channels, Metric};

/// Frames that a clip may hold: a film that is none of an empty room should not go on for ever.
pub const MAX_CLIP_FRAMES: u32 = 20_000;

/// Frames that are summed: sums of bytes then fit 16 bits, sums of squares 32.
const MAX_SUMMED: u32 = 256;

/// Deviations are kept in eighths of a level.
pub(crate) const DEVIATION_UNITS: f64 = 8.0;

/// Why a clip makes no model.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum ModelError {
    /// A frame of the wrong length.
    #[error("background frame of {found} bytes, expected {expected}")]
    Frame {
        /// Bytes given.
        found: usize,
        /// Bytes of a frame of the clip's format.
        expected: usize,
    },
    /// A clip without frames.
    #[error("background clip without frames")]
    Empty,
    /// A clip that never ends.
    #[error("background clip of more than {MAX_CLIP_FRAMES} frames")]
    TooLong,
}

/// Takes the frames of a clip of the empty room, one at a time.
///
/// Of a clip of more than 256 frames, every second is summed, of one of more than 512 every fourth, and so
/// on: frames weigh the same wherever they stand, and a pixel costs six bytes more than its own at most.
#[derive(Clone, Debug)]
pub struct BackgroundBuilder {
    format: Format,
    frames: u32,
    /// Frames in the sums.
    summed: u32,
    /// Every how many-th frame is summed.
    step: u32,
    /// Of each byte.
    sums: Vec<u16>,
    /// Per pixel, of the length of its colour.
    square_sums: Vec<u32>,
    row: Vec<Channels>,
}

impl BackgroundBuilder {
    /// A clip of frames of that format.
    pub fn new(format: Format) -> BackgroundBuilder {
        BackgroundBuilder {
            format,
            frames: 0,
            summed: 0,
            step: 1,
            sums: vec![0; format.frame_bytes()],
            square_sums: vec![0; format.pixels()],
            row: vec![[[0; BLOCK]; 3]; format.columns().div_ceil(BLOCK)],
        }
    }

    /// Adds a frame.
    pub fn push(&mut self, bytes: &[u8]) -> Result<(), ModelError> {
        if bytes.len() != self.sums.len() {
            return Err(ModelError::Frame { found: bytes.len(), expected: self.sums.len() });
        }
        if self.frames == MAX_CLIP_FRAMES {
            return Err(ModelError::TooLong);
        }
        if self.frames.is_multiple_of(self.step) {
            if self.summed == MAX_SUMMED {
                self.halve();
            }
            if self.frames.is_multiple_of(self.step) {
                self.sum(bytes);
            }
        }
        self.frames += 1;
        Ok(())
    }

    /// Lets what was summed weigh half of it, and makes half of what comes weigh one.
    fn halve(&mut self) {
        self.sums.iter_mut().for_each(|sum| *sum = sum.div_ceil(2));
        self.square_sums.iter_mut().for_each(|sum| *sum = sum.div_ceil(2));
        self.summed /= 2;
        self.step *= 2;
    }

    fn sum(&mut self, bytes: &[u8]) {
        self.summed += 1;
        for (sum, &level) in self.sums.iter_mut().zip(bytes) {
            *sum += u16::from(level);
        }
        let metric = Metric::of(self.format.layout()).of_noise();
        for (row, squares) in self.square_sums.chunks_exact_mut(self.format.columns()).enumerate() {
            row_channels(metric, self.format, bytes, row, &mut self.row);
            for (squares, channels) in squares.chunks_mut(BLOCK).zip(&self.row) {
                for (lane, square) in squares.iter_mut().enumerate() {
                    *square += metric.square(channels.map(|channel| i32::from(channel[lane])));
                }
            }
        }
    }

    /// Frames so far.
    pub fn frames(&self) -> u32 {
        self.frames
    }

    /// The model of the frames so far.
    pub fn finish(&self) -> Result<BackgroundModel, ModelError> {
        if self.frames == 0 {
            return Err(ModelError::Empty);
        }
        let summed = self.summed;
        let mean = self.sums.iter().map(|&sum| ((u32::from(sum) + summed / 2) / summed) as u8).collect();
        let columns = self.format.columns();
        let deviation = (0..self.format.pixels()).map(|at| {
            let deviation = self.variance(at % columns, at / columns).max(0.0).sqrt();
            (deviation * DEVIATION_UNITS).round().min(255.0) as u8
        });
        Ok(BackgroundModel { format: self.format, frames: self.frames, deviation: deviation.collect(), mean })
    }

    /// The mean square distance of a pixel's colour from its mean, squared levels.
    fn variance(&self, column: usize, row: usize) -> f64 {
        let summed = f64::from(self.summed);
        let metric = Metric::of(self.format.layout()).of_noise();
        let (first, colour) = self.format.channels(column, row);
        let mean = |at: usize, c: usize| f64::from(self.sums[at]) / summed - f64::from(metric.offsets[c]);
        let (u, v) = colour.map_or((0.0, 0.0), |(u, v)| (mean(u, 1), mean(v, 2)));
        let of_mean: f64 = [mean(first, 0), u, v]
            .iter()
            .zip(metric.weights)
            .map(|(channel, weight)| f64::from(weight) * channel.powi(2))
            .sum();
        let square_sum = self.square_sums[row * self.format.columns() + column];
        (f64::from(square_sum) / summed - of_mean) / f64::from(metric.unit)
    }
}

/// The empty room as one camera sees it. To take it again, build another.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BackgroundModel {
    format: Format,
    frames: u32,
    mean: Arc<[u8]>,
    deviation: Arc<[u8]>,
}

impl BackgroundModel {
    /// From a single picture: nothing is known of the noise, so settings' floors stand in for it.
    pub fn from_plate(format: Format, bytes: &[u8]) -> Result<BackgroundModel, ModelError> {
        let mut builder = BackgroundBuilder::new(format);
        builder.push(bytes)?;
        builder.finish()
    }

    /// Size and layout of the frames it was learnt from.
    pub fn format(&self) -> Format {
        self.format
    }

    /// Frames it was learnt from.
    pub fn frames(&self) -> u32 {
        self.frames
    }

    /// Mean colour: a frame of the model's format.
    pub fn mean(&self) -> &[u8] {
        &self.mean
    }

    /// The same room in another layout: a plate for a film that comes as YUV.
    pub fn in_layout(&self, layout: Layout) -> BackgroundModel {
        if layout == self.format.layout() {
            return self.clone();
        }
        let format = self.format.with_layout(layout);
        let (mut rgb, mut mean) = (Vec::new(), Vec::new());
        to_rgb(&self.mean, self.format, &mut rgb);
        from_rgb(&rgb, format, &mut mean);
        BackgroundModel {
            format,
            frames: self.frames,
            mean: mean.into(),
            deviation: Arc::clone(&self.deviation),
        }
    }

    /// Root mean square distance of a pixel's colour from its mean over the clip, levels.
    pub fn deviation(&self, column: u32, row: u32) -> f64 {
        f64::from(self.deviation[row as usize * self.format.columns() + column as usize]) / DEVIATION_UNITS
    }

    /// The deviation that half of the pixels do not exceed, levels; `None` for a single picture.
    pub fn median_deviation(&self) -> Option<f64> {
        let mut counts = [0usize; 256];
        self.deviation.iter().for_each(|&deviation| counts[usize::from(deviation)] += 1);
        let mut below = 0;
        let median = counts.iter().position(|count| {
            below += count;
            2 * below >= self.deviation.len()
        });
        median.filter(|_| self.frames > 1).map(|median| median as f64 / DEVIATION_UNITS)
    }

    pub(crate) fn shared_mean(&self) -> Arc<[u8]> {
        Arc::clone(&self.mean)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::layout::Range;

    fn rgb(width: u32, height: u32) -> Format {
        Format::new(Layout::Rgb, width, height).expect("size")
    }

    #[test]
    fn mean_and_deviation_are_those_of_the_clip() {
        let mut builder = BackgroundBuilder::new(rgb(2, 1));
        for level in [96, 104, 96, 104] {
            builder.push(&[level, 50, 50, 7, 8, 9]).expect("a frame");
        }
        let model = builder.finish().expect("frames");
        assert_eq!(model.mean(), [100, 50, 50, 7, 8, 9]);
        assert_eq!((model.deviation(0, 0), model.deviation(1, 0)), (4.0, 0.0));
        assert_eq!((model.frames(), model.median_deviation()), (4, Some(0.0)));
    }

    #[test]
    fn all_frames_of_a_long_clip_weigh_the_same() {
        let mut builder = BackgroundBuilder::new(rgb(1, 1));
        (0..3000u32)
            .for_each(|frame| builder.push(&[if frame < 1500 { 90 } else { 110 }; 3]).expect("a frame"));
        let model = builder.finish().expect("frames");
        assert!(model.mean().iter().all(|level| (99..=101).contains(level)), "{:?}", model.mean());
        assert!((model.deviation(0, 0) - 10.0 * 3f64.sqrt()).abs() < 0.5, "{}", model.deviation(0, 0));
        assert_eq!(model.frames(), 3000);
    }

    #[test]
    fn noise_is_as_many_levels_in_every_layout() {
        // Grey that flickers by four levels of 255: three channels, so √3 times as far. Colour stands still.
        for (range, levels) in [(Range::Full, [96, 104]), (Range::Limited, [98, 105])] {
            let format = Format::new(Layout::Nv12(range), 2, 2).expect("size");
            let mut builder = BackgroundBuilder::new(format);
            for at in 0..40 {
                let y = levels[at % 2];
                builder.push(&[y, y, y, y, 119, 141]).expect("a frame");
            }
            let deviation = builder.finish().expect("frames").deviation(1, 1);
            assert!((deviation - 4.0 * 3f64.sqrt()).abs() < 0.3, "{range:?}: {deviation}");
        }
    }

    #[test]
    fn clips_that_are_none_are_refused() {
        let mut builder = BackgroundBuilder::new(rgb(2, 2));
        assert_eq!(builder.push(&[0; 11]), Err(ModelError::Frame { found: 11, expected: 12 }));
        assert_eq!(builder.finish().err(), Some(ModelError::Empty));
    }

    #[test]
    fn a_plate_serves_a_film_of_another_layout() {
        let plate = BackgroundModel::from_plate(rgb(2, 2), &[200, 40, 40].repeat(4)).expect("a plate");
        assert_eq!(plate.median_deviation(), None);
        let model = plate.in_layout(Layout::Nv12(Range::Full));
        let mut back = Vec::new();
        to_rgb(model.mean(), model.format(), &mut back);
        assert!(back.chunks_exact(3).all(|rgb| rgb[0].abs_diff(200) <= 1 && rgb[1].abs_diff(40) <= 1));
        assert_eq!((model.frames(), model.format().frame_bytes()), (1, 6));
    }
}
