//! Cameras that look at the studio, several at once: looking takes a while.

use parking_lot::Mutex;
use setup::cli::{Outcome, Progress};

/// Cameras that look at once, at most: one of 7680x4320 takes 800 MB while it looks.
const MOST_CREWS: usize = 4;

/// What each of so many cameras sees, in their order, with a bar for who waits. It does not depend on who else looks.
pub fn all_see<T: Clone + Default + Send>(
    what: &'static str,
    cameras: usize,
    look: impl Fn(usize) -> Outcome<T> + Sync,
) -> Outcome<Vec<T>> {
    let progress = Mutex::new(Progress::new(what, cameras as u64));
    each(cameras, |index| {
        let seen = look(index);
        progress.lock().step();
        seen
    })
}

/// The same without a bar, for what takes no time.
pub fn each<T: Clone + Default + Send>(
    cameras: usize,
    look: impl Fn(usize) -> Outcome<T> + Sync,
) -> Outcome<Vec<T>> {
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let mut all: Vec<Outcome<T>> = vec![Ok(T::default()); cameras];
    // Each crew takes neighbours.
    let share = cameras.div_ceil(cores.min(MOST_CREWS)).max(1);
    std::thread::scope(|scope| {
        for (crew, seen) in all.chunks_mut(share).enumerate() {
            let look = &look;
            scope.spawn(move || {
                for (at, seen) in seen.iter_mut().enumerate() {
                    *seen = look(crew * share + at);
                }
            });
        }
    });
    all.into_iter().collect()
}
