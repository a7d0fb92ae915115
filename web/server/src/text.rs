//! The feed's text messages: JSON objects with an `"op"`.

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use coordinator::live::{BodyLook, Outcome, RunStatus, SceneState};
use proto::convert::{SilhouetteEncoding, silhouette_data};
use proto::text::{MAX_MESSAGE_CHARS, clean};
use serde::Serialize;
use serde_json::{Value, json};
use sim::Scene;
use world_encodings::shape;

use crate::run_info::{RunInfo, Volume};
use hull::rule::OutOfView;
use hull::{Camera, Silhouette};

/// The version of the format.
pub const VERSION: u8 = 1;

/// The first message to a page. `volume` is the info's own, which takes a while to find.
pub fn hello(info: &RunInfo, volume: &Volume, session: &str, is_controller: bool) -> String {
    let rule = info.probes.rule();
    let cameras = info.rig.cameras().iter().zip(&info.ignored);
    let mut hello = json!({
        "op": "hello",
        "version": VERSION,
        "program": env!("CARGO_PKG_VERSION"),
        "session": session,
        "controller": is_controller,
        "fps": info.fps,
        "dt_s": info.step_s,
        "latency_s": info.latency_s,
        "cameras": cameras.map(|(known, ignored)| camera(known, ignored.as_ref())).collect::<Vec<_>>(),
        "rule": {
            "min_views": rule.min_views,
            "out_of_view": match rule.out_of_view {
                OutOfView::Outside => "outside",
                OutOfView::Abstain => "abstain",
            },
        },
        "up": info.up,
        "floor_m": info.floor_m,
        "volume": {"low": volume.low_m, "high": volume.high_m},
        "scenes": Scene::names().collect::<Vec<_>>(),
        "responses": [info.response.name(), "off"],
        "colour": info.has_colour,
        "replay": info.is_replay,
        "film_waits": info.film_waits,
        "insecure": info.insecure,
    });
    if let Some(length_s) = info.length_s {
        hello["length_s"] = length_s.into();
    }
    hello.to_string()
}

fn camera(camera: &Camera, ignored: Option<&Silhouette>) -> Value {
    let rows = |matrix: &nalgebra::Matrix3<f64>| -> Vec<[f64; 3]> {
        (0..3).map(|row| [0, 1, 2].map(|column| matrix[(row, column)])).collect()
    };
    let lens = camera.lens();
    let max_radius = lens.max_radius_squared().sqrt();
    let mut object = json!({
        "name": camera.name(),
        "width": camera.width(),
        "height": camera.height(),
        "matrix": rows(camera.intrinsics()),
        "distortions": lens.coefficients(),
        "rotation": rows(camera.rotation()),
        "translation": <[f64; 3]>::from(*camera.translation_m()),
        // Infinite becomes null: no radius is too large.
        "max_radius": max_radius,
    });
    if let (Some(mask), Value::Object(object)) = (ignored.filter(|mask| mask.area() > 0), &mut object) {
        let runs = silhouette_data(mask, SilhouetteEncoding::Runs);
        object.insert("ignored".into(), STANDARD.encode(runs).into());
    }
    object
}

/// Bodies and parameters.
pub fn scene(scene: &SceneState) -> String {
    let parameters = &scene.parameters;
    json!({
        "op": "scene",
        "generation": scene.generation,
        "version": scene.version,
        "scene": scene.scene,
        "parameters": {
            "answers_hull": parameters.answers_hull,
            "hull_restitution": parameters.hull_restitution,
            "hull_friction": parameters.hull_friction,
            "gravity_m_s2": parameters.gravity_m_s2,
        },
        "up": scene.up,
        "floor_m": scene.floor_m,
        "bodies": scene.bodies.iter().map(body).collect::<Vec<_>>(),
    })
    .to_string()
}

fn body(look: &BodyLook) -> Value {
    json!({
        "id": look.id,
        "name": look.name,
        "color": look.color,
        "fixed": look.fixed,
        "shape": shape::to_json(&look.solid),
    })
}

/// The figures of a page's own connection.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct FeedStatus {
    /// Bytes sent to this page a second, over the last quarter.
    pub bytes_per_s: f64,
    /// Frame sets sent to it.
    pub sent: u64,
    /// Frame sets that were left out because it could not take them.
    pub dropped: u64,
    /// The tier of its colours.
    pub tier: &'static str,
    /// Pages that are connected.
    pub pages: usize,
}

/// The figures of the run and of the page's own connection.
pub fn status(status: Option<&RunStatus>, is_paused: bool, feed: &FeedStatus) -> String {
    let mut object = status.map_or_else(|| json!({}), |status| json!(status));
    object["op"] = "status".into();
    object["paused"] = is_paused.into();
    object["blind"] = json!(status.and_then(|status| status.progress.hull_unavailable.as_ref()));
    object["feed"] = json!(feed);
    object.to_string()
}

/// The answer to a command that was applied.
pub fn done(id: u64, outcome: &Outcome) -> String {
    match outcome {
        Outcome::Applied => json!({"op": "done", "id": id}),
        Outcome::Spawned(body) => json!({"op": "done", "id": id, "body": body}),
        Outcome::Revocable(_) => json!({"op": "done", "id": id, "undo": true}),
    }
    .to_string()
}

/// The answer to a command that was refused, or to a message without a number.
pub fn refused(id: Option<u64>, why: &str) -> String {
    let why = clean(why, MAX_MESSAGE_CHARS);
    match id {
        Some(id) => json!({"op": "refused", "id": id, "why": why}),
        None => json!({"op": "refused", "why": why}),
    }
    .to_string()
}

/// The last message before the server closes on purpose.
pub fn bye(why: &str) -> String {
    json!({"op": "bye", "why": clean(why, MAX_MESSAGE_CHARS)}).to_string()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::run_info::tests::ring;
    use coordinator::live::PlaybackStatus;

    #[test]
    fn a_replay_says_how_long_it_is_and_how_it_is_played() {
        let told = |info: &RunInfo| -> Value {
            serde_json::from_str(&hello(info, &info.volume(), "a session", false)).expect("JSON")
        };
        let live = ring(2, OutOfView::Outside);
        assert!(told(&live).get("length_s").is_none(), "a live run has no length");
        let replay = RunInfo { is_replay: true, length_s: Some(2.5), ..live };
        assert_eq!(told(&replay)["length_s"], json!(2.5));
        let played = PlaybackStatus { speed: 0.5, loops: true, seeking_s: Some(1.25), has_ended: false };
        let expected = json!({"speed": 0.5, "loop": true, "seeking_s": 1.25, "ended": false});
        assert_eq!(json!(played), expected);
    }

    #[test]
    fn a_camera_says_which_pixels_it_ignores_as_the_runs_of_a_silhouette() {
        let mut info = ring(3, OutOfView::Outside);
        // Columns 3 to 5 of row 1, and nothing else.
        let mut mask = vec![0; 100 * 100];
        mask[103..106].fill(1);
        info.ignored[1] = Some(Silhouette::from_mask(100, 100, &mask).expect("a mask"));
        info.ignored[2] = Some(Silhouette::from_mask(100, 100, &[0; 100 * 100]).expect("a mask"));
        let text = hello(&info, &info.volume(), "a session", false);
        let told: Value = serde_json::from_str(&text).expect("JSON");
        let cameras = told["cameras"].as_array().expect("a list");
        assert!(cameras[0].get("ignored").is_none(), "no mask, no word of it");
        assert!(cameras[2].get("ignored").is_none(), "a mask without pixels is none");
        let runs = STANDARD.decode(cameras[1]["ignored"].as_str().expect("a text")).expect("base64");
        // A row without runs is a zero; row 1 has one run, after 3 pixels, of 2 more than one.
        assert_eq!(runs[..5], [0, 1, 3, 2, 0]);
        assert_eq!(runs.len(), 102);
        assert_eq!(cameras.len(), 3);
    }
}
