//! `hulltouch sync check` from silhouettes, and from clusters that it films itself.

#![allow(clippy::disallowed_macros, reason = "a test says what it measured")]
#![allow(clippy::print_stdout, reason = "a test that is skipped says so, and figures are worth seeing")]

use std::fs;
use std::path::Path;
use std::process::Output;

use crate::datasets;
use hull::Rig;
use serde_json::Value;
use stage::{Motion, StageSettings, studio_rig, true_silhouette};

const FPS: f64 = 20.0;
const FRAMES: usize = 60;

fn sync_check(folder: &Path, arguments: &[&str]) -> Output {
    let mut command = testkit::command(env!("CARGO_BIN_EXE_hulltouch"));
    command.current_dir(folder).args(["sync", "check"]).args(arguments).output().expect("runs")
}

/// Refused in one line.
#[track_caller]
fn refused(folder: &Path, arguments: &[&str]) -> String {
    let output = sync_check(folder, arguments);
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!((output.status.code(), said.lines().count()), (Some(2), 1), "{arguments:?}: {said}");
    said
}

fn studio() -> Rig {
    studio_rig(4, (320, 240)).expect("a rig")
}

/// Writes the film of cameras that are so late, as numbered masks, and their rig.
fn write_masks(folder: &Path, motion: Motion, late_s: [f64; 4], frames: usize) {
    let rig = studio();
    fs::write(folder.join("rig.toml"), rig.to_toml()).expect("written");
    let settings = StageSettings { motion, ..StageSettings::default() };
    for (camera, late_s) in rig.cameras().iter().zip(late_s) {
        let masks = folder.join("masks").join(camera.name());
        fs::create_dir_all(&masks).expect("a folder");
        for frame in 0..frames {
            let time_s = 3.0 + frame as f64 / FPS - late_s;
            let silhouette = true_silhouette(&settings, camera, time_s).expect("a size");
            let pixel = |x: u32, y: u32| {
                image::Luma([if silhouette.contains(x as i32, y as i32) { 255 } else { 0u8 }])
            };
            let mask = image::GrayImage::from_fn(camera.width(), camera.height(), pixel);
            mask.save(masks.join(format!("{frame:04}.png"))).expect("written");
        }
    }
}

/// A cluster file whose cameras have this source.
fn write_cluster(folder: &Path, source: impl Fn(&str) -> String) {
    let mut text = "rig = \"rig.toml\" # ours\nscene = \"topple\"\nfps = 20\n".to_owned();
    for camera in studio().cameras() {
        let name = camera.name();
        text += &format!("[[camera]]\nname = {name:?} # on the wall\nsource = {}\n", source(name));
    }
    fs::write(folder.join("studio.cluster.toml"), text).expect("written");
}

const MASKS: [&str; 6] = ["--rig", "rig.toml", "--silhouettes", "masks", "--fps", "20"];

#[test]
fn a_late_camera_is_named_with_its_time() {
    let folder = tempfile::tempdir().expect("a folder");
    let late_s = [0.0, 0.0, 0.035, 0.0];
    write_masks(folder.path(), Motion::Walk, late_s, FRAMES);
    let output = sync_check(folder.path(), &[&MASKS[..], &["--json", "sync.json"]].concat());
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(output.status.success(), "{said}{}", String::from_utf8_lossy(&output.stderr));
    let verdict = said.lines().last().expect("a verdict");
    assert!(verdict.starts_with("cam_2 is 3") && verdict.ends_with(" ms late"), "{said}");
    let text = fs::read(folder.path().join("sync.json")).expect("figures");
    let figures: Value = serde_json::from_slice(&text).expect("JSON");
    assert_eq!((&figures["frames"], &figures["moved"]), (&Value::from(FRAMES), &Value::Null));
    for (camera, late_s) in figures["cameras"].as_array().expect("cameras").iter().zip(late_s) {
        let number = |key: &str| camera[key].as_f64().expect("a number");
        let off_ms = 1e3 * (number("late_s") - late_s);
        assert!(off_ms.abs() < 5.0 && number("uncertainty_s") < 0.004, "{off_ms} ms: {camera}");
    }
}

#[test]
fn film_that_says_nothing_of_time_is_refused_in_one_line() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path();
    write_masks(path, Motion::Idle, [0.0; 4], FRAMES);
    let said = refused(path, &MASKS);
    assert!(said.starts_with("hulltouch: masks: too little motion: outlines move by "), "{said}");
    for camera in studio().cameras() {
        let masks = path.join("masks").join(camera.name());
        for frame in 1..FRAMES {
            fs::remove_file(masks.join(format!("{frame:04}.png"))).expect("removed");
        }
    }
    let short = "found 0.00 s of film of all cameras, expected at least 0.5 s, and best ten";
    assert_eq!(refused(path, &MASKS), format!("hulltouch: masks: {short}\n"));
}

#[test]
fn wrong_input_is_refused_in_one_line_that_names_it() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path();
    fs::write(path.join("rig.toml"), studio().to_toml()).expect("written");
    assert!(refused(path, &MASKS).contains("masks"));
    assert!(refused(path, &["--recording", "none.mcap"]).contains("none.mcap"));
    assert!(refused(path, &["none.cluster.toml"]).contains("none.cluster.toml"));
    let mut fps = MASKS;
    fps[5] = "0";
    assert_eq!(refused(path, &fps), "hulltouch: --fps is 0, expected 0.01 to 1000\n");
}

#[test]
fn a_cluster_is_filmed_and_one_without_live_cameras_has_no_latency_to_write() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path();
    write_masks(path, Motion::Walk, [0.0, 0.03, 0.0, 0.0], FRAMES);
    write_cluster(path, |name| format!("{{ kind = \"masks\", path = \"masks/{name}\" }}"));
    let output = sync_check(path, &["studio.cluster.toml"]);
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(output.status.success(), "{said}{}", String::from_utf8_lossy(&output.stderr));
    let verdict = said.lines().last().expect("a verdict");
    assert!(verdict.starts_with("cam_1 is ") && verdict.ends_with(" ms late"), "{said}");
    let said = refused(path, &["studio.cluster.toml", "--write"]);
    assert!(said.contains("camera \"cam_0\", source: found film, expected live = true"), "{said}");
}

#[test]
fn latencies_of_live_cameras_are_written_and_comments_stay() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path();
    write_masks(path, Motion::Walk, [0.0, 0.0, 0.0, 0.04], FRAMES);
    let live = "{ kind = \"pipe\", live = true, latency_s = 0.06, command = [\"film\", \"NAME\"] }";
    write_cluster(path, |name| live.replace("NAME", name));
    let before = fs::read_to_string(path.join("studio.cluster.toml")).expect("a file");
    // No camera films green cloth, but neither is one filmed: the silhouettes are there.
    let before = before + "[segmentation]\nmethod = \"chroma\"\n";
    fs::write(path.join("studio.cluster.toml"), &before).expect("written");
    let output = sync_check(path, &["studio.cluster.toml", "--silhouettes", "masks", "--write"]);
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(output.status.success(), "{said}{}", String::from_utf8_lossy(&output.stderr));
    let changed = said.lines().last().expect("a line");
    let written = changed.strip_prefix("cam_3: latency_s 0.0600 becomes ").expect("only that one");
    let latency_s: f64 = written.parse().expect("a number");
    assert!((latency_s - 0.1).abs() < 0.005, "{said}");
    let after = fs::read_to_string(path.join("studio.cluster.toml")).expect("a file");
    let last = before.rfind("latency_s = 0.06").expect("one");
    let expected =
        format!("{}latency_s = {latency_s}{}", &before[..last], &before[last + "latency_s = 0.06".len()..]);
    assert_eq!(after, expected);
}

#[test]
fn real_film_shifted_by_whole_frames_is_found_within_half_a_frame() {
    let Some(datasets) = datasets::datasets() else { return };
    let datasets = datasets.canonicalize().expect("the folder is there");
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let shipped = fs::read_to_string(root.join("deploy/pose2sim_balance.cluster.toml")).expect("a file");
    let shipped = shipped.replace("./pose2sim_balance.scene.toml", "topple");
    let skipped = [3, 0, 7, 1];
    let mut parts = shipped.split("[[camera]]");
    let mut text = parts.next().expect("a head").to_owned();
    for (part, skipped) in parts.zip(skipped) {
        let shifted = format!("source = {{ start_frame = {skipped}, ");
        text += &format!("[[camera]]{}", part.replacen("source = { ", &shifted, 1));
    }
    let folder = tempfile::tempdir().expect("a folder");
    fs::write(folder.path().join("shifted.cluster.toml"), text).expect("written");
    let mut command = testkit::command(env!("CARGO_BIN_EXE_hulltouch"));
    command.current_dir(folder.path()).env("HULLTOUCH_DATASETS", datasets);
    let output = command.args(["sync", "check", "shifted.cluster.toml", "--json", "sync.json"]).output();
    let output = output.expect("runs");
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(output.status.success(), "{said}{}", String::from_utf8_lossy(&output.stderr));
    println!("{said}");
    let text = fs::read(folder.path().join("sync.json")).expect("figures");
    let figures: Value = serde_json::from_slice(&text).expect("JSON");
    let late_s: Vec<f64> = figures["cameras"]
        .as_array()
        .expect("cameras")
        .iter()
        .map(|camera| camera["late_s"].as_f64().expect("a number"))
        .collect();
    // Whose film begins later shows everything earlier.
    let truth_s = skipped.map(|frames| -f64::from(frames) / 60.0);
    let common_s = late_s.iter().zip(truth_s).map(|(late_s, truth_s)| late_s - truth_s).sum::<f64>() / 4.0;
    for (late_s, truth_s) in late_s.iter().zip(truth_s) {
        let off_frames = (late_s - truth_s - common_s) * 60.0;
        assert!(off_frames.abs() < 0.5, "{off_frames} frames: {said}");
    }
    assert_eq!(figures["moved"], Value::Null, "{said}");
}
