//! A camera made ready to film: its background is learnt.

use std::sync::Arc;

use hull::Observer;
use segment::{BackgroundBuilder, BackgroundModel, Format, Layout, ModelError};

use super::CaptureError;
use super::segmenter::{ColourSegmenter, CutoutError};
use crate::config::NodeCamera;
use crate::source::{Image, ImageError, OpenContext, Source, SourceConfig};

/// A camera ready to film.
pub(super) struct ReadyCamera {
    pub config: NodeCamera,
    pub observer: Arc<Observer>,
    /// `None` if the source gives masks.
    pub segmenter: Option<ColourSegmenter>,
}

impl ReadyCamera {
    /// Learns the background. A frame's segmentation may take so many cores.
    pub fn prepare(
        config: &NodeCamera,
        observer: Arc<Observer>,
        fps: f64,
        cores: usize,
    ) -> Result<ReadyCamera, CaptureError> {
        let mut camera = ReadyCamera { config: config.clone(), observer, segmenter: None };
        if config.source.gives_masks() {
            return Ok(camera);
        }
        let background = config.background.clone().or_else(|| config.source.empty_room());
        let model = background.map(|background| camera.learn(&background, fps)).transpose()?;
        let segmenter = camera.colour_segmenter(model, cores);
        camera.segmenter = Some(segmenter.map_err(|error| camera.segmentation_error(error))?);
        Ok(camera)
    }

    /// Its name in the rig.
    pub fn name(&self) -> &str {
        self.config.camera.name()
    }

    /// Opens its source.
    pub fn open(&self, context: &OpenContext) -> Result<Box<dyn Source>, CaptureError> {
        self.open_source(&self.config.source, context)
    }

    pub fn segmentation_error(&self, error: CutoutError) -> CaptureError {
        CaptureError::Segmentation { camera: self.name().into(), error }
    }

    fn colour_segmenter(
        &self,
        model: Option<BackgroundModel>,
        cores: usize,
    ) -> Result<ColourSegmenter, CutoutError> {
        let NodeCamera { camera, segmentation, .. } = &self.config;
        let format = match &model {
            Some(model) => model.format(),
            None => Format::new(Layout::Rgb, camera.width(), camera.height()).map_err(ImageError::Size)?,
        };
        Ok(ColourSegmenter::new(segmentation, format, model, cores)?)
    }

    fn open_source(
        &self,
        source: &SourceConfig,
        context: &OpenContext,
    ) -> Result<Box<dyn Source>, CaptureError> {
        let opened = source.open(&self.config.camera, usize::from(self.config.rig_index), context);
        opened.map_err(|error| CaptureError::Source { camera: self.name().into(), error })
    }

    /// Reads the whole clip of the empty room.
    fn learn(&self, background: &SourceConfig, fps: f64) -> Result<BackgroundModel, CaptureError> {
        let context = OpenContext::outside_runs(fps);
        let mut source = self.open_source(background, &context)?;
        let refused = |error| CaptureError::Background { camera: self.name().into(), error };
        let mut builder: Option<BackgroundBuilder> = None;
        let mut image = Image::default();
        let mut next = 0;
        loop {
            let frame = source.next(next, &mut image);
            let frame = frame.map_err(|error| CaptureError::Source { camera: self.name().into(), error })?;
            let Some(frame) = frame else { break };
            let format = image.format().map_err(|error| refused(error.into()))?;
            let builder = builder.get_or_insert_with(|| BackgroundBuilder::new(format));
            builder.push(&image.data).map_err(|error| refused(error.into()))?;
            next = frame.number.saturating_add(1);
        }
        let clip = builder.as_ref().map_or(Err(ModelError::Empty), BackgroundBuilder::finish);
        clip.map_err(|error| refused(error.into()))
    }
}
