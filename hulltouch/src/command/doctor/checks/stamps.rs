//! Do cameras say when they captured, in order and evenly?

use film_time::Stamps;
use proto::TroubleKind;

use super::super::facts::{CameraFacts, Facts};
use super::super::finding::{Finding, or_ok};
use super::{filmed, trouble};

/// Times that are more uneven blur which frame is which.
const MOST_JITTER_PERIODS: f64 = 0.1;

/// Fails for times and counts that cannot be; warns of uneven ones.
pub fn check(facts: &Facts) -> Vec<Finding> {
    let cameras = match filmed(facts) {
        Ok(cameras) => cameras,
        Err(skipped) => return vec![skipped],
    };
    let wrong = cameras.iter().filter_map(|camera| of_camera(camera, facts.fps)).collect();
    or_ok(wrong, || Finding::ok("times and counts of frames only grow, evenly"))
}

fn of_camera(camera: &CameraFacts, fps: f64) -> Option<Finding> {
    let last = camera.last()?;
    let is_about_stamps = |kind| kind == TroubleKind::Stamps;
    if let Some(trouble) = trouble(last).filter(|trouble| is_about_stamps(trouble.kind)) {
        return Some(Finding::fail(
            trouble.message.clone(),
            "take the driver's monotonic times or counts, one a line; or leave {times} or {counts} out of its command",
        ));
    }
    let says_times = last.newest.as_ref().is_some_and(|newest| newest.stamps == Stamps::Capture);
    // The best of several looks, once it filmed evenly.
    let jitter_s = camera.looks.iter().map(|look| look.jitter_s).fold(f64::INFINITY, f64::min);
    (says_times && jitter_s > MOST_JITTER_PERIODS / fps).then(|| {
        Finding::warn(
            format!("camera {}: the times that it says are uneven by {:.1} ms", camera.name, 1e3 * jitter_s),
            "take the driver's times instead of arrival; leave {times} out if it has none",
        )
    })
}
