//! Live cameras for tests: programs that write what a studio's cameras see, each frame when it is due.

use std::fmt::Write as _;
use std::fs;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};

use stage::{CameraStage, Motion, StageSettings};

/// Frames a second: a busy machine must not miss one.
pub const FPS: f64 = 10.0;
const SIZE: (u32, u32) = (96, 72);
/// Frames of the empty room.
const EMPTY_FRAMES: u64 = 12;

/// Writes films and a cluster file of so many cameras, two at each of these addresses.
pub fn filmed_room(folder: &Path, nodes: &[SocketAddr]) -> PathBuf {
    let rig = stage::studio_rig(2 * nodes.len(), SIZE).expect("a rig");
    fs::write(folder.join("rig.toml"), rig.to_toml()).expect("written");
    let settings = StageSettings { fps: FPS, motion: Motion::Sweep, ..StageSettings::default() };
    let begin = (settings.motion.loop_start_s() * FPS).ceil() as u64;
    let frames = (settings.motion.period_s() * FPS).round() as u64;
    let mut text = format!("rig = \"rig.toml\"\nscene = \"topple\"\nfps = {FPS:?}\n");
    for (index, camera) in rig.cameras().iter().enumerate() {
        let mut stage = CameraStage::new(&settings, camera, index);
        let size = stage.frame_bytes();
        let mut film = vec![0; size * frames as usize];
        (begin..).zip(film.chunks_exact_mut(size)).for_each(|(frame, rgb)| stage.render(frame, rgb));
        let mut empty = vec![0; size * EMPTY_FRAMES as usize];
        (0..).zip(empty.chunks_exact_mut(size)).for_each(|(frame, rgb)| stage.render_empty(frame, rgb));
        let name = camera.name();
        fs::write(film_of(folder, name), film).expect("written");
        fs::write(folder.join(format!("{name}.empty")), empty).expect("written");
        // A camera's own clock is right, whatever its node's is made to say.
        let words = [film_argument(folder, name), format!("bytes={size}"), format!("fps={FPS:?}")];
        let command = ["env", "-u", "LD_PRELOAD", testkit::CAMERA, &words[0], &words[1], &words[2]];
        write!(
            text,
            "[[camera]]\nname = {name:?}\nnode = \"{}\"\n\
             source = {{ kind = \"pipe\", live = true, raw = \"rgb\", command = {command:?} }}\n\
             background = {{ kind = \"pipe\", raw = \"rgb\", command = [\"cat\", \"{name}.empty\"] }}\n",
            nodes[index / 2]
        )
        .expect("a text");
    }
    let file = folder.join("room.cluster.toml");
    fs::write(&file, text).expect("written");
    file
}

/// The film that a camera's program writes.
pub fn film_of(folder: &Path, camera: &str) -> PathBuf {
    folder.join(format!("{camera}.film"))
}

/// The argument by which a camera's program is known: no other test has its folder.
pub fn film_argument(folder: &Path, camera: &str) -> String {
    format!("film={}", film_of(folder, camera).display())
}
