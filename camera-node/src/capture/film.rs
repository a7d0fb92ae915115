//! The film of all cameras of a node: runs begin, go on as far as credits allow, and stop.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use proto::{Pace, unix_now_s};

use super::CaptureError;
use super::background::{BackgroundError, BackgroundRequest, RequestSlot};
use super::camera::ReadyCamera;
use super::capture_loop::{CaptureLoop, Opened};
use super::gate::Gate;
use crate::config::{NodeCamera, NodeConfig};
use crate::frames::FrameRing;
use crate::pictures::ColourRing;
use crate::source::OpenContext;

/// A live camera that misses so many frames, and for so long, has failed. Dim light makes some cameras slow, and no
/// camera that slow.
const SILENT_FRAMES: f64 = 30.0;
const LEAST_SILENCE: Duration = Duration::from_secs(1);

/// The film of all cameras of a node.
pub struct Film {
    fps: f64,
    ring: Arc<FrameRing>,
    colours: Arc<ColourRing>,
    cameras: Vec<FilmCamera>,
    run: Mutex<Option<Run>>,
    /// Of the run that is on, or begins; apart from it, so that a credit never waits for sources to open.
    gate: Mutex<Arc<Gate>>,
}

struct FilmCamera {
    config: NodeCamera,
    ready: Arc<Mutex<ReadyCamera>>,
    slot: Arc<RequestSlot>,
}

struct Run {
    pace: Pace,
    gate: Arc<Gate>,
    threads: Vec<JoinHandle<()>>,
}

impl Film {
    /// Learns every camera's background, all at once. Blocks until done.
    pub fn prepare(config: &NodeConfig, ring: Arc<FrameRing>) -> Result<Film, CaptureError> {
        let machine = std::thread::available_parallelism().map_or(1, usize::from);
        let cores = (machine / config.cameras.len().max(1)).max(1);
        let observers = config.observers();
        let prepared: Vec<Result<ReadyCamera, CaptureError>> = std::thread::scope(|scope| {
            let begin = |(camera, observer)| {
                scope.spawn(move || ReadyCamera::prepare(camera, observer, config.fps, cores))
            };
            let threads: Vec<_> = config.cameras.iter().zip(observers).map(begin).collect();
            threads.into_iter().map(|thread| thread.join().unwrap_or(Err(CaptureError::Panicked))).collect()
        });
        let cameras = config.cameras.iter().zip(prepared).map(|(config, ready)| {
            let ready = Arc::new(Mutex::new(ready?));
            Ok(FilmCamera { config: config.clone(), ready, slot: Arc::default() })
        });
        Ok(Film {
            fps: config.fps,
            ring,
            colours: Arc::new(ColourRing::new(config.cameras.len())),
            cameras: cameras.collect::<Result<_, _>>()?,
            run: Mutex::default(),
            gate: Mutex::default(),
        })
    }

    /// The colours of recent frames, kept while they are requested.
    pub fn colours(&self) -> Arc<ColourRing> {
        Arc::clone(&self.colours)
    }

    /// Begins a run. The pace it runs at already changes nothing; another one begins film anew. Blocks
    /// while sources open and an earlier run stops. Refused if a source cannot be opened; but live ones of a run
    /// that is not in lock-step, which the system may only lack something for, are opened until they film.
    pub fn start(&self, pace: Pace) -> Result<(), CaptureError> {
        let mut run = lock(&self.run);
        if run.as_ref().is_some_and(|run| run.pace == pace) {
            return Ok(());
        }
        if let Some(before) = run.take() {
            before.stop();
        }
        self.ring.clear();
        self.colours.clear();
        let gate = Arc::new(Gate::default());
        *lock(&self.gate) = Arc::clone(&gate);
        // All sources open before any thread begins: one that never will leaves nothing running.
        let loops = self.loops(pace, &gate)?;
        let threads = loops.into_iter().zip(&self.cameras).map(|((capture, opened), camera)| {
            let ready = Arc::clone(&camera.ready);
            std::thread::spawn(move || film(&capture, opened, &ready))
        });
        *run = Some(Run { pace, gate, threads: threads.collect() });
        Ok(())
    }

    fn loops(&self, pace: Pace, gate: &Arc<Gate>) -> Result<Vec<(CaptureLoop, Opened)>, CaptureError> {
        let context = self.context(pace, gate);
        let capture_loop = |(index, camera): (usize, &FilmCamera)| {
            camera.slot.set(None);
            let capture = CaptureLoop {
                index,
                pace,
                is_live: camera.config.source.is_live(),
                context: context.clone(),
                ring: Arc::clone(&self.ring),
                colours: Arc::clone(&self.colours),
                gate: Arc::clone(gate),
                slot: Arc::clone(&camera.slot),
            };
            match lock(&camera.ready).open(&context) {
                Err(error) if !(capture.reopens() && error.may_pass()) => Err(error),
                opened => Ok((capture, opened)),
            }
        };
        self.cameras.iter().enumerate().map(capture_loop).collect()
    }

    /// What the sources of a run are opened with.
    fn context(&self, pace: Pace, gate: &Arc<Gate>) -> OpenContext {
        let gate = Arc::clone(gate);
        let live_silence = if pace.lock_step { Duration::MAX } else { silence(self.fps) };
        OpenContext {
            fps: self.fps,
            clock: Arc::new(move || unix_now_s() - pace.epoch_unix_s),
            stopped: Arc::new(move || gate.is_stopped()),
            live_silence,
        }
    }

    /// Has every camera learn its background anew from frames of the film; until it has, the old one stays in
    /// use. Refused if a camera has none to learn.
    pub fn take_background(&self, request: BackgroundRequest) -> Result<(), BackgroundError> {
        self.check_background(request)?;
        self.cameras.iter().for_each(|camera| camera.slot.set(Some(request)));
        Ok(())
    }

    /// Whether [`Film::take_background`] would be refused, and why.
    pub fn check_background(&self, request: BackgroundRequest) -> Result<(), BackgroundError> {
        request.check(self.cameras.iter().map(|camera| &camera.config), self.fps)
    }

    /// Lets a lock-step run go on up to this frame.
    pub fn credit(&self, up_to_frame: u64) {
        lock(&self.gate).credit(up_to_frame);
    }
}

impl Drop for Film {
    fn drop(&mut self) {
        if let Some(run) = lock(&self.run).take() {
            run.stop();
        }
    }
}

impl Run {
    fn stop(self) {
        self.gate.stop();
        for thread in self.threads {
            // A panic of the thread was caught and reported inside it.
            let _ = thread.join();
        }
    }
}

/// A film thread: the ring hears how the film ended.
fn film(capture: &CaptureLoop, opened: Opened, camera: &Mutex<ReadyCamera>) {
    let mut camera = lock(camera);
    let run = std::panic::AssertUnwindSafe(|| capture.run(&mut camera, opened));
    match std::panic::catch_unwind(run).unwrap_or(Err(CaptureError::Panicked)) {
        Ok(()) => capture.ring.end(capture.index),
        Err(error) => {
            tracing::error!("{error}");
            capture.ring.fail(error.to_string());
        }
    }
}

/// How long a live source that films may give nothing.
fn silence(fps: f64) -> Duration {
    Duration::try_from_secs_f64(SILENT_FRAMES / fps).map_or(LEAST_SILENCE, |frames| frames.max(LEAST_SILENCE))
}

/// What these locks guard is consistent between any two statements that can panic.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use hull::ProbeSettings;
    use proto::FilmState;
    use segment::SegmentSettings;

    use super::*;
    use crate::source::{SourceConfig, StageConfig};

    /// The film of one camera of the studio.
    fn film(frames: Option<u64>) -> Film {
        let camera = NodeCamera {
            camera: crate::source::tests::camera(16, 12),
            rig_index: 0,
            source: SourceConfig::Stage(StageConfig { frames, ..StageConfig::default() }),
            background: None,
            segmentation: SegmentSettings::default(),
            ignored: None,
        };
        let config = NodeConfig { cameras: vec![camera], settings: ProbeSettings::default(), fps: 30.0 };
        Film::prepare(&config, Arc::new(FrameRing::new(1))).expect("a background")
    }

    fn end_of(film: &Film) -> FilmState {
        while film.ring.state() == FilmState::Running {
            std::thread::sleep(Duration::from_millis(1));
        }
        film.ring.state()
    }

    #[test]
    fn no_epoch_makes_film_panic() {
        let film = film(None);
        for epoch_unix_s in [1e300, f64::INFINITY, f64::NAN] {
            film.start(Pace { epoch_unix_s, lock_step: false }).expect("opens");
        }
        film.start(Pace { epoch_unix_s: -1e300, lock_step: false }).expect("opens");
        assert_eq!(end_of(&film), FilmState::Ended, "no number is left for a frame");
    }

    #[test]
    fn a_credit_beyond_the_end_makes_the_last_frame_and_no_more() {
        let film = film(Some(12));
        film.start(Pace { epoch_unix_s: 0.0, lock_step: true }).expect("opens");
        film.credit(u64::MAX);
        assert_eq!(end_of(&film), FilmState::Ended);
        assert_eq!(film.ring.newest().expect("frames").number, 11);
        assert!(film.ring.get(4).is_ok(), "the last frames stay");
    }
}
