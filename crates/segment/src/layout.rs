//! How the bytes of a frame are laid out: what cameras, films and pictures hand over.

use std::fmt;

use thiserror::Error;

/// Which bytes of a YUV frame are black and white.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Range {
    /// 16 to 235 (colour 16 to 240): what cameras and films carry unless they say otherwise.
    Limited,
    /// 0 to 255.
    Full,
}

/// How many pixels of a YUV frame share a colour sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Sampling {
    /// No colour, brightness only.
    Mono,
    /// 2 × 2 pixels.
    C420,
    /// 2 × 1 pixels.
    C422,
    /// 4 × 1 pixels.
    C411,
    /// Every pixel has its own.
    C444,
}

impl Sampling {
    /// How many pixels share a colour sample, as powers of two: across and down; `None` for mono.
    pub fn shifts(self) -> Option<(u32, u32)> {
        match self {
            Sampling::Mono => None,
            Sampling::C420 => Some((1, 1)),
            Sampling::C422 => Some((1, 0)),
            Sampling::C411 => Some((2, 0)),
            Sampling::C444 => Some((0, 0)),
        }
    }
}

/// The order of a frame's bytes: rows from the top, without padding between them. Sides that a colour
/// sample does not divide are rounded up.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Layout {
    /// Triples of red, green, blue.
    Rgb,
    /// A plane of Y, then one of U, then one of V: I420 and all that YUV4MPEG2 carries.
    Planar(Sampling, Range),
    /// A plane of Y, then one of pairs U, V for 2 × 2 pixels.
    Nv12(Range),
    /// Quadruples Y, U, Y, V for two pixels.
    Yuyv(Range),
    /// Quadruples U, Y, V, Y for two pixels.
    Uyvy(Range),
}

impl fmt::Display for Layout {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Layout::Rgb => "RGB",
            Layout::Planar(Sampling::Mono, _) => "mono",
            Layout::Planar(Sampling::C420, _) => "planar YUV 4:2:0",
            Layout::Planar(Sampling::C422, _) => "planar YUV 4:2:2",
            Layout::Planar(Sampling::C411, _) => "planar YUV 4:1:1",
            Layout::Planar(Sampling::C444, _) => "planar YUV 4:4:4",
            Layout::Nv12(_) => "NV12",
            Layout::Yuyv(_) => "YUYV",
            Layout::Uyvy(_) => "UYVY",
        })
    }
}

/// An image size that no camera has.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[error("image of {width} x {height}, expected 1 to {max} pixels a side", max = hull::camera::MAX_SIDE_PIXELS)]
pub struct SizeError {
    /// Pixels across.
    pub width: u32,
    /// Pixels down.
    pub height: u32,
}

/// Size and layout: what the bytes of a camera's frames mean.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Format {
    width: u32,
    height: u32,
    layout: Layout,
}

impl Format {
    /// Frames of that size, both sides from 1 to [`hull::camera::MAX_SIDE_PIXELS`].
    pub fn new(layout: Layout, width: u32, height: u32) -> Result<Format, SizeError> {
        let sides = 1..=hull::camera::MAX_SIDE_PIXELS;
        if !sides.contains(&width) || !sides.contains(&height) {
            return Err(SizeError { width, height });
        }
        Ok(Format { width, height, layout })
    }

    /// Pixels across.
    pub fn width(self) -> u32 {
        self.width
    }

    /// Pixels down.
    pub fn height(self) -> u32 {
        self.height
    }

    /// The order of the bytes.
    pub fn layout(self) -> Layout {
        self.layout
    }

    /// The same size in another layout.
    pub fn with_layout(self, layout: Layout) -> Format {
        Format { layout, ..self }
    }

    /// Bytes of one frame.
    pub fn frame_bytes(self) -> usize {
        let (first, colour) = self.plane_bytes();
        first + 2 * colour
    }

    /// Pixels of one frame.
    pub(crate) fn pixels(self) -> usize {
        self.columns() * self.rows()
    }

    pub(crate) fn columns(self) -> usize {
        self.width as usize
    }

    pub(crate) fn rows(self) -> usize {
        self.height as usize
    }

    /// Bytes of the first plane (the only one of packed layouts), and of each of the two colour planes
    /// (half of the plane of pairs).
    pub(crate) fn plane_bytes(self) -> (usize, usize) {
        let colour = match (self.layout, self.shifts()) {
            (Layout::Planar(..) | Layout::Nv12(_), Some((across, down))) => {
                self.columns().div_ceil(1 << across) * self.rows().div_ceil(1 << down)
            }
            _ => 0,
        };
        (self.first_row_bytes() * self.rows(), colour)
    }

    /// Bytes of a row of the first plane.
    pub(crate) fn first_row_bytes(self) -> usize {
        match self.layout {
            Layout::Rgb => 3 * self.columns(),
            Layout::Planar(..) | Layout::Nv12(_) => self.columns(),
            Layout::Yuyv(_) | Layout::Uyvy(_) => 4 * self.columns().div_ceil(2),
        }
    }

    /// How many pixels share a colour sample, as powers of two; `None` where there is none.
    pub(crate) fn shifts(self) -> Option<(u32, u32)> {
        match self.layout {
            Layout::Rgb => Some((0, 0)),
            Layout::Planar(sampling, _) => sampling.shifts(),
            Layout::Nv12(_) => Some((1, 1)),
            Layout::Yuyv(_) | Layout::Uyvy(_) => Some((1, 0)),
        }
    }

    /// Where the three channels of a pixel stand in a frame; colour's are `None` in a frame without.
    #[inline]
    pub(crate) fn channels(self, column: usize, row: usize) -> (usize, Option<(usize, usize)>) {
        let start = row * self.first_row_bytes();
        let (first, colour) = self.plane_bytes();
        match self.layout {
            Layout::Rgb => (start + 3 * column, Some((start + 3 * column + 1, start + 3 * column + 2))),
            Layout::Planar(sampling, _) => {
                let place = sampling.shifts().map(|(across, down)| {
                    let at = (row >> down) * self.columns().div_ceil(1 << across) + (column >> across);
                    (first + at, first + colour + at)
                });
                (start + column, place)
            }
            Layout::Nv12(_) => {
                let at = first + 2 * ((row / 2) * self.columns().div_ceil(2) + column / 2);
                (start + column, Some((at, at + 1)))
            }
            Layout::Yuyv(_) => {
                let pair = start + 4 * (column / 2);
                (start + 2 * column, Some((pair + 1, pair + 3)))
            }
            Layout::Uyvy(_) => {
                let pair = start + 4 * (column / 2);
                (start + 2 * column + 1, Some((pair, pair + 2)))
            }
        }
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// Every layout there is.
    pub(crate) const LAYOUTS: [Layout; 10] = [
        Layout::Rgb,
        Layout::Planar(Sampling::Mono, Range::Full),
        Layout::Planar(Sampling::C420, Range::Limited),
        Layout::Planar(Sampling::C422, Range::Full),
        Layout::Planar(Sampling::C411, Range::Limited),
        Layout::Planar(Sampling::C444, Range::Limited),
        Layout::Nv12(Range::Limited),
        Layout::Nv12(Range::Full),
        Layout::Yuyv(Range::Limited),
        Layout::Uyvy(Range::Limited),
    ];

    #[test]
    fn odd_sides_round_colour_up() {
        let bytes = |layout| Format::new(layout, 5, 3).expect("size").frame_bytes();
        let expected = [45, 15, 15 + 12, 15 + 18, 15 + 12, 45, 15 + 12, 15 + 12, 36, 36];
        assert_eq!(LAYOUTS.map(bytes), expected);
    }

    #[test]
    fn every_byte_belongs_to_a_pixel_and_none_lies_outside() {
        for layout in LAYOUTS {
            let format = Format::new(layout, 6, 4).expect("size");
            let mut seen = vec![0; format.frame_bytes()];
            for (row, column) in (0..4).flat_map(|row| (0..6).map(move |column| (row, column))) {
                let (first, colour) = format.channels(column, row);
                seen[first] += 1;
                if let Some((u, v)) = colour {
                    seen[u] += 1;
                    seen[v] += 1;
                }
            }
            // Four columns do not divide six: the last colour sample of 4:1:1 has but two pixels.
            assert!(seen.iter().all(|&pixels| [1, 2, 4].contains(&pixels)), "{layout:?}: {seen:?}");
        }
    }

    #[test]
    fn sizes_that_no_camera_has_are_refused() {
        let error = Format::new(Layout::Rgb, 0, 4).expect_err("no pixels").to_string();
        assert_eq!(error, "image of 0 x 4, expected 1 to 16384 pixels a side");
        assert!(Format::new(Layout::Rgb, 1, 16_385).is_err());
    }
}
