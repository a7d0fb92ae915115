//! The share of a camera's foreground that the hull of all cameras explains.

use hull::Camera;
use nalgebra::Point2;

use super::PreparedFrames;
use super::ray::{Ray, meets_hull};
use super::refine::Scenery as _;

/// Foreground pixels looked at, and those whose viewing ray meets the hull of all cameras.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Share {
    pub(super) pixels: u64,
    pub(super) explained: u64,
}

/// Counts every `stride`-th foreground pixel (in raster order) of one camera's silhouette in one frame.
pub(super) fn share(
    prepared: &PreparedFrames,
    cameras: &[Camera],
    frame: usize,
    index: usize,
    stride: u64,
) -> Share {
    let silhouette = &prepared.frames[frame][index];
    let camera = &cameras[index];
    let others = prepared.others(frame, index, cameras);
    let mut share = Share::default();
    // The first pixel taken differs from frame to frame, so that no column is looked at alone.
    let mut until_next = (frame as u64 * 7) % stride;
    for row in 0..silhouette.height() {
        for run in silhouette.row(row) {
            let mut column = u64::from(run.start) + until_next;
            while column < u64::from(run.end) {
                share.pixels += 1;
                let ray = camera.ray_world(&Point2::new(column as f64, f64::from(row)));
                if let (Some(others), Some(direction)) = (&others, ray) {
                    let ray = Ray { origin: camera.centre_world(), direction };
                    share.explained += u64::from(meets_hull(&ray, others));
                }
                column += stride;
            }
            until_next = column - u64::from(run.end);
        }
    }
    share
}
