//! Each camera's time against the others, from film in which a person moves.
//!
//! An outline pixel of a camera at its own frame is a ray that touches the person at that moment. It must meet the
//! silhouettes of all others there, whose distance fields are mixed between the two frames beside the moment. A camera
//! whose frames are older than they say makes gaps before and behind a moving person.

mod film;
mod fit;
mod motion;
mod report;
mod solve;

use hull::{Camera, Rig};
use thiserror::Error;

use crate::check::in_parallel;
use crate::check::ray::nearest;
use crate::check::refine::{CAP_PX, OutlineRay, Scenery as _, ray_of};
use film::{AtTimes, Films};

pub use film::TimedSilhouette;
pub use report::{CameraSync, SyncReport};

/// Film on both sides of what is compared, so that a camera may be so late, seconds; of a short film a quarter.
const REACH_S: f64 = 0.3;
/// Film that is shorter is refused, seconds.
const SHORTEST_S: f64 = 0.5;
/// A camera with fewer frames is refused.
const LEAST_FRAMES: usize = 8;
/// Moments that are compared.
const MOMENTS: usize = 40;
/// Outline pixels whose rays are fitted, per camera and moment.
const RAYS: usize = 60;
/// Outlines must move so fast, root mean square: pixels of an image 640 wide a second; of the image itself, if that is
/// smaller. Who stands and breathes makes
/// 1 to 2, who waves 10, who walks 60.
const LEAST_PX_PER_S: f64 = 4.0;
/// Times that are more uncertain than this share of a frame are refused.
const MOST_UNCERTAIN: f64 = 0.25;

/// Why times cannot be found.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum SyncError {
    /// One camera has nothing to be compared with.
    #[error("found {0} cameras, expected at least two")]
    Alone(usize),
    /// Films are not those of the rig.
    #[error("found films of {found} cameras, expected one for each of {expected}")]
    Count {
        /// Films given.
        found: usize,
        /// Cameras of the rig.
        expected: usize,
    },
    /// A silhouette is not of its camera's size.
    #[error(
        "a silhouette of camera {camera:?} is {found_width} x {found_height}, expected {expected_width} x {expected_height}"
    )]
    Size {
        /// The camera's name.
        camera: String,
        /// Pixels across, of the silhouette.
        found_width: u32,
        /// Pixels down, of the silhouette.
        found_height: u32,
        /// Pixels across, of the camera.
        expected_width: u32,
        /// Pixels down, of the camera.
        expected_height: u32,
    },
    /// Frames whose times do not grow.
    #[error("camera {camera:?}: a frame of {next_s} s follows one of {time_s} s, expected times that grow")]
    Order {
        /// The camera's name.
        camera: String,
        /// The time of a frame, seconds.
        time_s: f64,
        /// The time of the frame after it, seconds.
        next_s: f64,
    },
    /// Too little film.
    #[error("found {found_s:.2} s of film of all cameras, expected at least {SHORTEST_S} s, and best ten")]
    Short {
        /// What all cameras have, seconds.
        found_s: f64,
    },
    /// All cameras never see a person at once.
    #[error(
        "found no moment at which every camera sees a person, expected a person who walks about in the middle"
    )]
    NoPerson,
    /// Who stands still has no time.
    #[error(
        "too little motion: outlines move by {found_px_per_s:.1} pixels a second (of an image 640 wide), expected at \
         least {expected_px_per_s:.1}: a person who walks about"
    )]
    Still {
        /// How fast outlines move, root mean square, pixels of an image 640 wide a second.
        found_px_per_s: f64,
        /// The least, the same way.
        expected_px_per_s: f64,
    },
    /// The film does not say enough.
    #[error(
        "too little motion: the time of camera {camera:?} is uncertain by {found_ms:.1} ms, expected at most \
         {expected_ms:.1}"
    )]
    Uncertain {
        /// The camera's name.
        camera: String,
        /// One standard deviation, milliseconds.
        found_ms: f64,
        /// The most, milliseconds.
        expected_ms: f64,
    },
}

/// Finds each camera's time against the others: some seconds for eight cameras and ten seconds of film.
///
/// Films are in rig order, each with its own times; frames need not be of the same times, nor of the same number.
pub fn check_sync(rig: &Rig, films: &[Vec<TimedSilhouette>]) -> Result<SyncReport, SyncError> {
    let cameras = rig.cameras();
    let range_s = compared(cameras, films)?;
    let films = Films::new(films, cameras, range_s, MOMENTS);
    let found_px_per_s = motion::motion_px_per_s(&films).ok_or(SyncError::NoPerson)?;
    let expected_px_per_s = LEAST_PX_PER_S / films.scale_px().min(1.0);
    if found_px_per_s < expected_px_per_s {
        return Err(SyncError::Still { found_px_per_s, expected_px_per_s });
    }
    let rays = outline_rays(&films, cameras);
    if rays.iter().all(Vec::is_empty) {
        return Err(SyncError::NoPerson);
    }
    let found = fit::fit(&films, cameras, &rays);
    let report = found.report(&films, cameras, found_px_per_s);
    let worst = report.cameras.iter().max_by(|a, b| a.uncertainty_s.total_cmp(&b.uncertainty_s));
    let most_s = MOST_UNCERTAIN * report.interval_s;
    match worst.filter(|camera| camera.uncertainty_s > most_s) {
        Some(camera) => Err(SyncError::Uncertain {
            camera: camera.camera.clone(),
            found_ms: 1e3 * camera.uncertainty_s,
            expected_ms: 1e3 * most_s,
        }),
        None => Ok(report),
    }
}

/// The seconds of film between which all cameras are compared.
fn compared(cameras: &[Camera], films: &[Vec<TimedSilhouette>]) -> Result<(f64, f64), SyncError> {
    if films.len() != cameras.len() {
        return Err(SyncError::Count { found: films.len(), expected: cameras.len() });
    }
    if cameras.len() < 2 {
        return Err(SyncError::Alone(cameras.len()));
    }
    for (camera, frames) in cameras.iter().zip(films) {
        check_frames(camera, frames)?;
    }
    let time_s = |frame: Option<&TimedSilhouette>| frame.map_or(0.0, |frame| frame.time_s);
    let from_s = films.iter().map(|frames| time_s(frames.first())).fold(f64::NEG_INFINITY, f64::max);
    let to_s = films.iter().map(|frames| time_s(frames.last())).fold(f64::INFINITY, f64::min);
    let found_s = (to_s - from_s).max(0.0);
    if found_s < SHORTEST_S || films.iter().any(|frames| frames.len() < LEAST_FRAMES) {
        return Err(SyncError::Short { found_s });
    }
    let reach_s = REACH_S.min(0.2 * found_s);
    Ok((from_s + reach_s, to_s - reach_s))
}

fn check_frames(camera: &Camera, frames: &[TimedSilhouette]) -> Result<(), SyncError> {
    let name = || camera.name().to_owned();
    let (expected_width, expected_height) = (camera.width(), camera.height());
    for TimedSilhouette { silhouette, .. } in frames {
        let (found_width, found_height) = (silhouette.width(), silhouette.height());
        if (found_width, found_height) != (expected_width, expected_height) {
            let camera = name();
            return Err(SyncError::Size {
                camera,
                found_width,
                found_height,
                expected_width,
                expected_height,
            });
        }
    }
    let grows = |pair: &&[TimedSilhouette]| pair[0].time_s < pair[1].time_s;
    match frames.windows(2).find(|pair| !grows(pair)) {
        Some(pair) => {
            Err(SyncError::Order { camera: name(), time_s: pair[0].time_s, next_s: pair[1].time_s })
        }
        None => Ok(()),
    }
}

/// The rays of all moments, each with the depth where it comes nearest as times are said to be.
fn outline_rays(films: &Films, cameras: &[Camera]) -> Vec<Vec<OutlineRay>> {
    let late_s = vec![0.0; cameras.len()];
    let times = AtTimes { films, late_s: &late_s };
    let cap_px = CAP_PX * films.scale_px();
    let moments: Vec<usize> = (0..films.frames.len()).collect();
    in_parallel(&moments, |&moment| {
        let mut rays = Vec::new();
        for camera in 0..cameras.len() {
            let Some(others) = times.others(moment, camera, cameras) else { continue };
            let pixels = motion::moving(films, moment, camera, RAYS);
            for direction_camera in pixels.iter().filter_map(|pixel| cameras[camera].ray_camera(pixel)) {
                let mut ray = OutlineRay { camera, direction_camera, depth_m: f64::INFINITY };
                let in_world = ray_of(&cameras[camera], &ray);
                ray.depth_m = nearest(&in_world, &others, (-cap_px, cap_px), f64::INFINITY).depth_m;
                rays.push(ray);
            }
        }
        rays
    })
}

#[cfg(test)]
mod tests;
