//! Slow and obvious twins of the probes, for tests and as the baseline of benchmarks.

pub mod brute;
pub mod literal;

use crate::camera::{Camera, Pixel};

/// One camera with its mask, a byte a pixel, row by row: not zero is foreground.
#[derive(Clone, Debug)]
pub struct DenseView {
    /// The camera.
    pub camera: Camera,
    /// One byte a pixel, row by row: not zero is foreground.
    pub mask: Vec<u8>,
    /// Static occluders, a byte a pixel, if there are any.
    pub ignored: Option<Vec<u8>>,
}

impl DenseView {
    fn at(&self, mask: &[u8], pixel: Pixel) -> bool {
        mask[pixel.row as usize * self.camera.width() as usize + pixel.column as usize] != 0
    }

    /// True on foreground; false off the image.
    pub fn is_foreground(&self, pixel: Pixel) -> bool {
        self.camera.holds(pixel) && self.at(&self.mask, pixel)
    }

    /// True on an ignored pixel; false off the image.
    pub fn is_ignored(&self, pixel: Pixel) -> bool {
        self.camera.holds(pixel) && self.ignored.as_ref().is_some_and(|ignored| self.at(ignored, pixel))
    }
}
