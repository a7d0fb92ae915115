//! YUV planes to red, green, blue, in integers, so that a film gives the same bytes everywhere.
//!
//! The matrix is BT.601's: YUV4MPEG2 does not say which one a film was made with, and background
//! and film go through the same one. Colour samples are repeated, not interpolated: the camera
//! never had more of them.

use super::y4m::{Header, Range};

/// 16.16 fixed-point factors of one range.
struct Factors {
    luma: i32,
    luma_offset: i32,
    red_v: i32,
    green_u: i32,
    green_v: i32,
    blue_u: i32,
}

const LIMITED: Factors = Factors {
    luma: 76_309,
    luma_offset: 16,
    red_v: 104_597,
    green_u: 25_675,
    green_v: 53_279,
    blue_u: 132_201,
};
const FULL: Factors = Factors {
    luma: 65_536,
    luma_offset: 0,
    red_v: 91_881,
    green_u: 22_554,
    green_v: 46_802,
    blue_u: 116_130,
};

/// Turns one frame's planes (Y, U, V; `header.frame_bytes()` bytes) into `rgb`, three bytes a
/// pixel, row by row; `rgb` is resized to fit.
pub fn rgb_from_planes(header: &Header, planes: &[u8], rgb: &mut Vec<u8>) {
    debug_assert_eq!(planes.len(), header.frame_bytes());
    let factors = match header.range {
        Range::Limited => &LIMITED,
        Range::Full => &FULL,
    };
    let width = header.width as usize;
    let (luma_bytes, chroma_bytes) = header.plane_bytes();
    let (luma, colour) = planes.split_at(luma_bytes);
    rgb.resize(luma_bytes * 3, 0);
    let rows = rgb.chunks_exact_mut(width * 3).zip(luma.chunks_exact(width));
    let Some((across, down)) = header.chroma.shifts() else {
        for (rgb, luma) in rows {
            row(factors, 0, luma, std::iter::repeat((128, 128)), rgb);
        }
        return;
    };
    let (u, v) = colour.split_at(chroma_bytes);
    let chroma_width = width.div_ceil(1 << across);
    for (y, (rgb, luma)) in rows.enumerate() {
        let start = (y >> down) * chroma_width;
        let samples = start..start + chroma_width;
        let pairs = u[samples.clone()].iter().copied().zip(v[samples].iter().copied());
        match across {
            0 => row(factors, 0, luma, pairs, rgb),
            1 => row(factors, 1, luma, pairs, rgb),
            _ => row(factors, 2, luma, pairs, rgb),
        }
    }
}

/// One row; each colour sample covers `1 << shift` pixels.
#[inline(always)]
fn row(factors: &Factors, shift: u32, luma: &[u8], colours: impl Iterator<Item = (u8, u8)>, rgb: &mut [u8]) {
    let run = 1 << shift;
    for ((rgb, luma), (u, v)) in rgb.chunks_mut(3 * run).zip(luma.chunks(run)).zip(colours) {
        let (u, v) = (i32::from(u) - 128, i32::from(v) - 128);
        let red = factors.red_v * v;
        let green = -factors.green_u * u - factors.green_v * v;
        let blue = factors.blue_u * u;
        for (rgb, &luma) in rgb.chunks_exact_mut(3).zip(luma) {
            let grey = factors.luma * (i32::from(luma) - factors.luma_offset) + (1 << 15);
            rgb[0] = byte(grey + red);
            rgb[1] = byte(grey + green);
            rgb[2] = byte(grey + blue);
        }
    }
}

#[inline(always)]
fn byte(fixed: i32) -> u8 {
    // Clamped first, so the cast keeps the value.
    (fixed >> 16).clamp(0, 255) as u8
}

#[cfg(test)]
mod tests {
    use super::super::y4m::Chroma;
    use super::*;

    fn converted(width: u32, height: u32, chroma: Chroma, range: Range, planes: &[u8]) -> Vec<[u8; 3]> {
        let header = Header { width, height, rate: None, chroma, range };
        let mut rgb = vec![7; 1000];
        rgb_from_planes(&header, planes, &mut rgb);
        rgb.chunks_exact(3).map(|rgb| [rgb[0], rgb[1], rgb[2]]).collect()
    }

    #[test]
    fn black_and_white_honour_the_range() {
        assert_eq!(converted(2, 1, Chroma::Mono, Range::Limited, &[16, 235]), [[0; 3], [255; 3]]);
        assert_eq!(converted(2, 1, Chroma::Mono, Range::Full, &[0, 255]), [[0; 3], [255; 3]]);
        assert_eq!(converted(2, 1, Chroma::Mono, Range::Limited, &[0, 255]), [[0; 3], [255; 3]]);
    }

    #[test]
    fn every_colour_is_within_one_of_the_formula_in_floats() {
        let mut worst: f64 = 0.0;
        for range in [Range::Limited, Range::Full] {
            for y in (0..=255).step_by(5) {
                for u in (0..=255).step_by(15) {
                    for v in (0..=255).step_by(15) {
                        let (l, c, offset) = match range {
                            Range::Limited => (255.0 / 219.0, 255.0 / 224.0, 16.0),
                            Range::Full => (1.0, 1.0, 0.0),
                        };
                        let grey = l * (f64::from(y) - offset);
                        let (cb, cr) = (c * (f64::from(u) - 128.0), c * (f64::from(v) - 128.0));
                        let expected =
                            [grey + 1.402 * cr, grey - 0.344_136 * cb - 0.714_136 * cr, grey + 1.772 * cb];
                        let planes = [y as u8, u as u8, v as u8];
                        let found = converted(1, 1, Chroma::C444, range, &planes)[0];
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
        for (chroma, across, down) in
            [(Chroma::C420, 1, 1), (Chroma::C422, 1, 0), (Chroma::C411, 2, 0), (Chroma::C444, 0, 0)]
        {
            let (columns, rows) = (5usize.div_ceil(1 << across), 3usize.div_ceil(1 << down));
            let mut planes = vec![100; 15];
            planes.extend(vec![128; columns * rows]);
            planes.extend((0..columns * rows).map(|i| 128 + 2 * i as u8));
            let rgb = converted(5, 3, chroma, Range::Full, &planes);
            for y in 0..3 {
                for x in 0..5 {
                    let v = 2.0 * ((y >> down) * columns + (x >> across)) as f64;
                    assert_eq!(
                        f64::from(rgb[y * 5 + x][0]),
                        (100.0 + 1.402 * v).round(),
                        "{chroma:?} {x} {y}"
                    );
                }
            }
        }
    }
}
