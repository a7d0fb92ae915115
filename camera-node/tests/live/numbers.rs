//! What numbers frames of real pipes get: jitter, capture times, counts, and what is wrong with them.

use std::time::{Duration, Instant};

use camera_node::capture::Filming as _;
use proto::{FilmState, Stamps};

use super::live;
use super::rig::{FPS, LiveCamera, LiveRig, SOON};

/// Films at the pace of the cluster, this many seconds after its own beginning, each frame up to 6 ms late; `say` is what
/// it does for each frame `$n`, which is captured at `$at`.
fn film(phase_s: f64, say: &str) -> String {
    format!(
        r#"h; exec perl -MTime::HiRes=time,sleep -e '$| = 1; use IO::Handle;
if (@ARGV) {{ open($side, ">", $ARGV[0]); $side->autoflush(1) }}
$zero = int(time) + 1 + {phase_s};
for ($n = 0; ; $n++) {{ $at = $zero + $n / {FPS}; $left = $at + rand(0.006) - time; sleep $left if $left > 0;
print "FRAME\n", "0" x 96; {say} }}' "$@""#
    )
}

/// Films until the ring has a frame this long after its first one; which share of numbers was missed in between.
fn missed(rig: &LiveRig, seconds: f64) -> f64 {
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
            return 1.0 - count as f64 / (last - first + 1) as f64;
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    panic!("{count} frames in time");
}

#[test]
fn pipes_whose_captures_lie_anywhere_miss_no_common_frame() {
    let cameras = (0..8).map(|camera| LiveCamera::new(&[&film(f64::from(camera) / 8.0 / FPS, "")]));
    let rig = LiveRig::of(cameras);
    let share = missed(&rig, 6.0);
    // One frame of 120 may fall to a busy machine.
    assert!(share < 0.01, "{share} missed");
    let frame = rig.ring.newest().expect("frames");
    for camera in &frame.cameras {
        let pace = camera.pace.expect("known by now");
        assert!((pace.frames_per_s / FPS - 1.0).abs() < 0.01, "{pace:?}");
        assert_eq!(camera.stamps, Stamps::Arrival);
    }
}

#[test]
fn times_and_counts_that_a_program_writes_number_its_frames() {
    let times =
        LiveCamera::new(&[&film(0.0, r#"printf $side "%.3f\n", 1e6 + $n * 50"#)]).with_word("{times}");
    let counts = LiveCamera::new(&[&film(0.0, r#"printf $side "%d\n", 700 + $n"#)]).with_word("{counts}");
    let rig = LiveRig::of([times, counts]);
    let share = missed(&rig, 3.0);
    assert!(share < 0.02, "{share} missed");
    // The newest may have gone on without a camera that a busy machine held up.
    let mut stamps: Vec<Stamps> = Vec::new();
    rig.until(SOON, "a frame of both", || {
        let newest = rig.ring.newest().expect("frames");
        stamps = newest.cameras.iter().map(|camera| camera.stamps).collect();
        stamps.len() == 2
    });
    assert_eq!(stamps, [Stamps::Capture, Stamps::Counter]);
}

/// A camera that says this of its frames is opened again, and the run goes on.
#[track_caller]
fn check_opened_again(say: &str) {
    let bad = film(0.0, say);
    let good = film(0.0, r#"printf $side "%.3f\n", $n * 50"#);
    let rig = LiveRig::of([LiveCamera::new(&[&bad, &good]).with_word("{times}")]);
    rig.film.start(live()).expect("opens");
    rig.await_program(0, 2, SOON);
    rig.await_frames_of_a_new_program(0);
    assert_eq!(rig.ring.state(), FilmState::Running);
}

#[test]
fn times_that_are_letters_open_a_camera_again() {
    check_opened_again(r#"print $side "soon\n""#);
}

#[test]
fn times_that_run_backwards_open_a_camera_again() {
    check_opened_again(r#"printf $side "%d\n", 100000 - $n * 50"#);
}

#[test]
fn times_that_jump_open_a_camera_again() {
    check_opened_again(r#"printf $side "%d\n", $n * 50 + ($n > 9 ? 1e7 : 0)"#);
}

#[test]
fn too_few_times_or_none_open_a_camera_again() {
    check_opened_again(r#"printf $side "%d\n", $n * 50 if $n < 5"#);
    check_opened_again("");
}

#[test]
fn too_many_times_open_a_camera_again() {
    check_opened_again(r#"printf $side "%d\n", $n * 1000 + $_ for 1 .. 40"#);
}

#[test]
fn a_camera_of_another_rate_is_opened_again() {
    let slow = film(0.0, "").replace(&format!("$n / {FPS}"), "$n / 18");
    let rig = LiveRig::of([LiveCamera::new(&[&slow, &film(0.0, "")])]);
    rig.film.start(live()).expect("opens");
    rig.await_program(0, 2, SOON);
    rig.await_frames_of_a_new_program(0);
    rig.check_numbers();
}

#[test]
fn capture_times_through_ffmpeg_number_frames() {
    let ffmpeg = r#"exec ffmpeg -y -v error -re -copyts -f lavfi -i testsrc=size=8x4:rate=20 \
-pix_fmt yuv444p -f yuv4mpegpipe - -flush_packets 1 -f mkvtimestamp_v2 "$1""#;
    let rig = LiveRig::of([LiveCamera::new(&[ffmpeg]).with_word("{times}")]);
    let share = missed(&rig, 3.0);
    assert!(share < 0.05, "{share} missed");
    assert_eq!(rig.programs(0).len(), 1, "it was never opened again");
}
