//! `hulltouch query` against answers from elsewhere: the golden rigs, whose answers come from an
//! independent program, and a rig small enough to be worked by hand.

#![allow(clippy::disallowed_macros, reason = "a test says what it measured")]
#![allow(clippy::print_stdout, reason = "a test that is skipped says so, and figures are worth seeing")]

use std::fs;
use std::path::{Path, PathBuf};

use assert_cmd::Command;
use serde_json::Value;

/// The folder of golden rigs, or `None`, with the reason printed. A variable that is set and leads
/// nowhere fails the test.
fn golden() -> Option<PathBuf> {
    let (folder, named) = match std::env::var_os("HULLTOUCH_GOLDEN") {
        Some(folder) => (PathBuf::from(folder), true),
        None => (Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/golden"), false),
    };
    if folder.is_dir() {
        return Some(folder);
    }
    assert!(!named, "HULLTOUCH_GOLDEN leads to {}, which is no folder", folder.display());
    testkit::skip(format_args!("{} is no folder and HULLTOUCH_GOLDEN is not set", folder.display()));
    None
}

/// Runs `query` in a folder with `rig.toml`, `sil/` and `points.csv`; the file of answers.
fn query(folder: &Path, options: &[&str]) -> Vec<u8> {
    let out = tempfile::tempdir().expect("a folder");
    let json = out.path().join("answers.json");
    let mut command = Command::from_std(testkit::command(env!("CARGO_BIN_EXE_hulltouch")));
    command.arg("query").arg("--rig").arg(folder.join("rig.toml"));
    command.arg("--silhouettes").arg(folder.join("sil")).arg("--points").arg(folder.join("points.csv"));
    command.args(["--normal-window", "2", "--max-depth", "1.0"]).args(options);
    command.arg("--json").arg(&json).assert().success();
    fs::read(&json).expect("answers")
}

fn parsed(bytes: &[u8]) -> Value {
    serde_json::from_slice(bytes).expect("JSON")
}

fn vector(value: &Value) -> [f64; 3] {
    std::array::from_fn(|axis| value[axis].as_f64().expect("a number"))
}

fn gap(a: &Value, b: &Value) -> f64 {
    if a.is_null() || b.is_null() {
        return if a == b { 0.0 } else { f64::INFINITY };
    }
    let (a, b) = (vector(a), vector(b));
    (0..3).map(|axis| (a[axis] - b[axis]).powi(2)).sum::<f64>().sqrt()
}

/// What of the golden tolerances does not hold.
#[derive(Default)]
struct Misses {
    judged: usize,
    bodies: usize,
    wrong: Vec<String>,
}

impl Misses {
    fn point(&mut self, place: &str, found: &Value, expected: &Value) {
        if expected["near_a_tie"] == true {
            return;
        }
        self.judged += 1;
        for key in ["inside", "camera", "pixel"] {
            if found[key] != expected[key] {
                self.wrong.push(format!("{place} {key}: {} for {}", found[key], expected[key]));
                return;
            }
        }
        if expected["inside"] == false {
            return;
        }
        let number = |value: &Value| value["distance"].as_f64().expect("a number");
        let distance_m = (number(found) - number(expected)).abs();
        // Of unit vectors the chord is the angle, this near.
        let normal_deg = gap(&found["normal"], &expected["normal"]).to_degrees();
        if distance_m > 0.05e-3 || normal_deg > 0.05 {
            self.wrong.push(format!("{place}: distance off by {distance_m} m, normal by {normal_deg}°"));
        }
        let off_m = gap(&found["response"], &expected["response"]);
        if off_m > 0.5e-3 {
            self.wrong.push(format!("{place}: response off by {off_m} m"));
        }
    }
}

#[test]
fn the_five_golden_rigs_are_answered_within_their_tolerances() {
    let Some(golden) = golden() else { return };
    let mut misses = Misses::default();
    for rig in ["rig_101", "rig_102", "rig_103", "rig_104", "rig_106"] {
        let found = parsed(&query(&golden.join(rig), &[]));
        let expected = parsed(&fs::read(golden.join(rig).join("answers.json")).expect("golden answers"));
        let list = |value: &Value, key: &str| value[key].as_array().expect("a list").clone();
        let (points, golden_points) = (list(&found, "points"), list(&expected, "points"));
        assert_eq!(points.len(), golden_points.len());
        for (index, (found, expected)) in points.iter().zip(&golden_points).enumerate() {
            misses.point(&format!("{rig} point {index}"), found, expected);
        }
        let (bodies, golden_bodies) = (list(&found, "bodies"), list(&expected, "bodies"));
        assert_eq!(bodies.len(), golden_bodies.len());
        for (found, expected) in bodies.iter().zip(&golden_bodies) {
            assert_eq!((&found["body"], &found["inside"]), (&expected["body"], &expected["inside"]), "{rig}");
            let off_m = gap(&found["response"], &expected["response"]);
            assert!(off_m <= 2e-3, "{rig} {}: response off by {off_m} m", found["body"]);
        }
        misses.bodies += bodies.len();
    }
    println!("{} points and {} bodies judged", misses.judged, misses.bodies);
    assert_eq!(misses.bodies, 35);
    assert!(misses.judged > 500, "{}", misses.judged);
    assert!(misses.wrong.is_empty(), "{:#?}", misses.wrong);
}

#[test]
fn nodes_answer_the_golden_rigs_byte_for_byte_as_one_process_does() {
    let Some(golden) = golden() else { return };
    for rig in ["rig_101", "rig_103"] {
        let folder = golden.join(rig);
        assert!(query(&folder, &[]) == query(&folder, &["--cluster"]), "{rig}");
    }
}

/// Three cameras that look at the origin along −z (from 2 m), −x (from 2 m) and −y (from 3 m). 101 x 101
/// pixels, focal length 100, centre 50; each sees a square of 21 pixels, columns and rows 40 to 60.
fn write_hand_rig(folder: &Path) {
    // World to camera. front: diag(1, −1, −1), half a turn about x. side: rows −z, −y, −x, half a turn
    // about (1, 0, −1) / √2. top: rows x, z, −y, a quarter turn back about x.
    let half = std::f64::consts::PI;
    let slant = half / 2f64.sqrt();
    let cameras = [
        ("front", [half, 0.0, 0.0], 2.0),
        ("side", [slant, 0.0, -slant], 2.0),
        ("top", [-half / 2.0, 0.0, 0.0], 3.0),
    ];
    let mask = image::GrayImage::from_fn(101, 101, |column, row| {
        let within = (40..=60).contains(&column) && (40..=60).contains(&row);
        // 127 is background still, 128 foreground.
        image::Luma([if within { 128 } else { 127 }])
    });
    fs::create_dir(folder.join("sil")).expect("a folder");
    let mut rig = String::new();
    for (name, rotation, depth_m) in cameras {
        rig += &format!(
            "[{name}]\nname = \"{name}\"\nsize = [101, 101]\ndistortions = [0.0, 0.0, 0.0, 0.0]\n\
             matrix = [[100.0, 0.0, 50.0], [0.0, 100.0, 50.0], [0.0, 0.0, 1.0]]\n\
             rotation = {rotation:?}\ntranslation = [0.0, 0.0, {depth_m:?}]\n"
        );
        mask.save(folder.join(format!("sil/{name}.png"))).expect("written");
    }
    fs::write(folder.join("rig.toml"), rig).expect("written");
}

#[track_caller]
fn near(found: &Value, expected: [f64; 3]) {
    let off = gap(found, &Value::from(expected.to_vec()));
    assert!(off < 1e-6, "{found} for {expected:?}");
}

#[test]
fn a_rig_worked_by_hand_gives_the_numbers_worked_by_hand() {
    let folder = tempfile::tempdir().expect("a folder");
    write_hand_rig(folder.path());
    let points = "x,y,z,body\n0.16,0,0,beam\n0.5,0,0,far\n-0.16,0,0,beam\n";
    fs::write(folder.path().join("points.csv"), points).expect("written");
    let bytes = query(folder.path(), &[]);
    let answers = parsed(&bytes);

    // The first point is (0.16, 0, 2) for `front`: u = 50 + 100 · 0.16 / 2 = 58, v = 50. Column 61 is the
    // nearest background, 3 pixels away; its ray is d = (0.11, 0, 1), |d|² = 1.0121, and the distance
    // |a × d| / |d| = (2 · 0.11 − 0.16) / |d| = 0.06 / |d|. For `side` it is (0, 0, 1.84), 11 pixels from
    // any background: 1.84 · 0.11 / |d|. For `top` it is (0.16, 0, 3): u = 55.3, column 61 again,
    // (3 · 0.11 − 0.16) / |d| = 0.17 / |d|. So `front` wins.
    let d = 1.0121f64.sqrt();
    let first = &answers["points"][0];
    assert_eq!((&first["inside"], &first["camera"]), (&Value::from(true), &Value::from("front")));
    assert_eq!(first["pixel"], Value::from(vec![61, 50]));
    let distance_m = first["distance"].as_f64().expect("a number");
    assert!((distance_m - 0.06 / d).abs() < 1e-7, "{distance_m}");
    // Columns 61, 62 and 63 of the window are background: m points right. Jᵀ m ~ (1, 0, −0.11) in the
    // camera frame, and z of the camera is −z of the world.
    near(&first["normal"], [1.0 / d, 0.0, 0.11 / d]);
    // Along n, with s = t / |d|, the point is (0.16 + s, 0, 2 − 0.11 s) for `front` and leaves column 60 at
    // u = 60.5: 0.16 + s = 0.105 (2 − 0.11 s), s = 0.05 / 1.01155. The others still see it then.
    let s = 0.05 / 1.01155;
    near(&first["response"], [s, 0.0, 0.11 * s]);

    // (0.5, 0, 0) is at column 75 of `front`.
    assert_eq!(answers["points"][1], serde_json::json!({ "inside": false }));
    // The third is the first one's mirror image.
    let third = &answers["points"][2];
    assert_eq!((&third["camera"], &third["pixel"]), (&Value::from("front"), &Value::from(vec![39, 50])));
    near(&third["response"], [-s, 0.0, 0.11 * s]);

    // The mean of the beam's responses points along +z. For `side` its points are at depths 1.84 and
    // 2.16 and leave column 40 at u = 39.5, after 0.105 · 1.84 and 0.105 · 2.16 m; that is before `front`
    // (0.16 / (2 − t) = 0.105: 0.476 m) and `top` (0.105 · 3 m). The longest counts.
    let [beam, far] = [&answers["bodies"][0], &answers["bodies"][1]];
    assert_eq!((&beam["body"], &beam["inside"]), (&Value::from("beam"), &Value::from(2)));
    near(&beam["response"], [0.0, 0.0, 0.105 * 2.16]);
    assert_eq!(far, &serde_json::json!({ "body": "far", "inside": 0, "response": null }));

    assert!(bytes == query(folder.path(), &["--cluster"]), "the same bytes through nodes");
    fs::write(folder.path().join("points.csv"), "x,y,z\n0.16,0,0\n0.5,0,0\n-0.16,0,0\n").expect("written");
    let nameless = parsed(&query(folder.path(), &[]));
    assert_eq!(nameless["points"], answers["points"]);
    assert_eq!(nameless["bodies"], Value::Array(vec![]), "no names, no bodies");
}
