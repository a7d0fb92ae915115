//! Prints how long a frame takes: median, 90 % and most, per motion, on one core.
//!
//! `cargo run --release -p stage --example frame_time -- [WIDTHxHEIGHT] [FRAMES]`

use std::error::Error;
use std::io::Write as _;
use std::time::Instant;

use stage::{CameraStage, Motion, Prop, StageSettings, studio_rig};

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let size = arguments.next().unwrap_or_else(|| "640x480".to_owned());
    let (width, height) = size.split_once('x').ok_or("expected WIDTHxHEIGHT")?;
    let size = (width.parse()?, height.parse()?);
    let frames: u64 = arguments.next().unwrap_or_else(|| "150".to_owned()).parse()?;
    let rig = studio_rig(4, size)?;
    let mut out = std::io::stdout();
    for motion in Motion::ALL {
        let props = if motion == Motion::Lift { vec![Prop::Table, Prop::LiftedBox] } else { Vec::new() };
        let settings = StageSettings { motion, props, ..StageSettings::default() };
        let (mut times_ms, mut start_ms) = (Vec::new(), 0.0);
        for (index, camera) in rig.cameras().iter().enumerate() {
            let start = Instant::now();
            let mut film = CameraStage::new(&settings, camera, index);
            start_ms += start.elapsed().as_secs_f64() * 1e3 / 4.0;
            let mut rgb = vec![0; film.frame_bytes()];
            for frame in 0..frames {
                let start = Instant::now();
                film.render(2 * frame, &mut rgb);
                times_ms.push(start.elapsed().as_secs_f64() * 1e3);
            }
        }
        times_ms.sort_by(f64::total_cmp);
        let at = |share: f64| times_ms[((times_ms.len() - 1) as f64 * share) as usize];
        writeln!(
            out,
            "{motion:6} median {:.2} ms, 90 % {:.2} ms, most {:.2} ms; start {start_ms:.0} ms",
            at(0.5),
            at(0.9),
            at(1.0)
        )?;
    }
    Ok(())
}
