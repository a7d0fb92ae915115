//! A film of the studio that can be late, silent, out of order, or lack frames.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::{Arc, Mutex};

use camera_node::frames::{CameraFrame, Frame, FrameRing, Stamp};
use coordinator::BoxError;
use film_time::Pace;
use hull::{Camera, Observer, ProbeSettings, Rig, Silhouette, ViewSet};
use setup::RingFilm;
use sim::Scene;
use stage::{StageSettings, studio_rig, true_silhouette};

pub const FPS: f64 = 30.0;

/// A film of the studio, drawn as it is asked for, and what is wrong with it.
pub struct Film {
    stage: StageSettings,
    pub observers: Vec<Arc<Observer>>,
    ring: FrameRing,
    /// The number of each frame, and the frame of the studio that it shows.
    shown: Vec<(u64, u64)>,
    drawn: Mutex<usize>,
    seen: Mutex<BTreeMap<u64, Vec<Silhouette>>>,
    /// Live: the epoch, once it is known, and how long after it the first frame comes.
    live: Mutex<Option<Pace>>,
    pub late_s: f64,
    /// Frames about which one camera does not answer.
    pub silent: Range<u64>,
}

pub fn stage_of(scene: &Scene) -> StageSettings {
    let hint = scene.stage().expect("a stage");
    StageSettings {
        motion: hint.motion.parse().unwrap_or_default(),
        person: hint.person,
        props: hint.props.iter().map(|prop| prop.parse().expect("a prop")).collect(),
        ..StageSettings::default()
    }
}

impl Film {
    /// A film of a scene that shows these frames.
    pub fn of(scene: &Scene, rig: &Rig, shown: Vec<(u64, u64)>) -> Film {
        let stage = stage_of(scene);
        let observer = |(index, camera): (u16, &Camera)| {
            Arc::new(Observer::new(camera.clone(), index, ProbeSettings::default(), None))
        };
        Film {
            stage,
            observers: (0..).zip(rig.cameras()).map(observer).collect(),
            ring: FrameRing::new(rig.cameras().len()),
            shown,
            drawn: Mutex::default(),
            seen: Mutex::default(),
            live: Mutex::default(),
            late_s: 0.0,
            silent: 0..0,
        }
    }

    fn draw(&self, number: u64, content: u64) {
        // Nothing moves where there is no person.
        let content = if self.stage.person { content } else { 0 };
        let time_s = self.stage.time_s(content);
        let mut seen = self.seen.lock().expect("whole");
        let silhouettes = seen.entry(content).or_insert_with(|| {
            let cameras = self.observers.iter().map(|observer| observer.camera());
            cameras.map(|camera| true_silhouette(&self.stage, camera, time_s).expect("drawn")).collect()
        });
        if self.ring.newest().is_ok_and(|newest| newest.number >= number) {
            self.ring.begin_run(1, false);
        }
        let stamp = Stamp { number, capture_time_s: time_s, captured_unix_s: time_s };
        for (index, (observer, silhouette)) in self.observers.iter().zip(silhouettes).enumerate() {
            self.ring.offer(index, stamp, CameraFrame::new(observer, silhouette.clone(), 0.0));
        }
    }
}

impl RingFilm for Film {
    fn ring(&self) -> &FrameRing {
        &self.ring
    }

    fn start(&self, pace: Pace) -> Result<(), BoxError> {
        *self.live.lock().expect("whole") = (!pace.lock_step).then_some(pace);
        Ok(())
    }

    fn credit(&self, up_to_frame: u64) {
        let mut drawn = self.drawn.lock().expect("whole");
        // Always one that new: film that drops frames goes on to the next that there is.
        while self.ring.newest().map_or(0, |frame| frame.number + 1) <= up_to_frame {
            let Some(&(number, content)) = self.shown.get(*drawn) else {
                return (0..self.observers.len()).for_each(|camera| self.ring.end(camera));
            };
            self.draw(number, content);
            *drawn += 1;
        }
    }

    fn poll(&self) {
        let Some(pace) = *self.live.lock().expect("whole") else { return };
        let film_s = pace.film_now_s();
        if film_s >= self.late_s {
            self.credit((film_s * FPS) as u64);
        }
    }

    fn views<'a>(&self, frame: &'a Frame) -> Option<Cow<'a, ViewSet>> {
        (!self.silent.contains(&frame.number)).then_some(Cow::Borrowed(&frame.views))
    }
}

pub fn rig() -> Rig {
    studio_rig(4, (320, 240)).expect("a rig")
}

/// So many frames, each shown in its turn.
pub fn all(frames: u64) -> Vec<(u64, u64)> {
    (0..frames).map(|frame| (frame, frame)).collect()
}
