//! True silhouettes of the studio, drawn as a run asks for them; on request their outlines flicker.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::sync::Arc;

use camera_node::frames::{CameraFrame, Frame, FrameRing, Stamp};
use coordinator::BoxError;
use film_time::Pace;
use hull::{Camera, Observer, ProbeSettings, Silhouette, ViewSet};
use parking_lot::Mutex;
use setup::RingFilm;
use setup::cli::{Failure, Outcome};
use stage::{StageSettings, studio_rig, true_silhouette};

use crate::crews::each;
use crate::random::Random;

/// What cameras see at best.
pub const FINEST: (u32, u32) = (7680, 4320);

/// The studio as its cameras truly see it: each frame is drawn once, however many runs see it.
pub struct StageFilm {
    /// What is filmed.
    pub stage: StageSettings,
    /// The cameras, in rig order.
    pub observers: Vec<Arc<Observer>>,
    drawn: Mutex<BTreeMap<u64, Vec<CameraFrame>>>,
}

impl StageFilm {
    /// A studio of so many cameras of this size.
    pub fn new(stage: StageSettings, cameras: usize, size: (u32, u32)) -> Outcome<StageFilm> {
        let rig =
            studio_rig(cameras, size).map_err(|error| Failure::input(format_args!("--size: {error}")))?;
        let observer = |(index, camera): (usize, &Camera)| {
            Arc::new(Observer::new(camera.clone(), index as u16, ProbeSettings::default(), None))
        };
        Ok(StageFilm {
            observers: rig.cameras().iter().enumerate().map(observer).collect(),
            drawn: Mutex::default(),
            stage,
        })
    }

    /// The frame in which all stands as in this one, and before which nothing repeats.
    fn first_like(&self, frame: u64) -> u64 {
        let (begin, period) = (self.stage.motion.loop_start_s(), self.stage.motion.period_s());
        let (begin, period) = ((begin * self.stage.fps).ceil() as u64, period * self.stage.fps);
        // A loop that is not so many whole frames long never repeats.
        if frame < begin || (period - period.round()).abs() > 1e-9 {
            return frame;
        }
        begin + (frame - begin) % period.round() as u64
    }

    fn cameras(&self, frame: u64) -> Outcome<Vec<CameraFrame>> {
        let frame = self.first_like(frame);
        if let Some(known) = self.drawn.lock().get(&frame) {
            return Ok(known.clone());
        }
        let time_s = self.stage.time_s(frame);
        let look = |index: usize| {
            let observer = &self.observers[index];
            let silhouette = true_silhouette(&self.stage, observer.camera(), time_s).map_err(Failure::run)?;
            Ok(Some(CameraFrame::new(observer, silhouette, 0.0)))
        };
        let seen: Vec<CameraFrame> = each(self.observers.len(), look)?.into_iter().flatten().collect();
        self.drawn.lock().insert(frame, seen.clone());
        Ok(seen)
    }
}

/// A film for one run.
pub struct Showing {
    film: Arc<StageFilm>,
    ring: FrameRing,
    /// The share of pixels on either side of an outline that are inverted, and the seed that says which.
    flicker: f64,
    seed: u64,
    tells_speeds: bool,
    /// The next frame to draw.
    next: Mutex<u64>,
}

impl Showing {
    /// The film with outlines that flicker.
    pub fn new(film: &Arc<StageFilm>, flicker: f64, seed: u64) -> Showing {
        let ring = FrameRing::new(film.observers.len());
        Showing { film: Arc::clone(film), ring, flicker, seed, tells_speeds: true, next: Mutex::new(0) }
    }

    /// The same; without speeds it is unknown how far planes moved since the frame before.
    pub fn telling_speeds(self, tells_speeds: bool) -> Showing {
        Showing { tells_speeds, ..self }
    }

    fn draw(&self, frame: u64) -> Outcome {
        let time_s = self.film.stage.time_s(frame);
        let stamp = Stamp { number: frame, capture_time_s: time_s, captured_unix_s: time_s };
        let cameras = self.film.cameras(frame)?;
        for (index, (observer, seen)) in self.film.observers.iter().zip(cameras).enumerate() {
            let seen = if self.flicker > 0.0 {
                let size = (seen.silhouette.width(), seen.silhouette.height());
                let mut random = Random::new((self.seed << 40) ^ (frame << 16) ^ index as u64);
                let mask = flickering(&seen.silhouette, self.flicker, &mut random);
                let silhouette = Silhouette::from_mask(size.0, size.1, &mask).map_err(Failure::run)?;
                CameraFrame::new(observer, silhouette, 0.0)
            } else {
                seen
            };
            self.ring.offer(index, stamp, seen);
        }
        Ok(())
    }
}

impl RingFilm for Showing {
    fn ring(&self) -> &FrameRing {
        &self.ring
    }

    fn start(&self, _: Pace) -> Result<(), BoxError> {
        self.credit(0);
        Ok(())
    }

    fn credit(&self, up_to_frame: u64) {
        let mut next = self.next.lock();
        while *next <= up_to_frame {
            if let Err(error) = self.draw(*next) {
                return self.ring.fail(error.to_string());
            }
            *next += 1;
        }
    }

    fn views<'a>(&self, frame: &'a Frame) -> Option<Cow<'a, ViewSet>> {
        if self.tells_speeds {
            return Some(Cow::Borrowed(&frame.views));
        }
        // No frames after another, nothing is known of it.
        Some(Cow::Owned(frame.views.clone().after(&frame.views, 0)))
    }
}

/// The silhouette with pixels on either side of its outlines inverted, each with this chance. The border stays.
fn flickering(silhouette: &Silhouette, chance: f64, random: &mut Random) -> Vec<u8> {
    let mask = silhouette.to_mask();
    let mut flickers = mask.clone();
    let Some(bounds) = silhouette.bounds() else { return flickers };
    let (width, height) = (silhouette.width() as usize, silhouette.height() as usize);
    // One pixel more on every side, within the border.
    let within =
        |first: u32, end: u32, size: usize| (first as usize).max(2) - 1..(end as usize + 1).min(size - 1);
    for row in within(bounds.top, bounds.bottom, height) {
        for at in within(bounds.left, bounds.right, width).map(|column| row * width + column) {
            let me = mask[at];
            let is_inner = mask[at - 1] == me && mask[at + 1] == me;
            if !(is_inner && mask[at - width] == me && mask[at + width] == me) && random.share() < chance {
                flickers[at] = 255 - me;
            }
        }
    }
    flickers
}

#[cfg(test)]
mod tests {
    use stage::Motion;

    use super::*;

    #[test]
    fn only_pixels_beside_an_outline_flicker() {
        let mut mask = vec![0u8; 40 * 30];
        for row in 10..20 {
            mask[row * 40 + 10..row * 40 + 30].fill(255);
        }
        let silhouette = Silhouette::from_mask(40, 30, &mask).expect("a size");
        let all = flickering(&silhouette, 1.0, &mut Random::new(3));
        let changed: Vec<usize> = (0..mask.len()).filter(|&at| all[at] != mask[at]).collect();
        // The outline of 20 by 10 pixels, within and without, and no corner without.
        assert_eq!(changed.len(), (2 * 20 + 2 * 8) + (2 * 20 + 2 * 10));
        assert_eq!(flickering(&silhouette, 0.0, &mut Random::new(3)), mask);
    }

    #[test]
    fn frames_of_a_loop_are_drawn_once() {
        let stage = StageSettings { motion: Motion::Idle, ..StageSettings::default() };
        let film = StageFilm::new(stage, 2, (64, 48)).expect("a film");
        assert_eq!((film.first_like(3), film.first_like(30), film.first_like(150)), (3, 30, 30));
        let silhouettes = |frame: u64| -> Vec<Arc<Silhouette>> {
            film.cameras(frame).expect("drawn").into_iter().map(|camera| camera.silhouette).collect()
        };
        assert_eq!(silhouettes(40), silhouettes(160));
        assert_eq!(film.drawn.lock().len(), 1);
    }
}
