//! Film: a thread a camera that takes frames when they are due, segments them and offers them to the
//! ring. In real time a frame that comes too late is passed over; in lock-step every frame is made, as
//! far ahead as credits allow.

mod background;

pub use background::{Lesson, MAX_LESSON_FRAMES};

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use hull::{Observer, Silhouette};
use segment::{BackgroundBuilder, BackgroundModel, Format, Layout, ModelError, SegmentSettings, Segmenter};
use thiserror::Error;

use crate::frames::{CameraFrame, FrameRing, Stamp};
use crate::source::{Image, Kind, OpenContext, Source, SourceError};
use crate::{NodeCamera, NodeConfig};
use background::{Desk, Pupil};

/// How long a thread sleeps at most before it looks whether it should stop.
const NAP: Duration = Duration::from_millis(20);

/// Why a camera's film cannot begin, or ends early.
#[derive(Debug, Error)]
pub enum CaptureError {
    /// The source.
    #[error("camera {camera:?}: {error}")]
    Source {
        /// Which camera.
        camera: String,
        /// What happened.
        error: SourceError,
    },
    /// The background clip or the segmentation's settings.
    #[error("camera {camera:?}: {what}: {problem}")]
    Segment {
        /// Which camera.
        camera: String,
        /// Background or segmentation.
        what: &'static str,
        /// What was found and expected.
        problem: String,
    },
}

/// Wall clock, unix seconds.
pub fn unix_now_s() -> f64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0.0, |since| since.as_secs_f64())
}

/// When a run began and how it is paced.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pace {
    /// Unix seconds at which film time is zero.
    pub epoch_unix_s: f64,
    /// Every frame, as credits allow, instead of in real time.
    pub lock_step: bool,
}

/// A camera ready to film: its background is learnt.
pub struct ReadyCamera {
    config: NodeCamera,
    observer: Arc<Observer>,
    /// `None` if the source gives masks.
    cutter: Option<Cutter>,
}

/// What makes silhouettes of one camera's colour frames.
struct Cutter {
    settings: SegmentSettings,
    /// The empty room, unless the settings need none.
    background: Option<BackgroundModel>,
    segmenter: Segmenter,
    /// Cores that one frame may take.
    cores: usize,
    /// Was the last frame hardly a person any more?
    doubted: bool,
}

/// The film of all cameras of a node.
pub struct Film {
    fps: f64,
    ring: Arc<FrameRing>,
    cameras: Vec<Arc<Mutex<ReadyCamera>>>,
    /// One a camera.
    desks: Vec<Arc<Desk>>,
    /// Why a camera has no background to learn, if one has none.
    no_lessons: Option<String>,
    run: Mutex<Option<Run>>,
}

struct Run {
    pace: Pace,
    gate: Arc<Gate>,
    threads: Vec<JoinHandle<()>>,
}

/// What stops a run, and how far it may go ahead.
struct Gate {
    stop: AtomicBool,
    up_to_frame: Mutex<u64>,
    raised: Condvar,
}

impl Film {
    /// Learns every camera's background, all at once. Blocks until done.
    pub fn prepare(config: &NodeConfig, ring: Arc<FrameRing>) -> Result<Film, CaptureError> {
        let observers = config.observers();
        let machine = std::thread::available_parallelism().map_or(1, usize::from);
        let cores = (machine / config.cameras.len().max(1)).max(1);
        let prepared: Vec<Result<ReadyCamera, CaptureError>> = std::thread::scope(|scope| {
            let threads: Vec<_> = config
                .cameras
                .iter()
                .zip(observers)
                .map(|(camera, observer)| scope.spawn(move || ready(camera, observer, config.fps, cores)))
                .collect();
            threads.into_iter().map(|thread| thread.join().unwrap_or_else(|_| Err(panicked()))).collect()
        });
        let cameras = prepared
            .into_iter()
            .map(|camera| camera.map(|camera| Arc::new(Mutex::new(camera))))
            .collect::<Result<_, _>>()?;
        let desks = config.cameras.iter().map(|_| Arc::default()).collect();
        let no_lessons = config.cameras.iter().find_map(background::why_not);
        Ok(Film { fps: config.fps, ring, cameras, desks, no_lessons, run: Mutex::new(None) })
    }

    /// Begins a run. The pace it runs at already changes nothing; another one begins film anew. Blocks
    /// while sources open and an earlier run stops.
    pub fn start(&self, pace: Pace) -> Result<(), CaptureError> {
        let mut run = self.run.lock().unwrap_or_else(PoisonError::into_inner);
        if run.as_ref().is_some_and(|run| run.pace == pace) {
            return Ok(());
        }
        if let Some(before) = run.take() {
            before.stop();
        }
        self.ring.clear();
        let clock = move || unix_now_s() - pace.epoch_unix_s;
        let context = OpenContext { fps: self.fps, clock: Arc::new(clock) };
        let gate = Arc::new(Gate {
            stop: AtomicBool::new(false),
            up_to_frame: Mutex::new(0),
            raised: Condvar::new(),
        });
        // All sources open before any thread begins: a source that cannot leaves nothing running.
        let mut rolls = Vec::new();
        for (index, camera) in self.cameras.iter().enumerate() {
            let ready = camera.lock().unwrap_or_else(PoisonError::into_inner);
            let config = &ready.config;
            let source = config
                .source
                .open(&config.camera, usize::from(config.rig_index), &context)
                .map_err(|error| CaptureError::Source { camera: config.camera.name().into(), error })?;
            let roll = Roll {
                index,
                pace,
                fps: self.fps,
                live: config.source.is_live(),
                source,
                ring: Arc::clone(&self.ring),
                gate: Arc::clone(&gate),
                desk: Arc::clone(&self.desks[index]),
            };
            roll.desk.set(None);
            rolls.push(roll);
        }
        let mut threads = Vec::new();
        for (roll, camera) in rolls.into_iter().zip(&self.cameras) {
            let camera = Arc::clone(camera);
            threads.push(std::thread::spawn(move || {
                let mut camera = camera.lock().unwrap_or_else(PoisonError::into_inner);
                let (ring, index) = (Arc::clone(&roll.ring), roll.index);
                let outcome =
                    std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| roll.film(&mut camera)));
                match outcome.unwrap_or_else(|_| Err(panicked())) {
                    Ok(()) => ring.end(index),
                    Err(error) => {
                        tracing::error!("{error}");
                        ring.fail(error.to_string());
                    }
                }
            }));
        }
        *run = Some(Run { pace, gate, threads });
        Ok(())
    }

    /// Has every camera learn its background anew from frames of the film; until it has, the old one stays in
    /// use. Refused, in one line, if a camera has none to learn.
    pub fn take_background(&self, lesson: Lesson) -> Result<(), String> {
        self.can_take_background(lesson)?;
        self.desks.iter().for_each(|desk| desk.set(Some(lesson)));
        Ok(())
    }

    /// Whether [`Film::take_background`] would be refused, and why.
    pub fn can_take_background(&self, lesson: Lesson) -> Result<(), String> {
        let Lesson { frames, .. } = lesson;
        if !(1..=MAX_LESSON_FRAMES).contains(&frames) {
            return Err(format!("a background of {frames} frames, expected 1 to {MAX_LESSON_FRAMES}"));
        }
        self.no_lessons.clone().map_or(Ok(()), Err)
    }

    /// Lets a lock-step run go on up to this frame.
    pub fn credit(&self, up_to_frame: u64) {
        let run = self.run.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(run) = run.as_ref() {
            let mut allowed = run.gate.up_to_frame.lock().unwrap_or_else(PoisonError::into_inner);
            *allowed = (*allowed).max(up_to_frame);
            run.gate.raised.notify_all();
        }
    }
}

impl Drop for Film {
    fn drop(&mut self) {
        if let Some(run) = self.run.lock().unwrap_or_else(PoisonError::into_inner).take() {
            run.stop();
        }
    }
}

impl Run {
    fn stop(self) {
        self.gate.stop.store(true, Ordering::Relaxed);
        self.gate.raised.notify_all();
        for thread in self.threads {
            // A panic of the thread was caught and told inside it.
            let _ = thread.join();
        }
    }
}

impl Gate {
    /// Waits until a frame may be made; false if the run stops.
    fn wait_for(&self, frame: u64) -> bool {
        let mut allowed = self.up_to_frame.lock().unwrap_or_else(PoisonError::into_inner);
        while !self.stop.load(Ordering::Relaxed) {
            if frame <= *allowed {
                return true;
            }
            let (next, _) = self.raised.wait_timeout(allowed, NAP).unwrap_or_else(PoisonError::into_inner);
            allowed = next;
        }
        false
    }

    /// Sleeps until a moment of the wall clock; false if the run stops.
    fn sleep_until(&self, unix_s: f64) -> bool {
        loop {
            if self.stop.load(Ordering::Relaxed) {
                return false;
            }
            let left = unix_s - unix_now_s();
            if left <= 0.0 {
                return true;
            }
            std::thread::sleep(Duration::from_secs_f64(left).min(NAP));
        }
    }
}

/// One camera's film of one run.
struct Roll {
    index: usize,
    pace: Pace,
    fps: f64,
    live: bool,
    source: Box<dyn Source>,
    ring: Arc<FrameRing>,
    gate: Arc<Gate>,
    desk: Arc<Desk>,
}

impl Roll {
    fn film(mut self, camera: &mut ReadyCamera) -> Result<(), CaptureError> {
        let name = camera.config.camera.name().to_owned();
        let mut image = Image::default();
        let mut pupil = Pupil::default();
        let mut next = 0u64;
        loop {
            let Some(at_least) = self.await_turn(next) else { return Ok(()) };
            let taken = self
                .source
                .next(at_least, &mut image)
                .map_err(|error| CaptureError::Source { camera: name.clone(), error })?;
            let Some(taken) = taken else { return Ok(()) };
            let began = Instant::now();
            let silhouette = silhouette(camera, &image).map_err(|problem| CaptureError::Segment {
                camera: name.clone(),
                what: "segmentation",
                problem,
            })?;
            let film_s = self.pace.epoch_unix_s + taken.capture_time_s;
            let stamp = Stamp {
                number: taken.number,
                capture_time_s: taken.capture_time_s,
                captured_unix_s: if self.pace.lock_step { unix_now_s() } else { film_s },
                skipped: taken.number.saturating_sub(next),
            };
            let segment_ms = began.elapsed().as_secs_f64() * 1e3;
            self.ring.colours().keep(self.index, taken.number, &image, &silhouette);
            self.ring.offer(self.index, stamp, CameraFrame::new(&camera.observer, silhouette, segment_ms));
            if let Some(learnt) = pupil.look(&self.desk, taken.number, &image) {
                match learnt.and_then(|model| camera.use_background(model)) {
                    Ok(()) => {
                        tracing::info!(
                            "camera {name:?}: a new background from frame {} on",
                            taken.number + 1
                        );
                    }
                    Err(problem) => tracing::warn!("camera {name:?} keeps its background: {problem}"),
                }
            }
            next = taken.number + 1;
        }
    }

    /// Waits until frame `next` is due, and says which is the oldest frame still of use; `None` if the
    /// run stops.
    fn await_turn(&self, next: u64) -> Option<u64> {
        if self.pace.lock_step {
            return self.gate.wait_for(next).then_some(next);
        }
        if self.live {
            return (!self.gate.stop.load(Ordering::Relaxed)).then_some(next);
        }
        let due_unix_s = self.pace.epoch_unix_s + next as f64 / self.fps;
        self.gate.sleep_until(due_unix_s).then(|| {
            // A frame is still of use while it is the newest one due; older ones are too late.
            let due = ((unix_now_s() - self.pace.epoch_unix_s) * self.fps).floor().max(0.0) as u64;
            next.max(due)
        })
    }
}

/// More raw foreground than this share of an image is no person: the camera was moved, or the light.
const DOUBTFUL_SHARE: f64 = 0.5;

fn silhouette(camera: &mut ReadyCamera, image: &Image) -> Result<Silhouette, String> {
    match (image.kind, &mut camera.cutter) {
        (Kind::Mask, _) => {
            let mask: Vec<u8> = image.data.iter().map(|&pixel| u8::from(pixel > 127)).collect();
            Silhouette::from_mask(image.width, image.height, &mask).map_err(|error| error.to_string())
        }
        (Kind::Colour(layout), Some(cutter)) => {
            let format = Format::new(layout, image.width, image.height).map_err(|error| error.to_string())?;
            cutter.cut(format, &image.data, camera.config.camera.name())
        }
        (Kind::Colour(_), None) => Err("colour frames and no segmenter, expected masks".into()),
    }
}

impl ReadyCamera {
    /// Frames are cut out with another background from now on.
    fn use_background(&mut self, model: BackgroundModel) -> Result<(), String> {
        let cutter = self.cutter.as_mut().ok_or("it cuts nothing out")?;
        *cutter = Cutter::new(&cutter.settings, model.format(), Some(model), cutter.cores)?;
        Ok(())
    }
}

impl Cutter {
    /// For frames of that format; another one's will do, too.
    fn new(
        settings: &SegmentSettings,
        format: Format,
        background: Option<BackgroundModel>,
        cores: usize,
    ) -> Result<Cutter, String> {
        let segmenter =
            Segmenter::new(settings, format, background.as_ref()).map_err(|error| error.to_string())?;
        let mut cutter = Cutter { settings: settings.clone(), background, segmenter, cores, doubted: false };
        cutter.segmenter.set_cores(cores);
        Ok(cutter)
    }

    /// The silhouette of a frame. The background may have come in another layout than the film does (a plate
    /// from a picture, a film from a camera): it is turned over when the first frame shows.
    fn cut(&mut self, format: Format, bytes: &[u8], camera: &str) -> Result<Silhouette, String> {
        if self.segmenter.format() != format {
            let background = self.background.as_ref().map(|model| model.in_layout(format.layout()));
            *self = Cutter::new(&self.settings, format, background, self.cores)?;
        }
        let found = self.segmenter.segment(bytes).map_err(|error| error.to_string())?;
        let doubted = found.raw_share > DOUBTFUL_SHARE;
        if doubted && !self.doubted {
            tracing::warn!(
                "camera {camera:?}: {:.0} % of the image differ from the background, is it still true?",
                100.0 * found.raw_share
            );
        }
        self.doubted = doubted;
        Ok(found.silhouette)
    }
}

fn ready(
    config: &NodeCamera,
    observer: Arc<Observer>,
    fps: f64,
    cores: usize,
) -> Result<ReadyCamera, CaptureError> {
    let wrong =
        |what, problem: String| CaptureError::Segment { camera: config.camera.name().into(), what, problem };
    let cutter = if matches!(config.source, crate::SourceConfig::Masks(_)) {
        None
    } else {
        let background = config.background.clone().or_else(|| config.source.empty_room());
        let model = match background {
            Some(background) => Some(learn(config, &background, fps)?),
            None => None,
        };
        let format = match &model {
            Some(model) => model.format(),
            None => Format::new(Layout::Rgb, config.camera.width(), config.camera.height())
                .map_err(|error| wrong("segmentation", error.to_string()))?,
        };
        let cutter = Cutter::new(&config.segmentation, format, model, cores)
            .map_err(|problem| wrong("segmentation", problem))?;
        Some(cutter)
    };
    Ok(ReadyCamera { config: config.clone(), observer, cutter })
}

/// Reads the whole clip of the empty room.
fn learn(
    config: &NodeCamera,
    background: &crate::SourceConfig,
    fps: f64,
) -> Result<BackgroundModel, CaptureError> {
    let camera = &config.camera;
    let context = OpenContext { fps, clock: Arc::new(|| 0.0) };
    let source_error = |error| CaptureError::Source { camera: camera.name().into(), error };
    let wrong =
        |problem: String| CaptureError::Segment { camera: camera.name().into(), what: "background", problem };
    let mut source =
        background.open(camera, usize::from(config.rig_index), &context).map_err(source_error)?;
    let mut builder: Option<BackgroundBuilder> = None;
    let mut image = Image::default();
    let mut next = 0;
    while let Some(taken) = source.next(next, &mut image).map_err(source_error)? {
        if builder.is_none() {
            let Kind::Colour(layout) = image.kind else {
                return Err(wrong("masks, expected colours".into()));
            };
            let format = Format::new(layout, image.width, image.height);
            builder = Some(BackgroundBuilder::new(format.map_err(|error| wrong(error.to_string()))?));
        }
        if let Some(builder) = &mut builder {
            builder.push(&image.data).map_err(|error| wrong(error.to_string()))?;
        }
        next = taken.number + 1;
    }
    let clip = builder.as_ref().map_or(Err(ModelError::Empty), BackgroundBuilder::finish);
    clip.map_err(|error| wrong(error.to_string()))
}

fn panicked() -> CaptureError {
    CaptureError::Segment { camera: String::new(), what: "film", problem: "a thread panicked".into() }
}

#[cfg(test)]
mod tests {
    use segment::{Range, Sampling, from_rgb};
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
        let mut cutter =
            Cutter::new(&SegmentSettings::default(), model.format(), Some(model), 1).expect("fits");
        let mut overlaps = Vec::new();
        for frame in [10, 40, 70] {
            camera.render(frame, &mut rgb);
            from_rgb(&rgb, format(layout), &mut bytes);
            let found = cutter.cut(format(layout), &bytes, "cam").expect("a silhouette").to_mask();
            let truth = camera.mask(settings.time_s(frame));
            let count = |both: fn(bool, bool) -> bool| {
                found.iter().zip(&truth).filter(|(a, b)| both(**a != 0, **b != 0)).count() as f64
            };
            overlaps.push(count(|a, b| a && b) / count(|a, b| a || b));
        }
        overlaps.iter().sum::<f64>() / overlaps.len() as f64
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
