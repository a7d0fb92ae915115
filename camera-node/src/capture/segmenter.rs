//! One camera's frames to silhouettes.

use hull::Silhouette;
use segment::{BackgroundModel, Format, ModelError, SegmentError, SegmentSettings, Segmenter};
use thiserror::Error;

use crate::source::{Image, ImageError, ImageKind};

/// More raw foreground than this share of an image is no person: the camera was moved, or the light.
const DOUBTFUL_SHARE: f64 = 0.5;
/// Backgrounds kept that can be used again, at most: one that was taken, and one that is refused elsewhere meanwhile.
const MAX_BEFORE: usize = 2;

/// Why a frame has no silhouette, or a camera no background.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum CutoutError {
    /// The frame is no colour image, or of a size that is none.
    #[error(transparent)]
    Image(#[from] ImageError),
    /// Colours from a source of masks.
    #[error("colour frames and no segmenter, expected masks")]
    NoSegmenter,
    /// No frame came while the background was to be learnt.
    #[error("no frame came in time")]
    NoFrame,
    /// The background.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// The segmentation.
    #[error(transparent)]
    Segment(#[from] SegmentError),
}

/// Makes silhouettes of one camera's colour frames, in whatever layout they come.
pub(super) struct ColourSegmenter {
    settings: SegmentSettings,
    /// The empty room, unless the settings need none.
    background: Option<BackgroundModel>,
    /// Those before, the newest last, each with the id of the one that took its place.
    before: Vec<(u64, BackgroundModel)>,
    segmenter: Segmenter,
    /// Cores that one frame may take.
    cores: usize,
    /// Whether the last frame was more than a person.
    doubted: bool,
}

impl ColourSegmenter {
    /// For frames of that format; others cost a start again.
    pub fn new(
        settings: &SegmentSettings,
        format: Format,
        background: Option<BackgroundModel>,
        cores: usize,
    ) -> Result<ColourSegmenter, SegmentError> {
        let mut segmenter = Segmenter::new(settings, format, background.as_ref())?;
        segmenter.set_cores(cores);
        Ok(ColourSegmenter {
            settings: settings.clone(),
            background,
            before: vec![],
            segmenter,
            cores,
            doubted: false,
        })
    }

    /// Uses another background from now on, of that id.
    pub fn use_background(&mut self, id: u64, model: BackgroundModel) -> Result<(), SegmentError> {
        let former = self.background.clone();
        self.begin_again(model.format(), Some(model))?;
        if self.before.len() == MAX_BEFORE {
            self.before.remove(0);
        }
        self.before.extend(former.map(|former| (id, former)));
        Ok(())
    }

    /// Uses the background again that was in use before the one of that id; whether that one is in use.
    pub fn restore_background(&mut self, id: u64) -> Result<bool, SegmentError> {
        let Some((_, model)) = self.before.pop_if(|(taken, _)| *taken == id) else { return Ok(false) };
        self.begin_again(model.format(), Some(model))?;
        Ok(true)
    }

    fn begin_again(
        &mut self,
        format: Format,
        background: Option<BackgroundModel>,
    ) -> Result<(), SegmentError> {
        let next = ColourSegmenter::new(&self.settings, format, background, self.cores)?;
        *self = ColourSegmenter { before: std::mem::take(&mut self.before), ..next };
        Ok(())
    }

    /// The silhouette of a frame. The background may have come in another layout than the film does (a plate
    /// from a picture, a film from a camera): it is converted when the first frame shows.
    fn segment(&mut self, format: Format, bytes: &[u8], camera: &str) -> Result<Silhouette, SegmentError> {
        if self.segmenter.format() != format {
            let background = self.background.as_ref().map(|model| model.in_layout(format.layout()));
            self.begin_again(format, background)?;
        }
        let found = self.segmenter.segment(bytes)?;
        let doubted = found.raw_share > DOUBTFUL_SHARE;
        if doubted && !self.doubted {
            tracing::warn!(
                "camera {camera:?}: {:.0} % of the image differ from the background: was the camera moved, or the light?",
                100.0 * found.raw_share
            );
        }
        self.doubted = doubted;
        Ok(found.silhouette)
    }
}

/// The silhouette of a frame: masks as they are, colours through the segmenter.
pub(super) fn silhouette(
    segmenter: Option<&mut ColourSegmenter>,
    image: &Image,
    camera: &str,
) -> Result<Silhouette, CutoutError> {
    if image.kind == ImageKind::Mask {
        let silhouette = Silhouette::from_mask(image.width, image.height, &image.data);
        return Ok(silhouette.map_err(SegmentError::from)?);
    }
    let segmenter = segmenter.ok_or(CutoutError::NoSegmenter)?;
    Ok(segmenter.segment(image.format()?, &image.data, camera)?)
}

#[cfg(test)]
mod tests {
    use segment::{BackgroundBuilder, Layout, Range, Sampling, from_rgb};
    use stage::{CameraStage, StageSettings, studio_rig};

    use super::*;

    /// Mean intersection over union with the studio's truth: shadows, sensor noise and all.
    fn overlap(layout: Layout, of_background: Layout) -> f64 {
        let (width, height) = (640, 480);
        let rig = studio_rig(4, (width, height)).expect("a rig");
        let settings = StageSettings::default();
        let mut camera = CameraStage::new(&settings, &rig.cameras()[1], 1);
        let mut rgb = vec![0; camera.frame_bytes()];
        let mut bytes = Vec::new();
        let format = |layout| Format::new(layout, width, height).expect("size");
        let mut clip = BackgroundBuilder::new(format(of_background));
        for frame in 0..12 {
            camera.render_empty(frame, &mut rgb);
            from_rgb(&rgb, format(of_background), &mut bytes);
            clip.push(&bytes).expect("a frame");
        }
        let model = clip.finish().expect("frames");
        let mut segmenter =
            ColourSegmenter::new(&SegmentSettings::default(), model.format(), Some(model), 1).expect("fits");
        let mut overlaps = Vec::new();
        for frame in [10, 40, 70] {
            camera.render(frame, &mut rgb);
            from_rgb(&rgb, format(layout), &mut bytes);
            let found = segmenter.segment(format(layout), &bytes, "cam").expect("a silhouette").to_mask();
            let truth = camera.mask(settings.time_s(frame));
            let count = |both: fn(bool, bool) -> bool| {
                found.iter().zip(&truth).filter(|(a, b)| both(**a != 0, **b != 0)).count() as f64
            };
            overlaps.push(count(|a, b| a && b) / count(|a, b| a || b));
        }
        overlaps.iter().sum::<f64>() / overlaps.len() as f64
    }

    #[test]
    fn backgrounds_are_restored_in_the_order_in_which_they_came() {
        let format = Format::new(Layout::Rgb, 8, 8).expect("a size");
        let plate = |level: u8| BackgroundModel::from_plate(format, &[level; 192]).expect("a plate");
        let mut segmenter =
            ColourSegmenter::new(&SegmentSettings::default(), format, Some(plate(10)), 1).expect("fits");
        let level = |segmenter: &ColourSegmenter| segmenter.background.as_ref().map(|model| model.mean()[0]);
        for id in 1..4 {
            segmenter.use_background(id, plate(10 + id as u8)).expect("fits");
        }
        assert_eq!(level(&segmenter), Some(13));
        assert_eq!(segmenter.restore_background(2), Ok(false), "it is not in use");
        for (id, restored, in_use) in [(3, true, 12), (2, true, 11), (1, false, 11)] {
            assert_eq!(segmenter.restore_background(id), Ok(restored), "{id}");
            assert_eq!(level(&segmenter), Some(in_use));
        }
    }

    #[test]
    fn a_person_is_cut_out_of_the_studio_in_every_layout() {
        let i420 = Layout::Planar(Sampling::C420, Range::Limited);
        for (layout, least) in [
            (Layout::Rgb, 0.975),
            (Layout::Planar(Sampling::C444, Range::Full), 0.975),
            (Layout::Yuyv(Range::Limited), 0.955),
            (Layout::Uyvy(Range::Full), 0.955),
            (i420, 0.955),
            (Layout::Nv12(Range::Limited), 0.955),
        ] {
            let found = overlap(layout, layout);
            assert!(found > least, "{layout:?}: {found:.4}");
        }
        let by_pictures = overlap(i420, Layout::Rgb);
        assert!(by_pictures > 0.955, "a background of pictures: {by_pictures:.4}");
    }
}
