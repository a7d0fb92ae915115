//! Frames in, silhouettes out: test, clean-up, runs.

use hull::silhouette::{Run, SilhouetteBuilder, SilhouetteError};
use hull::{Silhouette, VectorPath};
use thiserror::Error;

use crate::bits::{Area, BitImage};
use crate::blobs::Blobs;
use crate::gain::{Correction, Gains};
use crate::kernel::{Background, Band, ChromaTest, DifferenceTest, Test, Work, bands};
use crate::layout::{Format, Layout};
use crate::metric::Metric;
use crate::model::BackgroundModel;
use crate::settings::{Cleanup, Method, SegmentSettings, SettingsError};
use crate::thresholds::low_thresholds;

/// Why there is no segmenter, or no silhouette.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum SegmentError {
    /// A setting out of its range.
    #[error(transparent)]
    Settings(#[from] SettingsError),
    /// The method `difference` without a model.
    #[error("method \"difference\" without a background clip or plate")]
    NoBackground,
    /// A model of another camera.
    #[error("background of {found_width} x {found_height}, expected {width} x {height} as the frames")]
    Size {
        /// Pixels across that it has.
        found_width: u32,
        /// Pixels down that it has.
        found_height: u32,
        /// Pixels across of the frames.
        width: u32,
        /// Pixels down of the frames.
        height: u32,
    },
    /// A frame of the wrong length.
    #[error("frame of {found} bytes, expected {expected}: {layout} of {width} x {height}")]
    Frame {
        /// Bytes given.
        found: usize,
        /// Bytes of a frame of the segmenter's format.
        expected: usize,
        /// The segmenter's.
        layout: Layout,
        /// Pixels across.
        width: u32,
        /// Pixels down.
        height: u32,
    },
    /// An image size that no silhouette has.
    #[error(transparent)]
    Silhouette(#[from] SilhouetteError),
}

/// A frame's silhouette, and measures of whether it can be trusted.
#[derive(Clone, Debug, PartialEq)]
pub struct Segmented {
    /// The foreground after clean-up.
    pub silhouette: Silhouette,
    /// Share of the image that the test called foreground before clean-up; far more than the silhouette
    /// covers, or more than about a half, means that the background is broken (the camera was moved, the
    /// light changed).
    pub raw_share: f64,
    /// How much brighter than the model the frame was and was corrected for: red, green, blue.
    pub gains: [f64; 3],
}

/// Pixels that are worth a core of their own: starting a thread costs what a few ten thousand pixels do.
const GRAIN_PX: usize = 1 << 21;

/// Segments the frames of one camera; buffers are kept between frames, results are not. After the first
/// frames nothing is allocated but the silhouette that is handed out (and threads, if there are several).
#[derive(Clone, Debug)]
pub struct Segmenter {
    format: Format,
    cleanup: Cleanup,
    test: Test,
    gains: Option<Gains>,
    path: VectorPath,
    cores: usize,
    bits: BitImage,
    grown: BitImage,
    blobs: Blobs,
    row_runs: Vec<Run>,
}

impl Segmenter {
    /// A segmenter for frames of that format. The method `difference` needs the background, of the
    /// same size; if it is of another layout, it is turned into the frames'. `chroma` does not look at it.
    pub fn new(
        settings: &SegmentSettings,
        format: Format,
        background: Option<&BackgroundModel>,
    ) -> Result<Segmenter, SegmentError> {
        settings.validate()?;
        let (width, height) = (format.width(), format.height());
        let (test, gains) = match (settings.method, background) {
            (Method::Chroma, _) => (Test::Chroma(ChromaTest::new(settings, format.layout())), None),
            (Method::Difference, None) => return Err(SegmentError::NoBackground),
            (Method::Difference, Some(model)) => {
                let found = model.format();
                if (found.width(), found.height()) != (width, height) {
                    let (found_width, found_height) = (found.width(), found.height());
                    return Err(SegmentError::Size { found_width, found_height, width, height });
                }
                let model = model.in_layout(format.layout());
                let background =
                    Background::new(format, model.shared_mean(), &low_thresholds(settings, &model));
                let test = DifferenceTest::new(settings, Metric::of(format.layout()));
                let gains = Gains::new(settings.gain, format, model.mean());
                (Test::Difference(test, background), Some(gains))
            }
        };
        Ok(Segmenter {
            format,
            cleanup: settings.cleanup(width, height),
            test,
            gains,
            path: VectorPath::best(),
            cores: 1,
            bits: BitImage::new(width, height),
            grown: BitImage::new(width, height),
            blobs: Blobs::default(),
            row_runs: Vec::new(),
        })
    }

    /// Size and layout of the frames.
    pub fn format(&self) -> Format {
        self.format
    }

    /// Lets large frames be read by up to so many cores at once; one by default. Small ones are read by
    /// one all the same.
    pub fn set_cores(&mut self, cores: usize) {
        self.cores = cores.max(1);
    }

    /// Takes another vector path than the machine's best; the silhouettes are the same. One that the
    /// machine lacks becomes the portable one.
    pub fn set_vector_path(&mut self, path: VectorPath) {
        self.path = path;
    }

    /// The silhouette of a frame: bytes of the segmenter's format.
    pub fn segment(&mut self, bytes: &[u8]) -> Result<Segmented, SegmentError> {
        let expected = self.format.frame_bytes();
        if bytes.len() != expected {
            return Err(SegmentError::Frame {
                found: bytes.len(),
                expected,
                layout: self.format.layout(),
                width: self.format.width(),
                height: self.format.height(),
            });
        }
        let correction = self.gains.as_mut().map_or(Correction::NONE, |gains| gains.estimate(bytes));
        self.read(bytes, correction);
        let (area, raw_px) = self.bits.extent(self.path);
        let area = self.clean(&area, raw_px);
        let silhouette = self.silhouette(&area)?;
        let raw_share = raw_px as f64 / self.format.pixels() as f64;
        Ok(Segmented { silhouette, raw_share, gains: correction.gains() })
    }

    /// Bytes to bits.
    fn read(&mut self, bytes: &[u8], correction: Correction) {
        let Segmenter { format, ref test, path, cores, .. } = *self;
        let most = (format.pixels() / GRAIN_PX).clamp(1, cores);
        let band = |(first_group, words)| Band { format, bytes, test, correction, first_group, words };
        if most == 1 {
            band((0, self.bits.words_mut())).run_on(path);
        } else {
            std::thread::scope(|scope| {
                let mut rest = bands(format, self.bits.words_mut(), most).map(band);
                let own = rest.next();
                rest.for_each(|band| drop(scope.spawn(move || band.run_on(path))));
                own.into_iter().for_each(|band| band.run_on(path));
            });
        }
    }

    /// Takes noise out of the bits: so many, all in the area; gives the area that holds them then.
    fn clean(&mut self, area: &Area, raw_px: u64) -> Area {
        let path = self.path;
        let (area, cleanup) = self.open(area, raw_px);
        let Cleanup { close_px, speck_px, hole_px, join_px, keep, .. } = cleanup;
        let area = self.bits.close(close_px, area, path);
        self.blobs.remove_specks(&mut self.bits, &area, speck_px);
        if let Some(keep) = keep {
            self.grown.copy_from(&self.bits);
            let grown = self.grown.grow(join_px, &area, path);
            self.blobs.keep_largest(&mut self.bits, &self.grown, &grown, keep);
        }
        self.blobs.fill_holes(&mut self.bits, &area, hole_px);
        area
    }

    /// Opens the bits, as far as they need it: what the full opening takes says how noisy the frame is. Gives
    /// the area that holds them then, and what clean-up is right.
    fn open(&mut self, area: &Area, raw_px: u64) -> (Area, Cleanup) {
        let (path, open_px) = (self.path, self.cleanup.open_px);
        self.grown.copy_from(&self.bits);
        self.bits.open(open_px, area, path);
        // Noise has made the area larger than people are.
        let (opened, opened_px) = self.bits.extent(path);
        let cleanup = self.cleanup.adapted(raw_px, opened_px);
        if cleanup.open_px == open_px {
            return (opened, cleanup);
        }
        self.bits.copy_from(&self.grown);
        self.bits.open(cleanup.open_px, area, path);
        (self.bits.extent(path).0, cleanup)
    }

    fn silhouette(&mut self, area: &Area) -> Result<Silhouette, SilhouetteError> {
        let mut builder = SilhouetteBuilder::new(self.format.width(), self.format.height())?;
        for row in 0..self.format.rows() {
            self.row_runs.clear();
            if area.rows.contains(&row) {
                self.bits.row_runs(row, area, &mut self.row_runs);
            }
            builder.push_runs(&self.row_runs)?;
        }
        builder.finish()
    }
}
