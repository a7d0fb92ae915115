//! The cameras' films as times are looked for in them: silhouettes by the times they are said to be of, distance fields
//! made when they are wanted.

use std::sync::OnceLock;

use hull::{Camera, Silhouette};
use nalgebra::Point2;

use crate::check::field::{Blend, Field};
use crate::check::outline;
use crate::check::ray::Other;
use crate::check::refine::{CAP_PX, Scenery};

/// A frame of a camera's film.
#[derive(Clone, Debug)]
pub struct TimedSilhouette {
    /// When it was captured, as far as is known: seconds of film time.
    pub time_s: f64,
    /// What it shows.
    pub silhouette: Silhouette,
}

/// Two frames farther apart than this many usual ones say nothing about the time between them.
const WIDEST_GAP: f64 = 2.5;

/// One camera's film.
pub(super) struct CameraFilm<'a> {
    pub frames: &'a [TimedSilhouette],
    fields: Vec<OnceLock<Option<Field>>>,
    /// The usual time from frame to frame.
    pub interval_s: f64,
    spacing_px: u32,
    margin_px: u32,
}

/// The frames before and after a moment.
#[derive(Clone, Copy)]
struct Pair {
    before: usize,
    share: f64,
}

impl<'a> CameraFilm<'a> {
    /// At least two frames, in the order of their times.
    pub fn new(frames: &'a [TimedSilhouette], camera: &Camera, scale_px: f64) -> CameraFilm<'a> {
        let mut steps: Vec<f64> = frames.windows(2).map(|pair| pair[1].time_s - pair[0].time_s).collect();
        steps.sort_by(f64::total_cmp);
        CameraFilm {
            frames,
            fields: frames.iter().map(|_| OnceLock::new()).collect(),
            interval_s: steps[steps.len() / 2],
            spacing_px: (camera.width().max(camera.height()) / 600).max(1),
            margin_px: (CAP_PX * scale_px) as u32 + 2,
        }
    }

    /// The distance to a frame's silhouette; `None` if that is empty.
    pub fn field(&self, frame: usize) -> Option<&Field> {
        let make = || Field::new(&self.frames[frame].silhouette, self.spacing_px, self.margin_px);
        self.fields[frame].get_or_init(make).as_ref()
    }

    /// The frame whose time is nearest.
    pub fn nearest(&self, time_s: f64) -> usize {
        let after = self.frames.partition_point(|frame| frame.time_s < time_s).min(self.frames.len() - 1);
        let before = after.saturating_sub(1);
        let off_s = |frame: usize| (self.frames[frame].time_s - time_s).abs();
        if off_s(before) < off_s(after) { before } else { after }
    }

    /// `None` beyond the film's ends and in gaps.
    fn pair(&self, time_s: f64) -> Option<Pair> {
        let before = self.frames.partition_point(|frame| frame.time_s <= time_s).checked_sub(1)?;
        let (from_s, to_s) = (self.frames[before].time_s, self.frames.get(before + 1)?.time_s);
        let is_near = to_s - from_s < WIDEST_GAP * self.interval_s;
        is_near.then_some(Pair { before, share: (time_s - from_s) / (to_s - from_s) })
    }

    /// The distance to the silhouette at a moment.
    fn blend(&self, time_s: f64) -> Option<Blend<'_>> {
        let Pair { before, share } = self.pair(time_s)?;
        Some(Blend { before: self.field(before)?, after: self.field(before + 1)?, share })
    }

    /// Seconds from the frame before a moment to the frame after it.
    pub fn step_s(&self, time_s: f64) -> f64 {
        let pair = self.pair(time_s);
        pair.map_or(self.interval_s, |Pair { before, .. }| {
            self.frames[before + 1].time_s - self.frames[before].time_s
        })
    }
}

/// All films, and the moments at which they are compared.
pub(super) struct Films<'a> {
    pub cameras: Vec<CameraFilm<'a>>,
    /// Of each moment, the frame of each camera that is nearest to it.
    pub frames: Vec<Vec<usize>>,
    scale_px: f64,
}

impl<'a> Films<'a> {
    /// Compares at so many moments between two times, evenly.
    pub fn new(
        films: &'a [Vec<TimedSilhouette>],
        cameras: &[Camera],
        (from_s, to_s): (f64, f64),
        moments: usize,
    ) -> Films<'a> {
        let side = |camera: &Camera| camera.width().max(camera.height());
        let scale_px = f64::from(cameras.iter().map(side).max().unwrap_or(1)) / 640.0;
        let films = films.iter().zip(cameras);
        let cameras: Vec<CameraFilm> =
            films.map(|(frames, camera)| CameraFilm::new(frames, camera, scale_px)).collect();
        let at_s = |moment: usize| from_s + (to_s - from_s) * (moment as f64 + 0.5) / moments as f64;
        let frames =
            (0..moments).map(|moment| cameras.iter().map(|film| film.nearest(at_s(moment))).collect());
        Films { frames: frames.collect(), cameras, scale_px }
    }

    /// Outline pixels of one camera at one moment.
    pub fn outline(&self, moment: usize, camera: usize, count: usize) -> Vec<Point2<f64>> {
        outline(&self.cameras[camera].frames[self.frames[moment][camera]].silhouette, count)
    }

    /// What one camera's frame of a moment is said to be of, seconds.
    pub fn time_s(&self, moment: usize, camera: usize) -> f64 {
        self.cameras[camera].frames[self.frames[moment][camera]].time_s
    }

    pub fn scale_px(&self) -> f64 {
        self.scale_px
    }
}

/// The films if every camera is so late.
pub(super) struct AtTimes<'a> {
    pub films: &'a Films<'a>,
    pub late_s: &'a [f64],
}

impl AtTimes<'_> {
    /// What camera `other` calls the moment of camera `index`'s frame, seconds.
    pub fn time_s(&self, moment: usize, index: usize, other: usize) -> f64 {
        self.films.time_s(moment, index) - self.late_s[index] + self.late_s[other]
    }
}

impl Scenery for AtTimes<'_> {
    fn others<'b>(&'b self, moment: usize, index: usize, cameras: &'b [Camera]) -> Option<Vec<Other<'b>>> {
        let other = |other: usize| {
            let film = &self.films.cameras[other];
            Some(Other {
                index: other,
                camera: &cameras[other],
                silhouette: &film.frames[self.films.frames[moment][other]].silhouette,
                field: film.blend(self.time_s(moment, index, other))?,
                spacing_px: f64::from(film.spacing_px),
            })
        };
        (0..cameras.len()).filter(|&at| at != index).map(other).collect()
    }

    fn scale_px(&self) -> f64 {
        self.films.scale_px
    }
}
