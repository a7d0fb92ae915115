//! A room's folder on film: a person who walks, in files as cameras leave them.

use std::fs::{self, File};
use std::io::{self, BufWriter, Write as _};
use std::path::Path;

use stage::{CameraStage, Motion, StageSettings};

/// Frames a second: a busy machine must not miss one.
pub const FPS: f64 = 10.0;
const SIZE: (u32, u32) = (80, 60);
const EMPTY_FRAMES: usize = 12;
/// Longer than a test takes on a slow machine.
const FILM_FRAMES: usize = 600 * FPS as usize;

/// Writes the room `deployed` with cameras that read film, as its file says how.
pub fn filmed_room(deployed: &Path, folder: &Path) -> io::Result<()> {
    let text = fs::read_to_string(deployed.join("room.cluster.toml"))?;
    let studio = |line: &&str| !line.starts_with("source = { kind = \"stage\"");
    let lines = text.lines().filter(studio).map(|line| match line.strip_prefix('#') {
        Some(film) if film.starts_with("source") || film.starts_with("background") => film,
        _ => line,
    });
    let text = lines.collect::<Vec<_>>().join("\n").replace("fps = 30\n", &format!("fps = {FPS:?}\n"));
    assert_eq!(text.matches("\nsource = { kind = \"video\"").count(), 4, "{text}");
    fs::write(folder.join("room.cluster.toml"), text)?;
    fs::copy(deployed.join("room.scene.toml"), folder.join("room.scene.toml"))?;
    let rig = stage::studio_rig(4, SIZE).map_err(io::Error::other)?;
    fs::write(folder.join("rig.toml"), rig.to_toml())?;
    ["film", "empty"].into_iter().try_for_each(|name| fs::create_dir(folder.join(name)))?;
    let settings = StageSettings { fps: FPS, motion: Motion::Walk, ..StageSettings::default() };
    for (index, camera) in rig.cameras().iter().enumerate() {
        let stage = CameraStage::new(&settings, camera, index);
        write_films(folder, camera.name(), &settings, stage)?;
    }
    Ok(())
}

/// Writes one camera's film, which repeats a lap, and its empty room.
fn write_films(
    folder: &Path,
    name: &str,
    settings: &StageSettings,
    mut stage: CameraStage,
) -> io::Result<()> {
    let begin = (settings.motion.loop_start_s() * FPS).ceil() as u64;
    let lap = (settings.motion.period_s() * FPS).round() as usize;
    let mut rgb = vec![0; stage.frame_bytes()];
    let mut film = Vec::with_capacity(lap);
    for frame in (begin..).take(lap) {
        stage.render(frame, &mut rgb);
        film.push(planes(&rgb));
    }
    write(&folder.join(format!("film/{name}.y4m")), film.iter().cycle().take(FILM_FRAMES))?;
    let mut empty = Vec::with_capacity(EMPTY_FRAMES);
    for frame in (0..).take(EMPTY_FRAMES) {
        stage.render_empty(frame, &mut rgb);
        empty.push(planes(&rgb));
    }
    write(&folder.join(format!("empty/{name}.y4m")), empty.iter())
}

fn write<'a>(path: &Path, frames: impl Iterator<Item = &'a Vec<u8>>) -> io::Result<()> {
    let mut file = BufWriter::new(File::create(path)?);
    writeln!(file, "YUV4MPEG2 W{} H{} F{FPS}:1 C444", SIZE.0, SIZE.1)?;
    for frame in frames {
        file.write_all(b"FRAME\n")?;
        file.write_all(frame)?;
    }
    file.flush()
}

/// Luma and both chromas of BT.601, each a whole plane.
fn planes(rgb: &[u8]) -> Vec<u8> {
    let plane = |[red, green, blue]: [i32; 3], base: i32| {
        rgb.chunks_exact(3).map(move |pixel| {
            let [r, g, b] = [pixel[0], pixel[1], pixel[2]].map(i32::from);
            (((red * r + green * g + blue * b + 128) >> 8) + base) as u8
        })
    };
    plane([66, 129, 25], 16).chain(plane([-38, -74, 112], 128)).chain(plane([112, -94, -18], 128)).collect()
}
