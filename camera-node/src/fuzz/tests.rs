#[path = "../../../tests/shared/corpora.rs"]
mod corpora;

use std::io::Cursor;

use image::{DynamicImage, GrayImage, ImageBuffer, ImageFormat, Luma, Rgb, RgbImage, Rgba, RgbaImage};

use super::{image, y4m};

#[test]
fn films() {
    let film = |header: &str, frame: &str, bytes: usize| {
        let planes: Vec<u8> = (0..bytes).map(|at| (at * 7) as u8).collect();
        let frame = [frame.as_bytes(), b"\n", &planes].concat();
        [header.as_bytes(), b"\n", &frame, &frame].concat()
    };
    let seeds = [
        film("YUV4MPEG2 W5 H3 F25:1 C420jpeg", "FRAME", 15 + 12),
        film("YUV4MPEG2 W4 H2 F30000:1001 Ip A1:1 C422 XYSCSS=422 XCOLORRANGE=FULL", "FRAME Ip", 16),
        film("YUV4MPEG2 W4 H2 F0:0 C411", "FRAME", 12),
        film("YUV4MPEG2 W2 H2 C444 XCOLORRANGE=LIMITED", "FRAME XCOLORRANGE=FULL", 12),
        film("YUV4MPEG2 W2 H2 Cmono", "FRAME", 4),
        film("YUV4MPEG2 W16384 H16384 C444", "FRAME", 100),
        b"YUV4MPEG2 W2 H2 C420p10\n".to_vec(),
        b"RIFF".to_vec(),
    ];
    corpora::run("y4m", y4m, &seeds);
}

#[test]
fn images() {
    fn grey(width: u32, height: u32) -> GrayImage {
        GrayImage::from_fn(width, height, |x, y| Luma([(x * y * 5) as u8]))
    }
    let rgb = RgbImage::from_fn(16, 12, |x, y| Rgb([x as u8 * 9, y as u8 * 9, 7]));
    let deep = ImageBuffer::from_fn(16, 12, |x, y| Luma([(x * y * 999) as u16]));
    let clear = RgbaImage::from_fn(16, 12, |x, y| Rgba([1, x as u8, y as u8, (x * y) as u8]));
    let images: [(DynamicImage, ImageFormat); 7] = [
        (grey(16, 12).into(), ImageFormat::Png),
        (rgb.clone().into(), ImageFormat::Png),
        (deep.into(), ImageFormat::Png),
        (clear.into(), ImageFormat::Png),
        (grey(17, 12).into(), ImageFormat::Png),
        (grey(16, 12).into(), ImageFormat::Jpeg),
        (rgb.into(), ImageFormat::Jpeg),
    ];
    let seeds = images.map(|(picture, format)| {
        let mut bytes = Cursor::new(vec![]);
        picture.write_to(&mut bytes, format).expect("written");
        bytes.into_inner()
    });
    corpora::run("image", image, &seeds);
}
