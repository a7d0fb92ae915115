//! A part of a frame, in the frame's own layout.

use crate::layout::{Format, Layout};

/// Sides of a part begin at multiples of this: whole colour samples of every layout.
pub const CROP_GRID: u32 = 4;

impl Format {
    /// Copies the part that begins at `left`, `top` (multiples of [`CROP_GRID`]) and is `width` by `height`
    /// pixels (from 1 to what is left of the image) out of a frame; `part` is resized to fit. Returns the part's
    /// own format.
    ///
    /// # Panics
    /// If the part does not lie so, or `frame` does not hold a frame.
    pub fn crop(self, frame: &[u8], [left, top, width, height]: [u32; 4], part: &mut Vec<u8>) -> Format {
        assert_eq!(frame.len(), self.frame_bytes(), "one frame");
        assert!(left % CROP_GRID == 0 && top % CROP_GRID == 0, "parts begin with whole colour samples");
        assert!(left + width <= self.width() && top + height <= self.height(), "parts lie in the image");
        let format =
            Format::new(self.layout(), width, height).expect("as large as a part of an image can be");
        part.clear();
        part.reserve(format.frame_bytes());
        let mut copy =
            |begin: usize, stride: usize, column_bytes: usize, row_bytes: usize, rows: usize, top: usize| {
                for row in top..top + rows {
                    let at = begin + row * stride + column_bytes;
                    part.extend_from_slice(&frame[at..at + row_bytes]);
                }
            };
        let (left, top) = (left as usize, top as usize);
        let row_bytes = format.first_row_bytes();
        let pixel_bytes = match self.layout() {
            Layout::Rgb => 3,
            Layout::Yuyv(_) | Layout::Uyvy(_) => 2,
            Layout::Planar(..) | Layout::Nv12(_) => 1,
        };
        copy(0, self.first_row_bytes(), pixel_bytes * left, row_bytes, format.rows(), top);
        let (first, colour) = self.plane_bytes();
        if let (Layout::Planar(..) | Layout::Nv12(_), Some((across, down))) = (self.layout(), self.shifts()) {
            // Pairs of NV12 stand where planes have single samples.
            let (planes, sample) = if matches!(self.layout(), Layout::Nv12(_)) { (1, 2) } else { (2, 1) };
            let columns = |format: Format| sample * format.columns().div_ceil(1 << across);
            let rows = format.rows().div_ceil(1 << down);
            for plane in 0..planes {
                let begin = first + plane * colour;
                copy(begin, columns(self), sample * (left >> across), columns(format), rows, top >> down);
            }
        }
        format
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::layout::tests::LAYOUTS;
    use crate::{from_rgb, to_rgb};

    #[test]
    fn a_part_shows_what_the_whole_shows_there() {
        let (width, height) = (23, 15);
        let rgb: Vec<u8> = (0..3 * width * height).map(|at| (at * 37 % 251) as u8).collect();
        for layout in LAYOUTS {
            let format = Format::new(layout, width, height).expect("size");
            let (mut frame, mut whole) = (Vec::new(), Vec::new());
            from_rgb(&rgb, format, &mut frame);
            to_rgb(&frame, format, &mut whole);
            for rect in [[0, 0, 23, 15], [4, 8, 8, 4], [8, 4, 15, 11], [20, 12, 3, 3], [12, 4, 5, 7]] {
                let mut part = Vec::new();
                let part_format = format.crop(&frame, rect, &mut part);
                assert_eq!(part.len(), part_format.frame_bytes(), "{layout:?} {rect:?}");
                let mut found = Vec::new();
                to_rgb(&part, part_format, &mut found);
                let [left, top, across, down] = rect.map(|side| side as usize);
                for row in 0..down {
                    let begin = 3 * ((top + row) * width as usize + left);
                    let expected = &whole[begin..begin + 3 * across];
                    assert_eq!(
                        &found[3 * row * across..3 * (row + 1) * across],
                        expected,
                        "{layout:?} {rect:?}"
                    );
                }
            }
        }
    }
}
