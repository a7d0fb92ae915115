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

/// Writes a film from beginning to end and again, each frame when it is due. While a file beside the film says so, it
/// writes garbage, or nothing.
const PROGRAM: &str = "
import os, sys, time
path, size, fps = sys.argv[1], int(sys.argv[2]), float(sys.argv[3])
film = open(path, 'rb').read()
frame = int(time.monotonic() * fps) + 1
while True:
    time.sleep(max(0, frame / fps - time.monotonic()))
    at = frame % (len(film) // size)
    frame += 1
    if os.path.exists(path + '.silent'):
        continue
    garbled = os.path.exists(path + '.garbled')
    sys.stdout.buffer.write(b'?' * 1000 if garbled else film[at * size:(at + 1) * size])
    sys.stdout.buffer.flush()
";

/// Writes films and a cluster file of so many cameras, two at each of these addresses.
pub fn filmed_room(folder: &Path, nodes: &[SocketAddr]) -> PathBuf {
    let rig = stage::studio_rig(2 * nodes.len(), SIZE).expect("a rig");
    fs::write(folder.join("rig.toml"), rig.to_toml()).expect("written");
    fs::write(folder.join("camera.py"), PROGRAM).expect("written");
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
        let command = format!(
            "\"env\", \"-u\", \"LD_PRELOAD\", \"python3\", \"camera.py\", \"{name}.film\", \"{size}\", \"{FPS:?}\""
        );
        write!(
            text,
            "[[camera]]\nname = {name:?}\nnode = \"{}\"\n\
             source = {{ kind = \"pipe\", live = true, raw = \"rgb\", command = [{command}] }}\n\
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
