//! Which camera, moved, would fit best: for each camera by itself, the small turn and shift that
//! makes the outline rays of all cameras meet the common hull best (Levenberg–Marquardt on the gaps).
//!
//! An outline pixel's ray touches the object, so it must meet the cones of all other silhouettes at
//! one depth. Its gap is the least over depth of the greatest distance, in pixels, to another
//! silhouette. If one camera is off, moving that one closes all its gaps, while moving another closes
//! its share of them at best and opens new ones.

use hull::rotation::matrix_from_rodrigues;
use hull::{Camera, CameraError};
use nalgebra::{Matrix6, Vector3, Vector6};

use super::ray::{Miss, Other, Ray, distance_px, nearest};

/// Turn about the camera's x axis (tilt), y axis (pan) and z axis (roll), radians, then shifts along
/// its x, y and z, in units of the distance to the subject.
pub(crate) type Correction = Vector6<f64>;

/// Gaps beyond this many pixels (at 640 pixels a side) count linearly: a wrong limb must not decide.
const HUBER_PX: f64 = 3.0;
/// Gaps end here, pixels at 640 a side; 1.5° is some 13 of them for an ordinary lens.
pub(crate) const CAP_PX: f64 = 48.0;
/// A correction of this size (radians, or shares of the distance) costs as much as `PRIOR_COST` per ray.
const PRIOR_SIZE: f64 = 0.05;
const PRIOR_COST: f64 = 0.02;
const MAX_ROUNDS: usize = 12;

/// An outline pixel of one camera: its ray in the camera's own frame, which no pose changes.
#[derive(Clone)]
pub(crate) struct OutlineRay {
    pub(crate) camera: usize,
    pub(crate) direction_camera: Vector3<f64>,
    /// Where the ray comes nearest to the hull, or lies deepest in it, as the rig stands; metres.
    pub(crate) depth_m: f64,
}

/// What outline rays are held against.
pub(crate) trait Scenery: Sync {
    /// All cameras but `index` as its rays of one frame see them; `None` if one of them sees nothing then.
    fn others<'b>(&'b self, frame: usize, index: usize, cameras: &'b [Camera]) -> Option<Vec<Other<'b>>>;

    /// Pixels of the largest image that one pixel of an image 640 wide is.
    fn scale_px(&self) -> f64;
}

/// The gaps of all outline rays for one set of poses.
pub(crate) struct Gaps<'a> {
    pub(crate) scenery: &'a dyn Scenery,
    pub(crate) outlines: &'a [Vec<OutlineRay>],
    /// Distance from each camera to the subject, metres.
    pub(crate) subject_m: &'a [f64],
}

/// The best correction of one camera.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Refined {
    pub(crate) correction: Correction,
    pub(crate) cost: f64,
}

/// Normal equations of one frame.
#[derive(Clone, Copy, Default)]
struct System {
    cost: f64,
    normal: Matrix6<f64>,
    slope: Vector6<f64>,
}

impl System {
    fn add(self, other: &System) -> System {
        System {
            cost: self.cost + other.cost,
            normal: self.normal + other.normal,
            slope: self.slope + other.slope,
        }
    }
}

impl Gaps<'_> {
    /// The mean cost of an outline ray with these poses, square pixels at 640 a side.
    pub(crate) fn cost(&self, cameras: &[Camera]) -> f64 {
        self.system(cameras, None).cost / self.ray_count()
    }

    fn ray_count(&self) -> f64 {
        self.outlines.iter().map(Vec::len).sum::<usize>().max(1) as f64
    }

    /// The best correction of camera `moved` alone.
    pub(crate) fn refine(&self, cameras: &[Camera], moved: usize) -> Result<Refined, CameraError> {
        let rays = self.ray_count();
        let stiffness = PRIOR_COST * rays / (PRIOR_SIZE * PRIOR_SIZE);
        let mut posed = cameras.to_vec();
        let mut here = Correction::zeros();
        let mut system = self.system(&posed, Some(moved));
        let mut damping = 1e-3;
        let total = |system: &System, at: &Correction| system.cost + stiffness * at.norm_squared();
        for _ in 0..MAX_ROUNDS {
            let mut normal = system.normal + Matrix6::identity() * stiffness;
            let diagonal = normal.diagonal();
            for k in 0..6 {
                normal[(k, k)] += damping * diagonal[k];
            }
            let Some(inverse) = normal.try_inverse() else { break };
            let step = -(inverse * (system.slope + here * stiffness));
            let next = here + step;
            posed[moved] = corrected(&cameras[moved], &next, self.subject_m[moved])?;
            let next_system = self.system(&posed, Some(moved));
            let gain = total(&system, &here) - total(&next_system, &next);
            if gain > 0.0 {
                let small = gain < 1e-3 * total(&system, &here);
                (here, system) = (next, next_system);
                damping = f64::max(damping * 0.2, 1e-6);
                if small {
                    break;
                }
            } else {
                damping *= 8.0;
                if damping > 10.0 {
                    break;
                }
            }
        }
        Ok(Refined { correction: here, cost: system.cost / rays })
    }

    fn system(&self, cameras: &[Camera], moved: Option<usize>) -> System {
        let nudged: Vec<Camera> = moved
            .map(|moved| (0..6).filter_map(|k| self.nudged(&cameras[moved], moved, k)).collect())
            .unwrap_or_default();
        let frames: Vec<usize> = (0..self.outlines.len()).collect();
        let parts = super::in_parallel(&frames, |&frame| self.frame_system(frame, cameras, moved, &nudged));
        parts.iter().fold(System::default(), System::add)
    }

    fn nudged(&self, camera: &Camera, moved: usize, k: usize) -> Option<Camera> {
        let mut correction = Correction::zeros();
        correction[k] = NUDGE;
        corrected(camera, &correction, self.subject_m[moved]).ok()
    }

    fn frame_system(
        &self,
        frame: usize,
        cameras: &[Camera],
        moved: Option<usize>,
        nudged: &[Camera],
    ) -> System {
        let mut system = System::default();
        for index in 0..cameras.len() {
            let Some(others) = self.scenery.others(frame, index, cameras) else { continue };
            for outline in self.outlines[frame].iter().filter(|outline| outline.camera == index) {
                let ray = ray_of(&cameras[index], outline);
                let scale = self.scenery.scale_px();
                let found = nearest(&ray, &others, (0.0, CAP_PX * scale), outline.depth_m);
                if found.gap_px <= 0.0 {
                    continue;
                }
                let gap = found.gap_px / scale;
                let (cost, weight) = huber(gap);
                system.cost += cost;
                if let Some(moved) = moved.filter(|_| found.depth_m.is_finite()) {
                    let slope = gap_slope(&ray, outline, &others, &found, moved, nudged) / scale;
                    system.normal += slope * slope.transpose() * weight;
                    system.slope += slope * (gap * weight);
                }
            }
        }
        system
    }
}

/// What a gap costs, square pixels at 640 a side, and its weight in the normal equations.
pub(crate) fn huber(gap_px: f64) -> (f64, f64) {
    if gap_px <= HUBER_PX {
        (gap_px * gap_px, 1.0)
    } else {
        (HUBER_PX * (2.0 * gap_px - HUBER_PX), HUBER_PX / gap_px)
    }
}

/// Step of the numeric derivatives: a sixth of a pixel for a long lens.
const NUDGE: f64 = 1e-4;

/// The ray of an outline pixel from a posed camera.
pub(crate) fn ray_of(camera: &Camera, outline: &OutlineRay) -> Ray {
    Ray { origin: camera.centre_world(), direction: camera.rotation().tr_mul(&outline.direction_camera) }
}

/// How a ray's gap changes with the correction of camera `moved`. At the nearest depth either one
/// silhouette's distance is stationary, or two cross: then the mix of both that does not change with
/// depth is the gap's slope.
fn gap_slope(
    ray: &Ray,
    outline: &OutlineRay,
    others: &[Other],
    found: &Miss,
    moved: usize,
    nudged: &[Camera],
) -> Vector6<f64> {
    let mut slope = Vector6::zeros();
    for (active, share) in active(ray, others, found).into_iter().flatten() {
        let other = &others[active];
        let here = distance_px(other, &ray.at(found.depth_m));
        for (k, camera) in nudged.iter().enumerate() {
            let there = if outline.camera == moved {
                distance_px(other, &ray_of(camera, outline).at(found.depth_m))
            } else if other.index == moved {
                distance_px(&Other { camera, ..*other }, &ray.at(found.depth_m))
            } else {
                continue;
            };
            let change = (there - here) / NUDGE;
            if change.is_finite() {
                slope[k] += share * change;
            }
        }
    }
    slope
}

/// The one or two silhouettes that hold the gap open, each with its share.
pub(crate) fn active(ray: &Ray, others: &[Other], found: &Miss) -> [Option<(usize, f64)>; 2] {
    let near_m = 1e-4 * found.depth_m;
    let slope = |other: &Other| {
        let (before, after) = (found.depth_m - near_m, found.depth_m + near_m);
        distance_px(other, &ray.at(after)) - distance_px(other, &ray.at(before))
    };
    let distances: Vec<f64> = others.iter().map(|other| distance_px(other, &ray.at(found.depth_m))).collect();
    let Some(first) = (0..others.len()).max_by(|&a, &b| distances[a].total_cmp(&distances[b])) else {
        return [None, None];
    };
    let first_slope = slope(&others[first]);
    let opposite = (0..others.len())
        .filter(|&j| j != first && distances[first] - distances[j] < 2.0 * others[j].spacing_px)
        .filter_map(|j| {
            let slope = slope(&others[j]);
            (slope * first_slope < 0.0).then_some((j, slope))
        })
        .max_by(|a, b| distances[a.0].total_cmp(&distances[b.0]));
    match opposite {
        Some((second, second_slope)) => {
            let share = second_slope / (second_slope - first_slope);
            [Some((first, share)), Some((second, 1.0 - share))]
        }
        None => [Some((first, 1.0)), None],
    }
}

/// The camera turned and shifted in its own frame by a correction.
pub(crate) fn corrected(
    camera: &Camera,
    correction: &Correction,
    subject_m: f64,
) -> Result<Camera, CameraError> {
    let turn = matrix_from_rodrigues(&Vector3::new(correction[0], correction[1], correction[2]));
    let shift_camera = Vector3::new(correction[3], correction[4], correction[5]) * subject_m;
    let centre = camera.centre_world() + camera.rotation().tr_mul(&shift_camera);
    let rotation = turn * camera.rotation();
    let translation_m = -(rotation * centre.coords);
    let size = (camera.width(), camera.height());
    let distortion = camera.lens().coefficients();
    Camera::from_matrices(camera.name(), size, *camera.intrinsics(), distortion, &rotation, translation_m)
}
