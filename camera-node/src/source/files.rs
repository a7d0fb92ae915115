//! Numbered image files: colour frames, or masks that are silhouettes already.

use std::fs::File;
use std::io::{BufRead, BufReader, Seek};
use std::path::{Path, PathBuf};

use hull::{Camera, Silhouette};
use image::metadata::Orientation;
use image::{DynamicImage, ImageDecoder, ImageFormat, ImageReader, Limits};
use segment::Layout;
use segment::mask::{Channels, MaskError, MaskFilm, MaskImage, Samples};

use super::config::FileConfig;
use super::film::Fit;
use super::jpeg;
use super::numbered;
use super::{Image, ImageKind, OpenContext, Source, SourceError, SourceFrame};

/// What pictures are decoded to.
pub const COLOUR: ImageKind = ImageKind::Colour(Layout::Rgb);

/// A film of one file per frame.
pub struct FileFrames {
    /// Numbers and files, ascending.
    frames: Vec<(u64, PathBuf)>,
    cursor: usize,
    kind: ImageKind,
    masks: MaskFilm,
    fit: Fit,
    fps: f64,
}

impl FileFrames {
    /// Lists the files, and of a run checks that their numbers are frames of film.
    pub fn open(
        config: &FileConfig,
        kind: ImageKind,
        camera: &Camera,
        context: &OpenContext,
    ) -> Result<FileFrames, SourceError> {
        let frames = numbered::frames(config)?;
        if context.is_run {
            for note in numbered::check(config, &frames, context.fps)? {
                tracing::warn!("camera {:?}: {}: {note}", camera.name(), config.path.display());
            }
        }
        let fit = Fit::new(camera);
        let masks = match kind {
            ImageKind::Mask => film_of(frames.iter().map(|(_, path)| path.as_path()), &fit),
            ImageKind::Colour(_) => MaskFilm::default(),
        };
        Ok(FileFrames { frames, cursor: 0, kind, masks, fit, fps: context.fps })
    }
}

impl Source for FileFrames {
    fn next(&mut self, at_least: u64, image: &mut Image) -> Result<Option<SourceFrame>, SourceError> {
        let rest = &self.frames[self.cursor..];
        let skipped = rest.partition_point(|(number, _)| *number < at_least);
        let Some((number, path)) = rest.get(skipped) else {
            self.cursor = self.frames.len();
            return Ok(None);
        };
        load(path, self.kind, &mut self.masks, &self.fit, image)?;
        self.cursor += skipped + 1;
        Ok(Some(SourceFrame::of_film(*number, self.fps)))
    }
}

/// Reads one image file that must have the camera's size; colours become RGB.
fn load(
    path: &Path,
    kind: ImageKind,
    masks: &mut MaskFilm,
    fit: &Fit,
    image: &mut Image,
) -> Result<(), SourceError> {
    let file = File::open(path).map_err(|error| SourceError::file(path, error))?;
    decode(BufReader::new(file), path, kind, masks, fit, image)
}

/// The same of a file's bytes; `path` is its name in messages.
pub(super) fn decode(
    bytes: impl BufRead + Seek,
    path: &Path,
    kind: ImageKind,
    masks: &mut MaskFilm,
    fit: &Fit,
    image: &mut Image,
) -> Result<(), SourceError> {
    let mut reader =
        ImageReader::new(bytes).with_guessed_format().map_err(|error| SourceError::file(path, error))?;
    let is_lossy = reader.format() == Some(ImageFormat::Jpeg);
    if is_lossy {
        // The decoder fills what is missing with grey.
        let mut bytes = reader.into_inner();
        let is_whole = jpeg::has_end(&mut bytes).and_then(|has_end| bytes.rewind().map(|()| has_end));
        if !is_whole.map_err(|error| SourceError::file(path, error))? {
            return Err(SourceError::file(
                path,
                "found no end of the JPEG, expected a whole file: it is cut off",
            ));
        }
        reader = ImageReader::with_format(bytes, ImageFormat::Jpeg);
    }
    reader.limits(limits(fit.size()));
    let mut decoder = reader.into_decoder().map_err(|error| SourceError::file(path, error))?;
    // Checked before anything of that size is decoded.
    fit.check(&path.display().to_string(), decoder.dimensions())?;
    let orientation = decoder.orientation().map_err(|error| SourceError::file(path, error))?;
    if orientation != Orientation::NoTransforms {
        let turned = orientation.to_exif();
        let problem = format!(
            "found orientation {turned} in its tag, expected 1: some programs would turn it, write it as it is seen"
        );
        return Err(SourceError::file(path, problem));
    }
    let decoded = DynamicImage::from_decoder(decoder).map_err(|error| SourceError::file(path, error))?;
    (image.width, image.height) = (decoded.width(), decoded.height());
    match kind {
        ImageKind::Colour(_) => (image.kind, image.data) = (COLOUR, decoded.into_rgb8().into_raw()),
        ImageKind::Mask => {
            image.kind = ImageKind::Mask;
            write_mask(&decoded, is_lossy, masks, &mut image.data)
                .map_err(|error| SourceError::file(path, error))?;
        }
    }
    Ok(())
}

/// The silhouette in one image file, of the camera's size.
pub fn read_silhouette(path: &Path, camera: &Camera) -> Result<Silhouette, SourceError> {
    MaskFiles::new(&[], camera).read(path)
}

/// The masks of one camera as files, for commands that read them without a node: a film of them means the same here.
pub struct MaskFiles {
    masks: MaskFilm,
    fit: Fit,
    image: Image,
}

impl MaskFiles {
    /// `files` are all of the camera's film.
    pub fn new(files: &[&Path], camera: &Camera) -> MaskFiles {
        let fit = Fit::new(camera);
        MaskFiles { masks: film_of(files.iter().copied(), &fit), fit, image: Image::default() }
    }

    /// The masks of the cameras of a rig, in its order, with the film of each. A film that does not tell what foreground
    /// is (shadows alone) is read as those of the others.
    pub fn of_room(cameras: &[Camera], films: &[Vec<&Path>]) -> Vec<MaskFiles> {
        let mut room: Vec<MaskFiles> =
            cameras.iter().zip(films).map(|(camera, files)| MaskFiles::new(files, camera)).collect();
        let told = MaskFilm::beside(&room.iter().map(|camera| camera.masks).collect::<Vec<MaskFilm>>());
        for camera in room.iter_mut().filter(|camera| !camera.masks.is_decided()) {
            camera.masks = told;
        }
        room
    }

    /// The silhouette in one of the files, of the camera's size.
    pub fn read(&mut self, path: &Path) -> Result<Silhouette, SourceError> {
        let MaskFiles { masks, fit, image } = self;
        load(path, ImageKind::Mask, masks, fit, image)?;
        Silhouette::from_mask(image.width, image.height, &image.data)
            .map_err(|error| SourceError::file(path, error))
    }
}

/// Looks at some masks, evenly over a film, until one tells what foreground is: which frames a run skips makes no
/// difference then.
fn film_of<'a>(files: impl ExactSizeIterator<Item = &'a Path>, fit: &Fit) -> MaskFilm {
    const MOST_LOOKED_AT: usize = 16;
    let step = files.len().div_ceil(MOST_LOOKED_AT).max(1);
    let (mut masks, mut image) = (MaskFilm::default(), Image::default());
    for path in files.step_by(step) {
        // An image that cannot be read is refused when it is used.
        let _ = load(path, ImageKind::Mask, &mut masks, fit, &mut image);
        if masks.is_decided() {
            break;
        }
    }
    masks
}

/// A decoded image as a mask, a byte a pixel.
fn write_mask(
    image: &DynamicImage,
    is_lossy: bool,
    masks: &mut MaskFilm,
    mask: &mut Vec<u8>,
) -> Result<(), MaskError> {
    let (channels, samples) = match image {
        DynamicImage::ImageLuma8(grey) => (Channels::Grey, Samples::Bytes(grey.as_raw())),
        DynamicImage::ImageLumaA8(grey) => (Channels::GreyAlpha, Samples::Bytes(grey.as_raw())),
        DynamicImage::ImageRgb8(rgb) => (Channels::Rgb, Samples::Bytes(rgb.as_raw())),
        DynamicImage::ImageRgba8(rgba) => (Channels::Rgba, Samples::Bytes(rgba.as_raw())),
        DynamicImage::ImageLuma16(grey) => (Channels::Grey, Samples::Words(grey.as_raw())),
        DynamicImage::ImageLumaA16(grey) => (Channels::GreyAlpha, Samples::Words(grey.as_raw())),
        DynamicImage::ImageRgb16(rgb) => (Channels::Rgb, Samples::Words(rgb.as_raw())),
        DynamicImage::ImageRgba16(rgba) => (Channels::Rgba, Samples::Words(rgba.as_raw())),
        // Neither PNG nor JPEG has any other samples.
        other => return write_mask(&other.to_rgba16().into(), is_lossy, masks, mask),
    };
    let (width, height) = (image.width(), image.height());
    masks.read(&MaskImage { width, height, channels, samples, is_lossy }, mask)
}

/// What decoding an image of this size may take: a colour profile may unpack to a thousand times its bytes.
fn limits((width, height): (u32, u32)) -> Limits {
    const BYTES_A_PIXEL: u64 = 16;
    const BYTES_BESIDE: u64 = 4 << 20;
    let mut limits = Limits::no_limits();
    limits.max_alloc = Some(BYTES_A_PIXEL * u64::from(width) * u64::from(height) + BYTES_BESIDE);
    limits
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::io::Cursor;

    use super::super::tests::{camera, context, numbers};
    use super::*;

    fn write(folder: &Path, name: &str, size: (u32, u32), grey: u8) {
        image::GrayImage::from_pixel(size.0, size.1, image::Luma([grey]))
            .save(folder.join(name))
            .expect("written");
    }

    fn open(
        path: &Path,
        kind: ImageKind,
        start_frame: u64,
        frame_step: u64,
    ) -> Result<FileFrames, SourceError> {
        let config = FileConfig {
            path: path.to_owned(),
            start_frame: Some(start_frame),
            frame_step: frame_step.try_into().expect("not zero"),
        };
        FileFrames::open(&config, kind, &camera(4, 3), &context(30.0))
    }

    #[test]
    fn gaps_are_missing_frames_and_not_renumbered() {
        let folder = tempfile::tempdir().expect("folder");
        for name in ["cam2_0003.png", "cam2_0007.png", "cam2_0008.png", "cam2_0011.jpg", "notes_0001.txt"] {
            write(folder.path(), &name.replace(".txt", ".png"), (4, 3), 9);
            if name.ends_with(".txt") {
                fs::rename(folder.path().join("notes_0001.png"), folder.path().join(name)).expect("renamed");
            }
        }
        assert_eq!(numbers(&mut open(folder.path(), COLOUR, 0, 1).expect("opens")), [3, 7, 8, 11]);
        assert_eq!(numbers(&mut open(folder.path(), COLOUR, 3, 4).expect("opens")), [0, 1, 2]);
        let pattern = folder.path().join("cam2_%04d.png");
        assert_eq!(numbers(&mut open(&pattern, COLOUR, 0, 1).expect("opens")), [3, 7, 8]);
        let mut source = open(folder.path(), COLOUR, 0, 1).expect("opens");
        let taken = source.next(8, &mut Image::default()).expect("read").expect("a frame");
        assert_eq!(taken, SourceFrame { number: 8, capture_time_s: 8.0 / 30.0 });
        let error = open(folder.path(), COLOUR, 12, 1).err().expect("refused").to_string();
        assert!(
            error.ends_with("numbers 3 to 11, none of them start_frame 12 plus a multiple of frame_step 1"),
            "{error}"
        );
    }

    #[test]
    fn a_colour_profile_takes_no_more_than_an_image_may() {
        let bomb = include_bytes!("../../../tests/fuzz/regressions/image/profile-of-32-MiB");
        let profile_bytes = |limits: Limits| {
            let mut reader = ImageReader::new(Cursor::new(&bomb[..])).with_guessed_format().expect("a PNG");
            reader.limits(limits);
            let profile = reader.into_decoder().and_then(|mut decoder| decoder.icc_profile());
            profile.ok().flatten().map(|profile| profile.len())
        };
        assert_eq!(profile_bytes(Limits::default()), Some(32 << 20));
        assert_eq!(profile_bytes(limits((16, 12))), None);
    }

    #[test]
    fn one_image_is_a_plate_and_colour_or_mask_by_kind() {
        let folder = tempfile::tempdir().expect("folder");
        write(folder.path(), "cam01.png", (4, 3), 255);
        let path = folder.path().join("cam01.png");
        let mut image = Image::default();
        let taken = open(&path, COLOUR, 0, 1).expect("opens").next(0, &mut image).expect("read");
        assert_eq!((taken.expect("frame").number, image.kind, image.data.len()), (0, COLOUR, 36));
        open(&path, ImageKind::Mask, 0, 1).expect("opens").next(0, &mut image).expect("read");
        assert_eq!(image, Image { width: 4, height: 3, kind: ImageKind::Mask, data: vec![1; 12] });
    }

    #[test]
    fn masks_of_a_film_keep_their_foreground() {
        let folder = tempfile::tempdir().expect("folder");
        for (number, other) in [255u8, 255, 1].into_iter().enumerate() {
            let mask = image::GrayImage::from_fn(12, 12, |x, _| image::Luma([if x > 3 { other } else { 0 }]));
            mask.save(folder.path().join(format!("{number}.png"))).expect("written");
        }
        let config = FileConfig::new(folder.path());
        let (camera, mut image) = (camera(12, 12), Image::default());
        let mut source = FileFrames::open(&config, ImageKind::Mask, &camera, &context(30.0)).expect("opens");
        for _ in 0..2 {
            source.next(0, &mut image).expect("a mask");
        }
        let error = source.next(0, &mut image).expect_err("refused").to_string();
        assert!(
            error.contains("2.png: found the grey value 1 as foreground, and values over half"),
            "{error}"
        );
    }

    #[track_caller]
    fn check_refused(path: &Path, message: &str) {
        let result = open(path, COLOUR, 0, 1).and_then(|mut source| source.next(0, &mut Image::default()));
        let error = result.expect_err("refused").to_string();
        assert!(error.contains(message), "{error}");
    }

    /// What a program of background subtraction writes: a shadow alone in the first masks, and then a person with one.
    #[test]
    fn masks_mean_the_same_whichever_of_a_film_are_read() {
        let folder = tempfile::tempdir().expect("folder");
        let mut paths = Vec::new();
        for number in 0..40_u8 {
            let person = if number < 8 { 0 } else { 255 };
            let path = folder.path().join(format!("{number:03}.png"));
            let pixels = [127, 127, 0, 0, person, 0, 0, 0, 0, 0, 0, 0].to_vec();
            image::GrayImage::from_vec(4, 3, pixels).expect("a size").save(&path).expect("written");
            paths.push(path);
        }
        let mut source = open(folder.path(), ImageKind::Mask, 0, 1).expect("opens");
        let mut image = Image::default();
        let film: Vec<&Path> = paths.iter().map(PathBuf::as_path).collect();
        let mut film = MaskFiles::new(&film, &camera(4, 3));
        for (number, path) in paths.iter().enumerate() {
            source.next(0, &mut image).expect("read").expect("a frame");
            let area = u64::from(number >= 8);
            assert_eq!(image.data.iter().map(|&pixel| u64::from(pixel)).sum::<u64>(), area, "frame {number}");
            assert_eq!(film.read(path).expect("read").area(), area, "frame {number}");
        }
    }

    #[test]
    fn a_shadow_alone_is_background_where_another_camera_tells_that_it_is_a_shadow() {
        let folder = tempfile::tempdir().expect("folder");
        let write = |name: &str, pixels: [u8; 12]| {
            let path = folder.path().join(name);
            image::GrayImage::from_vec(4, 3, pixels.to_vec()).expect("a size").save(&path).expect("written");
            path
        };
        let left = write("left.png", [127, 127, 0, 0, 255, 0, 0, 0, 0, 0, 0, 0]);
        let right = write("right.png", [0, 127, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]);
        let cameras = [camera(4, 3), camera(4, 3)];
        let mut room = MaskFiles::of_room(&cameras, &[vec![left.as_path()], vec![right.as_path()]]);
        assert_eq!(room[0].read(&left).expect("read").area(), 1);
        assert_eq!(room[1].read(&right).expect("read").area(), 0);
        let mut alone = MaskFiles::of_room(&cameras[..1], &[vec![right.as_path()]]);
        assert_eq!(alone[0].read(&right).expect("read").area(), 1);
    }

    #[test]
    fn wrong_files_are_named() {
        let folder = tempfile::tempdir().expect("folder");
        let at = |name: &str| folder.path().join(name);
        check_refused(&at("none"), "none: no such file or folder");
        check_refused(folder.path(), "found no numbered image, expected .png or .jpg files");
        check_refused(&at("a%xd%d.png"), "expected one %d or %06d in the file name");
        write(folder.path(), "large.png", (5, 3), 0);
        check_refused(
            &at("large.png"),
            "large.png is 5 x 3 pixels, expected 4 x 3 as camera \"cam\" of the rig",
        );
        fs::write(at("broken.png"), b"\x89PNG\r\n\x1a\nrest").expect("written");
        check_refused(&at("broken.png"), "broken.png: ");
        fs::write(at("text.png"), b"hello").expect("written");
        write(folder.path(), "cut.jpg", (4, 3), 255);
        let whole = fs::read(at("cut.jpg")).expect("written");
        for length in [whole.len() - 1, whole.len() / 2, 4] {
            fs::write(at("cut.jpg"), &whole[..length]).expect("written");
            check_refused(
                &at("cut.jpg"),
                "cut.jpg: found no end of the JPEG, expected a whole file: it is cut off",
            );
        }
        check_refused(&at("text.png"), "text.png: ");
        fs::create_dir(at("twice")).expect("made");
        write(&at("twice"), "a1.png", (4, 3), 0);
        write(&at("twice"), "b01.png", (4, 3), 0);
        check_refused(&at("twice"), "b01.png are both number 1");
    }

    /// A PNG of 4 × 3 pixels: rows of packed samples, and what is set before they are written.
    fn png(
        (colour, depth): (png::ColorType, png::BitDepth),
        set: impl Fn(&mut png::Encoder<'_, &mut Vec<u8>>),
        rows: [&[u8]; 3],
    ) -> Vec<u8> {
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, 4, 3);
        encoder.set_color(colour);
        encoder.set_depth(depth);
        set(&mut encoder);
        let mut writer = encoder.write_header().expect("a header");
        writer.write_image_data(&rows.concat()).expect("pixels");
        writer.finish().expect("an end");
        bytes
    }

    fn mask_of(png: &[u8]) -> Result<Vec<u8>, SourceError> {
        let mut image = Image::default();
        let fit = Fit::new(&camera(4, 3));
        let decoded = decode(
            Cursor::new(png),
            Path::new("mask.png"),
            ImageKind::Mask,
            &mut MaskFilm::default(),
            &fit,
            &mut image,
        );
        decoded.map(|()| image.data)
    }

    /// A mask with an orientation in its tags.
    fn tagged(orientation: u8) -> Vec<u8> {
        const EXIF: [u8; 26] =
            [b'I', b'I', 42, 0, 8, 0, 0, 0, 1, 0, 0x12, 0x01, 3, 0, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0];
        let mut exif = EXIF;
        exif[18] = orientation;
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, 4, 3);
        encoder.set_color(png::ColorType::Grayscale);
        let mut writer = encoder.write_header().expect("a header");
        writer.write_chunk(png::chunk::eXIf, &exif).expect("tags");
        writer.write_image_data(&[0, 0, 0, 0, 0, 255, 255, 0, 0, 0, 0, 0]).expect("pixels");
        writer.finish().expect("an end");
        bytes
    }

    #[test]
    fn an_image_that_some_programs_would_turn_is_refused() {
        assert!(mask_of(&tagged(1)).is_ok());
        for orientation in 2..=8 {
            let error = mask_of(&tagged(orientation)).expect_err("turned").to_string();
            assert!(
                error.contains(&format!("mask.png: found orientation {orientation} in its tag")),
                "{error}"
            );
        }
    }

    #[test]
    fn palettes_few_bits_and_transparent_colours_are_masks_as_their_samples_are() {
        use png::{BitDepth, ColorType};
        const MIDDLE: [u8; 12] = [0, 0, 0, 0, 0, 1, 1, 0, 0, 0, 0, 0];
        for (depth, middle) in [(BitDepth::One, 0b0110_0000), (BitDepth::Two, 0b0001_0100)] {
            let grey = png((ColorType::Grayscale, depth), |_| {}, [&[0], &[middle], &[0]]);
            assert_eq!(mask_of(&grey), Ok(MIDDLE.to_vec()), "{depth:?}");
        }
        let rows: [&[u8]; 3] = [&[0, 0, 0, 0], &[0, 1, 1, 0], &[0, 0, 0, 0]];
        let labelled: [&[u8]; 3] = [&[0, 0, 0, 0], &[0, 1, 1, 0], &[2, 2, 2, 2]];
        let indexed = (ColorType::Indexed, BitDepth::Eight);
        let palette = |colours: &'static [u8]| {
            move |encoder: &mut png::Encoder<'_, &mut Vec<u8>>| encoder.set_palette(colours)
        };
        assert_eq!(mask_of(&png(indexed, palette(&[0, 0, 0, 128, 0, 0]), rows)), Ok(MIDDLE.to_vec()));
        let voc = png(indexed, palette(&[0, 0, 0, 192, 128, 128, 224, 224, 192]), labelled);
        let error = mask_of(&voc).expect_err("refused").to_string();
        assert!(error.contains("mask.png: found the colours #000000, #c08080, "), "{error}");
        let transparent = |encoder: &mut png::Encoder<'_, &mut Vec<u8>>| {
            encoder.set_palette(&[255u8; 6][..]);
            encoder.set_trns(&[0u8, 255][..]);
        };
        assert_eq!(mask_of(&png(indexed, transparent, rows)), Ok(MIDDLE.to_vec()), "alpha of a palette");
        let clear_black = |encoder: &mut png::Encoder<'_, &mut Vec<u8>>| encoder.set_trns(&[0u8, 0][..]);
        let grey = png((ColorType::Grayscale, BitDepth::Eight), clear_black, rows);
        assert_eq!(mask_of(&grey), Ok(MIDDLE.to_vec()), "a transparent grey");
        let deep: [&[u8]; 3] = [&[0; 8], &[0, 0, 0, 1, 0, 1, 0, 0], &[0; 8]];
        let grey = png((ColorType::Grayscale, BitDepth::Sixteen), |_| {}, deep);
        assert_eq!(mask_of(&grey), Ok(MIDDLE.to_vec()), "16 bits");
    }
}
