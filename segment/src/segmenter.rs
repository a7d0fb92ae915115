//! Frames in, silhouettes out: test, clean-up, runs.

use hull::Silhouette;
use hull::silhouette::{Run, SilhouetteBuilder, SilhouetteError};
use thiserror::Error;

use crate::bits::BitImage;
use crate::blobs::Blobs;
use crate::gain::Tones;
use crate::model::BackgroundModel;
use crate::settings::{Cleanup, Method, SegmentSettings, SettingsError};
use crate::test_row::{BackgroundRow, ChromaTest, ShadowTest, test_against_background};

/// Why there is no segmenter, or no silhouette.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum SegmentError {
    /// A setting out of its range.
    #[error(transparent)]
    Settings(#[from] SettingsError),
    /// The method `difference` without a model.
    #[error("method \"difference\" without a background clip or plate")]
    NoBackground,
    /// A model or mask of another camera.
    #[error("{what} of {found_width} x {found_height}, expected {width} x {height} as the frames")]
    Size {
        /// Model or mask.
        what: &'static str,
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
    #[error("frame of {found} bytes, expected {expected}: RGB of {width} x {height}")]
    Frame {
        /// Bytes given.
        found: usize,
        /// Three for each pixel.
        expected: usize,
        /// Pixels across.
        width: u32,
        /// Pixels down.
        height: u32,
    },
    /// An image size that no silhouette has.
    #[error(transparent)]
    Silhouette(#[from] SilhouetteError),
}

/// A frame's silhouette, and what tells whether it can be believed.
#[derive(Clone, Debug, PartialEq)]
pub struct Segmented {
    /// The foreground after clean-up.
    pub silhouette: Silhouette,
    /// Share of the image that the silhouette covers, 0 to 1.
    pub foreground_share: f64,
    /// Share of the image that the test called foreground before clean-up; far more than
    /// `foreground_share`, or more than about a half, means that the background is broken (the
    /// camera was moved, the light changed).
    pub raw_share: f64,
    /// How much brighter than the model the frame was and was corrected for: red, green, blue.
    pub gains: [f64; 3],
}

/// Segments the frames of one camera; buffers are kept between frames, results are not.
#[derive(Clone, Debug)]
pub struct Segmenter {
    width: u32,
    height: u32,
    settings: SegmentSettings,
    cleanup: Cleanup,
    test: Test,
    never: Option<BitImage>,
    tones: Tones,
    toned: Vec<u8>,
    squares: Vec<u16>,
    foreground: Vec<u8>,
    bits: BitImage,
    grown: BitImage,
    blobs: Blobs,
    row_runs: Vec<Run>,
}

#[derive(Clone, Debug)]
enum Test {
    Difference { mean: Vec<u8>, low: Vec<u8>, high: Vec<u8>, shadow: ShadowTest },
    Chroma(ChromaTest),
}

impl Segmenter {
    /// A segmenter for frames of that size. The method `difference` needs the background, of the
    /// same size; `chroma` does not look at it.
    pub fn new(
        settings: &SegmentSettings,
        width: u32,
        height: u32,
        background: Option<&BackgroundModel>,
    ) -> Result<Segmenter, SegmentError> {
        settings.validate()?;
        Silhouette::empty(width, height)?;
        let test = match (settings.method, background) {
            (Method::Chroma, _) => Test::Chroma(ChromaTest::new(settings)),
            (Method::Difference, None) => return Err(SegmentError::NoBackground),
            (Method::Difference, Some(model)) => {
                same_size("background", (model.width(), model.height()), (width, height))?;
                let (low, high) = thresholds(settings, model);
                Test::Difference {
                    mean: model.mean_rgb().to_vec(),
                    low,
                    high,
                    shadow: ShadowTest::new(settings),
                }
            }
        };
        let row = width as usize;
        Ok(Segmenter {
            width,
            height,
            settings: settings.clone(),
            cleanup: settings.cleanup(width, height),
            test,
            never: None,
            tones: Tones::new(),
            toned: vec![0; 3 * row],
            squares: vec![0; 3 * row],
            foreground: vec![0; row],
            bits: BitImage::new(width, height),
            grown: BitImage::new(width, height),
            blobs: Blobs::default(),
            row_runs: Vec::new(),
        })
    }

    /// Pixels that are never foreground, whatever they show: a bystander, a screen, a window.
    pub fn set_never_foreground(&mut self, mask: &Silhouette) -> Result<(), SegmentError> {
        same_size("never-foreground mask", (mask.width(), mask.height()), (self.width, self.height))?;
        let mut never = BitImage::new(self.width, self.height);
        for row in 0..self.height {
            mask.row(row).iter().for_each(|&run| never.set_run(row as usize, run, true));
        }
        self.never = Some(never);
        Ok(())
    }

    /// The silhouette of a frame: rows of RGB triples, top row first.
    pub fn segment(&mut self, rgb: &[u8]) -> Result<Segmented, SegmentError> {
        let (width, height) = (self.width, self.height);
        let expected = 3 * width as usize * height as usize;
        if rgb.len() != expected {
            return Err(SegmentError::Frame { found: rgb.len(), expected, width, height });
        }
        self.test_rows(rgb);
        let raw_px = self.bits.count();
        self.clean();
        let silhouette = self.runs()?;
        let pixels = f64::from(width) * f64::from(height);
        Ok(Segmented {
            foreground_share: silhouette.area() as f64 / pixels,
            raw_share: raw_px as f64 / pixels,
            gains: self.tones.gains(),
            silhouette,
        })
    }

    fn test_rows(&mut self, rgb: &[u8]) {
        let row_bytes = 3 * self.width as usize;
        if let Test::Difference { mean, .. } = &self.test {
            self.tones.estimate(self.settings.gain, rgb, mean);
        }
        for (row, rgb) in rgb.chunks_exact(row_bytes).enumerate() {
            match &self.test {
                Test::Chroma(chroma) => chroma.test(rgb, &mut self.foreground),
                Test::Difference { mean, low, high, shadow } => {
                    let pixels = row * self.width as usize..(row + 1) * self.width as usize;
                    let background = BackgroundRow {
                        mean: &mean[3 * pixels.start..3 * pixels.end],
                        low: &low[pixels.clone()],
                        high: &high[pixels],
                    };
                    let rgb = self.tones.apply(rgb, &mut self.toned);
                    let (squares, foreground) = (&mut self.squares, &mut self.foreground);
                    test_against_background(rgb, background, *shadow, squares, foreground);
                }
            }
            self.bits.set_row(row, &self.foreground);
        }
        if let Some(never) = &self.never {
            self.bits.clear_where(never);
        }
    }

    fn clean(&mut self) {
        let Cleanup { open_px, close_px, speck_px, hole_px, join_px, keep } = self.cleanup;
        let height = self.height as usize;
        self.bits.open(open_px);
        self.bits.close(close_px);
        self.blobs.remove_specks(&mut self.bits, height, speck_px);
        if let Some(keep) = keep {
            self.grown.copy_from(&self.bits);
            self.grown.grow(join_px);
            self.blobs.keep_largest(&mut self.bits, &self.grown, height, keep);
        }
        self.blobs.fill_holes(&mut self.bits, self.width, height, hole_px);
        if let Some(never) = &self.never {
            self.bits.clear_where(never);
        }
    }

    fn runs(&mut self) -> Result<Silhouette, SilhouetteError> {
        let mut builder = SilhouetteBuilder::new(self.width, self.height)?;
        for row in 0..self.height as usize {
            self.row_runs.clear();
            self.bits.row_runs(row, &mut self.row_runs);
            builder.push_runs(&self.row_runs)?;
        }
        builder.finish()
    }
}

/// The least low threshold, levels: the rounding of cameras and codecs alone reaches it.
const LEAST_LOW: f64 = 15.0;

/// The most that is estimated from the noise of a clip.
const MOST_LOW: f64 = 30.0;

/// The low threshold of a single picture, of whose noise nothing is known.
const PLATE_LOW: f64 = 20.0;

/// Low and high threshold per pixel.
fn thresholds(settings: &SegmentSettings, model: &BackgroundModel) -> (Vec<u8>, Vec<u8>) {
    let floor = settings.low.unwrap_or_else(|| {
        model.median_deviation().map_or(PLATE_LOW, |deviation| (6.0 * deviation).clamp(LEAST_LOW, MOST_LOW))
    });
    let pixels = (0..model.height()).flat_map(|row| (0..model.width()).map(move |column| (column, row)));
    let low = pixels.map(|(column, row)| {
        let noise = settings.sigma_factor * model.deviation(column, row);
        let edge = settings.edge_px * model.gradient(column as usize, row as usize);
        floor.max(noise).max(edge).round().min(255.0) as u8
    });
    let low: Vec<u8> = low.collect();
    let high = low.iter().map(|&low| low.max(settings.high.round() as u8)).collect();
    (low, high)
}

fn same_size(what: &'static str, found: (u32, u32), expected: (u32, u32)) -> Result<(), SegmentError> {
    if found == expected {
        return Ok(());
    }
    let ((found_width, found_height), (width, height)) = (found, expected);
    Err(SegmentError::Size { what, found_width, found_height, width, height })
}
