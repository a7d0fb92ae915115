//! Two recordings of real people, played by the cluster files that are shipped: the whole chain from
//! film through silhouettes and probes to bodies that are pushed. What the silhouettes are worth is
//! tested in `segment`.

#![allow(clippy::disallowed_macros, reason = "a test says what it measured")]
#![allow(clippy::print_stdout, reason = "a test that is skipped says so, and figures are worth seeing")]

use std::path::Path;

use crate::datasets;
use assert_cmd::Command;
use serde_json::Value;

/// Gravity in the world and on both sets' rigs, m/s².
const GRAVITY_M_S2: f64 = 9.81;
/// The solver pushes overlapping bodies apart at up to this speed, m/s; nothing else adds to a fall under the paper's
/// response, which only mirrors velocities.
const PUSHED_APART_M_S: f64 = 1.0;
/// Under contacts limbs hand on their own speed too, m/s.
const HANDED_ON_M_S: f64 = 3.0;
/// Where the seat of the chair is, and half of the box on the lap, metres.
const SEAT_M: f64 = 0.45;
const HALF_BOX_M: f64 = 0.075;

/// The program with a shipped cluster file and the datasets that were found.
fn demo(recording: &str, datasets: &Path) -> Command {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let datasets = datasets.canonicalize().expect("the folder is there");
    let mut command = Command::from_std(testkit::command(env!("CARGO_BIN_EXE_hulltouch")));
    command.env("HULLTOUCH_DATASETS", datasets).arg("demo").arg("--recording");
    command.arg(root.join(format!("deploy/{recording}.cluster.toml"))).args(["--unpaced", "--headless"]);
    command
}

/// What the program reports of a run, after the checks that hold for every run; `None`, with the reason
/// printed, if the recordings are not there.
fn play(recording: &str, options: &[&str]) -> Option<Value> {
    let datasets = datasets::datasets()?;
    let folder = tempfile::tempdir().expect("a folder");
    let json = folder.path().join("out.json");
    demo(recording, &datasets).args(options).arg("--json").arg(&json).assert().success();
    let report = serde_json::from_slice(&std::fs::read(&json).expect("the report")).expect("JSON");
    check_sound(&format!("{recording} {}", options.join(" ")), &report);
    Some(report)
}

/// No frame is missed, nothing is lost to bad numbers, few samples stay in the hull, and no body is
/// faster than its fall explains.
#[track_caller]
fn check_sound(run: &str, report: &Value) {
    let left_inside = number(report, "/left_inside");
    println!("{run}: {} inside samples, {left_inside:.3} left inside", number(report, "/inside_samples"));
    assert_eq!(number(report, "/missed/share"), 0.0, "{run}: {}", report["missed"]);
    assert_eq!(number(report, "/faults"), 0.0, "{run}");
    assert!(left_inside < 0.2, "{run}: a share of {left_inside} of the samples is left inside");
    for body in report["bodies"].as_array().expect("bodies") {
        let speed_m_s = number(body, "/max_speed_m_s");
        let fall_m = number(body, "/start/2");
        let handed_on_m_s = if report["response"] == "contacts" { HANDED_ON_M_S } else { 0.0 };
        let explained_m_s = (2.0 * GRAVITY_M_S2 * fall_m).sqrt() + PUSHED_APART_M_S + handed_on_m_s;
        println!(
            "  {}: touched at {} s, {:.3} m up in the end, tilt {:.1}°, up to {speed_m_s:.1} m/s",
            body["name"],
            body["first_touch_s"],
            height_m(body),
            number(body, "/max_tilt_deg"),
        );
        assert!(speed_m_s < explained_m_s, "{run}, {}: {speed_m_s} m/s", body["name"]);
    }
}

/// A number of the report; a missing one, and one that is not finite (null in JSON), fails the test.
#[track_caller]
fn number(value: &Value, pointer: &str) -> f64 {
    let found = value.pointer(pointer).and_then(Value::as_f64);
    found.unwrap_or_else(|| panic!("no number at {pointer} of {value}"))
}

/// How high a body's centre is in the end, metres; both worlds have z up.
fn height_m(body: &Value) -> f64 {
    number(body, "/end/2")
}

fn body<'a>(report: &'a Value, name: &str) -> &'a Value {
    let mut bodies = report["bodies"].as_array().expect("bodies").iter();
    bodies.find(|body| body["name"] == name).unwrap_or_else(|| panic!("no body {name}"))
}

fn greatest_tilt_deg(report: &Value) -> f64 {
    let bodies = report["bodies"].as_array().expect("bodies").iter();
    bodies.map(|body| number(body, "/max_tilt_deg")).fold(0.0, f64::max)
}

fn digest(report: &Value) -> &str {
    report["trajectory_digest"].as_str().expect("a digest")
}

#[test]
fn a_box_on_the_lap_is_above_the_seat_after_a_second_and_on_the_floor_without_the_man() {
    let a_second = ["--transport", "inprocess", "--seconds", "1"];
    for response in ["contacts", "paper"] {
        let of_response = [&a_second[..], &["--response", response]].concat();
        let Some(with_him) = play("uu_horseman", &of_response) else { return };
        let Some(again) = play("uu_horseman", &of_response) else { return };
        assert_eq!(digest(&again), digest(&with_him), "two runs of one seed, {response}");
        let lap = body(&with_him, "lap");
        assert!(height_m(lap) > SEAT_M + HALF_BOX_M + 0.1, "{response}: on the lap and not the seat: {lap}");
        // Contacts tip it off the head; it would lie on the floor after 0.6 s.
        let head = body(&with_him, "head");
        let least_m = if response == "paper" { 1.4 } else { 0.6 };
        assert!(height_m(head) > least_m, "{response}: stopped by the head: {head}");
    }
    let Some(empty) = play("uu_horseman", &[&a_second[..], &["--empty"]].concat()) else { return };
    let lap = body(&empty, "lap");
    assert!(height_m(lap) < HALF_BOX_M + 0.02, "on the floor: {lap}");
    assert!(empty["bodies"].as_array().expect("bodies").iter().all(|body| body["first_touch_s"].is_null()));
}

#[test]
fn the_man_on_the_chair_is_hit_by_every_box_and_every_transport_tells_the_same() {
    let Some(report) = play("uu_horseman", &["--transport", "inprocess"]) else { return };
    assert_eq!((&report["frames"], &report["response"]), (&426.into(), &"contacts".into()), "frames in use");
    for body in report["bodies"].as_array().expect("bodies") {
        // The box on his head knocks another off his shoulder.
        let touch_s = body["first_touch_s"].as_f64().unwrap_or(f64::INFINITY);
        assert!(touch_s > 0.05, "starts above him: {body}");
        assert!(touch_s < 0.5 || body["name"] == "left_shoulder", "falls on him: {body}");
        assert!(number(body, "/max_tilt_deg") > 3.0, "is turned by him: {body}");
        assert!(height_m(body) > 0.05, "on him or on the floor: {body}");
    }
    let lap = body(&report, "lap");
    assert!(height_m(lap) > SEAT_M + HALF_BOX_M + 0.1, "stays on the lap to the end: {lap}");
    check_transports("uu_horseman", &report, &[]);
}

#[test]
fn every_box_is_stopped_by_the_man_on_the_chair_under_the_papers_response() {
    let paper = ["--response", "paper"];
    let Some(report) = play("uu_horseman", &[&paper[..], &["--transport", "inprocess"]].concat()) else {
        return;
    };
    assert_eq!((&report["frames"], &report["response"]), (&426.into(), &"paper".into()), "frames in use");
    for body in report["bodies"].as_array().expect("bodies") {
        let touch_s = number(body, "/first_touch_s");
        assert!(touch_s > 0.05, "starts above him: {body}");
        assert!(number(body, "/hull_moved_m") > 0.005, "is stopped by him: {body}");
        assert!(height_m(body) > 0.05, "on him or on the floor: {body}");
    }
    check_transports("uu_horseman", &report, &paper);
}

/// Another way to answer is the same run.
#[track_caller]
fn check_transports(recording: &str, inprocess: &Value, options: &[&str]) {
    for transport in ["gather", "cluster"] {
        let Some(again) = play(recording, &[options, &["--transport", transport]].concat()) else { return };
        assert_eq!(digest(&again), digest(inprocess), "{transport} {}", options.join(" "));
    }
}

#[test]
fn a_man_who_walks_knocks_over_a_stack_in_his_way() {
    for response in ["contacts", "paper"] {
        let of_response = ["--response", response];
        let inprocess = [&of_response[..], &["--transport", "inprocess"]].concat();
        let Some(report) = play("pose2sim_balance", &inprocess) else { return };
        assert_eq!(report["frames"], 100, "frames of the film in use");
        assert!(greatest_tilt_deg(&report) > 60.0, "{response}: a box falls over");
        for body in report["bodies"].as_array().expect("bodies").iter().filter(|body| body["fixed"] == false)
        {
            let touch_s = body["first_touch_s"].as_f64();
            assert!(touch_s.unwrap_or(f64::INFINITY) > 0.2, "{response}: starts clear of him: {body}");
            // Under contacts the one in the middle falls with the others before he is there.
            let falls_with_others = response == "contacts" && body["name"] == "stack_1";
            assert!(
                touch_s.is_some_and(|at_s| at_s < 2.0) || falls_with_others,
                "{response}: is in his way: {body}"
            );
        }
        check_transports("pose2sim_balance", &report, &of_response);
    }
}

#[test]
fn the_stack_stands_while_no_person_walks() {
    let Some(report) = play("pose2sim_balance", &["--transport", "inprocess", "--empty"]) else { return };
    assert!(greatest_tilt_deg(&report) < 2.0, "the stack stands");
    assert_eq!(number(&report, "/inside_samples"), 0.0);
}

#[test]
fn what_is_missing_is_told_in_one_line_before_anything_runs() {
    let nowhere = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    for recording in ["uu_horseman", "pose2sim_balance"] {
        let failed = demo(recording, &nowhere).assert().code(2);
        check_one_line(&failed.get_output().stderr, &[recording, "folder"]);
    }
}

#[test]
fn a_machine_without_ffmpeg_is_told_so_in_one_line() {
    let Some(datasets) = datasets::datasets() else { return };
    let bare = tempfile::tempdir().expect("a folder");
    for transport in ["inprocess", "cluster"] {
        let mut command = demo("uu_horseman", &datasets);
        let failed = command.args(["--transport", transport]).env("PATH", bare.path()).assert().failure();
        check_one_line(&failed.get_output().stderr, &["ffmpeg", "cam1"]);
    }
}

/// One line of complaint with these words; the note that a debug build is slow is no complaint.
#[track_caller]
fn check_one_line(stderr: &[u8], words: &[&str]) {
    let text = String::from_utf8_lossy(stderr);
    let complaints: Vec<&str> = text.lines().filter(|line| !line.contains("debug build")).collect();
    assert_eq!(complaints.len(), 1, "{text}");
    for word in words {
        assert!(complaints[0].contains(word), "{word:?} in {text}");
    }
}
