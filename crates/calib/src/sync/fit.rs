//! Late or bumped: times are fitted, then each camera's place, and where a place mends more, times once more with that
//! put right.

use hull::Camera;

use super::film::{AtTimes, Films};
use super::report::{CameraSync, SyncReport};
use super::solve::Times;
use crate::check::refine::{Correction, Gaps, OutlineRay, Refined, corrected};
use crate::check::{SIGNIFICANT_COST, SIGNIFICANT_SHARE, report, subject_distance_m};

/// How often times and the place of a camera that has moved are fitted in turn.
const TURNS: usize = 4;
/// Places are fitted to the rays of every so many moments.
const PLACE_EVERY: usize = 3;

/// Times and places that fit.
pub(super) struct Fit {
    late_s: Vec<f64>,
    cost: f64,
    /// Of each camera, with the times found.
    refined: Vec<Refined>,
    moved: Option<usize>,
    cost_as_said: f64,
    uncertainty_s: Vec<f64>,
    in_time: Vec<f64>,
    subject_m: Vec<f64>,
}

/// What is fitted, to which outlines.
struct Fitting<'a> {
    films: &'a Films<'a>,
    cameras: &'a [Camera],
    rays: &'a [Vec<OutlineRay>],
    /// The rays of some moments: a place needs fewer than a time, and takes longer.
    some_rays: Vec<Vec<OutlineRay>>,
    subject_m: Vec<f64>,
}

/// Fits times, and a camera's place if that clearly mends more.
pub(super) fn fit(films: &Films, cameras: &[Camera], rays: &[Vec<OutlineRay>]) -> Fit {
    let of_moment = |(moment, rays): (usize, &Vec<OutlineRay>)| {
        if moment.is_multiple_of(PLACE_EVERY) { rays.clone() } else { Vec::new() }
    };
    let some_rays = rays.iter().enumerate().map(of_moment).collect();
    let subject_m = cameras.iter().map(|camera| subject_distance_m(camera, cameras)).collect();
    Fitting { films, cameras, rays, some_rays, subject_m }.fit()
}

impl Fitting<'_> {
    fn fit(self) -> Fit {
        let Fitting { films, cameras, rays, .. } = self;
        let zero = vec![0.0; cameras.len()];
        let mut late_s = Times { films, cameras, rays }.solve(&zero);
        let mut placed = cameras.to_vec();
        let mut refined: Vec<Refined> =
            (0..cameras.len()).map(|camera| self.place(&late_s, camera)).collect();
        let moved = significant(self.cost(cameras, &late_s), &refined);
        if let Some(moved) = moved {
            for _ in 0..TURNS {
                let correction = &refined[moved].correction;
                let Ok(camera) = corrected(&cameras[moved], correction, self.subject_m[moved]) else { break };
                placed[moved] = camera;
                late_s = Times { films, cameras: &placed, rays }.solve(&late_s);
                refined[moved] = self.place(&late_s, moved);
            }
        }
        let common_s = common(&late_s, interval_s(films));
        let in_time = (0..cameras.len()).map(|camera| {
            let mut late_s = late_s.clone();
            late_s[camera] = common_s;
            self.cost(&placed, &late_s)
        });
        Fit {
            in_time: in_time.collect(),
            uncertainty_s: Times { films, cameras: &placed, rays }.uncertainty_s(&late_s),
            cost_as_said: self.cost(cameras, &zero),
            cost: self.cost(&placed, &late_s),
            late_s,
            refined,
            moved,
            subject_m: self.subject_m,
        }
    }

    /// The mean cost of an outline ray.
    fn cost(&self, cameras: &[Camera], late_s: &[f64]) -> f64 {
        let scenery = AtTimes { films: self.films, late_s };
        Gaps { scenery: &scenery, outlines: &self.some_rays, subject_m: &self.subject_m }.cost(cameras)
    }

    /// The best place of one camera if all are so late.
    fn place(&self, late_s: &[f64], camera: usize) -> Refined {
        let scenery = AtTimes { films: self.films, late_s };
        let gaps = Gaps { scenery: &scenery, outlines: &self.some_rays, subject_m: &self.subject_m };
        gaps.refine(self.cameras, camera)
            .unwrap_or_else(|_| Refined { correction: Correction::zeros(), cost: gaps.cost(self.cameras) })
    }
}

impl Fit {
    pub fn report(self, films: &Films, cameras: &[Camera], motion_px_per_s: f64) -> SyncReport {
        let common_s = common(&self.late_s, interval_s(films));
        let camera = |(at, camera): (usize, &Camera)| CameraSync {
            camera: camera.name().to_owned(),
            late_s: self.late_s[at] - common_s,
            uncertainty_s: self.uncertainty_s[at],
            cost_in_time: self.in_time[at],
            refinement: report::described(camera, &self.refined[at], self.subject_m[at]),
        };
        SyncReport {
            cameras: cameras.iter().enumerate().map(camera).collect(),
            cost_as_said: self.cost_as_said,
            cost: self.cost,
            moved: self.moved,
            motion_px_per_s,
            interval_s: interval_s(films),
        }
    }
}

/// The camera whose correction lowers the cost most, if that is significant. Two that disagree cannot tell which of
/// them moved.
fn significant(cost: f64, refined: &[Refined]) -> Option<usize> {
    let best = (0..refined.len()).min_by(|&a, &b| refined[a].cost.total_cmp(&refined[b].cost))?;
    let gained = cost - refined[best].cost;
    (refined.len() >= 3 && gained >= SIGNIFICANT_COST && gained >= SIGNIFICANT_SHARE * cost).then_some(best)
}

/// The usual time from frame to frame, seconds.
fn interval_s(films: &Films) -> f64 {
    films.cameras.iter().map(|film| film.interval_s).sum::<f64>() / films.cameras.len() as f64
}

/// What most cameras share: the mean of those within a quarter of a frame of the one that is nearest to all.
fn common(late_s: &[f64], interval_s: f64) -> f64 {
    let near_s = 0.25 * interval_s;
    let off_s = |from_s: f64| late_s.iter().map(|late_s| (late_s - from_s).abs().min(near_s)).sum::<f64>();
    let middle_s = late_s.iter().copied().min_by(|&a, &b| off_s(a).total_cmp(&off_s(b))).unwrap_or(0.0);
    let near: Vec<f64> =
        late_s.iter().copied().filter(|late_s| (late_s - middle_s).abs() <= near_s).collect();
    near.iter().sum::<f64>() / near.len().max(1) as f64
}
