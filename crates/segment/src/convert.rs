//! RGB to YUV and back, in integers, so that a frame gives the same bytes everywhere.
//!
//! The matrix is BT.601's: neither cameras nor YUV4MPEG2 say which one a film was made with, and
//! background and film go through the same one. This is for pictures that come in another layout than
//! the film (plates, the studio) and for a few samples a frame; film itself stays as it is.

use crate::layout::{Format, Layout, Range};

/// 16.16 fixed-point factors of one range: to RGB, and from it.
struct Factors {
    luma: i32,
    luma_offset: i32,
    red_v: i32,
    green_u: i32,
    green_v: i32,
    blue_u: i32,
    y: [i32; 3],
    u: [i32; 3],
    v: [i32; 3],
}

const LIMITED: Factors = Factors {
    luma: 76_309,
    luma_offset: 16,
    red_v: 104_597,
    green_u: 25_675,
    green_v: 53_279,
    blue_u: 132_201,
    y: [16_829, 33_039, 6_416],
    u: [-9_714, -19_070, 28_784],
    v: [28_784, -24_103, -4_681],
};
const FULL: Factors = Factors {
    luma: 65_536,
    luma_offset: 0,
    red_v: 91_881,
    green_u: 22_554,
    green_v: 46_802,
    blue_u: 116_130,
    y: [19_595, 38_470, 7_471],
    u: [-11_059, -21_709, 32_768],
    v: [32_768, -27_439, -5_329],
};

const HALF: i32 = 1 << 15;

fn factors(range: Range) -> &'static Factors {
    match range {
        Range::Limited => &LIMITED,
        Range::Full => &FULL,
    }
}

impl Layout {
    /// The range of a YUV layout.
    pub(crate) fn range(self) -> Option<Range> {
        match self {
            Layout::Rgb => None,
            Layout::Planar(_, range) | Layout::Nv12(range) | Layout::Yuyv(range) | Layout::Uyvy(range) => {
                Some(range)
            }
        }
    }
}

/// Turns one YUV colour into red, green, blue.
pub(crate) fn rgb_of_yuv(range: Range, [y, u, v]: [u8; 3]) -> [u8; 3] {
    let factors = factors(range);
    let (u, v) = (i32::from(u) - 128, i32::from(v) - 128);
    let grey = factors.luma * (i32::from(y) - factors.luma_offset) + HALF;
    [
        byte(grey + factors.red_v * v),
        byte(grey - factors.green_u * u - factors.green_v * v),
        byte(grey + factors.blue_u * u),
    ]
}

fn luma(factors: &Factors, rgb: [u8; 3]) -> u8 {
    byte(dot(factors.y, rgb) + (factors.luma_offset << 16) + HALF)
}

fn chroma(factors: &Factors, rgb: [u8; 3]) -> (u8, u8) {
    let one = |row| byte(dot(row, rgb) + (128 << 16) + HALF);
    (one(factors.u), one(factors.v))
}

fn dot(row: [i32; 3], rgb: [u8; 3]) -> i32 {
    row.iter().zip(rgb).map(|(&factor, level)| factor * i32::from(level)).sum()
}

fn byte(fixed: i32) -> u8 {
    // Clamped first, so the cast keeps the value.
    (fixed >> 16).clamp(0, 255) as u8
}

/// Writes a picture of RGB triples, of the format's size, in the format's layout; `bytes` is resized to
/// fit. A colour sample is the mean of the pixels that share it.
///
/// # Panics
/// If `rgb` does not hold three bytes for every pixel.
pub fn from_rgb(rgb: &[u8], format: Format, bytes: &mut Vec<u8>) {
    assert_eq!(rgb.len(), 3 * format.pixels(), "three bytes a pixel");
    bytes.clear();
    bytes.resize(format.frame_bytes(), 0);
    let Some(range) = format.layout().range() else {
        bytes.copy_from_slice(rgb);
        return;
    };
    let factors = factors(range);
    let colour = |column: usize, row: usize| {
        let at = 3 * (row * format.columns() + column);
        [rgb[at], rgb[at + 1], rgb[at + 2]]
    };
    for row in 0..format.rows() {
        for column in 0..format.columns() {
            bytes[format.channels(column, row).0] = luma(factors, colour(column, row));
        }
    }
    if let Layout::Yuyv(_) | Layout::Uyvy(_) = format.layout() {
        repeat_last_luma(format, bytes);
    }
    let Some((across, down)) = format.shifts() else { return };
    for top in (0..format.rows()).step_by(1 << down) {
        for left in (0..format.columns()).step_by(1 << across) {
            let rows = top..(top + (1 << down)).min(format.rows());
            let columns = left..(left + (1 << across)).min(format.columns());
            let shared = rows.flat_map(|row| columns.clone().map(move |column| colour(column, row)));
            if let (_, Some((u, v))) = format.channels(left, top) {
                (bytes[u], bytes[v]) = chroma(factors, mean(shared));
            }
        }
    }
}

/// Packed rows of odd width end in a brightness that no pixel has.
fn repeat_last_luma(format: Format, bytes: &mut [u8]) {
    if format.columns().is_multiple_of(2) {
        return;
    }
    for row in 0..format.rows() {
        let last = format.channels(format.columns() - 1, row).0;
        bytes[last + 2] = bytes[last];
    }
}

fn mean(colours: impl Iterator<Item = [u8; 3]>) -> [u8; 3] {
    let (mut sums, mut count) = ([0u32; 3], 0);
    for colour in colours {
        sums.iter_mut().zip(colour).for_each(|(sum, level)| *sum += u32::from(level));
        count += 1;
    }
    sums.map(|sum| ((sum + count / 2) / count.max(1)) as u8)
}

/// Writes a frame as RGB triples; `rgb` is resized to fit. Colour samples are repeated, not
/// interpolated: the camera never had more of them.
///
/// # Panics
/// If `bytes` is not of the format's length.
pub fn to_rgb(bytes: &[u8], format: Format, rgb: &mut Vec<u8>) {
    assert_eq!(bytes.len(), format.frame_bytes(), "a frame of the format");
    rgb.clear();
    rgb.reserve(3 * format.pixels());
    for row in 0..format.rows() {
        for column in 0..format.columns() {
            rgb.extend_from_slice(&rgb_at(bytes, format, column, row));
        }
    }
}

/// One pixel of a frame as red, green, blue.
pub(crate) fn rgb_at(bytes: &[u8], format: Format, column: usize, row: usize) -> [u8; 3] {
    let (first, colour) = format.channels(column, row);
    let (second, third) = colour.map_or((128, 128), |(u, v)| (bytes[u], bytes[v]));
    match format.layout().range() {
        None => [bytes[first], second, third],
        Some(range) => rgb_of_yuv(range, [bytes[first], second, third]),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::layout::Sampling;
    use crate::layout::tests::LAYOUTS;

    #[test]
    fn black_and_white_honour_the_range() {
        let rgb = |range, y| rgb_of_yuv(range, [y, 128, 128]);
        assert_eq!([16, 235].map(|y| rgb(Range::Limited, y)), [[0; 3], [255; 3]]);
        assert_eq!([0, 255].map(|y| rgb(Range::Full, y)), [[0; 3], [255; 3]]);
        assert_eq!([0, 255].map(|y| rgb(Range::Limited, y)), [[0; 3], [255; 3]]);
    }

    #[test]
    fn every_colour_is_within_one_of_the_formula_in_floats() {
        let mut worst: f64 = 0.0;
        for range in [Range::Limited, Range::Full] {
            let (l, c, offset) = match range {
                Range::Limited => (255.0 / 219.0, 255.0 / 224.0, 16.0),
                Range::Full => (1.0, 1.0, 0.0),
            };
            for y in (0..=255).step_by(5) {
                for u in (0..=255).step_by(15) {
                    for v in (0..=255).step_by(15) {
                        let grey = l * (f64::from(y) - offset);
                        let (cb, cr) = (c * (f64::from(u) - 128.0), c * (f64::from(v) - 128.0));
                        let expected =
                            [grey + 1.402 * cr, grey - 0.344_136 * cb - 0.714_136 * cr, grey + 1.772 * cb];
                        let found = rgb_of_yuv(range, [y as u8, u as u8, v as u8]);
                        for (found, expected) in found.into_iter().zip(expected) {
                            worst = worst.max((f64::from(found) - expected.clamp(0.0, 255.0)).abs());
                        }
                    }
                }
            }
        }
        assert!(worst < 0.51, "off by {worst}");
    }

    #[test]
    fn colour_samples_reach_the_pixels_they_stand_for() {
        // 5 x 3 pixels of one brightness; every colour sample has its own red.
        for (sampling, across, down) in
            [(Sampling::C420, 1, 1), (Sampling::C422, 1, 0), (Sampling::C411, 2, 0), (Sampling::C444, 0, 0)]
        {
            let (columns, rows) = (5usize.div_ceil(1 << across), 3usize.div_ceil(1 << down));
            let mut planes = vec![100; 15];
            planes.extend(vec![128; columns * rows]);
            planes.extend((0..columns * rows).map(|i| 128 + 2 * i as u8));
            let mut rgb = Vec::new();
            let format = Format::new(Layout::Planar(sampling, Range::Full), 5, 3).expect("size");
            to_rgb(&planes, format, &mut rgb);
            for (row, column) in (0..3).flat_map(|row| (0..5).map(move |column| (row, column))) {
                let v = 2.0 * ((row >> down) * columns + (column >> across)) as f64;
                let red = f64::from(rgb[3 * (row * 5 + column)]);
                assert_eq!(red, (100.0 + 1.402 * v).round(), "{sampling:?} {column} {row}");
            }
        }
    }

    #[test]
    fn there_and_back_is_the_same_picture_but_for_rounding() {
        // Blocks of 4 x 2 pixels of one colour, so that no layout blurs them; colours within all ranges.
        let (width, height) = (11u32, 5u32);
        let mut rgb = Vec::new();
        for (row, column) in (0..height).flat_map(|row| (0..width).map(move |column| (row, column))) {
            let block = row / 2 * 3 + column / 4;
            rgb.extend([60 + 10 * block as u8, 200 - 12 * block as u8, 90 + 7 * block as u8]);
        }
        for layout in
            LAYOUTS.into_iter().filter(|layout| !matches!(layout, Layout::Planar(Sampling::Mono, _)))
        {
            let format = Format::new(layout, width, height).expect("size");
            let (mut bytes, mut back) = (Vec::new(), Vec::new());
            from_rgb(&rgb, format, &mut bytes);
            to_rgb(&bytes, format, &mut back);
            let worst = rgb.iter().zip(&back).map(|(a, b)| a.abs_diff(*b)).max();
            assert!(worst <= Some(2), "{layout:?}: off by {worst:?}");
        }
    }
}
