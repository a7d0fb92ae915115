//! The empty room: mean colour and deviation per pixel, learnt once and then frozen.

use thiserror::Error;

/// Frames that a clip may hold: 32-bit sums of squares over three channels bear 22,000.
pub const MAX_CLIP_FRAMES: u32 = 20_000;

/// Deviations are kept in eighths of a level.
pub(crate) const DEVIATION_UNITS: f64 = 8.0;

/// Why a clip makes no model.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum ModelError {
    /// A side is zero or too large.
    #[error("background of {width} x {height}, expected 1 to {max} pixels a side", max = hull::camera::MAX_SIDE_PIXELS)]
    Size {
        /// Pixels across.
        width: u32,
        /// Pixels down.
        height: u32,
    },
    /// A frame of the wrong length.
    #[error("background frame of {found} bytes, expected {expected}")]
    Frame {
        /// Bytes given.
        found: usize,
        /// Three for each pixel.
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
#[derive(Clone, Debug)]
pub struct BackgroundBuilder {
    width: u32,
    height: u32,
    frames: u32,
    /// Per channel of each pixel.
    sums: Vec<u32>,
    /// Per pixel, over the three channels.
    square_sums: Vec<u32>,
}

impl BackgroundBuilder {
    /// A clip of frames of that size.
    pub fn new(width: u32, height: u32) -> Result<BackgroundBuilder, ModelError> {
        let sides = 1..=hull::camera::MAX_SIDE_PIXELS;
        if !sides.contains(&width) || !sides.contains(&height) {
            return Err(ModelError::Size { width, height });
        }
        let pixels = width as usize * height as usize;
        Ok(BackgroundBuilder {
            width,
            height,
            frames: 0,
            sums: vec![0; 3 * pixels],
            square_sums: vec![0; pixels],
        })
    }

    /// Adds a frame: rows of RGB triples.
    pub fn push(&mut self, rgb: &[u8]) -> Result<(), ModelError> {
        if rgb.len() != self.sums.len() {
            return Err(ModelError::Frame { found: rgb.len(), expected: self.sums.len() });
        }
        if self.frames == MAX_CLIP_FRAMES {
            return Err(ModelError::TooLong);
        }
        self.frames += 1;
        for (sum, &level) in self.sums.iter_mut().zip(rgb) {
            *sum += u32::from(level);
        }
        for (sum, colour) in self.square_sums.iter_mut().zip(rgb.chunks_exact(3)) {
            *sum += colour.iter().map(|&level| u32::from(level).pow(2)).sum::<u32>();
        }
        Ok(())
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
        let mean = self.sums.iter().map(|&sum| ((sum + self.frames / 2) / self.frames) as u8).collect();
        let frames = f64::from(self.frames);
        let deviation = self.sums.chunks_exact(3).zip(&self.square_sums).map(|(sums, &square_sum)| {
            let of_mean: f64 = sums.iter().map(|&sum| (f64::from(sum) / frames).powi(2)).sum();
            let variance = (f64::from(square_sum) / frames - of_mean).max(0.0);
            (variance.sqrt() * DEVIATION_UNITS).round().min(255.0) as u8
        });
        Ok(BackgroundModel {
            width: self.width,
            height: self.height,
            frames: self.frames,
            deviation: deviation.collect(),
            mean,
        })
    }
}

/// The empty room as one camera sees it. To take it anew, build another.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BackgroundModel {
    width: u32,
    height: u32,
    frames: u32,
    mean: Vec<u8>,
    deviation: Vec<u8>,
}

impl BackgroundModel {
    /// From a single picture: nothing is known of the noise, so settings' floors stand in for it.
    pub fn from_plate(width: u32, height: u32, rgb: &[u8]) -> Result<BackgroundModel, ModelError> {
        let mut builder = BackgroundBuilder::new(width, height)?;
        builder.push(rgb)?;
        builder.finish()
    }

    /// Pixels across.
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Pixels down.
    pub fn height(&self) -> u32 {
        self.height
    }

    /// Frames it was learnt from.
    pub fn frames(&self) -> u32 {
        self.frames
    }

    /// Mean colour: rows of RGB triples.
    pub fn mean_rgb(&self) -> &[u8] {
        &self.mean
    }

    /// Root mean square distance of a pixel's colour from its mean over the clip, levels.
    pub fn deviation(&self, column: u32, row: u32) -> f64 {
        f64::from(self.deviation[row as usize * self.width as usize + column as usize]) / DEVIATION_UNITS
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

    /// How much the mean changes from this pixel to its four neighbours, levels per pixel: the
    /// largest colour distance.
    pub(crate) fn gradient(&self, column: usize, row: usize) -> f64 {
        let (last_column, last_row) = (self.width as usize - 1, self.height as usize - 1);
        let colour = |column: usize, row: usize| {
            let at = 3 * (row * (last_column + 1) + column);
            &self.mean[at..at + 3]
        };
        let squared = |a: &[u8], b: &[u8]| -> i32 {
            a.iter().zip(b).map(|(&a, &b)| (i32::from(a) - i32::from(b)).pow(2)).sum()
        };
        let here = colour(column, row);
        let neighbours = [
            colour(column.saturating_sub(1), row),
            colour((column + 1).min(last_column), row),
            colour(column, row.saturating_sub(1)),
            colour(column, (row + 1).min(last_row)),
        ];
        f64::from(neighbours.map(|colour| squared(colour, here)).into_iter().max().unwrap_or(0)).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mean_and_deviation_are_those_of_the_clip() {
        let mut builder = BackgroundBuilder::new(2, 1).expect("size");
        for level in [96, 104, 96, 104] {
            builder.push(&[level, 50, 50, 7, 8, 9]).expect("a frame");
        }
        let model = builder.finish().expect("frames");
        assert_eq!(model.mean_rgb(), [100, 50, 50, 7, 8, 9]);
        assert_eq!((model.deviation(0, 0), model.deviation(1, 0)), (4.0, 0.0));
        assert_eq!((model.frames(), model.median_deviation()), (4, Some(0.0)));
    }

    #[test]
    fn clips_that_are_none_are_refused() {
        assert_eq!(BackgroundBuilder::new(0, 4).err(), Some(ModelError::Size { width: 0, height: 4 }));
        let mut builder = BackgroundBuilder::new(2, 2).expect("size");
        assert_eq!(builder.push(&[0; 11]), Err(ModelError::Frame { found: 11, expected: 12 }));
        assert_eq!(builder.finish().err(), Some(ModelError::Empty));
    }

    #[test]
    fn a_single_picture_has_contours_but_no_deviation() {
        let model = BackgroundModel::from_plate(3, 1, &[0, 0, 0, 0, 0, 0, 30, 0, 40]).expect("a plate");
        assert_eq!(model.median_deviation(), None);
        assert_eq!([0, 1, 2].map(|column| model.gradient(column, 0)), [0.0, 50.0, 50.0]);
    }
}
