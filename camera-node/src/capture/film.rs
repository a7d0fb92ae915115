//! The film of all cameras of a node: runs begin, go on as far as credits allow, and stop.

use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Duration;

use film_time::{BackgroundFilm, ClockLine, RunStart};
use parking_lot::Mutex;
use telemetry::{Beat, Pulse};

use super::CaptureError;
use super::background::{BackgroundError, BackgroundSlot, Learning, check_background};
use super::camera::ReadyCamera;
use super::capture_loop::{CaptureLoop, Opened};
use super::film_clock::FilmClock;
use super::filming::Filming;
use super::gate::Gate;
use crate::config::{NodeCamera, NodeConfig};
use crate::frames::FrameRing;
use crate::metrics::FilmMeter;
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
    meter: Arc<FilmMeter>,
    pulse: Pulse,
    run: Mutex<Option<Run>>,
    /// Of the current run, or of one that starts. It has a lock of its own: a message never waits for sources to open.
    controls: Mutex<RunControls>,
}

struct FilmCamera {
    config: NodeCamera,
    ready: Arc<Mutex<ReadyCamera>>,
    slot: Arc<BackgroundSlot>,
    /// Of its film thread.
    beat: Arc<Beat>,
}

/// What messages of the lease holder change of a run: its number, credits, clock and frame phase.
#[derive(Default)]
struct RunControls {
    run: u64,
    gate: Arc<Gate>,
    clock: Option<Arc<FilmClock>>,
    phase: Arc<Mutex<Option<f64>>>,
}

struct Run {
    start: RunStart,
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
        let pulse = Pulse::default();
        let cameras = config.cameras.iter().zip(prepared).map(|(config, ready)| {
            let ready = Arc::new(Mutex::new(ready?));
            let beat = pulse.beat(format!("camera {:?}", config.camera.name()));
            Ok(FilmCamera { config: config.clone(), ready, slot: Arc::default(), beat })
        });
        let names = config.cameras.iter().map(|camera| camera.camera.name().to_owned());
        Ok(Film {
            fps: config.fps,
            ring,
            colours: Arc::new(ColourRing::new(config.cameras.len())),
            cameras: cameras.collect::<Result<_, _>>()?,
            meter: Arc::new(FilmMeter::new(names)),
            pulse,
            run: Mutex::default(),
            controls: Mutex::default(),
        })
    }

    /// The colours of recent frames, kept while they are requested.
    pub fn colours(&self) -> Arc<ColourRing> {
        Arc::clone(&self.colours)
    }

    /// What its cameras have filmed.
    pub fn meter(&self) -> Arc<FilmMeter> {
        Arc::clone(&self.meter)
    }

    /// Whether the film threads get on.
    pub fn pulse(&self) -> Pulse {
        self.pulse.clone()
    }

    fn loops(
        &self,
        start: RunStart,
        gate: &Arc<Gate>,
        clock: &Arc<FilmClock>,
    ) -> Result<Vec<(CaptureLoop, Opened)>, CaptureError> {
        let capture_loop = |(index, camera): (usize, &FilmCamera)| {
            let context = self.context(start, gate, clock, &camera.beat);
            let capture = CaptureLoop {
                index,
                start,
                clock: Arc::clone(clock),
                is_live: camera.config.source.is_live(),
                context: context.clone(),
                ring: Arc::clone(&self.ring),
                colours: Arc::clone(&self.colours),
                gate: Arc::clone(gate),
                slot: Arc::clone(&camera.slot),
                meter: Arc::clone(&self.meter),
                beat: Arc::clone(&camera.beat),
            };
            camera.beat.works();
            let opened = camera.ready.lock().open(&context);
            camera.beat.waits();
            match opened {
                Err(error) if !(capture.reopens() && error.may_pass()) => Err(error),
                opened => Ok((capture, opened)),
            }
        };
        self.cameras.iter().enumerate().map(capture_loop).collect()
    }

    /// Ends the run that is on, if one is, and begins another.
    fn begin(&self, run: &mut Option<Run>, start: RunStart) -> Result<(), CaptureError> {
        if let Some(before) = run.take() {
            before.stop();
        }
        self.ring.begin_run(start.run, !start.lock_step);
        self.colours.clear();
        let (gate, clock) = (Arc::new(Gate::default()), Arc::new(FilmClock::new(start.clock)));
        self.meter.clock(start.clock.bound_s);
        *self.controls.lock() = RunControls {
            run: start.run,
            gate: Arc::clone(&gate),
            clock: Some(Arc::clone(&clock)),
            phase: Arc::default(),
        };
        // All sources open before any thread begins: one that never will leaves nothing running.
        let loops = self.loops(start, &gate, &clock)?;
        let threads = loops.into_iter().zip(&self.cameras).map(|((capture, opened), camera)| {
            let ready = Arc::clone(&camera.ready);
            std::thread::spawn(move || film(&capture, opened, &ready))
        });
        *run = Some(Run { start, gate, threads: threads.collect() });
        Ok(())
    }

    /// What the sources of a run are opened with.
    fn context(
        &self,
        start: RunStart,
        gate: &Arc<Gate>,
        clock: &Arc<FilmClock>,
        beat: &Arc<Beat>,
    ) -> OpenContext {
        let (gate, clock, beat) = (Arc::clone(gate), Arc::clone(clock), Arc::clone(beat));
        let phase = Arc::clone(&self.controls.lock().phase);
        let live_silence = if start.lock_step { Duration::MAX } else { silence(self.fps) };
        OpenContext {
            fps: self.fps,
            is_run: true,
            clock: Arc::new(move || clock.now_s()),
            phase: Arc::new(move || *phase.lock()),
            stopped: Arc::new(move || {
                // Who asks while it waits for a frame is not stuck in it.
                beat.works();
                gate.is_stopped()
            }),
            live_silence,
        }
    }

    /// The same of the run that is on.
    pub fn cut_here(&self, phase: f64) {
        *self.controls.lock().phase.lock() = Some(phase);
    }
}

impl Filming for Film {
    fn start(&self, start: RunStart) -> Result<(), CaptureError> {
        let mut run = self.run.lock();
        if run.as_ref().is_some_and(|run| run.start.run == start.run) {
            self.keep_time(start.run, start.clock);
            return Ok(());
        }
        self.begin(&mut run, start)
    }

    fn stop_if(&self, is_wanted: &dyn Fn() -> bool) -> bool {
        let mut run = self.run.lock();
        if !is_wanted() {
            return false;
        }
        *self.controls.lock() = RunControls::default();
        run.take().map(Run::stop).is_some()
    }

    fn credit(&self, up_to_frame: u64) {
        self.controls.lock().gate.credit(up_to_frame);
    }

    fn keep_time(&self, run: u64, line: ClockLine) -> bool {
        let controls = self.controls.lock();
        let Some(clock) = controls.clock.as_ref().filter(|_| controls.run == run) else { return true };
        self.meter.clock(line.bound_s);
        clock.follow(line)
    }

    fn start_again(&self, run: u64, line: ClockLine) -> Result<(), CaptureError> {
        let mut current = self.run.lock();
        let start = current.as_ref().map(|current| current.start).filter(|start| start.run == run);
        match start {
            Some(start) if !start.lock_step && !self.keep_time(run, line) => {
                tracing::warn!("film starts again: the coordinator's clock stood still");
                self.begin(&mut current, RunStart { clock: line, ..start })
            }
            _ => Ok(()),
        }
    }

    fn cut_at(&self, run: u64, phase: f64) {
        let controls = self.controls.lock();
        if controls.run == run {
            *controls.phase.lock() = Some(phase);
        }
    }

    fn take_background(&self, film: BackgroundFilm) -> Result<Learning, BackgroundError> {
        self.check_background(film)?;
        let cameras = self.cameras.iter().map(|camera| (camera.config.camera.name(), &camera.slot));
        Ok(Learning::begin(film, cameras))
    }

    fn check_background(&self, film: BackgroundFilm) -> Result<(), BackgroundError> {
        check_background(film, self.cameras.iter().map(|camera| &camera.config), self.fps)
    }

    fn restore_background(&self, id: u64) {
        self.cameras.iter().for_each(|camera| camera.slot.restore(id));
    }
}

impl Drop for Film {
    fn drop(&mut self) {
        self.stop_if(&|| true);
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
    let mut camera = camera.lock();
    capture.slot.set_filmed(true);
    let run = std::panic::AssertUnwindSafe(|| capture.run(&mut camera, opened));
    let filmed = std::panic::catch_unwind(run).unwrap_or(Err(CaptureError::Panicked));
    capture.beat.waits();
    capture.slot.set_filmed(false);
    match filmed {
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

#[cfg(test)]
mod tests {
    use film_time::{FilmState, Pace};
    use hull::ProbeSettings;
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
    fn no_film_time_makes_film_panic() {
        let film = film(None);
        let begins = |run: u64, film_s: f64| {
            let clock = ClockLine { film_s, ..ClockLine::of_this_process(0.0) };
            film.start(RunStart { clock, ..RunStart::of_this_process(Pace::live(run, 0.0)) }).expect("opens");
        };
        for (run, film_s) in (1..).zip([-1e300, f64::NEG_INFINITY, f64::NAN]) {
            begins(run, film_s);
        }
        begins(9, 1e300);
        assert_eq!(end_of(&film), FilmState::Ended, "no number is left for a frame");
    }

    #[test]
    fn film_far_ahead_of_the_coordinator_s_time_starts_again() {
        let film = film(None);
        let line = |film_s: f64| ClockLine { film_s, ..ClockLine::of_this_process(film_time::monotonic_s()) };
        let newest = || film.ring.newest().map_or(0, |frame| frame.number);
        let film_until = |is: &dyn Fn(u64) -> bool| {
            let began = std::time::Instant::now();
            while !is(newest()) {
                assert!(began.elapsed() < Duration::from_secs(60), "the newest frame is {}", newest());
                std::thread::sleep(Duration::from_millis(1));
            }
        };
        let start = RunStart::of_this_process(Pace::live(1, 0.0));
        film.start(RunStart { clock: line(1000.0), ..start }).expect("opens");
        film_until(&|newest| newest >= 30_000);
        assert!(film.keep_time(1, line(1000.2)), "a little is made good by and by");
        assert!(!film.keep_time(1, line(500.0)));
        film.start_again(2, line(500.0)).expect("another run's");
        assert!(newest() >= 30_000);
        film.start_again(1, line(500.0)).expect("opens");
        film_until(&|newest| (15_000..29_000).contains(&newest));
        assert!(film.keep_time(1, line(500.0)) && film.keep_time(1, line(900.0)));
        film_until(&|newest| newest >= 27_000);
    }

    #[test]
    fn a_credit_beyond_the_end_makes_the_last_frame_and_no_more() {
        let film = film(Some(12));
        film.start(RunStart::of_this_process(Pace::lock_step(1))).expect("opens");
        film.credit(u64::MAX);
        assert_eq!(end_of(&film), FilmState::Ended);
        assert_eq!(film.ring.newest().expect("frames").number, 11);
        assert!(film.ring.get(4).is_ok(), "the last frames stay");
    }
}
