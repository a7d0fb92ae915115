//! Writes a sheet of pictures for every motion: cameras across, times down.
//!
//! `cargo run --release -p stage --example contact_sheet -- DIR [WIDTHxHEIGHT] [CAMERAS] [MOTION]`

use std::error::Error;

use image::{RgbImage, imageops};
use stage::{CameraStage, Motion, Prop, StageSettings, studio_rig};

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let folder = arguments.next().ok_or("expected a folder for the pictures")?;
    let size = arguments.next().unwrap_or_else(|| "480x360".to_owned());
    let (width, height) = size.split_once('x').ok_or("expected WIDTHxHEIGHT")?;
    let (width, height): (u32, u32) = (width.parse()?, height.parse()?);
    let cameras: usize = arguments.next().unwrap_or_else(|| "4".to_owned()).parse()?;
    let only: Option<Motion> = arguments.next().map(|name| name.parse()).transpose()?;
    std::fs::create_dir_all(&folder)?;
    let rig = studio_rig(cameras, (width, height))?;
    for motion in Motion::ALL.into_iter().filter(|motion| only.is_none_or(|only| only == *motion)) {
        let props = if motion == Motion::Lift { vec![Prop::Table, Prop::LiftedBox] } else { Vec::new() };
        let settings = StageSettings { motion, props, ..StageSettings::default() };
        let times_s: Vec<f64> =
            (0..6).map(|step| motion.loop_start_s() + motion.period_s() * f64::from(step) / 6.0).collect();
        let mut sheet = RgbImage::new(width * cameras as u32, height * times_s.len() as u32);
        for (index, camera) in rig.cameras().iter().enumerate() {
            let mut film = CameraStage::new(&settings, camera, index);
            let mut rgb = vec![0; film.frame_bytes()];
            for (row, time_s) in times_s.iter().enumerate() {
                film.render((time_s * settings.fps) as u64, &mut rgb);
                let picture =
                    RgbImage::from_raw(width, height, rgb.clone()).ok_or("a frame of another size")?;
                let (x, y) = (index as u32 * width, row as u32 * height);
                imageops::replace(&mut sheet, &picture, i64::from(x), i64::from(y));
            }
        }
        sheet.save(format!("{folder}/{motion}.png"))?;
    }
    Ok(())
}
