#[path = "../../../../tests/shared/corpora.rs"]
mod corpora;

use super::{call, osc, page};
use crate::programs::world_service::tests::calls;

#[test]
fn pages() {
    let command = |keys: &str| format!("{{\"op\":\"command\",\"id\":7,\"command\":{keys}}}");
    let shape = |shape: &str| command(&format!("\"spawn\",\"position\":[0,2,1],\"shape\":{{{shape}}}"));
    let lines = [
        r#"{"op":"want","colour":"half","fps":10,"state_hz":0,"touches":false,"patches":true,"image_of":null}"#.into(),
        r#"{"op":"want","thumbnails_hz":0.5,"silhouettes":false,"image_of":"cam_1","fps":1e-300}"#.into(),
        r#"{"op":"shown","seq":4294967295}"#.into(),
        command(r#""step","steps":12"#),
        command(r#""choose","scene":"crowd""#),
        command(r#""remove","body":0"#),
        command(r#""push","body":0,"impulse":[0,1.5,0],"at":[0,1,0]"#),
        command(r#""grab","body":0,"grip":[0,0,0.1],"target":[1,1,1]"#),
        command(r#""release","body":0,"velocity":[0,3,0]"#),
        command(r#""set","answers_hull":false,"gravity":[0,0,0],"hull_friction":1,"hull_restitution":0"#),
        command(r#""take_background","seconds":2.5"#),
        command(
            r#""spawn","name":"b","shape":{"box":{"size":[0.2,0.3,0.4]}},"position":[0,2,1],"rotation_xyzw":[0,1,0,0],"mass":2,"velocity":[0,0,3],"color":[1,0,0.5]"#,
        ),
        shape(r#""capsule":{"radius":0.1,"length":0.3}"#),
        shape(r#""cone":{"radius":0.1,"height":0.3}"#),
        shape(r#""hull":{"points":[[0,0,0],[0.2,0,0],[0,0.2,0],[0,0,0.2]]}"#),
        "[[[[{}]]]]".into(),
    ];
    let all = lines.join("\n");
    let seeds: Vec<Vec<u8>> = lines.into_iter().chain([all]).map(String::into_bytes).collect();
    corpora::run("page", page, &seeds);
}

#[test]
fn calls_of_programs() {
    corpora::run("call", call, &calls());
}

#[test]
fn names_in_osc() {
    let long = format!("{}\n", "é".repeat(50)).repeat(40);
    let seeds = ["box_0\nbox_1\n", "", "a b#c*d,e/f?g[h]i{j}k\n\u{1f600}", &long]
        .map(|text| text.as_bytes().to_vec());
    corpora::run("osc", osc, &seeds);
}
