//! The shipped scenes, played through the program: what a person on film does to virtual bodies.

use std::path::Path;

use nalgebra::Vector3;
use serde_json::Value;
use stage::{Joint, Motion};

const GRAVITY_M_S2: f64 = 9.81;

/// Plays a scene in lock-step on this machine and reads what it reports.
fn play(scene: &str, seconds: f64, seed: u64, extra: &[&str]) -> Value {
    let folder = tempfile::tempdir().expect("a folder");
    let json = folder.path().join("out.json");
    let output = testkit::command(env!("CARGO_BIN_EXE_hulltouch"))
        .args(["demo", "--unpaced", "--transport", "inprocess", "--headless", "--scene", scene])
        .args(["--seconds", &seconds.to_string(), "--seed", &seed.to_string(), "--json"])
        .arg(&json)
        .args(extra)
        .output()
        .expect("the program runs");
    assert!(output.status.success(), "{scene}: {}", String::from_utf8_lossy(&output.stderr));
    read(&json)
}

fn read(json: &Path) -> Value {
    serde_json::from_slice(&std::fs::read(json).expect("figures")).expect("JSON")
}

/// The figures of one body.
struct BodyRecord {
    name: String,
    fixed: bool,
    start_m: Vector3<f64>,
    end_m: Vector3<f64>,
    moved_m: f64,
    hull_moved_m: f64,
    first_touch_s: Option<f64>,
    moved_before_touch_m: f64,
    max_speed_m_s: f64,
}

fn bodies(run: &Value) -> Vec<BodyRecord> {
    let body = |body: &Value| {
        let number = |key: &str| body[key].as_f64().unwrap_or_else(|| panic!("{key} is {}", body[key]));
        let point = |key: &str| Vector3::from_fn(|axis, _| body[key][axis].as_f64().expect("a coordinate"));
        BodyRecord {
            name: body["name"].as_str().expect("a name").to_owned(),
            fixed: body["fixed"].as_bool().expect("fixed"),
            start_m: point("start"),
            end_m: point("end"),
            moved_m: number("moved_m"),
            hull_moved_m: number("hull_moved_m"),
            first_touch_s: body["first_touch_s"].as_f64(),
            moved_before_touch_m: number("moved_before_touch_m"),
            max_speed_m_s: number("max_speed_m_s"),
        }
    };
    run["bodies"].as_array().expect("bodies").iter().map(body).filter(|body| !body.fixed).collect()
}

/// What holds for every scene: responses free the samples, numbers are numbers, and no body is faster than
/// falling makes it. The paper's response hands no speed on (it displaces, and mirrors what a body has), so
/// that speed comes from height: what the body had at the start and what responses lifted it by. The solver
/// pushes overlapping bodies apart at up to 1 m/s.
fn check_sound(scene: &str, run: &Value) {
    let left_inside = run["left_inside"].as_f64().expect("left_inside");
    assert!(left_inside < 0.2, "{scene}: {left_inside} left inside");
    assert_eq!(run["faults"], 0, "{scene}");
    for body in bodies(run) {
        let height_m = body.start_m.y + body.hull_moved_m;
        let bound_m_s = (2.0 * GRAVITY_M_S2 * height_m).sqrt() + 1.0;
        let (name, found) = (&body.name, body.max_speed_m_s);
        assert!(found < bound_m_s, "{scene}: {name} flew at {found} m/s, expected under {bound_m_s}");
        assert!(body.end_m.y > 0.0 && body.end_m.norm() < 20.0, "{scene}: {name} ended at {}", body.end_m);
    }
}

/// How near the arms' bones are to a place, metres, in the frame in use at a film time.
fn arms_away_m(place: &Vector3<f64>, film_s: f64) -> f64 {
    let frame_s = (film_s * 30.0 + 1e-6).floor() / 30.0;
    let at = |joint| Motion::Sweep.joint_world(joint, frame_s).coords;
    let left = [Joint::LeftShoulder, Joint::LeftElbow, Joint::LeftWrist, Joint::LeftHand];
    let right = [Joint::RightShoulder, Joint::RightElbow, Joint::RightWrist, Joint::RightHand];
    let bones = left.windows(2).chain(right.windows(2));
    let away = bones.map(|bone| {
        let (from, along) = (at(bone[0]), at(bone[1]) - at(bone[0]));
        let share = ((place - from).dot(&along) / along.norm_squared()).clamp(0.0, 1.0);
        (place - from - along * share).norm()
    });
    away.fold(f64::INFINITY, f64::min)
}

#[test]
fn the_stacks_fall_when_the_arms_arrive_and_not_before() {
    let run = play("topple", 10.0, 1, &[]);
    assert_eq!(run["response"], "contacts");
    check_stacks(&run);
}

#[test]
fn with_the_papers_response_the_stacks_are_moved_out_of_the_arms_and_fall() {
    let run = play("topple", 10.0, 1, &["--response", "paper"]);
    check_sound("topple", &run);
    let inside = run["inside_samples"].as_u64().expect("inside_samples");
    assert!(inside > 1000, "{inside} samples inside");
    let pushed = bodies(&run).iter().filter(|body| body.hull_moved_m > 0.1).count();
    assert!(pushed >= 3, "{pushed} boxes were moved by the hull");
    check_stacks(&run);
}

/// Boxes fall from their stands, none before an arm is at it.
fn check_stacks(run: &Value) {
    let bodies = bodies(run);
    let fell = bodies.iter().filter(|body| body.start_m.y - body.end_m.y > 0.3).count();
    assert!(fell >= 6, "{fell} boxes fell");
    // From a box's middle to its edge, plus half an arm, plus what the hull is thicker than the arm.
    let reach_m = Vector3::new(0.125, 0.055, 0.125).norm() + 0.06 + 0.05;
    for body in &bodies {
        let (name, early_m) = (&body.name, body.moved_before_touch_m);
        assert!(early_m <= 0.02, "{name} moved {early_m} m before it was touched");
        let Some(touch_s) = body.first_touch_s else {
            assert!(body.moved_m <= 0.02, "{name} moved {} m and was never touched", body.moved_m);
            continue;
        };
        let away_m = arms_away_m(&body.start_m, touch_s);
        assert!(away_m < reach_m, "{name} touched at {touch_s} s by an arm {away_m} m away");
    }
}

#[test]
fn without_the_person_the_stacks_stand() {
    let run = play("topple", 10.0, 1, &["--empty"]);
    assert_eq!(run["inside_samples"], 0);
    for body in bodies(&run) {
        assert!(body.moved_m <= 0.02, "{} moved {} m", body.name, body.moved_m);
    }
}

#[test]
fn a_seed_gives_one_run_and_another_seed_another() {
    let digest = |seed| play("topple", 4.0, seed, &[])["trajectory_digest"].clone();
    let first = digest(1);
    assert_eq!(first.as_str().map(str::len), Some(64));
    assert_eq!(digest(1), first);
    assert_ne!(digest(2), first);
}

#[test]
fn what_rains_on_the_person_is_thrown_off_and_stays_around() {
    let run = play("crowd", 4.0, 1, &[]);
    check_sound("crowd", &run);
    let bodies = bodies(&run);
    assert_eq!(bodies.len(), 40);
    let touched = bodies.iter().filter(|body| body.first_touch_s.is_some()).count();
    assert!(touched >= 10, "{touched} bodies were touched");
    let near = bodies.iter().filter(|body| body.end_m.xz().norm() < 1.5).count();
    assert!(near >= 20, "{near} bodies lie around him");
}

#[test]
fn boxes_rest_on_a_real_box_rise_with_it_and_tilt_with_its_lid() {
    // The lid rises by 0.35 m until 3.2 s, and tilts to 24 degrees from 5.2 to 6.7 s.
    let [rest, top, tilted] = [1.9, 4.5, 7.0].map(|seconds| play("lift", seconds, 1, &[]));
    assert!(stage::LIFT_RISE_S.0 >= 1.9 && stage::LIFT_RISE_S.1 < 4.5 && stage::LIFT_TILT_S[0] > 4.5);
    let (rest, top, tilted) = (bodies(&rest), bodies(&top), bodies(&tilted));
    for (before, after) in rest.iter().zip(&top) {
        let drift_m = before.moved_m;
        assert!(drift_m < 0.04, "{} drifted {drift_m} m before the lift", before.name);
        let rise_m = after.end_m.y - before.end_m.y;
        assert!((0.33..0.37).contains(&rise_m), "{} rose {rise_m} m", after.name);
        let aside_m = (after.end_m - before.end_m).xz().norm();
        assert!(aside_m < 0.1, "{} slid {aside_m} m on the lid", after.name);
    }
    // The slippery box slides off or far down, the tower goes over, the rough box stays.
    for (name, least_m, most_m) in [("slippery", 0.05, 2.0), ("tower_2", 0.3, 2.0), ("rough", 0.0, 0.15)] {
        let body =
            |bodies: &[BodyRecord]| bodies.iter().find(|body| body.name == name).map(|body| body.end_m);
        let moved_m = (body(&tilted).expect("it") - body(&top).expect("it")).norm();
        assert!((least_m..most_m).contains(&moved_m), "{name} moved {moved_m} m");
    }
}
