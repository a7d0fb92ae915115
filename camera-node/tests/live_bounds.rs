//! A live camera whose program always ends at once: pauses grow, and nothing is left of its programs. Alone in its
//! process, whose threads and descriptors it counts.

#[path = "live/rig.rs"]
mod rig;

use std::time::{Duration, Instant};

use camera_node::capture::Filming as _;
use film_time::{Pace, RunStart};
use rig::{LiveCamera, LiveRig, SOON};
use testkit::{Watch, timely};

/// Threads and open descriptors of this process.
fn held() -> (usize, usize) {
    let count = |folder| std::fs::read_dir(folder).expect("listed").count();
    (count("/proc/self/task"), count("/proc/self/fd"))
}

#[test]
fn a_program_that_always_ends_at_once_is_started_ever_more_rarely_and_leaves_nothing() {
    // What it leaves running holds its standard error.
    let rig = LiveRig::of([LiveCamera::new(&["sleep 100 > /dev/null & exit 3"])]);
    let watch = Watch::start();
    let (before, began) = (held(), Instant::now());
    rig.film.start(RunStart::of_this_process(Pace::live(1, 0.0))).expect("opens");
    // Pauses of at least 50, 100, 200, 400 and 800 ms lie between so many.
    rig.await_program(0, 6, SOON);
    assert!(began.elapsed() > Duration::from_millis(1550), "{:?}", began.elapsed());
    // The film thread is left, and waits longer than a second.
    await_held((before.0 + 1, before.1));
    assert!(!rig.programs(0).iter().any(|program| rig::runs(*program)));
    let stopped = Instant::now();
    drop(rig);
    let took = stopped.elapsed();
    await_held(before);
    timely!(watch, took < Duration::from_secs(1), "a stop ends the pause: it took {took:?}");
}

#[track_caller]
fn await_held(expected: (usize, usize)) {
    let deadline = Instant::now() + SOON;
    while held() != expected {
        assert!(Instant::now() < deadline, "{:?}, expected {expected:?}", held());
        std::thread::sleep(Duration::from_millis(5));
    }
}
