//! Do cameras that count one trigger capture at one moment?

use film_time::Stamps;

use super::super::facts::{CameraFacts, Facts};
use super::super::finding::Finding;
use super::filmed;

/// Captures of one trigger lie within this, periods.
const MOST_SPREAD: f64 = 0.25;

/// Fails for cameras that count a trigger and are not triggered together.
pub fn check(facts: &Facts) -> Vec<Finding> {
    let cameras = match filmed(facts) {
        Ok(cameras) => cameras,
        Err(skipped) => return vec![skipped],
    };
    let triggered: Vec<(&str, f64)> = cameras.iter().filter_map(phase_of_triggered).collect();
    if triggered.len() < 2 {
        return vec![Finding::ok("no two cameras count a trigger: they need not capture together")];
    }
    let Some((middle, _)) = narrowest(&triggered) else { return Vec::new() };
    let wrong = triggered.iter().filter(|(_, phase)| away(*phase, middle) > MOST_SPREAD);
    let wrong: Vec<Finding> =
        wrong.map(|(name, phase)| of_camera(name, away(*phase, middle), facts.fps)).collect();
    super::super::finding::or_ok(wrong, || {
        Finding::ok(format!("{} cameras of a trigger capture together", triggered.len()))
    })
}

fn of_camera(name: &str, away: f64, fps: f64) -> Finding {
    let late_ms = 1e3 * away / fps;
    Finding::fail(
        format!("camera {name} counts a trigger and captures {late_ms:.1} ms away from others that do"),
        "look at its trigger's cable and that it is set to external trigger; or measure its latency_s: hulltouch sync \
         check FILE",
    )
}

/// A camera that counts a trigger, and when between frames it captures.
fn phase_of_triggered(camera: &CameraFacts) -> Option<(&str, f64)> {
    let newest =
        camera.looks.iter().rev().find_map(|look| look.newest.filter(|newest| newest.pace.is_some()))?;
    (newest.stamps == Stamps::Counter).then(|| Some((&camera.name[..], newest.pace?.phase))).flatten()
}

/// The phase to which all others are nearest, in all.
fn narrowest(phases: &[(&str, f64)]) -> Option<(f64, f64)> {
    let sum = |of: f64| phases.iter().map(|(_, phase)| away(*phase, of)).sum::<f64>();
    phases.iter().map(|(_, phase)| (*phase, sum(*phase))).min_by(|a, b| a.1.total_cmp(&b.1))
}

/// How far two phases are apart, periods: at most a half.
fn away(one: f64, other: f64) -> f64 {
    let apart = (one - other).rem_euclid(1.0);
    apart.min(1.0 - apart)
}
