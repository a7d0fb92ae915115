#[path = "../../../../tests/shared/corpora.rs"]
mod corpora;

use super::{cluster_file, dns_message};

const NAMED_NODES: &str = r#"name = "room-a"
rig = "rig.toml"
scene = "topple"
fps = 30
latency_s = "auto"
hold_s = 1.0
seed = 1
gravity = [0.0, 0.0, -9.81]
out_of_view = "abstain"
min_views = 2
min_cameras = 2
push_m_s = 1.5
normal_window = "auto"
max_depth_m = 1.0
[wire]
precision = "quantised"
max_connection_age_s = 3600
[segmentation]
high = 110
[[node]]
name = "left"
address = "left-pc.local:7001"
[[node]]
name = "right"
[[camera]]
name = "left"
node = "left"
source = { kind = "pipe", command = ["ffmpeg", "-i", "cam1.mp4", "-"], live = true, latency_s = 0.02 } # USB
background = { kind = "images", path = "empty/cam1.png" }
segmentation = { low = 20 }
ignore_mask = "masks/left.png"
stamps = "arrival"
[[camera]]
name = "right"
node = "right"
source = { kind = "pipe", command = ["grab", "--to", "{times}"], live = true, latency_s = 0.01 }
background = { kind = "video", path = "${ROOM}/right.y4m" }
"#;

const OLD_FORM: &str = r#"folder = "${STUDIO:-.}"
rig = "rig.toml"
scene = "my.scene.toml"
fps = 29.97
latency_s = 0.1
unused_cameras = ["right"]
normal_window = 3
[[camera]]
name = "left"
node = "unix:/run/left.sock"
[camera.source]
kind = "masks"
path = "masks/left.png"
start_frame = 3
frame_step = 2
"#;

const STUDIO: &str = r#"rig = "rig.toml"
scene = "topple"
fps = 30
camera = [
    { name = "left", source = { kind = "stage", motion = "punch" } },
    { name = "right", node = "127.0.0.1:7001", source = { kind = "images", path = "$${NO/%06d.png" },
      background = { kind = "images", path = "empty.png" } },
]
"#;

#[test]
fn cluster_files() {
    let wrong = [
        OLD_FORM.replace("frame_step = 2", "frame_step = 0"),
        OLD_FORM.replace("STUDIO", "ST UDIO"),
        NAMED_NODES.replace("name = \"room-a\"", "name = \"-room\""),
        NAMED_NODES.replace("fps = 30", "fps = nan"),
    ];
    let seeds = [NAMED_NODES, OLD_FORM, STUDIO].map(str::to_owned).into_iter().chain(wrong);
    let seeds: Vec<Vec<u8>> = seeds.map(String::into_bytes).collect();
    corpora::run("cluster_file", cluster_file, &seeds);
}

#[test]
fn dns_messages() {
    corpora::run("dns_message", dns_message, &crate::dns_sd::example_messages());
}
