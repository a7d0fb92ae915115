//! Film of the studio by cameras that are late, as nodes would segment it.

use calib::sync::TimedSilhouette;
use hull::{Camera, Rig};
use segment::{BackgroundBuilder, Format, Layout, SegmentSettings, Segmenter};
use stage::{CameraStage, Motion, StageSettings};

use setup::cli::{Failure, Outcome};

/// Frames of the empty room, as many as give its noise.
const EMPTY_FRAMES: u64 = 32;
/// The stage is asked for frames of so many a second: how exactly a camera can be late.
pub const MOMENTS_PER_S: f64 = 3000.0;
/// Film begins here, seconds: the person moves by then.
const START_S: f64 = 3.0;

/// What is filmed.
#[derive(Clone, Copy)]
pub struct Filmed {
    /// What the person does.
    pub motion: Motion,
    /// Chooses the sensor noise.
    pub seed: u64,
    /// Frames a second.
    pub fps: f64,
    /// Length of the film, seconds.
    pub seconds: f64,
}

impl Filmed {
    /// The films of cameras that are so late, seconds.
    pub fn films(self, rig: &Rig, late_s: &[f64]) -> Outcome<Vec<Vec<TimedSilhouette>>> {
        std::thread::scope(|scope| {
            let cameras = rig.cameras().iter().zip(late_s).enumerate();
            let running: Vec<_> = cameras
                .map(|(index, (camera, &late_s))| scope.spawn(move || self.film(camera, index, late_s)))
                .collect();
            running
                .into_iter()
                .map(|thread| thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)))
                .collect()
        })
    }

    fn film(self, camera: &Camera, index: usize, late_s: f64) -> Outcome<Vec<TimedSilhouette>> {
        let Filmed { motion, seed, fps, seconds } = self;
        let settings = StageSettings { motion, seed, fps: MOMENTS_PER_S, ..StageSettings::default() };
        let mut stage = CameraStage::new(&settings, camera, index);
        let mut rgb = vec![0; stage.frame_bytes()];
        let format = Format::new(Layout::Rgb, camera.width(), camera.height()).map_err(Failure::input)?;
        let mut room = BackgroundBuilder::new(format);
        for frame in 0..EMPTY_FRAMES {
            stage.render_empty(frame, &mut rgb);
            room.push(&rgb).map_err(Failure::run)?;
        }
        let room = room.finish().map_err(Failure::run)?;
        let mut segmenter =
            Segmenter::new(&SegmentSettings::default(), format, Some(&room)).map_err(Failure::run)?;
        let frame = |frame: usize| {
            let time_s = START_S + frame as f64 / fps;
            stage.render(((time_s - late_s) * MOMENTS_PER_S).round() as u64, &mut rgb);
            let silhouette = segmenter.segment(&rgb).map_err(Failure::run)?.silhouette;
            Ok(TimedSilhouette { time_s, silhouette })
        };
        (0..(seconds * fps) as usize).map(frame).collect()
    }
}
