//! Decoders of film and images, for [`crate::fuzz`].

use std::io::Cursor;
use std::path::Path;

use hull::Rig;
use segment::mask::MaskFilm;

use super::files::{COLOUR, decode};
use super::film::Fit;
use super::y4m::Reader;
use super::{Image, ImageKind};

/// A film: its frames are whole, and no more than the bytes hold.
pub fn y4m(bytes: &[u8]) {
    let mut reader = match Reader::new(bytes) {
        Ok(reader) => reader,
        Err(error) => return assert!(!error.to_string().contains('\n'), "an error of one line: {error}"),
    };
    let (header, mut planes, mut total) = (*reader.header(), Vec::new(), 0);
    assert!(header.format().is_ok(), "a size that frames may have: {header:?}");
    while let Ok(true) = reader.read(&mut planes) {
        assert_eq!(planes.len(), header.frame_bytes(), "a whole frame");
        total += planes.len();
    }
    assert!(total <= bytes.len(), "{total} bytes of {}", bytes.len());
    assert!(planes.capacity() <= 2 * bytes.len().max(1 << 12), "memory by what came: {}", planes.capacity());
}

/// An image file, as picture and as mask of a camera of 16 × 12 pixels: of that size, or refused.
pub fn image(bytes: &[u8]) {
    let Ok(rig) = Rig::from_toml(CAMERA) else { return };
    let fit = Fit::new(&rig.cameras()[0]);
    for (kind, channels) in [(COLOUR, 3), (ImageKind::Mask, 1)] {
        let mut image = Image::default();
        if decode(Cursor::new(bytes), Path::new("image"), kind, &mut MaskFilm::default(), &fit, &mut image)
            .is_ok()
        {
            assert_eq!((image.width, image.height, image.kind), (16, 12, kind));
            assert_eq!(image.data.len(), 16 * 12 * channels, "a whole image");
            assert!(kind == COLOUR || image.data.iter().all(|&value| value <= 1), "a byte of 0 or 1 a pixel");
        }
    }
}

const CAMERA: &str = "[cam_0]\nname = \"cam\"\nsize = [ 16, 12 ]\nmatrix = [ [ 10.0, 0.0, 8.0 ], [ 0.0, 10.0, 6.0 ], \
    [ 0.0, 0.0, 1.0 ] ]\ndistortions = [ ]\nrotation = [ 0.0, 0.0, 0.0 ]\ntranslation = [ 0.0, 0.0, 1.0 ]\n";
