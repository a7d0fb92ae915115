//! Numbered image files: colour frames, or masks that are silhouettes already.

use std::fs::{self, File};
use std::io::{BufRead, BufReader, Seek};
use std::path::{Path, PathBuf};

use hull::Camera;
use image::{DynamicImage, ImageDecoder, ImageReader, Limits};
use segment::Layout;

use super::config::FileConfig;
use super::film::{Fit, Numbering};
use super::{Image, ImageKind, OpenContext, Source, SourceError, SourceFrame};

/// What pictures are decoded to.
pub const COLOUR: ImageKind = ImageKind::Colour(Layout::Rgb);

/// A film of one file per frame.
pub struct FileFrames {
    /// Numbers and files, ascending.
    frames: Vec<(u64, PathBuf)>,
    cursor: usize,
    kind: ImageKind,
    fit: Fit,
    fps: f64,
}

impl FileFrames {
    /// Lists the files. `config.path` is a folder (a file's number is the last run of digits in its
    /// name), a folder with a pattern as last part (`frame_%06d.png`), or one image, which is frame 0.
    pub fn open(
        config: &FileConfig,
        kind: ImageKind,
        camera: &Camera,
        context: &OpenContext,
    ) -> Result<FileFrames, SourceError> {
        let path = &config.path;
        let files = numbered_files(path)?;
        let (first, last) = (files.first().map(|f| f.0), files.last().map(|f| f.0));
        let numbering = Numbering::new(config.start_frame, config.frame_step);
        let frames: Vec<(u64, PathBuf)> = files
            .into_iter()
            .filter_map(|(index, path)| numbering.number(index).map(|number| (number, path)))
            .collect();
        if frames.is_empty() {
            return Err(SourceError::file(
                path,
                match (first, last) {
                    (Some(first), Some(last)) => format!(
                        "numbers {first} to {last}, none of them start_frame {} plus a multiple of frame_step {}",
                        config.start_frame, config.frame_step
                    ),
                    _ => "found no numbered image, expected .png or .jpg files".to_owned(),
                },
            ));
        }
        Ok(FileFrames { frames, cursor: 0, kind, fit: Fit::new(camera), fps: context.fps })
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
        load(path, self.kind, &self.fit, image)?;
        self.cursor += skipped + 1;
        Ok(Some(SourceFrame::of_film(*number, self.fps)))
    }
}

/// Reads one image file that must have the camera's size; colours become RGB.
fn load(path: &Path, kind: ImageKind, fit: &Fit, image: &mut Image) -> Result<(), SourceError> {
    let file = File::open(path).map_err(|error| SourceError::file(path, error))?;
    decode(BufReader::new(file), path, kind, fit, image)
}

/// The same of a file's bytes; `path` is its name in messages.
pub(super) fn decode(
    bytes: impl BufRead + Seek,
    path: &Path,
    kind: ImageKind,
    fit: &Fit,
    image: &mut Image,
) -> Result<(), SourceError> {
    let mut reader =
        ImageReader::new(bytes).with_guessed_format().map_err(|error| SourceError::file(path, error))?;
    reader.limits(limits(fit.size()));
    let decoder = reader.into_decoder().map_err(|error| SourceError::file(path, error))?;
    // Checked before anything of that size is decoded.
    fit.check(&path.display().to_string(), decoder.dimensions())?;
    let decoded = DynamicImage::from_decoder(decoder).map_err(|error| SourceError::file(path, error))?;
    (image.width, image.height) = (decoded.width(), decoded.height());
    (image.kind, image.data) = match kind {
        ImageKind::Colour(_) => (COLOUR, decoded.into_rgb8().into_raw()),
        ImageKind::Mask => (ImageKind::Mask, decoded.into_luma8().into_raw()),
    };
    Ok(())
}

/// What decoding an image of this size may take: a colour profile may unpack to a thousand times its bytes.
pub fn limits((width, height): (u32, u32)) -> Limits {
    const BYTES_A_PIXEL: u64 = 16;
    const BYTES_BESIDE: u64 = 4 << 20;
    let mut limits = Limits::no_limits();
    limits.max_alloc = Some(BYTES_A_PIXEL * u64::from(width) * u64::from(height) + BYTES_BESIDE);
    limits
}

/// Files and their numbers, ascending.
fn numbered_files(path: &Path) -> Result<Vec<(u64, PathBuf)>, SourceError> {
    let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default();
    let mut files = if name.contains('%') {
        let expected = "expected one %d or %06d in the file name, and no other %";
        let pattern = Pattern::parse(name).ok_or_else(|| SourceError::file(path, expected))?;
        listed(path.parent().unwrap_or(Path::new(".")), |name| pattern.number(name))?
    } else if path.is_dir() {
        listed(path, plain_number)?
    } else if path.is_file() {
        vec![(0, path.to_owned())]
    } else {
        return Err(SourceError::file(path, "no such file or folder"));
    };
    files.sort();
    if let Some(twice) = files.windows(2).find(|pair| pair[0].0 == pair[1].0) {
        let names = (twice[0].1.display(), twice[1].1.display());
        return Err(SourceError::file(
            path,
            format_args!("{} and {} are both number {}", names.0, names.1, twice[0].0),
        ));
    }
    Ok(files)
}

fn listed(folder: &Path, number: impl Fn(&str) -> Option<u64>) -> Result<Vec<(u64, PathBuf)>, SourceError> {
    let refused = |error: std::io::Error| SourceError::file(folder, error);
    let mut files = Vec::new();
    for entry in fs::read_dir(folder).map_err(refused)? {
        let entry = entry.map_err(refused)?;
        if let Some(number) = entry.file_name().to_str().and_then(&number) {
            files.push((number, entry.path()));
        }
    }
    Ok(files)
}

/// The last run of digits in the name of a PNG or JPEG file.
fn plain_number(name: &str) -> Option<u64> {
    let (stem, extension) = name.rsplit_once('.')?;
    if !["png", "jpg", "jpeg"].iter().any(|known| extension.eq_ignore_ascii_case(known)) {
        return None;
    }
    let end = stem.rfind(|c: char| c.is_ascii_digit())? + 1;
    let start = stem[..end].rfind(|c: char| !c.is_ascii_digit()).map_or(0, |at| {
        // The character before the digits may be longer than a byte.
        at + stem[at..].chars().next().map_or(1, char::len_utf8)
    });
    stem[start..end].parse().ok()
}

/// `before%0<width>dafter`.
struct Pattern<'a> {
    before: &'a str,
    width: usize,
    after: &'a str,
}

impl<'a> Pattern<'a> {
    fn parse(name: &'a str) -> Option<Pattern<'a>> {
        let (before, rest) = name.split_once('%')?;
        let (width, after) = rest.split_once('d')?;
        let width = match width {
            "" => 0,
            zeros => zeros.strip_prefix('0')?.parse().ok().filter(|width| *width <= 20)?,
        };
        (!after.contains('%')).then_some(Pattern { before, width, after })
    }

    fn number(&self, name: &str) -> Option<u64> {
        let digits = name.strip_prefix(self.before)?.strip_suffix(self.after)?;
        let number: u64 = digits.parse().ok()?;
        (format!("{number:0width$}", width = self.width) == digits).then_some(number)
    }
}

#[cfg(test)]
mod tests {
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
            start_frame,
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
    fn numbers_are_the_last_digits_of_a_name() {
        for (name, expected) in [
            ("000045.png", Some(45)),
            ("cam1_0045.PNG", Some(45)),
            ("cam1-45é.jpeg", Some(45)),
            ("é7.jpg", Some(7)),
            ("cam.png", None),
            ("7.txt", None),
            ("99999999999999999999999.png", None),
        ] {
            assert_eq!(plain_number(name), expected, "{name}");
        }
    }

    #[test]
    fn a_colour_profile_takes_no_more_than_an_image_may() {
        let bomb = include_bytes!("../../../fuzz/regressions/image/profile-of-32-MiB");
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
        write(folder.path(), "cam01.png", (4, 3), 128);
        let path = folder.path().join("cam01.png");
        let mut image = Image::default();
        let taken = open(&path, COLOUR, 0, 1).expect("opens").next(0, &mut image).expect("read");
        assert_eq!((taken.expect("frame").number, image.kind, image.data.len()), (0, COLOUR, 36));
        open(&path, ImageKind::Mask, 0, 1).expect("opens").next(0, &mut image).expect("read");
        assert_eq!(image, Image { width: 4, height: 3, kind: ImageKind::Mask, data: vec![128; 12] });
    }

    #[track_caller]
    fn check_refused(path: &Path, message: &str) {
        let result = open(path, COLOUR, 0, 1).and_then(|mut source| source.next(0, &mut Image::default()));
        let error = result.expect_err("refused").to_string();
        assert!(error.contains(message), "{error}");
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
        check_refused(&at("text.png"), "text.png: ");
        fs::create_dir(at("twice")).expect("made");
        write(&at("twice"), "a1.png", (4, 3), 0);
        write(&at("twice"), "b01.png", (4, 3), 0);
        check_refused(&at("twice"), "b01.png are both number 1");
    }
}
