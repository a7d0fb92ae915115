//! What a physicist would measure of each scene, and what must hold.

use hull::surface::HullTime;
use nalgebra::{Isometry3, Vector3};
use stage::{LIFT_TILT_S, Prop, StageSettings};

use super::falls::falls;
use super::metric::{Limit, Metric, metric};
use super::track::{BodyAt, Track, TrackStep};

/// Bodies have come to rest, and are looked at, from this time of the film on, seconds.
const SETTLED_S: f64 = 2.0;

/// The film that a scene's claims need, seconds.
pub fn seconds_of(scene: &str) -> f64 {
    match scene {
        "rest" => 20.0,
        "lift" => 9.4,
        "tray" => 9.8,
        "push" => 5.0,
        "punch" => 3.5,
        "drops" => 3.0,
        "squeeze" => 9.5,
        _ => 8.0,
    }
}

/// What must hold depends on how fine the images are and whether they flicker.
#[derive(Clone, Copy)]
pub struct Conditions {
    /// Pixels of an image's width.
    pub width: u32,
    /// The share of outline pixels that flicker.
    pub flicker: f64,
    /// Of which moment the hull was.
    pub hull_time: HullTime,
}

/// The figures of a run of a scene.
pub fn judge(scene: &str, track: &Track, stage: &StageSettings, conditions: Conditions) -> Vec<Metric> {
    let mut metrics = match scene {
        "rest" => rest(track, conditions),
        "lift" => [lift(track, stage), falls(scene, track, stage)].concat(),
        "topple" => falls(scene, track, stage),
        "tray" => tray(track, stage),
        "push" => push(track),
        "punch" => punch(track),
        "drops" => drops(track),
        "squeeze" => squeeze(track),
        _ => Vec::new(),
    };
    let most_mm = match scene {
        "rest" => Some(4.0),
        // What is guessed of a motion is wrong by more than what is known of it.
        "lift" if conditions.width >= 1280 => Some(match conditions.hull_time {
            HullTime::Newest => 12.0,
            HullTime::Between => 6.0,
        }),
        _ => None,
    };
    metrics.push(metric("passes a frame", track.passes_a_frame, None));
    metrics.push(metric("depth p99, mm", 1e3 * depth_m(track, 0.99), most_mm.map(Limit::Most)));
    metrics
}

/// A quantile of how deep the deepest sample of any body was, step by step, metres.
fn depth_m(track: &Track, share: f64) -> f64 {
    let deepest = |step: &TrackStep| step.bodies.iter().map(|body| body.depth_m).fold(0.0, f64::max);
    let mut depths: Vec<f64> = track.since(SETTLED_S).iter().map(deepest).collect();
    depths.sort_by(f64::total_cmp);
    let at = (depths.len().saturating_sub(1)) as f64 * share;
    depths.get(at.round() as usize).copied().unwrap_or(f64::NAN)
}

/// The most of a figure over steps and bodies, each against its first step.
fn most(steps: &[TrackStep], of: impl Fn(&BodyAt, &BodyAt) -> f64) -> f64 {
    let Some(first) = steps.first() else { return f64::NAN };
    let of_step = |step: &TrackStep| {
        let bodies = step.bodies.iter().zip(&first.bodies);
        bodies.map(|(now, then)| of(now, then)).fold(0.0, f64::max)
    };
    steps.iter().map(of_step).fold(0.0, f64::max)
}

fn rest(track: &Track, conditions: Conditions) -> Vec<Metric> {
    let steps = track.since(SETTLED_S);
    let aside = |now: &BodyAt, then: &BodyAt| (now.place() - then.place()).xz().norm();
    let drift_mm = 1e3 * most(steps, aside);
    let turn_deg = most(steps, BodyAt::turned_deg);
    let last = steps.last().map_or(&[][..], |step| &step.bodies);
    let awake = last.iter().filter(|body| !body.sleeps).count() as f64;
    let (most_mm, most_deg) = match conditions {
        Conditions { flicker: 0.0, .. } => (0.1, 0.3),
        Conditions { width: 1280.., .. } => (2.0, 0.3),
        Conditions { .. } => (10.0, f64::INFINITY),
    };
    let settled = steps.first().and_then(|step| step.bodies.first());
    let table_m = stage::props::TABLE_HEIGHT_M;
    let over_mm = settled.map_or(f64::NAN, |body| 1e3 * (body.place().y - 0.1 - table_m));
    let most_awake = (conditions.flicker == 0.0).then_some(Limit::Most(0.0));
    vec![
        metric("drift, mm", drift_mm, Some(Limit::Most(most_mm))),
        metric("turn, deg", turn_deg, most_deg.is_finite().then_some(Limit::Most(most_deg))),
        metric("awake at the end", awake, most_awake),
        metric("lean of the lowest, deg", settled.map_or(f64::NAN, BodyAt::lean_deg), None),
        metric("over the table, mm", over_mm, None),
    ]
}

/// The figures of a run of a scene of which nothing is known that must hold.
pub fn judge_any(track: &Track) -> Vec<Metric> {
    let steps = track.since(SETTLED_S);
    let last = steps.last().map_or(&[][..], |step| &step.bodies);
    let drift = |now: &BodyAt, then: &BodyAt| (now.place() - then.place()).norm();
    let tilt_deg = |steps: &[TrackStep]| most(steps, BodyAt::turned_deg);
    let all = &track.steps[..];
    vec![
        metric("moved since its start, mm", 1e3 * most(all, drift), None),
        metric("drift since 2 s, mm", 1e3 * most(steps, drift), None),
        metric("turn since 2 s, deg", tilt_deg(steps), None),
        metric("turn since its start, deg", tilt_deg(all), None),
        metric("awake at the end", last.iter().filter(|body| !body.sleeps).count() as f64, None),
        metric("passes a frame", track.passes_a_frame, None),
        metric("depth p50, mm", 1e3 * depth_m(track, 0.5), None),
        metric("depth p99, mm", 1e3 * depth_m(track, 0.99), None),
    ]
}

/// A body in the frame of a prop.
fn on_prop(body: &BodyAt, prop_world: &Isometry3<f64>) -> Vector3<f64> {
    prop_world.inverse_transform_point(&body.place()).coords
}

/// What slides so far down the lid has gone, and had begun when it was farther than this, metres.
const SLID_M: f64 = 0.01;
const BEGAN_SLIDING_M: f64 = 0.002;
/// What leans so far from the lid goes over, and had begun when it leant more than this, degrees.
const LEANS_DEG: f64 = 12.0;
const BEGAN_LEANING_DEG: f64 = 6.0;

/// A body on the lid that tilts, step by step.
struct OnLid {
    tilt_deg: f64,
    /// Up the lid, from where it was before, metres.
    up_m: f64,
    /// Down the lid, from the highest that it has been, metres.
    slid_m: f64,
    /// Against the lid, degrees.
    leans_deg: f64,
}

fn on_lid(track: &Track, stage: &StageSettings, index: usize) -> Vec<OnLid> {
    let steps = track.between(LIFT_TILT_S[0] - 0.1, LIFT_TILT_S[2]);
    let (mut first_m, mut highest_m) = (None, f64::NEG_INFINITY);
    let on = |step: &TrackStep| {
        let body = &step.bodies[index];
        let lid = stage.prop_world(Prop::LiftedBox, step.film_s);
        // It sinks on the side of negative x.
        let along_m = on_prop(body, &lid).x;
        highest_m = highest_m.max(along_m);
        let up = body.pose.rotation() * Vector3::y();
        OnLid {
            tilt_deg: lid.rotation.angle().to_degrees(),
            up_m: along_m - *first_m.get_or_insert(along_m),
            slid_m: highest_m - along_m,
            leans_deg: up.angle(&(lid.rotation * Vector3::y())).to_degrees(),
        }
    };
    steps.iter().map(on).collect()
}

/// The lid's tilt, degrees, when a body begins to go: before a figure is greater than `gone`, it was last no greater
/// than `begun`. No number if it never is.
fn tilt_when(steps: &[OnLid], of: impl Fn(&OnLid) -> f64, begun: f64, gone: f64) -> f64 {
    let Some(end) = steps.iter().position(|step| of(step) > gone) else { return f64::NAN };
    let begins = steps[..end].iter().rposition(|step| of(step) <= begun);
    steps[begins.unwrap_or(0)].tilt_deg
}

fn lift(track: &Track, stage: &StageSettings) -> Vec<Metric> {
    let mut metrics = Vec::new();
    let greatest_mm = |steps: &[OnLid], of: fn(&OnLid) -> f64| 1e3 * steps.iter().map(of).fold(0.0, f64::max);
    if let Some(slippery) = track.index("slippery") {
        let at_deg = tilt_when(&on_lid(track, stage, slippery), |step| step.slid_m, BEGAN_SLIDING_M, SLID_M);
        metrics.push(metric("friction 0.3 slides at, deg", at_deg, Some(Limit::Within(13.0, 21.0))));
    }
    if let Some(rough) = track.index("rough") {
        let steps = on_lid(track, stage, rough);
        let (slid_mm, up_mm) =
            (greatest_mm(&steps, |step| step.slid_m), greatest_mm(&steps, |step| step.up_m));
        metrics.push(metric("friction 0.8 slides, mm", slid_mm, Some(Limit::Most(1e3 * SLID_M))));
        metrics.push(metric("the lid leaves it behind, mm", up_mm, Some(Limit::Most(1e3 * SLID_M))));
    }
    if let Some(top) = track.index("tower_2") {
        let at_deg =
            tilt_when(&on_lid(track, stage, top), |step| step.leans_deg, BEGAN_LEANING_DEG, LEANS_DEG);
        metrics.push(metric("tower goes over at, deg", at_deg, Some(Limit::Within(14.0, 22.0))));
    }
    metrics
}

/// The tray is carried between these times of the film, seconds.
const CARRIED_S: (f64, f64) = (3.0, 8.8);

fn tray(track: &Track, stage: &StageSettings) -> Vec<Metric> {
    let steps = track.between(CARRIED_S.0, CARRIED_S.1);
    let places = |step: &TrackStep| -> Vec<Vector3<f64>> {
        let tray = stage.prop_world(Prop::Tray, step.film_s);
        step.bodies.iter().map(|body| on_prop(body, &tray)).collect()
    };
    let Some(first) = steps.first().map(places) else { return Vec::new() };
    let slid = |step: &TrackStep| {
        places(step).iter().zip(&first).map(|(now, then)| (now - then).xz().norm()).fold(0.0, f64::max)
    };
    let slid_mm = 1e3 * steps.iter().map(slid).fold(0.0, f64::max);
    let last = steps.last().map(places).unwrap_or_default();
    let lost = last.iter().filter(|place| place.y < 0.0).count() as f64;
    vec![
        metric("slides on the tray, mm", slid_mm, Some(Limit::Most(50.0))),
        metric("off the tray", lost, Some(Limit::Most(0.0))),
    ]
}

fn push(track: &Track) -> Vec<Metric> {
    let leans = |name: &str| {
        let index = track.index(name)?;
        Some(track.steps.iter().map(|step| step.bodies[index].lean_deg()).fold(0.0, f64::max))
    };
    let slides = |name: &str| {
        let index = track.index(name)?;
        let (first, last) = (track.steps.first()?, track.steps.last()?);
        Some(1e3 * (last.bodies[index].place() - first.bodies[index].place()).z)
    };
    vec![
        metric("pushed low tilts, deg", leans("pushed_low").unwrap_or(f64::NAN), Some(Limit::Most(5.0))),
        metric("pushed low slides, mm", slides("pushed_low").unwrap_or(f64::NAN), Some(Limit::Least(50.0))),
        metric("pushed high tilts, deg", leans("pushed_high").unwrap_or(f64::NAN), Some(Limit::Least(45.0))),
    ]
}

/// What is struck falls off its stand once it has gone so far, metres.
const STRUCK_M: f64 = 0.3;

fn punch(track: &Track) -> Vec<Metric> {
    let along = |step: &TrackStep| step.bodies.first().map_or(f64::NAN, |body| body.place().z);
    let start_m = track.steps.first().map_or(f64::NAN, along);
    let ways_m = || track.steps.iter().map(|step| along(step) - start_m);
    let gone = track.steps.iter().zip(ways_m()).find(|(_, way_m)| *way_m > STRUCK_M);
    let speed_m_s = gone.map_or(0.0, |(step, _)| step.bodies[0].speed_m_s());
    vec![
        metric("knocked away at, m/s", speed_m_s, Some(Limit::Within(2.0, 4.5))),
        metric("thrown back, mm", -1e3 * ways_m().fold(0.0, f64::min), Some(Limit::Most(20.0))),
    ]
}

/// The side of the cubes that drop, metres, and gravity.
const DROPPED_M: f64 = 0.12;
const GRAVITY_M_S2: f64 = 9.81;

/// The energy of a cube as the height that it could rise to, metres.
fn energy_m(body: &BodyAt) -> f64 {
    let turning = DROPPED_M * DROPPED_M / 6.0 * body.spin_rad_s * body.spin_rad_s;
    body.place().y + (body.velocity_m_s.norm_squared() + turning) / (2.0 * GRAVITY_M_S2)
}

/// The most that any of these bodies has over its least so far, as height, metres, over the table and below it.
fn regained_m(track: &Track, index: usize) -> [f64; 2] {
    let (mut least_m, mut most_m) = (f64::INFINITY, [0.0_f64; 2]);
    for body in track.steps.iter().map(|step| &step.bodies[index]) {
        let energy_m = energy_m(body);
        least_m = least_m.min(energy_m);
        let where_it_is = usize::from(!is_over_table(body));
        most_m[where_it_is] = most_m[where_it_is].max(energy_m - least_m);
    }
    most_m
}

fn is_over_table(body: &BodyAt) -> bool {
    body.place().y > stage::props::TABLE_HEIGHT_M
}

fn drops(track: &Track) -> Vec<Metric> {
    let count = track.steps.first().map_or(0, |step| step.bodies.len());
    let regained_m = (0..count).map(|index| regained_m(track, index));
    let [over_mm, below_mm] = regained_m
        .fold([0.0; 2], |most_mm, regained_m| [0, 1].map(|at| f64::max(most_mm[at], 1e3 * regained_m[at])));
    let last = track.steps.last().map_or(&[][..], |step| &step.bodies);
    let left = last.iter().filter(|body| is_over_table(body)).count() as f64;
    vec![
        metric("energy regained, mm", over_mm, Some(Limit::Most(5.0))),
        // The solver's own contact with the floor: no hull is there.
        metric("energy regained on the floor, mm", below_mm, None),
        metric("left on the table", left, None),
    ]
}

/// The palms have risen and hold still, have pressed harder, and have opened, at these times of the film, seconds.
const HELD_S: f64 = 4.1;
const CRUSHED_S: (f64, f64) = (4.1, 5.9);
const OPENED_S: f64 = 7.6;
/// How far the palms rise, millimetres.
const PALMS_RISE_MM: f64 = 120.0;

fn squeeze(track: &Track) -> Vec<Metric> {
    let height_mm = |film_s: f64| {
        let step = track.since(film_s).first();
        step.and_then(|step| step.bodies.first()).map_or(f64::NAN, |body| 1e3 * body.place().y)
    };
    let fastest = |steps: &[TrackStep]| {
        let bodies = steps.iter().flat_map(|step| &step.bodies);
        bodies.map(BodyAt::speed_m_s).fold(0.0, f64::max)
    };
    let risen_mm = height_mm(HELD_S) - height_mm(SETTLED_S);
    let end_mm = track.steps.last().map_or(f64::NAN, |step| height_mm(step.film_s)) - height_mm(SETTLED_S);
    vec![
        metric(
            "risen with the palms, mm",
            risen_mm,
            Some(Limit::Within(0.9 * PALMS_RISE_MM, 1.1 * PALMS_RISE_MM)),
        ),
        metric(
            "speed while crushed, m/s",
            fastest(track.between(CRUSHED_S.0, CRUSHED_S.1)),
            Some(Limit::Most(0.3)),
        ),
        metric("speed once released, m/s", fastest(track.since(OPENED_S)), Some(Limit::Most(0.5))),
        metric("over its place at the end, mm", end_mm, Some(Limit::Within(-30.0, 30.0))),
    ]
}
