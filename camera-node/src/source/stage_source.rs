//! The synthetic studio as a source, so that no cameras are needed.

use hull::Camera;
use segment::Layout;
use stage::{CameraStage, StageSettings};

use super::config::StageConfig;
use super::{Image, ImageKind, OpenContext, Source, SourceError, SourceFrame};

/// The studio's film of one camera, rendered when asked for.
pub struct StageSource {
    stage: CameraStage,
    empty: bool,
    frames: u64,
    next: u64,
    fps: f64,
    size: (u32, u32),
}

impl StageSource {
    /// The studio seen by `camera`; `camera_index` chooses its noise.
    pub fn new(
        config: &StageConfig,
        camera: &Camera,
        camera_index: usize,
        context: &OpenContext,
    ) -> StageSource {
        let settings = StageSettings {
            seed: config.seed,
            motion: config.motion,
            person: config.person,
            props: config.props.clone(),
            fps: context.fps,
        };
        StageSource {
            stage: CameraStage::new(&settings, camera, camera_index),
            empty: config.empty,
            frames: config.frames.unwrap_or(u64::MAX),
            next: 0,
            fps: context.fps,
            size: (camera.width(), camera.height()),
        }
    }
}

impl Source for StageSource {
    fn next(&mut self, at_least: u64, image: &mut Image) -> Result<Option<SourceFrame>, SourceError> {
        let number = self.next.max(at_least);
        if number >= self.frames {
            return Ok(None);
        }
        (image.width, image.height, image.kind) = (self.size.0, self.size.1, ImageKind::Colour(Layout::Rgb));
        image.data.resize(self.stage.frame_bytes(), 0);
        if self.empty {
            self.stage.render_empty(number, &mut image.data);
        } else {
            self.stage.render(number, &mut image.data);
        }
        self.next = number.saturating_add(1);
        Ok(Some(SourceFrame::of_film(number, self.fps)))
    }
}

#[cfg(test)]
mod tests {
    use super::super::SourceConfig;
    use super::super::tests::context;
    use super::*;

    fn open(more: &str) -> Box<dyn Source> {
        let config: SourceConfig = toml::from_str(&format!("kind = \"stage\"\n{more}")).expect("valid");
        let rig = stage::studio_rig(4, (64, 48)).expect("a rig");
        config.open(&rig.cameras()[1], 1, &context(30.0)).expect("opens")
    }

    fn frame(source: &mut dyn Source, at_least: u64) -> (SourceFrame, Vec<u8>) {
        let mut image = Image::default();
        let taken = source.next(at_least, &mut image).expect("reads").expect("a frame");
        (taken, image.data)
    }

    #[test]
    fn a_frame_is_the_same_whatever_was_asked_before() {
        let (taken, late) = frame(&mut *open("motion = \"punch\""), 3);
        assert_eq!(taken, SourceFrame { number: 3, capture_time_s: 0.1 });
        let mut source = open("motion = \"punch\"");
        let films: Vec<_> = (0..4).map(|_| frame(&mut *source, 0)).collect();
        assert_eq!(films[3].0.number, 3);
        assert_eq!(films[3].1, late);
        assert_ne!(films[2].1, late);
        assert_ne!(frame(&mut *open("motion = \"punch\"\nseed = 2"), 3).1, late);
    }

    #[test]
    fn the_empty_room_has_no_person_and_ends_when_told() {
        let mut empty = open("empty = true\nframes = 2");
        let (a, b) = (frame(&mut *empty, 0).1, frame(&mut *empty, 0).1);
        assert_eq!(empty.next(0, &mut Image::default()), Ok(None));
        let person = frame(&mut *open(""), 0).1;
        let far = |a: &[u8], b: &[u8]| a.iter().zip(b).filter(|(a, b)| a.abs_diff(**b) > 40).count();
        assert_eq!(far(&a, &b), 0);
        assert!(far(&a, &person) > 100, "{}", far(&a, &person));
    }
}
