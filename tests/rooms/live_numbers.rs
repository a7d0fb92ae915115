//! Real nodes of live pipes that run freely: the coordinator cuts film where none of them captures.

use std::fs;
use std::path::{Path, PathBuf};

use crate::room::{Node, Running, coordinator, ended, program};
use testkit::{Watch, timely};

const CAMERAS: usize = 4;
const SECONDS: &str = "6";

/// Cameras whose frames come at 20 a second, each up to 6 ms late.
const FPS: u32 = 20;
const LATE: &str = "late_s=0.006";

fn cluster_file(folder: &Path) -> PathBuf {
    let rig = stage::studio_rig(CAMERAS, (96, 72)).expect("a rig");
    fs::write(folder.join("rig.toml"), rig.to_toml()).expect("written");
    let green = [149, 43, 21].map(|plane| [plane; 96 * 72]).concat();
    fs::write(folder.join("green.film"), green).expect("written");
    let (film, fps) = (format!("film={}/green.film", folder.display()), format!("fps={FPS}"));
    let header = format!("header=YUV4MPEG2 W96 H72 F{FPS}:1 C444");
    let mut text = format!("rig = \"rig.toml\"\nscene = \"topple\"\nfps = {FPS}\nlatency_s = 0.3\n");
    text += "segmentation = { method = \"chroma\" }\n";
    for (at, camera) in rig.cameras().iter().enumerate() {
        let name = camera.name();
        // They capture anywhere in a frame's period.
        let phase = format!("phase_s={}", at as f64 / CAMERAS as f64 / f64::from(FPS));
        let command = [testkit::CAMERA, &film, &fps, &header, &phase, LATE];
        text += &format!(
            "[[camera]]\nname = {name:?}\nnode = \"unix:{at}.sock\"\nstamps = \"arrival\"\nsource = {{ kind = \"pipe\", \
             live = true, command = {command:?} }}\n"
        );
    }
    let file = folder.join("room.cluster.toml");
    fs::write(&file, text).expect("written");
    file
}

#[test]
fn nodes_of_cameras_that_run_freely_share_their_frames() {
    let watch = Watch::start();
    let folder = tempfile::tempdir().expect("a folder");
    let (cluster, json) = (cluster_file(folder.path()), folder.path().join("out.json"));
    let node = |at: usize| Node::start(program(), &cluster, &[format!("cam_{at}")]);
    let nodes: Vec<Node> = (0..CAMERAS).map(node).collect();
    let run = Running::start(&mut coordinator(program(), &cluster, SECONDS, &json));
    let Some(figures) = watch.judge(ended(run, &json)) else { return };
    let missed = &figures["missed"];
    let (frames, slipped_s) = (missed["frames"].as_f64(), missed["slipped_s"].as_f64());
    // What the run had no time for is no fault of the numbers; one frame more may come too late.
    let most = slipped_s.expect("seconds") * 20.0 + 1.5;
    timely!(watch, frames.is_some_and(|frames| frames < most), "{missed}");
    timely!(watch, figures["frames"].as_u64().is_some_and(|frames| frames > 90), "{missed}");
    drop(nodes);
}
