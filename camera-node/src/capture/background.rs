//! The background learnt anew while film goes on: from so many frames of the film itself, beginning at the
//! same frame in every camera. Frames are cut out with the old background until the new one is there.

use std::sync::{Mutex, PoisonError};

use segment::{BackgroundBuilder, BackgroundModel, Format, Method};

use crate::source::{Image, Kind};
use crate::{NodeCamera, SourceConfig};

/// Film that a background is learnt from at most: half a minute at 120 frames/s.
pub const MAX_LESSON_FRAMES: u64 = 3600;

/// Which film a camera is to learn from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Lesson {
    /// The first frame.
    pub first_frame: u64,
    /// How many.
    pub frames: u64,
}

/// What a camera learns, handed from whoever asks to its film thread.
#[derive(Default)]
pub(super) struct Desk {
    set: Mutex<Option<Lesson>>,
}

/// A lesson as it goes on, in the film thread.
#[derive(Default)]
pub(super) struct Pupil {
    lesson: Option<Lesson>,
    builder: Option<BackgroundBuilder>,
}

/// Why a camera has no background to learn.
pub(super) fn why_not(camera: &NodeCamera) -> Option<String> {
    let reason = if matches!(camera.source, SourceConfig::Masks(_)) {
        "its source gives masks"
    } else if camera.segmentation.method == Method::Chroma {
        "it is keyed by colour"
    } else {
        return None;
    };
    Some(format!("camera {:?} learns no background: {reason}", camera.camera.name()))
}

impl Desk {
    /// Sets a lesson; one that is under way is dropped. `None`: there is nothing to learn any more.
    pub fn set(&self, lesson: Option<Lesson>) {
        *self.set.lock().unwrap_or_else(PoisonError::into_inner) = lesson;
    }

    fn take(&self) -> Option<Lesson> {
        self.set.lock().unwrap_or_else(PoisonError::into_inner).take()
    }
}

impl Pupil {
    /// Looks at a frame of the film; the background once the lesson is over. The error says why there is none,
    /// and ends the lesson.
    pub fn look(
        &mut self,
        desk: &Desk,
        frame: u64,
        image: &Image,
    ) -> Option<Result<BackgroundModel, String>> {
        if let Some(lesson) = desk.take() {
            *self = Pupil { lesson: Some(lesson), builder: None };
        }
        let lesson = self.lesson.filter(|lesson| frame >= lesson.first_frame)?;
        let is_over = frame >= lesson.first_frame + lesson.frames;
        let learnt = if is_over { self.finish() } else { self.push(image).map(|()| None) };
        if !matches!(learnt, Ok(None)) {
            *self = Pupil::default();
        }
        learnt.transpose()
    }

    fn push(&mut self, image: &Image) -> Result<(), String> {
        let Kind::Colour(layout) = image.kind else { return Err("masks, expected colours".into()) };
        let format = Format::new(layout, image.width, image.height).map_err(|error| error.to_string())?;
        let builder = self.builder.get_or_insert_with(|| BackgroundBuilder::new(format));
        builder.push(&image.data).map_err(|error| error.to_string())
    }

    fn finish(&mut self) -> Result<Option<BackgroundModel>, String> {
        let builder = self.builder.take().ok_or("no frame came in time")?;
        builder.finish().map(Some).map_err(|error| error.to_string())
    }
}

#[cfg(test)]
mod tests {
    use segment::Layout;

    use super::*;

    fn grey(level: u8) -> Image {
        Image { kind: Kind::Colour(Layout::Rgb), width: 8, height: 8, data: vec![level; 192] }
    }

    /// Shows frames to a pupil; after which one a background is there, and its level.
    fn learns(lesson: Lesson, frames: impl Iterator<Item = (u64, u8)>) -> Option<(u64, u8)> {
        let (desk, mut pupil) = (Desk::default(), Pupil::default());
        desk.set(Some(lesson));
        for (frame, level) in frames {
            if let Some(learnt) = pupil.look(&desk, frame, &grey(level)) {
                return learnt.ok().map(|model| (frame, model.mean()[0]));
            }
        }
        None
    }

    #[test]
    fn a_lesson_takes_its_own_frames_and_no_others() {
        let lesson = Lesson { first_frame: 5, frames: 4 };
        let level = |frame: u64| if (5..9).contains(&frame) { 100 } else { 200 };
        assert_eq!(learns(lesson, (0..20).map(|frame| (frame, level(frame)))), Some((9, 100)));
        let missed = (0..20).filter(|frame| frame % 3 != 0).map(|frame| (frame, level(frame)));
        assert_eq!(learns(lesson, missed), Some((10, 100)), "missed frames delay nothing");
        assert_eq!(
            learns(lesson, (0..4).chain(12..13).map(|frame| (frame, 50))),
            None,
            "no frame, no background"
        );
    }

    #[test]
    fn a_new_lesson_takes_the_place_of_the_old() {
        let (desk, mut pupil) = (Desk::default(), Pupil::default());
        desk.set(Some(Lesson { first_frame: 0, frames: 3 }));
        assert!(pupil.look(&desk, 0, &grey(10)).is_none());
        desk.set(Some(Lesson { first_frame: 1, frames: 2 }));
        let learnt: Vec<_> = (1..6).filter_map(|frame| pupil.look(&desk, frame, &grey(90))).collect();
        assert_eq!(learnt.len(), 1);
        assert_eq!(learnt[0].as_ref().map(|model| (model.frames(), model.mean()[0])), Ok((2, 90)));
    }
}
