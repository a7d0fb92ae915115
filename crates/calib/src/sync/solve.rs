//! How late each camera is: Levenberg–Marquardt on the gaps of all outline rays, over the lateness of all cameras at
//! once. Only differences matter, so their mean is held at zero.

use hull::Camera;
use nalgebra::{DMatrix, DVector};

use super::film::{AtTimes, Films};
use crate::check::in_parallel;
use crate::check::ray::{Miss, Other, Ray, nearest};
use crate::check::refine::{CAP_PX, OutlineRay, Scenery, active, huber, ray_of};

const MAX_ROUNDS: usize = 25;
/// A step in which no camera's time changes by more than this is the last, seconds.
const SMALL_STEP_S: f64 = 2e-5;
/// A step is at most this long, frames: gaps are straight in time between two frames and not much further.
const LONGEST_STEP: f64 = 1.0;
/// Gaps are counted from so far within the hull, pixels, and more in images over 640 wide: rays that just meet it on one side of a
/// person hold those of the other side in balance, and no time is as good as the next.
const SLACK_PX: f64 = 0.5;
/// No outline pixel is where the outline was to better than this, root mean square, pixels (of an image 640 wide, if the
/// image is larger): an eleventh of a pixel squared, as of any rounding.
const NOISE_PX: f64 = 0.3;
/// Stretches of film that count as independent of each other.
const BLOCKS: usize = 10;

/// Normal equations of one moment.
struct System {
    cost: f64,
    rays: usize,
    normal: DMatrix<f64>,
    slope: DVector<f64>,
}

impl System {
    fn zero(cameras: usize) -> System {
        System {
            cost: 0.0,
            rays: 0,
            normal: DMatrix::zeros(cameras, cameras),
            slope: DVector::zeros(cameras),
        }
    }

    fn add(mut self, other: &System) -> System {
        self.cost += other.cost;
        self.rays += other.rays;
        self.normal += &other.normal;
        self.slope += &other.slope;
        self
    }

    fn mean_cost(&self) -> f64 {
        self.cost / self.rays.max(1) as f64
    }
}

/// What is held against each other.
pub(super) struct Times<'a> {
    pub films: &'a Films<'a>,
    pub cameras: &'a [Camera],
    pub rays: &'a [Vec<OutlineRay>],
}

impl Times<'_> {
    /// The best lateness near `start_s`, seconds; its mean is zero.
    pub fn solve(&self, start_s: &[f64]) -> Vec<f64> {
        let count = self.cameras.len();
        let longest_s = LONGEST_STEP
            * self.films.cameras.iter().map(|film| film.interval_s).fold(f64::INFINITY, f64::min);
        let mut here = DVector::from_column_slice(start_s);
        let mut system = self.system(here.as_slice());
        let mut damping = 1e-3;
        for _ in 0..MAX_ROUNDS {
            let mut normal = with_gauge(&system.normal);
            for at in 0..count {
                normal[(at, at)] *= 1.0 + damping;
            }
            let Some(mut step) = normal.lu().solve(&-&system.slope) else { break };
            let longest = step.amax();
            if longest > longest_s {
                step *= longest_s / longest;
            }
            let mut next = &here + &step;
            next.add_scalar_mut(-next.mean());
            let next_system = self.system(next.as_slice());
            if next_system.mean_cost() < system.mean_cost() {
                (here, system) = (next, next_system);
                damping = f64::max(damping * 0.2, 1e-6);
                if step.amax() < SMALL_STEP_S {
                    break;
                }
            } else {
                damping *= 10.0;
                if damping > 1e4 || step.amax() < SMALL_STEP_S {
                    break;
                }
            }
        }
        here.as_slice().to_vec()
    }

    /// How uncertain each camera's lateness is, seconds: one standard deviation, from how much stretches of the film
    /// disagree, how much the rays of different cameras do, and how many rays there are. Infinite if they say nothing.
    pub fn uncertainty_s(&self, late_s: &[f64]) -> Vec<f64> {
        let count = self.cameras.len();
        let parts = self.systems(late_s);
        let stretch = parts.len().div_ceil(BLOCKS);
        let sum = |parts: &mut dyn Iterator<Item = &System>| parts.fold(System::zero(count), System::add);
        let total = sum(&mut parts.iter().flatten());
        let Some(inverse) = with_gauge(&total.normal).try_inverse() else {
            return vec![f64::INFINITY; count];
        };
        let stretches: Vec<System> =
            parts.chunks(stretch).map(|block| sum(&mut block.iter().flatten())).collect();
        let of_cameras: Vec<System> =
            (0..count).map(|camera| sum(&mut parts.iter().map(|moment| &moment[camera]))).collect();
        let noise_px = NOISE_PX / self.films.scale_px().min(1.0);
        let covariance = &inverse * (spread(&stretches) + spread(&of_cameras)) * &inverse
            + &inverse * (noise_px * noise_px);
        let variance = |at: usize| Some(covariance[(at, at)]).filter(|variance| variance.is_finite());
        (0..count).map(|at| variance(at).map_or(f64::INFINITY, |variance| variance.max(0.0).sqrt())).collect()
    }

    fn system(&self, late_s: &[f64]) -> System {
        self.systems(late_s).iter().flatten().fold(System::zero(self.cameras.len()), System::add)
    }

    /// One for the rays of each camera at each moment.
    fn systems(&self, late_s: &[f64]) -> Vec<Vec<System>> {
        let moments: Vec<usize> = (0..self.rays.len()).collect();
        in_parallel(&moments, |&moment| {
            let camera = |index| self.part(moment, index, late_s);
            (0..self.cameras.len()).map(camera).collect()
        })
    }

    fn part(&self, moment: usize, index: usize, late_s: &[f64]) -> System {
        let times = AtTimes { films: self.films, late_s };
        let mut system = System::zero(self.cameras.len());
        let Some(others) = times.others(moment, index, self.cameras) else { return system };
        let steps_s: Vec<f64> = others
            .iter()
            .map(|other| self.films.cameras[other.index].step_s(times.time_s(moment, index, other.index)))
            .collect();
        for outline in self.rays[moment].iter().filter(|ray| ray.camera == index) {
            self.add_ray(&mut system, outline, &others, &steps_s);
        }
        system
    }

    fn add_ray(&self, system: &mut System, outline: &OutlineRay, others: &[Other], steps_s: &[f64]) {
        let scale = self.films.scale_px();
        let ray = ray_of(&self.cameras[outline.camera], outline);
        let slack_px = SLACK_PX * scale.max(1.0);
        let found = nearest(&ray, others, (-slack_px, CAP_PX * scale), outline.depth_m);
        system.rays += 1;
        let gap = (found.gap_px + slack_px) / scale;
        if gap <= 0.0 {
            return;
        }
        let (cost, weight) = huber(gap);
        system.cost += cost;
        if found.depth_m.is_infinite() {
            return;
        }
        let slopes = slopes(&ray, outline.camera, others, steps_s, &found);
        for (row, slope) in slopes.map(|(camera, slope)| (camera, slope / scale)) {
            system.slope[row] += slope * gap * weight;
            for (column, other) in slopes {
                system.normal[(row, column)] += slope * other / scale * weight;
            }
        }
    }
}

/// How a gap changes with the lateness of the ray's own camera and of the one or two that hold it open, pixels a second.
fn slopes(ray: &Ray, own: usize, others: &[Other], steps_s: &[f64], found: &Miss) -> [(usize, f64); 3] {
    let point = ray.at(found.depth_m);
    let mut slopes = [(own, 0.0); 3];
    for (place, (at, share)) in active(ray, others, found).into_iter().flatten().enumerate() {
        let Some(image) = others[at].camera.project(&point) else { continue };
        let rate = share * others[at].field.change_px(image.x, image.y) / steps_s[at];
        slopes[place + 1] = (others[at].index, rate);
        slopes[0].1 -= rate;
    }
    slopes
}

/// Held fast against a common shift of all times, which changes no gap.
fn with_gauge(normal: &DMatrix<f64>) -> DMatrix<f64> {
    let count = normal.nrows();
    let stiffness = (normal.trace() / (count * count) as f64).max(f64::MIN_POSITIVE);
    normal.add_scalar(stiffness)
}

/// The covariance of the sum of slopes, if these parts are independent of each other.
fn spread(parts: &[System]) -> DMatrix<f64> {
    let size = parts[0].slope.len();
    let mean = parts.iter().fold(DVector::zeros(size), |sum, part| sum + &part.slope) / parts.len() as f64;
    let squares = parts.iter().fold(DMatrix::zeros(size, size), |sum, part| {
        let off = &part.slope - &mean;
        sum + &off * off.transpose()
    });
    squares * (parts.len() as f64 / (parts.len() - 1).max(1) as f64)
}
