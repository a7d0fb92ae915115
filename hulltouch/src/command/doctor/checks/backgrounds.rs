//! Do cameras tell people from the empty room?

use super::super::facts::{CameraFacts, Facts};
use super::super::finding::{Finding, or_ok};
use super::filmed;

/// No person fills so much of an image whose background is right.
const MOST: f64 = 0.6;
/// A camera with so much foreground sees a person.
const PERSON: f64 = 0.005;

/// Fails for cameras that take the room for a person; warns of those that never see one whom others see.
pub fn check(facts: &Facts) -> Vec<Finding> {
    let missing = facts.missing_backgrounds.iter().map(|(camera, path)| {
        Finding::fail(
            format!("camera {camera}: its film of the empty room, {}, is not there", path.display()),
            "film it: lights as they will be, no person in view",
        )
    });
    let mut wrong: Vec<Finding> = missing.collect();
    let cameras = match filmed(facts) {
        Ok(cameras) => cameras,
        Err(skipped) => return or_ok(wrong, || skipped),
    };
    let all: Vec<(&str, f64, f64)> = cameras.iter().filter_map(shares).collect();
    if all.is_empty() {
        return or_ok(wrong, || Finding::skip("no camera films"));
    }
    let see_a_person = all.iter().filter(|(_, _, most)| (PERSON..=MOST).contains(most)).count();
    for (name, least, most) in &all {
        if *least > MOST {
            wrong.push(Finding::fail(
                format!("camera {name}: {:.0} % of its image is foreground", 1e2 * least),
                "light, exposure or the camera have changed since: film the empty room again (background), or learn it \
                 again from the page",
            ));
        } else if *most == 0.0 && 2 * see_a_person > all.len() {
            wrong.push(Finding::warn(
                format!("camera {name} never has foreground, and most others do"),
                "look whether its lens is covered, and that no person stood in the film of its empty room",
            ));
        }
    }
    let (low, high) = all.iter().fold((1.0_f64, 0.0_f64), |(low, high), of| (low.min(of.1), high.max(of.2)));
    or_ok(wrong, || Finding::ok(format!("{:.1} to {:.1} % of images is foreground", 1e2 * low, 1e2 * high)))
}

/// The least and the most foreground of a camera while it was looked at.
fn shares(camera: &CameraFacts) -> Option<(&str, f64, f64)> {
    let shares = || camera.looks.iter().filter_map(|look| look.newest).map(|newest| newest.foreground);
    shares().next()?;
    Some((&camera.name, shares().fold(1.0, f64::min), shares().fold(0.0, f64::max)))
}
