//! What the studio really looks like, from anywhere: for comparing pictures of the hull with.
//!
//! `truth RIG.toml FOLDER MOTION FPS FRAME` looks at one frame of the studio's film from every camera of a rig
//! file and writes, for each, `NAME.mask` (a byte a pixel: 255 where the person is) and `NAME.rgb` (three bytes a
//! pixel), row by row from the top left.

use std::error::Error;
use std::path::Path;

use hull::Rig;
use stage::{CameraStage, Motion, StageSettings};

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [rig, folder, motion, fps, frame] = &arguments[..] else {
        return Err("expected RIG.toml FOLDER MOTION FPS FRAME".into());
    };
    let rig = Rig::from_toml(&std::fs::read_to_string(rig)?)?;
    let motion: Motion = motion.parse()?;
    let settings = StageSettings { motion, fps: fps.parse()?, ..StageSettings::default() };
    let frame: u64 = frame.parse()?;
    for (index, camera) in rig.cameras().iter().enumerate() {
        let mut stage = CameraStage::new(&settings, camera, index);
        let mut rgb = vec![0; stage.frame_bytes()];
        stage.render(frame, &mut rgb);
        let file = |ending: &str| Path::new(folder).join(format!("{}.{ending}", camera.name()));
        std::fs::write(file("rgb"), rgb)?;
        std::fs::write(file("mask"), stage.mask(settings.time_s(frame)))?;
    }
    Ok(())
}
