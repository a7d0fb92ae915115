//! The change of exposure between the model and a frame.
//!
//! Per channel (or over all), the median over a grid of pixels of the ratio between frame and model. The person
//! covers less than half of the image, so the median is a ratio of background pixels. It is estimated from the
//! frame alone, so that a frame's silhouette does not depend on the frames before it.

use crate::settings::GainMode;

/// Gains are in units of 1/1024.
const ONE: usize = 1024;

/// Frames more than four times as bright as the model, or under a quarter, are not compensated.
const BINS: usize = 4 * ONE;

/// Pixels looked at per channel: the median of 10,000 is good to a few thousandths.
const SAMPLES: usize = 10_000;

/// Gains closer to one than this are left alone: four levels at white, well under any threshold.
const STILL: usize = ONE / 64;

/// Ratios of darker levels are too coarse, those of brighter ones hit the ceiling.
const USABLE: std::ops::RangeInclusive<u8> = 32..=235;

/// Maps the levels of a frame to those the model would have seen, per channel.
#[derive(Clone, Debug)]
pub(crate) struct Tones {
    tables: [[u8; 256]; 3],
    gains: [usize; 3],
    histogram: Vec<u32>,
}

impl Tones {
    pub(crate) fn new() -> Tones {
        let identity = std::array::from_fn(|level| level as u8);
        Tones { tables: [identity; 3], gains: [ONE; 3], histogram: vec![0; BINS] }
    }

    /// Estimates the gains of a frame over the model, both RGB triples.
    pub(crate) fn estimate(&mut self, mode: GainMode, rgb: &[u8], mean: &[u8]) {
        self.gains = match mode {
            GainMode::Off => [ONE; 3],
            GainMode::Brightness => [self.median_gain(rgb, mean, &[0, 1, 2]); 3],
            GainMode::Colour => [0, 1, 2].map(|channel| self.median_gain(rgb, mean, &[channel])),
        };
        for (table, gain) in self.tables.iter_mut().zip(self.gains) {
            for (level, tone) in table.iter_mut().enumerate() {
                *tone = ((level * ONE + gain / 2) / gain).min(255) as u8;
            }
        }
    }

    /// How much brighter than the model the frame is, per channel.
    pub(crate) fn gains(&self) -> [f64; 3] {
        self.gains.map(|gain| gain as f64 / ONE as f64)
    }

    /// The row as the model would have seen it, or the row itself if nothing changed.
    pub(crate) fn apply<'a>(&self, row: &'a [u8], toned: &'a mut [u8]) -> &'a [u8] {
        if self.gains == [ONE; 3] {
            return row;
        }
        let [red, green, blue] = &self.tables;
        for (to, from) in toned.chunks_exact_mut(3).zip(row.chunks_exact(3)) {
            to[0] = red[usize::from(from[0])];
            to[1] = green[usize::from(from[1])];
            to[2] = blue[usize::from(from[2])];
        }
        toned
    }

    fn median_gain(&mut self, rgb: &[u8], mean: &[u8], channels: &[usize]) -> usize {
        self.histogram.fill(0);
        let pixels = rgb.len() / 3;
        // An odd step does not run down one column of an even image.
        let step = 3 * ((pixels / SAMPLES) | 1);
        let mut count = 0u32;
        for at in (0..rgb.len()).step_by(step) {
            for channel in channels {
                let (level, model) = (rgb[at + channel], mean[at + channel]);
                if !USABLE.contains(&model) || !USABLE.contains(&level) {
                    continue;
                }
                let (level, model) = (usize::from(level), usize::from(model));
                let ratio = (level * ONE + model / 2) / model;
                if ratio < BINS {
                    self.histogram[ratio] += 1;
                    count += 1;
                }
            }
        }
        let mut below = 0;
        let median = self.histogram.iter().position(|&bin| {
            below += bin;
            2 * below >= count
        });
        match median {
            // Too few pixels in range (a black or burnt frame) say nothing of the exposure.
            Some(median) if count >= 16 && median >= ONE / 4 && median.abs_diff(ONE) > STILL => median,
            _ => ONE,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_darker_frame_with_a_person_in_it_is_brought_back() {
        let mean: Vec<u8> = (0..3 * 40_000usize).map(|at| 60 + (at % 150) as u8).collect();
        let frame: Vec<u8> = (0..mean.len())
            .map(|at| if at < mean.len() / 3 { 5 } else { (u32::from(mean[at]) * 4 / 5) as u8 })
            .collect();
        let mut tones = Tones::new();
        tones.estimate(GainMode::Colour, &frame, &mean);
        assert!(tones.gains().iter().all(|gain| (gain - 0.8).abs() < 0.01), "{:?}", tones.gains());
        let mut toned = vec![0; 300];
        let end = frame.len() - 300;
        let back = tones.apply(&frame[end..], &mut toned);
        assert!(back.iter().zip(&mean[end..]).all(|(&back, &mean)| back.abs_diff(mean) <= 3));
    }

    #[test]
    fn off_and_black_frames_change_nothing() {
        let mean = vec![100; 3000];
        let mut tones = Tones::new();
        for (mode, frame) in [(GainMode::Off, vec![50; 3000]), (GainMode::Brightness, vec![0; 3000])] {
            tones.estimate(mode, &frame, &mean);
            assert_eq!(tones.gains(), [1.0; 3]);
        }
    }
}
