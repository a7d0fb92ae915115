//! What numbers frames of real pipes get: jitter, capture times, counts, and what is wrong with them.

use std::time::{Duration, Instant};

use camera_node::capture::Filming as _;
use film_time::{FilmState, Stamps};
use testkit::{Watch, timely};

use super::live;
use super::rig::{FPS, LiveCamera, LiveRig, SOON, film, film_at, film_with_numbers};

/// Films until the ring has a frame this long after its first one; which share of numbers was missed in between. `None` on
/// a machine that is too busy for so many frames.
fn missed(watch: &Watch, rig: &LiveRig, seconds: f64) -> Option<f64> {
    rig.film.start(live()).expect("opens");
    let deadline = Instant::now() + SOON;
    let mut first = None;
    let (mut last, mut count) = (0, 0u64);
    while Instant::now() < deadline {
        for frame in rig.ring.since(None).frames {
            if first.is_none_or(|_| frame.number > last) {
                first.get_or_insert(frame.number);
                (last, count) = (frame.number, count + 1);
            }
        }
        let first = first.unwrap_or(last);
        if (last - first) as f64 >= seconds * FPS {
            return Some(1.0 - count as f64 / (last - first + 1) as f64);
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    watch.judge(Err(format!("{count} frames in time")))
}

#[test]
fn pipes_whose_captures_lie_anywhere_miss_no_common_frame() {
    let watch = Watch::start();
    let cameras = (0..8).map(|camera| LiveCamera::new(&[&film(f64::from(camera) / 8.0 / FPS)]));
    let rig = LiveRig::of(cameras);
    let Some(share) = missed(&watch, &rig, 6.0) else { return };
    // One frame of 120 may come late.
    timely!(watch, share < 0.01, "{share} missed");
    let frame = rig.ring.newest().expect("frames");
    for camera in &frame.cameras {
        let pace = camera.pace.expect("known by now");
        assert!((pace.frames_per_s / FPS - 1.0).abs() < 0.01, "{pace:?}");
        assert_eq!(camera.stamps, Stamps::Arrival);
    }
}

#[test]
fn times_and_counts_that_a_program_writes_number_its_frames() {
    let watch = Watch::start();
    let folder = tempfile::tempdir().expect("folder");
    let times =
        film_with_numbers(folder.path(), "times", |frame| format!("{:.3}", 1e6 + frame as f64 * 50.0));
    let counts = film_with_numbers(folder.path(), "counts", |frame| (700 + frame).to_string());
    let times = LiveCamera::new(&[&times]).with_word("{times}");
    let counts = LiveCamera::new(&[&counts]).with_word("{counts}");
    let rig = LiveRig::of([times, counts]);
    let Some(share) = missed(&watch, &rig, 3.0) else { return };
    timely!(watch, share < 0.02, "{share} missed");
    // The newest may have gone on without a camera that a busy machine held up.
    let mut stamps: Vec<Stamps> = Vec::new();
    rig.until(SOON, "a frame of both", || {
        let newest = rig.ring.newest().expect("frames");
        stamps = newest.cameras.iter().map(|camera| camera.stamps).collect();
        stamps.len() == 2
    });
    assert_eq!(stamps, [Stamps::Capture, Stamps::Counter]);
}

/// A camera that writes these numbers is opened again, and the run goes on.
#[track_caller]
fn check_opened_again(lines: impl Fn(usize) -> String) {
    let folder = tempfile::tempdir().expect("folder");
    let bad = film_with_numbers(folder.path(), "bad", lines);
    let good = film_with_numbers(folder.path(), "good", |frame| (frame * 50).to_string());
    let rig = LiveRig::of([LiveCamera::new(&[&bad, &good]).with_word("{times}")]);
    rig.film.start(live()).expect("opens");
    rig.await_program(0, 2, SOON);
    rig.await_frames_of_a_new_program(0);
    assert_eq!(rig.ring.state(), FilmState::Running);
}

#[test]
fn times_that_are_letters_open_a_camera_again() {
    check_opened_again(|_| "soon".to_owned());
}

#[test]
fn times_that_run_backwards_open_a_camera_again() {
    check_opened_again(|frame| (2_000_000 - frame * 50).to_string());
}

#[test]
fn times_that_jump_open_a_camera_again() {
    check_opened_again(|frame| (frame * 50 + if frame > 9 { 10_000_000 } else { 0 }).to_string());
}

#[test]
fn too_few_times_or_none_open_a_camera_again() {
    check_opened_again(|frame| if frame < 5 { (frame * 50).to_string() } else { String::new() });
    check_opened_again(|_| String::new());
}

#[test]
fn too_many_times_open_a_camera_again() {
    check_opened_again(|frame| {
        (1..=40).map(|number| (frame * 1000 + number).to_string()).collect::<Vec<_>>().join(" ")
    });
}

#[test]
fn a_camera_of_another_rate_is_opened_again() {
    let rig = LiveRig::of([LiveCamera::new(&[&film_at(18.0, 0.0), &film(0.0)])]);
    rig.film.start(live()).expect("opens");
    rig.await_program(0, 2, SOON);
    rig.await_frames_of_a_new_program(0);
    rig.check_numbers();
}

#[test]
fn capture_times_through_ffmpeg_number_frames() {
    let watch = Watch::start();
    if !testkit::has_program("ffmpeg", "ffmpeg") {
        return;
    }
    let ffmpeg = r#"exec ffmpeg -y -v error -re -copyts -f lavfi -i testsrc=size=8x4:rate=20 \
-pix_fmt yuv444p -f yuv4mpegpipe - -flush_packets 1 -f mkvtimestamp_v2 "$1""#;
    let rig = LiveRig::of([LiveCamera::new(&[ffmpeg]).with_word("{times}")]);
    let Some(share) = missed(&watch, &rig, 3.0) else { return };
    timely!(watch, share < 0.05, "{share} missed");
    assert_eq!(rig.programs(0).len(), 1, "it was never opened again");
}
