//! A live camera whose program always ends at once: pauses grow, and nothing is left of its programs. Alone in its
//! process, whose threads and descriptors it counts.

#[path = "live/rig.rs"]
mod rig;

use std::time::{Duration, Instant};

use proto::{Pace, RunStart};
use rig::{LiveCamera, LiveRig, SOON};

/// Threads and open descriptors of this process.
fn held() -> (usize, usize) {
    let count = |folder| std::fs::read_dir(folder).expect("listed").count();
    (count("/proc/self/task"), count("/proc/self/fd"))
}

#[test]
fn a_program_that_always_ends_at_once_is_started_ever_more_rarely_and_leaves_nothing() {
    let rig = LiveRig::of([LiveCamera::new(&["sleep 100 & exit 3"])]);
    let before = held();
    rig.film.start(RunStart::of_this_process(Pace::live(1, 0.0))).expect("opens");
    let began = Instant::now();
    // Pauses of at least 50, 100, 200, 400 and 800 ms lie between so many.
    rig.await_program(0, 6, SOON);
    assert!(began.elapsed() > Duration::from_millis(1550), "{:?}", began.elapsed());
    std::thread::sleep(Duration::from_millis(200));
    let programs = rig.programs(0);
    assert_eq!(programs.len(), 6, "the next pause is longer than a second");
    assert!(!programs.iter().any(|program| rig::runs(*program)));
    let (threads, descriptors) = held();
    assert!(threads <= before.0 + 1 && descriptors <= before.1, "{:?}, was {before:?}", held());
    let stopped = Instant::now();
    drop(rig);
    assert!(stopped.elapsed() < Duration::from_millis(700), "a stop ends the pause: {:?}", stopped.elapsed());
    while held() != before {
        assert!(stopped.elapsed() < SOON, "{:?}, was {before:?}", held());
        std::thread::sleep(Duration::from_millis(5));
    }
}
