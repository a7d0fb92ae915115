//! Physics steps that share a film frame share its answers: fewer questions, and with the paper's response the same run.
//! Planes of contacts hold for their frame by themselves.

use std::path::Path;

use serde_json::Value;

/// A lock-step run of a small studio with more arguments; returns its figures.
fn play(arguments: &[&str]) -> Value {
    let folder = tempfile::tempdir().expect("folder");
    let json = folder.path().join("out.json");
    let output = testkit::command(env!("CARGO_BIN_EXE_hulltouch"))
        .args([
            "demo",
            "--response",
            "paper",
            "--cameras",
            "4",
            "--size",
            "320x240",
            "--unpaced",
            "--headless",
            "--json",
        ])
        .arg(&json)
        .args(arguments)
        .output()
        .expect("runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_str(&std::fs::read_to_string(json).expect("written")).expect("JSON")
}

fn count(run: &Value, key: &str) -> u64 {
    run["questions"][key].as_u64().unwrap_or_else(|| panic!("{key} of {}", run["questions"]))
}

/// Plays the same twice, asking once a frame where that is enough and asking at every step, and holds the
/// runs against one another. Returns both.
fn both(arguments: &[&str]) -> (Value, Value) {
    let shared = play(arguments);
    let each = play(&[arguments, &["--ask", "step"]].concat());
    for key in ["trajectory_digest", "inside_samples", "contacts", "left_inside", "steps", "frames"] {
        assert_eq!(shared[key], each[key], "{key} of {arguments:?}");
    }
    assert_eq!(each["questions"]["reused_share"], 0.0, "{arguments:?}");
    for run in [&shared, &each] {
        assert!(count(run, "passes") + count(run, "steps_without") == run["steps"], "{}", run["questions"]);
    }
    assert!(count(&shared, "passes") <= count(&each, "passes"), "{arguments:?}");
    (shared, each)
}

#[test]
fn shared_answers_make_the_same_run_with_fewer_questions_over_every_transport() {
    for seed in ["1", "2"] {
        let mut digests = vec![];
        for transport in ["inprocess", "gather", "cluster"] {
            let (shared, each) = both(&["--seconds", "4", "--transport", transport, "--seed", seed]);
            let inside = shared["inside_samples"].as_u64().expect("a number");
            assert!(inside > 20, "bodies meet the person: {inside}");
            let (few, many) = (count(&shared, "passes"), count(&each, "passes"));
            assert!(4 * few < 3 * many, "{few} passes, {many} when asked at every step");
            digests.push(shared["trajectory_digest"].clone());
        }
        assert!(digests.iter().all(|digest| *digest == digests[0]), "{digests:?}");
    }
}

#[test]
fn any_film_rate_makes_the_same_run() {
    for fps in ["24", "25", "50", "59.94", "60", "120", "200"] {
        let (shared, _) =
            both(&["--seconds", "2", "--transport", "inprocess", "--scene", "crowd", "--fps", fps]);
        let reused = shared["questions"]["reused_share"].as_f64().expect("a share");
        // Film as fast as the steps leaves nothing to share.
        assert_eq!(reused > 0.0, !["120", "200"].contains(&fps), "{reused} reused at {fps} frames/s");
    }
}

/// A scene of boxes side by side on the lid that a person lifts, with a tolerance.
fn lift_within(folder: &Path, reuse_within_m: f64) -> String {
    let boxes = [-0.155, 0.0, 0.155].map(|x: f64| {
        format!(
            "[[bodies]]\nname = \"at_{x}\"\nshape.box.size = [0.12, 0.16, 0.18]\n\
             place.stack.foot = [{x:?}, 1.15, 0.48]\ndensity = 80.0\nfriction = 0.8\nrestitution = 0.0\n"
        )
    });
    let text = format!(
        "[stage]\nmotion = \"lift\"\nprops = [\"table\", \"box\"]\n\
         [hull]\nreuse_within_m = {reuse_within_m:?}\n{}",
        boxes.concat()
    );
    let path = folder.join(format!("lift_{reuse_within_m}.toml"));
    std::fs::write(&path, text).expect("written");
    path.to_string_lossy().into_owned()
}

#[test]
fn within_a_tolerance_bodies_that_rest_on_a_person_are_asked_about_once_a_frame() {
    let folder = tempfile::tempdir().expect("folder");
    let (exact, loose) = (lift_within(folder.path(), 0.0), lift_within(folder.path(), 0.005));
    let run = |scene: &str, transport| play(&["--seconds", "3", "--scene", scene, "--transport", transport]);
    let exact = run(&exact, "cluster");
    let loose = ["inprocess", "gather", "cluster"].map(|transport| run(&loose, transport));
    for other in &loose {
        assert_eq!(other["trajectory_digest"], loose[0]["trajectory_digest"], "{}", other["transport"]);
        // Round trips are the transport's own.
        for key in ["passes", "poses", "steps_without"] {
            assert_eq!(count(other, key), count(&loose[0], key), "{key} over {}", other["transport"]);
        }
    }
    let (few, frames) = (count(&loose[2], "passes"), loose[2]["frames"].as_u64().expect("a number"));
    assert_eq!(count(&exact, "passes"), 360, "boxes that lie on the lid are touched at every step");
    assert!(few < 2 * frames, "{few} passes over {frames} frames");
    let bytes = |run: &Value| run["bytes"]["per_step"].as_f64().expect("a number");
    assert!(bytes(&loose[2]) < 0.75 * bytes(&exact), "{} {}", loose[2]["bytes"], exact["bytes"]);
    // Between two frames a box falls by 3 mm at most, and it rises with the lid all the same.
    let heights_m = |run: &Value| -> Vec<f64> {
        let bodies = run["bodies"].as_array().expect("bodies");
        bodies.iter().map(|body| body["end"][1].as_f64().expect("metres")).collect()
    };
    for (loose_m, exact_m) in heights_m(&loose[2]).into_iter().zip(heights_m(&exact)) {
        assert!((loose_m - exact_m).abs() < 0.02, "{loose_m} m high, {exact_m} m when asked at every step");
    }
}
