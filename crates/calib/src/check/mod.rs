//! Does a rig fit its silhouettes, and which single camera, moved, would fit best?
//!
//! The visual hull rule is the default one: off the image and behind the camera count as outside.

mod explained;
pub(crate) mod field;
pub(crate) mod ray;
pub(crate) mod refine;
pub(crate) mod report;

use hull::{Camera, Rig, Silhouette};
use nalgebra::Point2;
use thiserror::Error;

use explained::Share;
use field::{Blend, Field};
use ray::Other;
use refine::{Gaps, OutlineRay, Refined, Scenery};

pub use report::{CameraCheck, CheckReport, Refinement, SIGNIFICANT_COST, SIGNIFICANT_SHARE};

/// Foreground pixels looked at per camera, over all frames: the share is good to half a percent.
const PIXELS_PER_CAMERA: u64 = 4000;
/// Outline pixels whose rays are fitted, per camera over all frames.
const OUTLINE_RAYS_PER_CAMERA: usize = 1200;
/// Frames whose distance fields are kept and whose outlines are fitted, evenly chosen: a field of a full
/// HD silhouette takes half a megabyte. Explained shares are over all frames.
const FITTED_FRAMES: usize = 48;
/// Why a rig cannot be checked against silhouettes.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum CheckError {
    /// No frame at all.
    #[error("no frames of silhouettes given, expected at least one")]
    NoFrames,
    /// A frame has more or fewer silhouettes than the rig cameras.
    #[error("frame {frame} has {found} silhouettes, expected one for each of {expected} cameras")]
    Count {
        /// Which frame, counted from 0.
        frame: usize,
        /// Silhouettes given.
        found: usize,
        /// Cameras of the rig.
        expected: usize,
    },
    /// A silhouette is not of its camera's size.
    #[error(
        "silhouette of camera {camera:?} in frame {frame} is {found_width} x {found_height}, expected {expected_width} x {expected_height}"
    )]
    Size {
        /// The camera's name.
        camera: String,
        /// Which frame, counted from 0.
        frame: usize,
        /// Pixels across, of the silhouette.
        found_width: u32,
        /// Pixels down, of the silhouette.
        found_height: u32,
        /// Pixels across, of the camera.
        expected_width: u32,
        /// Pixels down, of the camera.
        expected_height: u32,
    },
    /// A camera has no foreground in any frame.
    #[error("camera {0:?} has no foreground in any frame, expected some")]
    Empty(String),
}

/// Silhouettes made ready for checking any rig of their sizes.
pub struct PreparedFrames<'a> {
    frames: &'a [Vec<Silhouette>],
    fields: Vec<Vec<Option<Field>>>,
    spacings_px: Vec<u32>,
    outlines: Vec<Vec<(usize, Point2<f64>)>>,
    scale_px: f64,
}

impl<'a> PreparedFrames<'a> {
    /// Distance fields and outlines of all silhouettes (the slow part that no rig changes).
    pub fn new(frames: &'a [Vec<Silhouette>]) -> Result<PreparedFrames<'a>, CheckError> {
        let first = frames.first().ok_or(CheckError::NoFrames)?;
        let count = first.len();
        if let Some((frame, other)) = frames.iter().enumerate().find(|(_, other)| other.len() != count) {
            return Err(CheckError::Count { frame, found: other.len(), expected: count });
        }
        let side = |silhouette: &Silhouette| silhouette.width().max(silhouette.height());
        let scale_px = f64::from(first.iter().map(side).max().unwrap_or(1)) / 640.0;
        let spacings_px: Vec<u32> = first.iter().map(|silhouette| (side(silhouette) / 600).max(1)).collect();
        let margin_px = (refine::CAP_PX * scale_px) as u32 + 2;
        let jobs: Vec<(usize, usize)> =
            (0..frames.len()).flat_map(|frame| (0..count).map(move |index| (frame, index))).collect();
        let fitted = frames.len().min(FITTED_FRAMES);
        let is_fitted = |frame: usize| (frame * fitted) % frames.len() < fitted;
        let rays_per_frame = (OUTLINE_RAYS_PER_CAMERA / fitted).max(1);
        let made = in_parallel(&jobs, |&(frame, index)| {
            let silhouette = &frames[frame][index];
            if is_fitted(frame) {
                let field = Field::new(silhouette, spacings_px[index], margin_px);
                (field, outline(silhouette, rays_per_frame))
            } else {
                (Field::of_rectangle(silhouette), Vec::new())
            }
        });
        let mut fields: Vec<Vec<Option<Field>>> = vec![Vec::new(); frames.len()];
        let mut outlines: Vec<Vec<(usize, Point2<f64>)>> = vec![Vec::new(); frames.len()];
        for ((frame, index), (field, outline)) in jobs.into_iter().zip(made) {
            fields[frame].push(field);
            outlines[frame].extend(outline.into_iter().map(|pixel| (index, pixel)));
        }
        Ok(PreparedFrames { frames, fields, spacings_px, outlines, scale_px })
    }

    /// Checks one rig: half a second for four cameras and ten frames.
    pub fn check(&self, rig: &Rig) -> Result<CheckReport, CheckError> {
        let cameras = rig.cameras();
        self.fits(cameras)?;
        let shares = self.shares(cameras);
        let frames: Vec<usize> = (0..self.frames.len()).collect();
        let outlines: Vec<Vec<OutlineRay>> =
            in_parallel(&frames, |&frame| outline_rays(self, cameras, frame));
        let subject_m: Vec<f64> = cameras.iter().map(|camera| subject_distance_m(camera, cameras)).collect();
        let gaps = Gaps { scenery: self, outlines: &outlines, subject_m: &subject_m };
        let cost = gaps.cost(cameras);
        let mut report = CheckReport { cameras: Vec::new(), cost, moved: None };
        for (index, camera) in cameras.iter().enumerate() {
            let refined = gaps
                .refine(cameras, index)
                .unwrap_or(Refined { correction: refine::Correction::zeros(), cost });
            let Share { pixels, explained } = shares[index];
            report.cameras.push(CameraCheck {
                camera: camera.name().to_owned(),
                explained: explained as f64 / pixels.max(1) as f64,
                pixels,
                refinement: report::described(camera, &refined, subject_m[index]),
            });
        }
        report.moved = report::significant(&report);
        Ok(report)
    }

    /// Counts and sizes agree, and every camera has some foreground.
    fn fits(&self, cameras: &[Camera]) -> Result<(), CheckError> {
        let (found, expected) = (self.frames[0].len(), cameras.len());
        if found != expected {
            return Err(CheckError::Count { frame: 0, found, expected });
        }
        for (frame, silhouettes) in self.frames.iter().enumerate() {
            for (silhouette, camera) in silhouettes.iter().zip(cameras) {
                if (silhouette.width(), silhouette.height()) != (camera.width(), camera.height()) {
                    return Err(CheckError::Size {
                        camera: camera.name().to_owned(),
                        frame,
                        found_width: silhouette.width(),
                        found_height: silhouette.height(),
                        expected_width: camera.width(),
                        expected_height: camera.height(),
                    });
                }
            }
        }
        for (index, camera) in cameras.iter().enumerate() {
            if self.frames.iter().all(|silhouettes| silhouettes[index].area() == 0) {
                return Err(CheckError::Empty(camera.name().to_owned()));
            }
        }
        Ok(())
    }

    fn shares(&self, cameras: &[Camera]) -> Vec<Share> {
        let jobs: Vec<(usize, usize, u64)> = (0..cameras.len())
            .flat_map(|index| {
                let area: u64 = self.frames.iter().map(|silhouettes| silhouettes[index].area()).sum();
                // Odd, so that it has no factor in common with widths that are powers of two.
                let stride = area.div_ceil(PIXELS_PER_CAMERA).max(1) | 1;
                (0..self.frames.len()).map(move |frame| (frame, index, stride))
            })
            .collect();
        let parts = in_parallel(&jobs, |&(frame, index, stride)| {
            explained::share(self, cameras, frame, index, stride)
        });
        let mut shares = vec![Share::default(); cameras.len()];
        for ((_, index, _), part) in jobs.into_iter().zip(parts) {
            shares[index].pixels += part.pixels;
            shares[index].explained += part.explained;
        }
        shares
    }
}

impl Scenery for PreparedFrames<'_> {
    fn others<'b>(&'b self, frame: usize, index: usize, cameras: &'b [Camera]) -> Option<Vec<Other<'b>>> {
        (0..cameras.len())
            .filter(|&other| other != index)
            .map(|other| {
                Some(Other {
                    index: other,
                    camera: &cameras[other],
                    silhouette: &self.frames[frame][other],
                    field: Blend::still(self.fields[frame][other].as_ref()?),
                    spacing_px: f64::from(self.spacings_px[other]),
                })
            })
            .collect()
    }

    fn scale_px(&self) -> f64 {
        self.scale_px
    }
}

/// Evenly chosen outline pixels: foreground with background beside, above or below, on the image.
pub(crate) fn outline(silhouette: &Silhouette, count: usize) -> Vec<Point2<f64>> {
    let (width, height) = (silhouette.width() as i32, silhouette.height() as i32);
    let mut pixels = Vec::new();
    for row in 0..height {
        for run in silhouette.row(row as u32) {
            for column in i32::from(run.start)..i32::from(run.end) {
                let open = (column > 0 && column == i32::from(run.start))
                    || (column + 1 < width && column + 1 == i32::from(run.end))
                    || (row > 0 && !silhouette.contains(column, row - 1))
                    || (row + 1 < height && !silhouette.contains(column, row + 1));
                if open {
                    pixels.push(Point2::new(f64::from(column), f64::from(row)));
                }
            }
        }
    }
    let step = pixels.len().div_ceil(count).max(1);
    pixels.into_iter().step_by(step).collect()
}

/// The rays of one frame's outline pixels, each with the depth where it lies deepest in the hull.
fn outline_rays(prepared: &PreparedFrames, cameras: &[Camera], frame: usize) -> Vec<OutlineRay> {
    let cap_px = refine::CAP_PX * prepared.scale_px;
    let others: Vec<_> = (0..cameras.len()).map(|index| prepared.others(frame, index, cameras)).collect();
    let ray = |&(camera, pixel): &(usize, Point2<f64>)| {
        let others = others[camera].as_ref()?;
        let direction_camera = cameras[camera].ray_camera(&pixel)?;
        let mut ray = OutlineRay { camera, direction_camera, depth_m: f64::INFINITY };
        let in_world = refine::ray_of(&cameras[camera], &ray);
        ray.depth_m = ray::nearest(&in_world, others, (-cap_px, cap_px), f64::INFINITY).depth_m;
        Some(ray)
    };
    prepared.outlines[frame].iter().filter_map(ray).collect()
}

/// How far the point that all optical axes pass nearest is from a camera, metres.
pub(crate) fn subject_distance_m(camera: &Camera, cameras: &[Camera]) -> f64 {
    let mut normal = nalgebra::Matrix3::identity() * 1e-6;
    let mut right = nalgebra::Vector3::zeros();
    for other in cameras {
        let axis = other.rotation().row(2).transpose();
        let across = nalgebra::Matrix3::identity() - axis * axis.transpose();
        normal += across;
        right += across * other.centre_world().coords;
    }
    let subject = normal.try_inverse().map_or(right, |inverse| inverse * right);
    (subject - camera.centre_world().coords).norm().max(0.1)
}

/// Maps over jobs on the machine's cores; results are in the order of the jobs, whatever ran where.
pub(crate) fn in_parallel<J: Sync, T: Send>(jobs: &[J], work: impl Fn(&J) -> T + Sync) -> Vec<T> {
    let threads = std::thread::available_parallelism().map_or(1, usize::from).min(8);
    let work = &work;
    std::thread::scope(|scope| {
        let running: Vec<_> = jobs
            .chunks(jobs.len().div_ceil(threads).max(1))
            .map(|chunk| scope.spawn(move || chunk.iter().map(work).collect::<Vec<T>>()))
            .collect();
        running
            .into_iter()
            .flat_map(|thread| thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)))
            .collect()
    })
}

#[cfg(test)]
mod tests;
