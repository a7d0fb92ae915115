//! The background learnt again while film goes on: from so many frames of the film itself, beginning at the
//! same frame in every camera. Frames are cut out with the old background until the new one is there.

use film_time::BACKGROUND_S;
use parking_lot::Mutex;
use segment::{BackgroundBuilder, BackgroundModel, Method};
use thiserror::Error;

use super::segmenter::CutoutError;
use crate::config::NodeCamera;
use crate::source::Image;

/// Which film a background is to be learnt from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BackgroundRequest {
    /// The first frame.
    pub first_frame: u64,
    /// How many.
    pub frames: u64,
}

/// Why no background is learnt.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum BackgroundError {
    /// Too little film, or too much.
    #[error("a background of {frames} frames, expected {least} to {most}")]
    Length {
        /// Frames requested.
        frames: u64,
        /// The least.
        least: u64,
        /// The most.
        most: u64,
    },
    /// A camera whose frames are silhouettes already.
    #[error("camera {0:?} learns no background: its source gives masks")]
    Masks(String),
    /// A camera that needs no background.
    #[error("camera {0:?} learns no background: it is keyed by colour")]
    Chroma(String),
}

impl BackgroundRequest {
    /// Checks the length at so many frames per second, and that all cameras have a background.
    pub(super) fn check<'a>(
        self,
        cameras: impl Iterator<Item = &'a NodeCamera>,
        fps: f64,
    ) -> Result<(), BackgroundError> {
        let frames_of = |seconds: f64| (seconds * fps).ceil() as u64;
        let (least, most) = (frames_of(*BACKGROUND_S.start()), frames_of(*BACKGROUND_S.end()));
        if !(least..=most).contains(&self.frames) {
            return Err(BackgroundError::Length { frames: self.frames, least, most });
        }
        for camera in cameras {
            let name = || camera.camera.name().to_owned();
            if camera.source.gives_masks() {
                return Err(BackgroundError::Masks(name()));
            }
            if camera.segmentation.method == Method::Chroma {
                return Err(BackgroundError::Chroma(name()));
            }
        }
        Ok(())
    }
}

/// A camera's request, on its way to the film thread.
#[derive(Default)]
pub(super) struct RequestSlot(Mutex<Option<BackgroundRequest>>);

impl RequestSlot {
    /// Replaces the request; `None` withdraws it.
    pub fn set(&self, request: Option<BackgroundRequest>) {
        *self.0.lock() = request;
    }

    fn take(&self) -> Option<BackgroundRequest> {
        self.0.lock().take()
    }
}

/// The request that a film thread is busy with.
#[derive(Default)]
pub(super) struct BackgroundCapture {
    request: Option<BackgroundRequest>,
    builder: Option<BackgroundBuilder>,
}

impl BackgroundCapture {
    /// Takes a frame of the film; returns the background once the last has come. A new request drops the one
    /// under way, an error ends it.
    pub fn add(
        &mut self,
        slot: &RequestSlot,
        frame: u64,
        image: &Image,
    ) -> Option<Result<BackgroundModel, CutoutError>> {
        if let Some(request) = slot.take() {
            *self = BackgroundCapture { request: Some(request), builder: None };
        }
        let request = self.request?;
        let frames_before = frame.checked_sub(request.first_frame)?;
        let learnt =
            if frames_before < request.frames { self.push(image).map(|()| None) } else { self.finish() };
        if !matches!(learnt, Ok(None)) {
            *self = BackgroundCapture::default();
        }
        learnt.transpose()
    }

    fn push(&mut self, image: &Image) -> Result<(), CutoutError> {
        let format = image.format()?;
        let builder = self.builder.get_or_insert_with(|| BackgroundBuilder::new(format));
        Ok(builder.push(&image.data)?)
    }

    fn finish(&mut self) -> Result<Option<BackgroundModel>, CutoutError> {
        let builder = self.builder.take().ok_or(CutoutError::NoFrame)?;
        Ok(Some(builder.finish()?))
    }
}

#[cfg(test)]
mod tests {
    use segment::Layout;

    use super::*;
    use crate::source::ImageKind;

    fn grey(level: u8) -> Image {
        Image { kind: ImageKind::Colour(Layout::Rgb), width: 8, height: 8, data: vec![level; 192] }
    }

    /// After which of the frames a background is there, and its level.
    fn learn(request: BackgroundRequest, frames: impl Iterator<Item = (u64, u8)>) -> Option<(u64, u8)> {
        let (slot, mut capture) = (RequestSlot::default(), BackgroundCapture::default());
        slot.set(Some(request));
        for (frame, level) in frames {
            if let Some(learnt) = capture.add(&slot, frame, &grey(level)) {
                return learnt.ok().map(|model| (frame, model.mean()[0]));
            }
        }
        None
    }

    #[test]
    fn a_background_is_learnt_from_the_requested_frames_alone() {
        let request = BackgroundRequest { first_frame: 5, frames: 4 };
        let level = |frame: u64| if (5..9).contains(&frame) { 100 } else { 200 };
        assert_eq!(learn(request, (0..20).map(|frame| (frame, level(frame)))), Some((9, 100)));
        let missed = (0..20).filter(|frame| frame % 3 != 0).map(|frame| (frame, level(frame)));
        assert_eq!(learn(request, missed), Some((10, 100)), "missed frames delay nothing");
        let none = (0..4).chain(12..13).map(|frame| (frame, 50));
        assert_eq!(learn(request, none), None, "no frame, no background");
    }

    #[test]
    fn a_new_request_replaces_the_old() {
        let (slot, mut capture) = (RequestSlot::default(), BackgroundCapture::default());
        slot.set(Some(BackgroundRequest { first_frame: 0, frames: 3 }));
        assert!(capture.add(&slot, 0, &grey(10)).is_none());
        slot.set(Some(BackgroundRequest { first_frame: 1, frames: 2 }));
        let learnt: Vec<_> = (1..6).filter_map(|frame| capture.add(&slot, frame, &grey(90))).collect();
        assert_eq!(learnt.len(), 1);
        assert_eq!(learnt[0].as_ref().map(|model| (model.frames(), model.mean()[0])), Ok((2, 90)));
    }

    #[test]
    fn numbers_at_the_end_of_their_range_overflow_nothing() {
        let request = BackgroundRequest { first_frame: u64::MAX - 1, frames: u64::MAX };
        assert_eq!(learn(request, [0, u64::MAX - 1, u64::MAX].into_iter().map(|frame| (frame, 9))), None);
    }

    #[test]
    fn a_background_takes_as_much_film_as_the_one_bound_says() {
        let check = |frames, fps| BackgroundRequest { first_frame: 0, frames }.check(std::iter::empty(), fps);
        let error = |frames| BackgroundError::Length { frames, least: 6, most: 900 };
        assert_eq!(check(5, 30.0), Err(error(5)));
        assert_eq!(check(6, 30.0), Ok(()));
        assert_eq!(check(900, 30.0), Ok(()));
        for frames in [0, 901, u64::MAX] {
            assert_eq!(check(frames, 30.0), Err(error(frames)));
        }
        assert_eq!(check(3600, 120.0), Ok(()));
    }
}
