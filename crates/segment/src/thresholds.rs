//! The low threshold of every pixel: what noise and contours of the background must bear.

use crate::kernel::{BLOCK, row_channels};
use crate::metric::{Channels, Metric};
use crate::model::BackgroundModel;
use crate::settings::SegmentSettings;

/// The least low threshold, levels: the rounding of cameras and codecs alone reaches it.
const LEAST_LOW: f64 = 15.0;

/// The most that is estimated from the noise of a clip.
const MOST_LOW: f64 = 30.0;

/// The low threshold of a single picture, of whose noise nothing is known.
const PLATE_LOW: f64 = 20.0;

/// Low thresholds, levels, row by row.
pub(crate) fn low_thresholds(settings: &SegmentSettings, model: &BackgroundModel) -> Vec<u8> {
    let floor = settings.low.unwrap_or_else(|| {
        model.median_deviation().map_or(PLATE_LOW, |deviation| (6.0 * deviation).clamp(LEAST_LOW, MOST_LOW))
    });
    let (width, height) = (model.format().width(), model.format().height());
    let mut thresholds = Vec::with_capacity(model.format().pixels());
    let mut contours = Contours::new(model);
    for row in 0..height {
        contours.move_to(row as usize);
        thresholds.extend((0..width).map(|column| {
            let noise = settings.sigma_factor * model.deviation(column, row);
            let edge = settings.edge_px * contours.gradient(column as usize);
            floor.max(noise).max(edge).round().min(255.0) as u8
        }));
    }
    thresholds
}

/// How much the mean changes from pixel to pixel.
struct Contours<'a> {
    model: &'a BackgroundModel,
    metric: Metric,
    /// The rows above, here and below.
    rows: [Vec<Channels>; 3],
    next: usize,
}

impl Contours<'_> {
    fn new(model: &BackgroundModel) -> Contours<'_> {
        let row = || vec![[[0; BLOCK]; 3]; model.format().columns().div_ceil(BLOCK)];
        let metric = Metric::of(model.format().layout());
        let mut contours = Contours { model, metric, rows: [row(), row(), row()], next: 0 };
        contours.take();
        contours
    }

    /// Reads the next row as the one below.
    fn take(&mut self) {
        self.rows.rotate_left(1);
        let row = self.next.min(self.model.format().rows() - 1);
        row_channels(self.metric, self.model.format(), self.model.mean(), row, &mut self.rows[2]);
        self.next += 1;
    }

    /// Rows must be taken in order, from the first.
    fn move_to(&mut self, row: usize) {
        self.take();
        if row == 0 {
            let [above, here, _] = &mut self.rows;
            above.copy_from_slice(here);
        }
    }

    fn colour(&self, row: usize, column: usize) -> [i32; 3] {
        self.rows[row][column / BLOCK].map(|channel| i32::from(channel[column % BLOCK]))
    }

    /// The largest distance from a pixel's colour to its four neighbours', levels per pixel.
    fn gradient(&self, column: usize) -> f64 {
        let here = self.colour(1, column);
        let last = self.model.format().columns() - 1;
        let neighbours = [
            self.colour(1, column.saturating_sub(1)),
            self.colour(1, (column + 1).min(last)),
            self.colour(0, column),
            self.colour(2, column),
        ];
        let square = |there: [i32; 3]| self.metric.square(std::array::from_fn(|c| there[c] - here[c]));
        let largest = neighbours.into_iter().map(square).max().unwrap_or(0);
        (f64::from(largest) / f64::from(self.metric.unit)).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::layout::{Format, Layout};

    #[test]
    fn contours_raise_the_threshold_of_both_their_sides() {
        let format = Format::new(Layout::Rgb, 3, 3).expect("size");
        let mut plate = [0; 27];
        plate[24..].copy_from_slice(&[90, 0, 120]);
        let model = BackgroundModel::from_plate(format, &plate).expect("a plate");
        let settings = SegmentSettings { edge_px: 0.5, ..SegmentSettings::default() };
        assert_eq!(low_thresholds(&settings, &model), [20, 20, 20, 20, 20, 75, 20, 75, 75]);
    }
}
