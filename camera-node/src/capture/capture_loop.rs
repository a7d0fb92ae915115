//! One camera's film of one run: takes frames in time, makes silhouettes, offers them to the ring. A live
//! camera's source that fails is opened again, for as long as the run goes on.

use std::sync::Arc;
use std::time::Instant;

use film_time::{CameraPace, RunStart, unix_now_s};
use telemetry::Beat;

use super::CaptureError;
use super::background::{BackgroundCapture, BackgroundError, BackgroundSlot, CapturedBackground};
use super::camera::ReadyCamera;
use super::film_clock::FilmClock;
use super::gate::Gate;
use super::mask_watch::{MaskWarning, MaskWatch};
use super::retry::{Failure, Retry};
use super::segmenter::{CutoutError, silhouette};
use crate::frames::{CameraFrame, FrameRing, Stamp};
use crate::metrics::{FilmMeter, FilmedFrame};
use crate::pictures::ColourRing;
use crate::source::{Image, ImageKind, OpenContext, Source, SourceConfig, SourceFrame};

/// Captures of one camera lie at least so many periods apart.
const LEAST_PERIODS: f64 = 0.1;

/// A source that was to be opened.
pub(super) type Opened = Result<Box<dyn Source>, CaptureError>;

/// The loop of a camera's film thread.
pub(super) struct CaptureLoop {
    /// The camera's place in the node.
    pub index: usize,
    pub start: RunStart,
    pub clock: Arc<FilmClock>,
    /// Whether the source gives frames at its own pace.
    pub is_live: bool,
    /// What its source is opened with.
    pub context: OpenContext,
    pub ring: Arc<FrameRing>,
    pub colours: Arc<ColourRing>,
    pub gate: Arc<Gate>,
    pub slot: Arc<BackgroundSlot>,
    pub meter: Arc<FilmMeter>,
    pub beat: Arc<Beat>,
}

/// How far a camera's film has come; it outlives the source.
#[derive(Default)]
struct Progress {
    /// The number after the newest frame.
    next: u64,
    /// When the newest frame was captured, seconds of film.
    past_s: Option<f64>,
    image: Image,
    background: BackgroundCapture,
    masks: MaskWatch,
}

impl CaptureLoop {
    /// Whether a source that fails, ends or cannot be opened is opened again: a live camera has no end, and
    /// no step waits for it. In lock-step its frames would be missing.
    pub fn reopens(&self) -> bool {
        self.is_live && !self.start.lock_step
    }

    /// Films until the film ends or the run stops.
    pub fn run(&self, camera: &mut ReadyCamera, opened: Opened) -> Result<(), CaptureError> {
        if self.reopens() {
            self.film_for_ever(camera, opened);
            return Ok(());
        }
        self.film(camera, opened?, &mut Progress::default(), |_| {})
    }

    /// Films until the run stops, whatever becomes of the source meanwhile.
    fn film_for_ever(&self, camera: &mut ReadyCamera, mut opened: Opened) {
        let mut progress = Progress::default();
        let mut retry = Retry::new(self.start.run ^ u64::from(camera.config.rig_index));
        loop {
            let filmed = |name: &str| {
                if retry.filmed(Instant::now()) {
                    tracing::warn!("camera {name:?} films again");
                }
            };
            let outcome = opened.and_then(|source| self.film(camera, source, &mut progress, filmed));
            if self.gate.is_stopped() {
                return;
            }
            let ended = || CaptureError::Ended { camera: camera.name().into() };
            let error = outcome.map_or_else(|error| error, |()| ended());
            let reason = error.to_string();
            self.ring.note_trouble(self.index, error.kind(), &reason);
            let Failure { pause, is_new } = retry.failed(&reason);
            self.ring.leave_out(self.index);
            self.meter.failed(self.index);
            if is_new {
                tracing::warn!("{reason}; it is opened again until it films");
            }
            self.beat.waits();
            if !self.gate.sleep(pause) {
                return;
            }
            self.beat.works();
            opened = camera.open(&self.context);
        }
    }

    /// Films until the source ends or the run stops, and closes the source. `filmed` hears the camera's name
    /// after each frame.
    fn film(
        &self,
        camera: &mut ReadyCamera,
        mut source: Box<dyn Source>,
        progress: &mut Progress,
        mut filmed: impl FnMut(&str),
    ) -> Result<(), CaptureError> {
        let Progress { next, past_s, image, background, masks } = progress;
        while let Some(at_least) = self.await_turn(*next) {
            self.beat.works();
            let frame = source.next(at_least, image);
            let frame =
                frame.map_err(|error| CaptureError::Source { camera: camera.name().into(), error })?;
            let Some(frame) = frame else { break };
            let frame = self.after(frame, past_s);
            // What came before its first frame was not missed.
            let missed = if *next == 0 { 0 } else { frame.number.saturating_sub(*next) };
            let foreground = self.offer(camera, frame, missed, source.pace(), image, masks)?;
            self.learn(camera, background, frame.number, image, foreground);
            *next = frame.number.saturating_add(1);
            filmed(camera.name());
        }
        warn_of_masks(camera, masks.finish());
        Ok(())
    }

    /// A frame that is not captured before the one before it, whatever its source has learnt of its clock since.
    fn after(&self, frame: SourceFrame, past_s: &mut Option<f64>) -> SourceFrame {
        if !self.is_live {
            return frame;
        }
        let least_s = past_s.map_or(f64::NEG_INFINITY, |past_s| past_s + LEAST_PERIODS / self.context.fps);
        let capture_time_s = frame.capture_time_s.max(least_s);
        *past_s = Some(capture_time_s);
        SourceFrame { capture_time_s, ..frame }
    }

    /// Shows a frame to the background that is being learnt, if any; once it is complete it is used, if the room was empty.
    fn learn(
        &self,
        camera: &mut ReadyCamera,
        background: &mut BackgroundCapture,
        number: u64,
        image: &Image,
        foreground: f64,
    ) {
        for id in self.slot.take_restores() {
            background.stop(id);
            restore(camera, id);
        }
        let Some(captured) = background.add(&self.slot, number, image, foreground) else { return };
        let used = use_background(camera, &captured);
        match &used {
            Ok(()) => tracing::info!("camera {:?}: new background after frame {number}", camera.name()),
            Err(error) => tracing::warn!("{error}"),
        }
        // A peer that has gone does not use it: see `Learning`.
        let _ = captured.order.answer.send(used);
    }

    /// Makes a frame's silhouette and hands it in; returns which share of the image it covers.
    fn offer(
        &self,
        camera: &mut ReadyCamera,
        frame: SourceFrame,
        missed: u64,
        pace: Option<CameraPace>,
        image: &Image,
        masks: &mut MaskWatch,
    ) -> Result<f64, CaptureError> {
        let began = Instant::now();
        let name = camera.config.camera.name();
        let silhouette = silhouette(camera.segmenter.as_mut(), image, name)
            .map_err(|error| camera.segmentation_error(error))?;
        if image.kind == ImageKind::Mask {
            warn_of_masks(camera, masks.note(&silhouette, self.context.fps));
        }
        let stamp = Stamp {
            number: frame.number,
            capture_time_s: frame.capture_time_s,
            captured_unix_s: match self.start.lock_step {
                true => unix_now_s(),
                false => self.start.epoch_unix_s + frame.capture_time_s,
            },
        };
        let segment_ms = began.elapsed().as_secs_f64() * 1e3;
        self.colours.keep(self.index, frame.number, image, &silhouette);
        let part = CameraFrame::new(&camera.observer, silhouette, segment_ms);
        let mut part = part.stamped(camera.config.source.stamps(), pace);
        let mut age_s = segment_ms / 1e3;
        if !self.start.lock_step {
            let now_s = self.clock.now_s();
            part.late_s = now_s - frame.number as f64 / self.context.fps;
            age_s = (now_s - stamp.capture_time_s).max(0.0);
        }
        let pixels = f64::from(part.silhouette.width()) * f64::from(part.silhouette.height());
        let foreground = part.silhouette.area() as f64 / pixels;
        self.ring.offer(self.index, stamp, part);
        let segment_s = segment_ms / 1e3;
        self.meter.filmed(self.index, FilmedFrame { missed, foreground, segment_s, age_s });
        Ok(foreground)
    }

    /// Waits until frame `next` is due; the oldest frame that is still of use, or `None` if the run stops.
    fn await_turn(&self, next: u64) -> Option<u64> {
        self.beat.waits();
        if self.start.lock_step {
            return self.gate.wait_for(next).then_some(next);
        }
        if self.is_live {
            return (!self.gate.is_stopped()).then_some(next);
        }
        self.gate.sleep_until(next as f64 / self.context.fps, &self.clock).then(|| {
            // A frame is still of use while it is the newest one due; older ones are too late.
            let due = (self.clock.now_s() * self.context.fps).floor().max(0.0) as u64;
            next.max(due)
        })
    }
}

/// Cuts out with the new background from now on, unless the room was not empty.
fn use_background(camera: &mut ReadyCamera, captured: &CapturedBackground) -> Result<(), BackgroundError> {
    let name = || camera.config.camera.name().to_owned();
    if captured.is_occupied() {
        return Err(BackgroundError::Foreground { camera: name(), share: captured.foreground });
    }
    let used = captured.model.clone().and_then(|model| match &mut camera.segmenter {
        Some(segmenter) => Ok(segmenter.use_background(captured.order.film.id, model)?),
        None => Err(CutoutError::NoSegmenter),
    });
    used.map_err(|error| BackgroundError::Cutout { camera: name(), error })
}

/// Cuts out with the background again that was in use before that one.
fn restore(camera: &mut ReadyCamera, id: u64) {
    let restored = camera.segmenter.as_mut().map(|segmenter| segmenter.restore_background(id));
    let name = camera.name();
    match restored {
        Some(Ok(true)) => tracing::info!("camera {name:?}: the background before is in use again"),
        Some(Err(error)) => tracing::warn!("camera {name:?} keeps its background: {error}"),
        Some(Ok(false)) | None => {}
    }
}

/// Says what is odd about a camera's masks, with their folder.
fn warn_of_masks(camera: &ReadyCamera, problem: Option<MaskWarning>) {
    if let (Some(problem), SourceConfig::Masks(files)) = (problem, &camera.config.source) {
        tracing::warn!("camera {:?}: {}: {problem}", camera.name(), files.path.display());
    }
}
