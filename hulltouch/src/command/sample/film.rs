//! The films of a sample: frame by frame, some cameras at once.

use std::fs::File;
use std::io::{self, BufWriter, Write as _};
use std::num::NonZero;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::mpsc::{SyncSender, sync_channel};
use std::thread;

use hull::Camera;
use setup::cli::{Failure, Outcome, Progress};
use stage::CameraStage;

use super::plan::{EMPTY_FRAMES, FRAME_LINE, Plan};
use super::target::Target;
use super::texts::{EMPTY, FILMS};

/// Frames that may wait to be counted.
const UNCOUNTED_FRAMES: usize = 64;

/// Writes the film and the empty room of every camera: as many cameras at once as the machine has cores, each frame as it
/// is rendered. Ends early, without an error, once `stop` is true; sets it when a file cannot be written.
pub fn write_films(plan: &Plan, target: &Target, stop: &AtomicBool) -> Outcome {
    let cameras = plan.rig.cameras();
    let threads = thread::available_parallelism().map_or(1, NonZero::get).min(cameras.len());
    let next = AtomicUsize::new(0);
    let (written, all_written) = sync_channel(UNCOUNTED_FRAMES);
    let film = |written: SyncSender<()>| -> Outcome {
        let filming = Filming { plan, target, stop, written };
        loop {
            let index = next.fetch_add(1, Ordering::Relaxed);
            let Some(camera) = cameras.get(index) else { return Ok(()) };
            if let Err(failure) = filming.camera(index, camera) {
                stop.store(true, Ordering::Relaxed);
                return Err(failure);
            }
        }
    };
    let film = &film;
    thread::scope(|scope| {
        let mut workers = Vec::with_capacity(threads);
        for _ in 0..threads {
            let written = written.clone();
            workers.push(scope.spawn(move || film(written)));
        }
        drop(written);
        let mut progress = Progress::new("filming", plan.all_frames());
        for () in all_written {
            progress.step();
        }
        let ended: Vec<Outcome> = workers
            .into_iter()
            .map(|worker| worker.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)))
            .collect();
        ended.into_iter().collect()
    })
}

/// What a thread needs to film cameras.
struct Filming<'a> {
    plan: &'a Plan,
    target: &'a Target,
    stop: &'a AtomicBool,
    /// Gets a message for each frame that is written.
    written: SyncSender<()>,
}

impl Filming<'_> {
    fn camera(&self, index: usize, camera: &Camera) -> Outcome {
        let mut stage = CameraStage::new(&self.plan.stage(), camera, index);
        let name = camera.name();
        self.film(&format!("{FILMS}/{name}.y4m"), self.plan.frames, |frame, rgb| stage.render(frame, rgb))?;
        self.film(&format!("{EMPTY}/{name}.y4m"), EMPTY_FRAMES, |frame, rgb| stage.render_empty(frame, rgb))
    }

    /// Writes one film; its frames are drawn by `render`.
    fn film(&self, name: &str, frames: u64, mut render: impl FnMut(u64, &mut [u8])) -> Outcome {
        let failure = |error: io::Error| -> Failure { self.target.unwritable(name, &error) };
        let mut file = BufWriter::new(File::create(self.target.writing(name)).map_err(failure)?);
        file.write_all(self.plan.film_header().as_bytes()).map_err(failure)?;
        let format = self.plan.format;
        let mut rgb = vec![0_u8; 3 * format.width() as usize * format.height() as usize];
        let mut planes = Vec::new();
        for frame in 0..frames {
            if self.stop.load(Ordering::Relaxed) {
                return Ok(());
            }
            render(frame, &mut rgb);
            segment::from_rgb(&rgb, format, &mut planes);
            file.write_all(FRAME_LINE).map_err(failure)?;
            file.write_all(&planes).map_err(failure)?;
            // It is counted for the progress bar alone.
            let _ = self.written.send(());
        }
        file.flush().map_err(failure)
    }
}

#[cfg(test)]
mod tests {
    use super::super::plan::SampleNumbers;
    use super::*;

    fn plan() -> Plan {
        let numbers = SampleNumbers { cameras: 3, size: (80, 64), seconds: 0.2, fps: 10, seed: 1 };
        Plan::checked(numbers).expect("in range")
    }

    #[test]
    fn films_have_the_size_that_was_announced() {
        let (parent, plan) = (tempfile::tempdir().expect("a folder"), plan());
        let folder = parent.path().join("room");
        let target = Target::open(&folder, false).expect("it may");
        write_films(&plan, &target, &AtomicBool::new(false)).expect("written");
        let mut bytes = 0;
        for camera in plan.rig.cameras() {
            for (kind, frames) in [(FILMS, 2), (EMPTY, EMPTY_FRAMES)] {
                let film =
                    std::fs::read(target.writing(&format!("{kind}/{}.y4m", camera.name()))).expect("there");
                let header = plan.film_header();
                assert!(film.starts_with(header.as_bytes()));
                let frame = (film.len() - header.len()) as u64 / frames;
                assert_eq!(frame, 6 + 80 * 64 * 3 / 2);
                bytes += film.len() as u64;
            }
        }
        assert_eq!(bytes, plan.film_bytes());
    }

    #[test]
    fn a_film_that_cannot_be_written_is_named_as_it_would_be_and_a_stop_is_no_failure() {
        let (parent, plan) = (tempfile::tempdir().expect("a folder"), plan());
        let folder = parent.path().join("room");
        let target = Target::open(&folder, false).expect("it may");
        let stop = AtomicBool::new(true);
        assert_eq!(write_films(&plan, &target, &stop), Ok(()));
        std::fs::remove_dir_all(target.writing(FILMS)).expect("removed");
        let stop = AtomicBool::new(false);
        let refused = write_films(&plan, &target, &stop).expect_err("no folder").to_string();
        assert!(refused.starts_with(&format!("cannot write {}/films/cam_", folder.display())), "{refused}");
        assert!(stop.load(Ordering::Relaxed), "the other cameras end too");
    }
}
