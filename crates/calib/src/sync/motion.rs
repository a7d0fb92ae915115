//! How fast people move, and which outline pixels do.

use nalgebra::Point2;

use super::film::Films;
use crate::check::field::Field;
use crate::check::in_parallel;
use crate::check::refine::CAP_PX;

/// Outline pixels looked at, per camera and moment.
const PIXELS: usize = 60;
/// Outlines are held against those one frame and so many seconds later: motion goes on, flicker does not grow.
const LATER_S: f64 = 0.1;
/// An outline pixel moves if it goes so far, pixels of an image 640 wide …
const LEAST_PX: f64 = 1.5;
/// … from so long before a moment to so long after it, seconds; without two frames there, from frame to frame.
const AROUND_S: f64 = 0.067;
/// Outline pixels that are tried, for each that is wanted.
const TRIED: usize = 4;

/// How fast outlines move, root mean square over all cameras and moments: pixels of an image 640 wide a second, what
/// only flickers from frame to frame left out. `None` where no person is seen.
pub(super) fn motion_px_per_s(films: &Films) -> Option<f64> {
    let jobs: Vec<(usize, usize)> = (0..films.frames.len())
        .flat_map(|moment| (0..films.cameras.len()).map(move |camera| (moment, camera)))
        .collect();
    let parts = in_parallel(&jobs, |&(moment, camera)| squares(films, moment, camera));
    let (sum, pixels) = parts.iter().fold((0.0, 0), |all, part| (all.0 + part.0, all.1 + part.1));
    (pixels > 0).then(|| (sum / pixels as f64).max(0.0).sqrt())
}

/// The sum of squared speeds of a frame's outline pixels, and of how many. A square of its own may be negative, where
/// flicker was less in the longer time; the sum makes up for it.
fn squares(films: &Films, moment: usize, camera: usize) -> (f64, usize) {
    let (film, frame) = (&films.cameras[camera], films.frames[moment][camera]);
    let later = ((LATER_S / film.interval_s).round() as usize).max(2);
    if frame + later >= film.frames.len() {
        return (0.0, 0);
    }
    let fields = (film.field(frame), film.field(frame + 1), film.field(frame + later));
    let (Some(now), Some(next), Some(then)) = fields else { return (0.0, 0) };
    let time_s = |after: usize| film.frames[frame + after].time_s - film.frames[frame].time_s;
    let squared_s = time_s(later).powi(2) - time_s(1).powi(2);
    let most_px = CAP_PX * films.scale_px();
    let pixels = films.outline(moment, camera, PIXELS);
    let square = |pixel: &Point2<f64>| {
        let here = now.distance_px(pixel.x, pixel.y);
        let off = |there: &Field| (there.distance_px(pixel.x, pixel.y) - here).clamp(-most_px, most_px);
        (off(then).powi(2) - off(next).powi(2)) / (films.scale_px().powi(2) * squared_s)
    };
    (pixels.iter().map(square).sum(), pixels.len())
}

/// Outline pixels that move: those of a body that stands still say nothing about time, and their flicker something
/// wrong.
pub(super) fn moving(films: &Films, moment: usize, camera: usize, count: usize) -> Vec<Point2<f64>> {
    let (film, frame) = (&films.cameras[camera], films.frames[moment][camera]);
    let around = ((AROUND_S / film.interval_s).round() as usize).max(1);
    let before = frame.checked_sub(around).and_then(|frame| film.field(frame));
    let after = (frame + around < film.frames.len()).then(|| film.field(frame + around)).flatten();
    let (Some(before), Some(after)) = (before, after) else { return Vec::new() };
    let goes = |pixel: &Point2<f64>| {
        let there = after.distance_px(pixel.x, pixel.y) - before.distance_px(pixel.x, pixel.y);
        there.abs() >= LEAST_PX * films.scale_px()
    };
    let mut pixels = films.outline(moment, camera, TRIED * count);
    pixels.retain(goes);
    let step = pixels.len().div_ceil(count).max(1);
    pixels.into_iter().step_by(step).collect()
}
