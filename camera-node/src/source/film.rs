//! What films share, wherever their bytes come from: numbers, checks, and the plain `.y4m` file.

use std::fs::File;
use std::io::BufReader;
use std::num::NonZeroU64;
use std::path::PathBuf;

use hull::Camera;
use segment::Format;

use super::config::FileConfig;
use super::y4m::{Header, Reader};
use super::{Image, ImageKind, OpenContext, Source, SourceError, SourceFrame};

/// How indices in a film become numbers in the cluster.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Numbering {
    start_frame: u64,
    frame_step: NonZeroU64,
}

impl Numbering {
    /// Index `start_frame` becomes number 0, every `frame_step`-th after it the next.
    pub fn new(start_frame: u64, frame_step: NonZeroU64) -> Numbering {
        Numbering { start_frame, frame_step }
    }

    /// The number of the frame with that index in the film, if it has one.
    pub fn number(self, index: u64) -> Option<u64> {
        let past = index.checked_sub(self.start_frame)?;
        past.is_multiple_of(self.frame_step.get()).then(|| past / self.frame_step)
    }

    /// How fast the film must run to give `fps` numbered frames a second.
    pub fn film_fps(self, fps: f64) -> f64 {
        fps * self.frame_step.get() as f64
    }
}

/// The camera that a source must fit.
#[derive(Clone, Debug)]
pub struct Fit {
    camera: String,
    size: (u32, u32),
}

impl Fit {
    /// Frames must have this camera's size.
    pub fn new(camera: &Camera) -> Fit {
        Fit { camera: camera.name().to_owned(), size: (camera.width(), camera.height()) }
    }

    /// The camera's width and height, pixels.
    pub fn size(&self) -> (u32, u32) {
        self.size
    }

    /// Refuses another size, naming both.
    pub fn check(&self, source_name: &str, found: (u32, u32)) -> Result<(), SourceError> {
        if found == self.size {
            return Ok(());
        }
        Err(SourceError::Size {
            source_name: source_name.to_owned(),
            found,
            camera: self.camera.clone(),
            expected: self.size,
        })
    }
}

/// Refuses a film whose header names another speed. A program that drops or repeats frames to keep
/// a speed of its own is noticed here, and not by a person moving at half speed.
pub fn check_rate(source_name: &str, header: &Header, expected: f64) -> Result<(), SourceError> {
    let Some((top, bottom)) = header.rate else { return Ok(()) };
    let found = f64::from(top) / f64::from(bottom);
    // 29.97 passes for 30.
    if (found / expected - 1.0).abs() < 0.005 {
        return Ok(());
    }
    Err(SourceError::Rate { source_name: source_name.to_owned(), found, expected })
}

/// Says what an image's bytes are.
pub fn label(format: Format, image: &mut Image) {
    (image.width, image.height) = (format.width(), format.height());
    image.kind = ImageKind::Colour(format.layout());
}

/// A film in one YUV4MPEG2 file.
pub struct FileFilm {
    path: PathBuf,
    reader: Reader<BufReader<File>>,
    format: Format,
    numbering: Numbering,
    fps: f64,
    index: u64,
}

impl FileFilm {
    /// Opens the file and checks its header against camera and cluster.
    pub fn open(
        config: &FileConfig,
        camera: &Camera,
        context: &OpenContext,
    ) -> Result<FileFilm, SourceError> {
        let path = config.path.clone();
        let file = File::open(&path).map_err(|error| SourceError::file(&path, error))?;
        let reader = Reader::new(BufReader::new(file)).map_err(|error| SourceError::file(&path, error))?;
        let (header, name) = (reader.header(), path.display().to_string());
        Fit::new(camera).check(&name, (header.width, header.height))?;
        let format = header.format().map_err(|error| SourceError::file(&path, error))?;
        let numbering = Numbering::new(config.start_frame.unwrap_or(0), config.frame_step);
        check_rate(&name, header, numbering.film_fps(context.fps))?;
        Ok(FileFilm { path, reader, format, numbering, fps: context.fps, index: 0 })
    }
}

impl Source for FileFilm {
    fn next(&mut self, at_least: u64, image: &mut Image) -> Result<Option<SourceFrame>, SourceError> {
        while self.reader.read(&mut image.data).map_err(|error| SourceError::file(&self.path, error))? {
            let number = self.numbering.number(self.index);
            self.index += 1;
            if let Some(number) = number.filter(|&number| number >= at_least) {
                label(self.format, image);
                return Ok(Some(SourceFrame::of_film(number, self.fps)));
            }
        }
        Ok(None)
    }
}

#[cfg(test)]
mod tests {
    use segment::{Layout, Range, Sampling};

    use super::super::tests::{camera, context, numbers};
    use super::*;

    const MONO: Layout = Layout::Planar(Sampling::Mono, Range::Full);

    fn film(
        folder: &tempfile::TempDir,
        start_frame: u64,
        frame_step: u64,
        fps: f64,
    ) -> Result<FileFilm, SourceError> {
        let path = folder.path().join("film.y4m");
        let mut bytes = b"YUV4MPEG2 W2 H1 F60:1 Cmono XCOLORRANGE=FULL\n".to_vec();
        for frame in 0..10 {
            bytes.extend_from_slice(b"FRAME\n");
            bytes.extend([frame, 100]);
        }
        std::fs::write(&path, bytes).expect("written");
        let config = FileConfig {
            path,
            start_frame: Some(start_frame),
            frame_step: frame_step.try_into().expect("not zero"),
        };
        FileFilm::open(&config, &camera(2, 1), &context(fps))
    }

    #[test]
    fn the_index_is_the_number_and_start_and_step_choose_frames() {
        let folder = tempfile::tempdir().expect("folder");
        let mut source = film(&folder, 3, 2, 30.0).expect("opens");
        let mut image = Image::default();
        let taken = source.next(0, &mut image).expect("read").expect("a frame");
        assert_eq!(taken, SourceFrame { number: 0, capture_time_s: 0.0 });
        assert_eq!(image, Image { width: 2, height: 1, kind: ImageKind::Colour(MONO), data: vec![3, 100] });
        let taken = source.next(2, &mut image).expect("read").expect("a frame");
        assert_eq!(taken, SourceFrame { number: 2, capture_time_s: 2.0 / 30.0 });
        assert_eq!(image.data[0], 7);
        assert_eq!(numbers(&mut source), [3]);
    }

    #[test]
    fn a_film_of_another_speed_is_refused() {
        let folder = tempfile::tempdir().expect("folder");
        let error = film(&folder, 0, 1, 30.0).err().expect("refused").to_string();
        assert!(
            error.ends_with(
                "film.y4m says 60 frames/s, expected 30 (fps times frame_step of the cluster file)"
            ),
            "{error}"
        );
    }
}
