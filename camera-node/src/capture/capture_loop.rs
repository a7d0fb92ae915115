//! One camera's film of one run: takes frames in time, makes silhouettes, offers them to the ring.

use std::sync::Arc;
use std::time::Instant;

use proto::{RunStart, unix_now_s};

use super::CaptureError;
use super::background::{BackgroundCapture, RequestSlot};
use super::camera::ReadyCamera;
use super::film_clock::FilmClock;
use super::gate::Gate;
use super::segmenter::{CutoutError, silhouette};
use crate::frames::{CameraFrame, FrameRing, Stamp};
use crate::pictures::ColourRing;
use crate::source::{Image, Source, SourceFrame};

/// The loop of a camera's film thread.
pub(super) struct CaptureLoop {
    /// The camera's place in the node.
    pub index: usize,
    pub start: RunStart,
    pub clock: Arc<FilmClock>,
    pub fps: f64,
    /// Whether the source gives frames at its own pace.
    pub is_live: bool,
    pub source: Box<dyn Source>,
    pub ring: Arc<FrameRing>,
    pub colours: Arc<ColourRing>,
    pub gate: Arc<Gate>,
    pub slot: Arc<RequestSlot>,
}

impl CaptureLoop {
    /// Films until the film ends or the run stops.
    pub fn run(mut self, camera: &mut ReadyCamera) -> Result<(), CaptureError> {
        let mut image = Image::default();
        let mut background = BackgroundCapture::default();
        let mut next = 0u64;
        while let Some(at_least) = self.await_turn(next) {
            let frame = self.source.next(at_least, &mut image);
            let frame =
                frame.map_err(|error| CaptureError::Source { camera: camera.name().into(), error })?;
            let Some(frame) = frame else { break };
            self.offer(camera, frame, &image, frame.number.saturating_sub(next))?;
            if let Some(learnt) = background.add(&self.slot, frame.number, &image) {
                let used = learnt.and_then(|model| match &mut camera.segmenter {
                    Some(segmenter) => Ok(segmenter.use_background(model)?),
                    None => Err(CutoutError::NoSegmenter),
                });
                let name = camera.name();
                match used {
                    Ok(()) => tracing::info!("camera {name:?}: new background after frame {}", frame.number),
                    Err(error) => tracing::warn!("camera {name:?} keeps its background: {error}"),
                }
            }
            next = frame.number.saturating_add(1);
        }
        Ok(())
    }

    /// Makes a frame's silhouette and hands it in.
    fn offer(
        &self,
        camera: &mut ReadyCamera,
        frame: SourceFrame,
        image: &Image,
        skipped: u64,
    ) -> Result<(), CaptureError> {
        let began = Instant::now();
        let name = camera.config.camera.name();
        let silhouette = silhouette(camera.segmenter.as_mut(), image, name)
            .map_err(|error| camera.segmentation_error(error))?;
        let stamp = Stamp {
            number: frame.number,
            capture_time_s: frame.capture_time_s,
            captured_unix_s: match self.start.lock_step {
                true => unix_now_s(),
                false => self.start.epoch_unix_s + frame.capture_time_s,
            },
            skipped,
        };
        let segment_ms = began.elapsed().as_secs_f64() * 1e3;
        self.colours.keep(self.index, frame.number, image, &silhouette);
        self.ring.offer(self.index, stamp, CameraFrame::new(&camera.observer, silhouette, segment_ms));
        Ok(())
    }

    /// Waits until frame `next` is due; the oldest frame that is still of use, or `None` if the run stops.
    fn await_turn(&self, next: u64) -> Option<u64> {
        if self.start.lock_step {
            return self.gate.wait_for(next).then_some(next);
        }
        if self.is_live {
            return (!self.gate.is_stopped()).then_some(next);
        }
        self.gate.sleep_until(next as f64 / self.fps, &self.clock).then(|| {
            // A frame is still of use while it is the newest one due; older ones are too late.
            let due = (self.clock.now_s() * self.fps).floor().max(0.0) as u64;
            next.max(due)
        })
    }
}
