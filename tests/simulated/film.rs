//! Film without threads: silhouettes that were drawn before, offered by a task when they are due.

use std::sync::{Arc, Mutex};
use std::time::Duration;

use camera_node::capture::{BackgroundError, CaptureError, FilmClock, Filming, Learning};
use camera_node::frames::{CameraFrame, FrameRing, Stamp};
use camera_node::source::{SourceConfig, StageConfig};
use camera_node::{NodeCamera, NodeConfig};
use film_time::{BackgroundFilm, ClockLine, RunStart};
use hull::{Observer, ProbeSettings, Rig, Silhouette};
use segment::SegmentSettings;
use stage::{Motion, StageSettings};
use tokio::task::JoinHandle;

pub const NODES: usize = 3;
pub const CAMERAS: usize = 2 * NODES;
pub const FPS: f64 = 10.0;
const SIZE: (u32, u32) = (48, 36);
/// From a frame's film time to its silhouette, seconds.
const TAKES_S: f64 = 0.015;

/// What all rooms film.
pub struct Studio {
    pub rig: Rig,
    /// By camera and frame; film starts over after the last.
    silhouettes: Arc<Vec<Vec<Silhouette>>>,
}

impl Studio {
    pub fn new() -> Studio {
        let rig = stage::studio_rig(CAMERAS, SIZE).expect("a rig");
        let settings = StageSettings { motion: Motion::Sweep, fps: FPS, ..StageSettings::default() };
        let (begin_s, period_s) = (settings.motion.loop_start_s(), settings.motion.period_s());
        let frames = (period_s * FPS).round() as usize;
        let film = |camera| {
            let drawn = (0..frames).map(|frame| {
                let time_s = begin_s + frame as f64 / FPS;
                stage::true_silhouette(&settings, camera, time_s).expect("a silhouette")
            });
            drawn.collect()
        };
        let silhouettes = Arc::new(rig.cameras().iter().map(film).collect());
        Studio { rig, silhouettes }
    }

    /// The cameras of a node, or those of all.
    pub fn config(&self, cameras: std::ops::Range<usize>) -> NodeConfig {
        let camera = |index: usize| NodeCamera {
            camera: self.rig.cameras()[index].clone(),
            rig_index: index as u16,
            source: SourceConfig::Stage(StageConfig::default()),
            background: None,
            segmentation: SegmentSettings::default(),
            ignored: None,
        };
        NodeConfig { cameras: cameras.map(camera).collect(), settings: ProbeSettings::default(), fps: FPS }
    }

    /// The film of a node's cameras into its ring.
    pub fn film(&self, config: &NodeConfig, ring: Arc<FrameRing>) -> SimulatedFilm {
        let cameras = Arc::new(Cameras {
            observers: config.observers(),
            silhouettes: Arc::clone(&self.silhouettes),
            ring,
        });
        SimulatedFilm { cameras, run: Mutex::default() }
    }
}

struct Cameras {
    observers: Vec<Arc<Observer>>,
    silhouettes: Arc<Vec<Vec<Silhouette>>>,
    ring: Arc<FrameRing>,
}

impl Cameras {
    /// Offers frame after frame, each once it is there.
    async fn film(self: Arc<Cameras>, clock: Arc<FilmClock>) {
        let mut frame = ((clock.now_s() - TAKES_S) * FPS).max(0.0).ceil() as u64;
        loop {
            let capture_time_s = frame as f64 / FPS;
            let left_s = capture_time_s + TAKES_S - clock.now_s();
            if left_s > 0.0 {
                tokio::time::sleep(Duration::from_secs_f64(left_s)).await;
            }
            for (place, observer) in self.observers.iter().enumerate() {
                let film = &self.silhouettes[usize::from(observer.rig_index())];
                let silhouette = film[frame as usize % film.len()].clone();
                let mut part = CameraFrame::new(observer, silhouette, 0.0);
                part.late_s = TAKES_S;
                let stamp = Stamp { number: frame, capture_time_s, captured_unix_s: 0.0 };
                self.ring.offer(place, stamp, part);
            }
            frame += 1;
        }
    }
}

/// A run of it.
struct Run {
    number: u64,
    clock: Arc<FilmClock>,
    task: JoinHandle<()>,
}

pub struct SimulatedFilm {
    cameras: Arc<Cameras>,
    run: Mutex<Option<Run>>,
}

impl Filming for SimulatedFilm {
    fn start(&self, start: RunStart) -> Result<(), CaptureError> {
        let mut run = self.run.lock().expect("no panic");
        if run.as_ref().is_some_and(|run| run.number == start.run) {
            return Ok(());
        }
        if let Some(before) = run.take() {
            before.task.abort();
        }
        self.cameras.ring.begin_run(start.run, !start.lock_step);
        let clock = Arc::new(FilmClock::new(start.clock));
        let task = tokio::spawn(Arc::clone(&self.cameras).film(Arc::clone(&clock)));
        *run = Some(Run { number: start.run, clock, task });
        Ok(())
    }

    fn stop_if(&self, is_wanted: &dyn Fn() -> bool) -> bool {
        let mut run = self.run.lock().expect("no panic");
        let stopped = if is_wanted() { run.take() } else { None };
        stopped.inspect(|run| run.task.abort()).is_some()
    }

    fn credit(&self, _: u64) {}

    fn keep_time(&self, number: u64, line: ClockLine) -> bool {
        let run = self.run.lock().expect("no panic");
        run.iter().filter(|run| run.number == number).all(|run| run.clock.follow(line))
    }

    fn start_again(&self, number: u64, line: ClockLine) -> Result<(), CaptureError> {
        let mut run = self.run.lock().expect("no panic");
        if let Some(run) = run.as_mut().filter(|run| run.number == number && !run.clock.follow(line)) {
            run.task.abort();
            self.cameras.ring.begin_run(number, true);
            run.clock = Arc::new(FilmClock::new(line));
            run.task = tokio::spawn(Arc::clone(&self.cameras).film(Arc::clone(&run.clock)));
        }
        Ok(())
    }

    fn cut_at(&self, _: u64, _: f64) {}

    fn take_background(&self, _: BackgroundFilm) -> Result<Learning, BackgroundError> {
        Err(BackgroundError::Masks("simulated".into()))
    }

    fn check_background(&self, _: BackgroundFilm) -> Result<(), BackgroundError> {
        Err(BackgroundError::Masks("simulated".into()))
    }

    fn restore_background(&self, _: u64) {}
}
