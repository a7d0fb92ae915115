//! `hulltouch sample`: a room in files, to rehearse without a camera.

mod film;
mod plan;
mod target;
mod texts;

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use clap::Args;
use setup::cli::{Failure, Outcome, outln, parse_size};

use self::plan::{Plan, SampleNumbers};
use self::target::Target;
use crate::interrupt::interrupted;

/// The largest seed that TOML can hold.
const MAX_SEED: u64 = i64::MAX as u64;

/// Write a room in files: a rig, films of the synthetic studio, the empty room of each camera, a scene and a cluster file
/// of two nodes. Every command for film and rooms can be tried with it, without a camera.
#[derive(Debug, Args)]
#[command(after_help = "\
    Example:\n  \
    hulltouch sample rehearsal\n  \
    hulltouch demo --recording rehearsal/room.cluster.toml")]
pub struct SampleArguments {
    /// The folder to make. Its README.txt lists commands to try.
    #[arg(value_name = "DIR")]
    folder: PathBuf,
    /// How many cameras the room has, 2 to 64.
    #[arg(long, value_name = "N", default_value_t = 4)]
    cameras: usize,
    /// The size of their images, 64x64 to 4096x4096.
    #[arg(long, default_value = "640x480", value_name = "WxH", value_parser = parse_size)]
    size: (u32, u32),
    /// How long the films are, 0.1 to 600 seconds.
    #[arg(long, value_name = "S", default_value_t = 5.0)]
    seconds: f64,
    /// Frames per second, a whole number from 1 to 1000.
    #[arg(long, value_name = "F", default_value_t = 30)]
    fps: u32,
    /// Decides the noise of the films, and what a run leaves to chance.
    #[arg(long, value_name = "K", default_value_t = 1, value_parser = clap::value_parser!(u64).range(..=MAX_SEED))]
    seed: u64,
    /// Replace the sample that is in the folder. Other files in it stay.
    #[arg(long)]
    force: bool,
}

/// Writes the sample whole, or nothing.
pub fn run(arguments: &SampleArguments) -> Outcome {
    let plan = Plan::checked(SampleNumbers {
        cameras: arguments.cameras,
        size: arguments.size,
        seconds: arguments.seconds,
        fps: arguments.fps,
        seed: arguments.seed,
    })?;
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().map_err(Failure::run)?;
    let written: Outcome = runtime.block_on(async {
        // From here on a signal removes what is half-written.
        let interrupt = interrupted();
        let target = Target::open(&arguments.folder, arguments.force)?;
        let announced = outln!("films and empty rooms of {}: {} bytes", plan.title(), plan.film_bytes());
        let stop = Arc::new(AtomicBool::new(false));
        let stopped = Arc::clone(&stop);
        let mut writing = tokio::task::spawn_blocking(move || write(&plan, &target, &stopped));
        let written = tokio::select! {
            done = &mut writing => done.map_err(Failure::run)?,
            () = interrupt => {
                stop.store(true, Ordering::Relaxed);
                writing.await.map_err(Failure::run)?
            }
        };
        // The sample is written also where standard output is closed.
        written.and(announced)
    });
    written?;
    let folder = arguments.folder.display();
    outln!("{folder} is written. Commands to try: {folder}/README.txt")
}

/// Writes everything beside the target, then puts it in its place.
fn write(plan: &Plan, target: &Target, stop: &AtomicBool) -> Outcome {
    target.write(texts::RIG, &plan.rig.to_toml())?;
    target.write(texts::SCENE, &texts::scene())?;
    target.write(texts::CLUSTER, &texts::cluster(plan))?;
    target.write(texts::README, &texts::readme(plan))?;
    film::write_films(plan, target, stop)?;
    if stop.load(Ordering::Relaxed) {
        return Err(Failure::run(format_args!("interrupted: {} is not written", target.folder().display())));
    }
    target.install()
}
