//! Live cameras whose programs fail film again in the same run.

mod numbers;
mod rig;

use std::fs;
use std::time::{Duration, Instant};

use camera_node::capture::Filming as _;
use camera_node::frames::FrameId;
use film_time::{FilmState, Pace, RunStart};
use rig::{FPS, LiveCamera, LiveRig, SOON, film};
use rustix::process::{Pid, Signal, kill_process};
use testkit::{Watch, timely};

/// Films a little.
const BRIEFLY: &str = "h; for i in 1 2 3 4 5 6 7 8; do f; sleep 0.01; done";

fn live() -> RunStart {
    RunStart::of_this_process(Pace::live(1, 0.0))
}

/// A camera whose first program films briefly, then does this, and whose next one films well.
#[track_caller]
fn check_films_again(then: &str) {
    let first = format!("{BRIEFLY}; {then}");
    let rig = LiveRig::of([LiveCamera::new(&[&first, &film(0.0)])]);
    rig.film.start(live()).expect("opens");
    rig.await_program(0, 2, SOON);
    rig.await_frames_of_a_new_program(0);
    assert_eq!(rig.ring.state(), FilmState::Running);
    rig.check_numbers();
}

#[test]
fn a_camera_whose_program_is_killed_films_again_within_3_s() {
    let watch = Watch::start();
    let rig = LiveRig::of([LiveCamera::new(&[&film(0.0)]), LiveCamera::new(&[&film(0.0)])]);
    let pace = Pace::live(1, 0.0);
    rig.film.start(RunStart::of_this_process(pace)).expect("opens");
    rig.await_frame(5, SOON);
    let run = rig.ring.since(None).run;
    for camera in [0, 1, 0] {
        let program = rig.programs(camera).last().copied().expect("runs");
        kill_process(Pid::from_raw(program).expect("a number"), Signal::KILL).expect("killed");
        let killed = Instant::now();
        rig.await_frames_of_a_new_program(camera);
        let took = killed.elapsed();
        assert!(!rig::runs(program), "nothing is left of it");
        timely!(watch, took < Duration::from_secs(3), "camera {camera} films again after {took:?}");
    }
    let newest = rig.ring.newest().expect("frames");
    let film_s = pace.film_now_s();
    assert_eq!(rig.ring.since(Some(FrameId { run, number: newest.number })).run, run, "in the same run");
    rig.check_numbers();
    let behind_s = film_s - newest.number as f64 / FPS;
    timely!(watch, behind_s.abs() < 0.5, "frame {} after {film_s} s", newest.number);
}

#[test]
fn a_camera_that_ends_without_an_error_films_again() {
    check_films_again("exit 0");
}

#[test]
fn a_camera_that_falls_silent_films_again() {
    check_films_again("sleep 100");
}

#[test]
fn a_camera_that_writes_garbage_films_again() {
    check_films_again("while :; do echo hello; done");
}

#[test]
fn a_camera_that_stops_within_a_frame_films_again() {
    check_films_again("printf 'FRAME\\nab'; sleep 100");
}

#[test]
fn a_camera_that_has_another_size_for_a_while_films_again() {
    let small = "printf 'YUV4MPEG2 W4 H4 F30:1 C444\\n'; sleep 100";
    let rig = LiveRig::of([LiveCamera::new(&[BRIEFLY, small, &film(0.0)])]);
    rig.film.start(live()).expect("opens");
    rig.await_program(0, 3, SOON);
    rig.await_frames_of_a_new_program(0);
    rig.check_numbers();
}

#[test]
fn a_camera_that_is_not_there_at_first_films_once_it_is() {
    let none = "echo no such device >&2; exit 1";
    let rig = LiveRig::of([LiveCamera::new(&[none, none, none, &film(0.0)]), LiveCamera::new(&[&film(0.0)])]);
    rig.film.start(live()).expect("a run does not wait for it");
    rig.await_cameras(1);
    rig.await_frame(1, SOON);
    assert_eq!(rig.programs(0).len(), 4);
    rig.await_frames_of_a_new_program(0);
    rig.check_numbers();
}

#[test]
fn a_start_is_refused_for_what_no_waiting_mends_alone() {
    let rig = LiveRig::of([LiveCamera::new(&[&film(0.0)]), LiveCamera::of_program("./camera.sh")]);
    let error = rig.film.start(live()).expect_err("refused").to_string();
    assert!(error.contains("camera \"cam_1\": cannot start \"./camera.sh\": No such file"), "{error}");
    let path = rig.write_program(1, &film(0.0));
    // Systems refuse to start a program that is open for writing; some do not, and start it.
    let writer = fs::OpenOptions::new().append(true).open(path).expect("opened");
    rig.film.start(live()).expect("it may become free");
    std::thread::sleep(Duration::from_millis(200));
    drop(writer);
    rig.await_frame(1, SOON);
}

#[test]
fn in_lock_step_a_live_camera_that_fails_or_ends_is_not_opened_again() {
    for (script, expected) in [("h; f; exit 0", "Ended"), ("h; f; echo unplugged >&2; exit 3", "unplugged")] {
        let rig = LiveRig::of([LiveCamera::new(&[script, &film(0.0)])]);
        rig.film.start(RunStart::of_this_process(Pace::lock_step(1))).expect("opens");
        rig.film.credit(u64::MAX);
        let state = rig.await_end();
        assert!(format!("{state:?}").contains(expected), "{state:?}");
        assert_eq!(rig.programs(0).len(), 1);
    }
}

#[test]
fn a_stop_does_not_wait_for_a_first_frame() {
    let rig = LiveRig::of([LiveCamera::new(&["sleep 1000"])]);
    rig.film.start(live()).expect("opens");
    rig.await_program(0, 1, SOON);
    let program = rig.programs(0)[0];
    let stopped = Instant::now();
    drop(rig);
    // A stop that waited for the program would take as long as it sleeps.
    assert!(stopped.elapsed() < Duration::from_secs(100), "{:?}", stopped.elapsed());
    assert!(!rig::runs(program));
}
