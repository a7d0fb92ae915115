//! Do cameras film as fast as the cluster file says?

use proto::TroubleKind;

use super::super::facts::{CameraFacts, Facts, NoFilm};
use super::super::finding::{Finding, or_ok};
use super::{filmed, trouble};

/// A camera that gives fewer frames than this share of the cluster's is too slow.
const LEAST_SHARE: f64 = 0.9;

/// Fails for cameras that film at another rate, or nothing; and if they were to be filmed and could not be.
pub fn check(facts: &Facts) -> Vec<Finding> {
    if let Err(NoFilm::Failed(why)) = &facts.film {
        return vec![Finding::fail(
            format!("cameras could not be filmed: {why}"),
            "run it again while no coordinator starts or ends; if it stays so, the logs of the nodes tell why",
        )];
    }
    let cameras = match filmed(facts) {
        Ok(cameras) => cameras,
        Err(skipped) => return vec![skipped],
    };
    let wrong = cameras.iter().filter_map(|camera| of_camera(camera, facts.fps)).collect();
    or_ok(wrong, || Finding::ok(format!("{} cameras film {} frames/s", cameras.len(), facts.fps)))
}

fn of_camera(camera: &CameraFacts, fps: f64) -> Option<Finding> {
    let (name, last) = (&camera.name, camera.last()?);
    match trouble(last) {
        Some(trouble) if trouble.kind == TroubleKind::Rate => {
            return Some(Finding::fail(
                trouble.message.clone(),
                "set the camera to fps of the cluster file (v4l2-ctl --set-parm), or fps to what all cameras give; in \
                 the dark long exposures slow cameras down",
            ));
        }
        // Its rate is of no matter, then.
        Some(trouble) if trouble.kind == TroubleKind::Stamps => return None,
        _ => {}
    }
    // The best of several looks: a machine may be busy for a moment.
    let best = camera.looks.iter().map(|look| look.frames_per_s).fold(0.0, f64::max);
    if best >= LEAST_SHARE * fps {
        return None;
    }
    Some(match trouble(last) {
        Some(trouble) => Finding::fail(
            trouble.message.clone(),
            "run the command of its source by hand on its PC, in the folder of the cluster file",
        ),
        None if best == 0.0 => Finding::fail(
            format!("camera {name} films nothing"),
            "look at its PC: does its source give frames?",
        ),
        None => Finding::fail(
            format!("camera {name} films {best:.1} frames/s, expected {fps}"),
            "its PC is too slow: fewer or smaller cameras there, or a lower fps",
        ),
    })
}
