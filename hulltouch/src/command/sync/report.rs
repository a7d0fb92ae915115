//! What `sync check` prints and writes.

use calib::sync::{CameraSync, SyncReport};
use serde::Serialize;

use super::film::Film;

/// A camera is called late if it is so many standard deviations …
const SURE: f64 = 3.0;
/// … and at least so much, seconds.
const LEAST_LATE_S: f64 = 0.001;

/// The figures' JSON form.
#[derive(Serialize)]
pub struct Figures<'a> {
    /// Frames looked at, of the camera that has the most.
    frames: usize,
    /// The camera that is out of its place, if one clearly is.
    moved: Option<&'a str>,
    /// The misfit with the times as the cameras say them.
    cost_as_said: f64,
    /// The misfit with the times found.
    cost: f64,
    /// How fast outlines move, root mean square, pixels of an image 640 wide a second.
    motion_px_per_s: f64,
    /// In rig order.
    cameras: &'a [CameraSync],
}

/// As JSON.
pub fn figures<'a>(found: &'a SyncReport, film: &Film) -> Figures<'a> {
    Figures {
        frames: frames(film),
        moved: moved(found).map(|camera| camera.camera.as_str()),
        cost_as_said: found.cost_as_said,
        cost: found.cost,
        motion_px_per_s: found.motion_px_per_s,
        cameras: &found.cameras,
    }
}

/// A line a camera.
pub fn table(found: &SyncReport) -> String {
    let names = found.cameras.iter().map(|camera| camera.camera.chars().count());
    let width = names.max().unwrap_or(0).max("camera".len());
    let mut text = format!("{:width$}             misfit if it alone were\n", "");
    text += &format!("{:width$}  late, ms      ±  in time   moved\n", "camera");
    for camera in &found.cameras {
        text += &format!(
            "{:width$}  {:8.1}  {:5.1}  {:7.3}  {:6.3}\n",
            camera.camera,
            1e3 * camera.late_s,
            1e3 * camera.uncertainty_s,
            camera.cost_in_time,
            camera.refinement.cost
        );
    }
    text
}

/// What was looked at.
pub fn summary(found: &SyncReport, film: &Film) -> String {
    format!(
        "{} frames; misfit {:.3} with the times as they are said, {:.3} with these",
        frames(film),
        found.cost_as_said,
        found.cost
    )
}

/// Who is late, and who is out of its place.
pub fn verdict(found: &SyncReport) -> String {
    let late: Vec<String> = found.cameras.iter().filter(|camera| is_late(camera)).map(in_words).collect();
    let mut text = if late.is_empty() {
        "no camera is late or early against the others".to_owned()
    } else {
        late.join("; ")
    };
    if let Some(camera) = moved(found) {
        let refinement = &camera.refinement;
        text += &format!(
            "\n{} is out of its place: it would turn {:.2}° right, {:.2}° up, {:.2}° clockwise; `hulltouch rig check` \
             says more. Its time is as if it were put right",
            camera.camera, refinement.pan_deg, refinement.tilt_deg, refinement.roll_deg
        );
    }
    text
}

fn moved(found: &SyncReport) -> Option<&CameraSync> {
    found.moved.and_then(|at| found.cameras.get(at))
}

/// Whether a camera's time is surely not that of the others.
pub fn is_late(camera: &CameraSync) -> bool {
    camera.late_s.abs() > (SURE * camera.uncertainty_s).max(LEAST_LATE_S)
}

fn in_words(camera: &CameraSync) -> String {
    let word = if camera.late_s > 0.0 { "late" } else { "early" };
    let (late_ms, off_ms) = (1e3 * camera.late_s.abs(), 1e3 * camera.uncertainty_s);
    format!("{} is {late_ms:.1} ± {off_ms:.1} ms {word}", camera.camera)
}

fn frames(film: &Film) -> usize {
    film.cameras.iter().map(Vec::len).max().unwrap_or(0)
}
