use std::collections::BTreeMap;

use film_time::{CameraReport, Cut, FrameReport};

use super::*;

const FPS: f64 = 30.0;
const JITTER_S: f64 = 0.006;
const CAMERAS: usize = 8;
const FRAMES: usize = 900;

/// Numbers from 0 up to 1 (splitmix64).
struct Random(u64);

impl Random {
    fn share(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut bits = self.0;
        bits = (bits ^ (bits >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        bits = (bits ^ (bits >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((bits ^ (bits >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }

    /// How late a frame comes, seconds: a normal distribution folded at zero.
    fn late_s(&mut self) -> f64 {
        let sum: f64 = (0..12).map(|_| self.share()).sum();
        (sum - 6.0).abs() * JITTER_S
    }
}

/// When frames of cameras with these phases (periods) arrive, seconds of film.
fn arrivals(phases: [f64; CAMERAS], seed: u64) -> Vec<[f64; CAMERAS]> {
    let mut random = Random(seed);
    let at = |frame: usize| phases.map(|phase| (frame as f64 + 3.0 + phase) / FPS + random.late_s());
    (0..FRAMES).map(at).collect()
}

/// The share of frames that not all cameras have, if each number is used once.
fn missed(numbers: &[[Option<u64>; CAMERAS]]) -> f64 {
    let mut have: BTreeMap<u64, usize> = BTreeMap::new();
    for camera in 0..CAMERAS {
        let mut next = 0;
        for number in numbers.iter().filter_map(|row| row[camera]) {
            if number >= next {
                *have.entry(number).or_default() += 1;
                next = number + 1;
            }
        }
    }
    1.0 - have.values().filter(|count| **count == CAMERAS).count() as f64 / FRAMES as f64
}

/// As it was: each frame by itself to the nearest.
fn rounded(phases: [f64; CAMERAS], seed: u64) -> f64 {
    let row = |row: [f64; CAMERAS]| row.map(|arrival_s| Some((arrival_s * FPS + 0.5).floor() as u64));
    missed(&arrivals(phases, seed).into_iter().map(row).collect::<Vec<_>>())
}

fn report(place: usize, pace: Option<CameraPace>, capture_time_s: f64) -> FrameReport {
    let camera = CameraReport {
        rig_index: place as u16,
        admitted: None,
        area: 0,
        silhouette_bytes: 0,
        segment_ms: 0.0,
        late_s: 0.0,
        stamps: Stamps::Arrival,
        pace,
    };
    FrameReport { frame: 0, capture_time_s, captured_unix_s: 0.0, cameras: vec![camera], skipped: 0 }
}

/// The share that is missed, and how far captures of one number lie apart in the end, periods.
fn counted(phases: [f64; CAMERAS], seed: u64) -> (f64, f64) {
    let mut cameras: Vec<LiveNumbers> =
        (0..CAMERAS).map(|_| LiveNumbers::new(Stamps::Arrival, FPS, 0.0)).collect();
    let (mut cut, mut phase) = (Cut::default(), None);
    let mut numbers = vec![];
    let mut apart: Vec<f64> = vec![];
    for (frame, row) in arrivals(phases, seed).into_iter().enumerate() {
        let mut given = [None; CAMERAS];
        apart.clear();
        for (place, arrival_s) in row.into_iter().enumerate() {
            let numbered = cameras[place].push(arrival_s, None, phase).expect("a pace");
            given[place] = numbered.number;
            cut.heard(&report(place, cameras[place].pace(), arrival_s));
            let number = numbered.number.expect("after the beginning") as f64;
            apart.push(numbered.capture_time_s * FPS - number);
        }
        numbers.push(given);
        if frame % 15 == 0 {
            phase = cut.phase();
        }
    }
    apart.sort_by(f64::total_cmp);
    (missed(&numbers), apart[CAMERAS - 1] - apart[0])
}

fn random_phases(seed: u64) -> [f64; CAMERAS] {
    let mut random = Random(seed + 1000);
    std::array::from_fn(|_| random.share())
}

#[test]
fn free_running_cameras_with_jitter_miss_almost_no_common_frame() {
    let even: [f64; CAMERAS] = std::array::from_fn(|camera| camera as f64 / CAMERAS as f64);
    let mut one_at_the_turn = [0.1; CAMERAS];
    one_at_the_turn[3] = 0.47;
    let cases = [even, one_at_the_turn].into_iter().chain((0..20).map(random_phases));
    let mut before = vec![];
    for (seed, phases) in (0..).zip(cases) {
        let (share, apart) = counted(phases, seed);
        assert!(share < 0.01, "{share} missed, phases {phases:?}");
        assert!(apart < 1.0, "captures of one number {apart} periods apart, phases {phases:?}");
        before.push(rounded(phases, seed));
    }
    before.sort_by(f64::total_cmp);
    assert!(before[before.len() / 2] > 0.15, "each by itself: {before:?}");
}

#[test]
fn captures_of_one_number_lie_together_after_the_cut() {
    // Around the turn of the count, and all within a fifth of a period.
    let phases = std::array::from_fn(|camera| 0.4 + 0.2 * camera as f64 / CAMERAS as f64);
    let (share, apart) = counted(phases, 5);
    assert!(share < 0.01 && apart < 0.25, "{share} missed, {apart} periods apart");
}

/// The numbers of frames that arrive at these times.
fn numbers(arrivals_s: impl IntoIterator<Item = f64>) -> Vec<Option<u64>> {
    let mut numbers = LiveNumbers::new(Stamps::Arrival, FPS, 0.0);
    arrivals_s.into_iter().map(|at_s| numbers.push(at_s, None, None).expect("a pace").number).collect()
}

#[test]
fn a_frame_that_comes_late_is_the_next_one_and_one_that_is_missed_is_noticed() {
    let late = |frame: u32| (f64::from(frame) + if frame == 100 { 0.9 } else { 0.0 }) / FPS;
    assert_eq!(numbers((0..200).map(late)), (0..200).map(Some).collect::<Vec<_>>());
    let gap = |frame: u32| f64::from(if frame < 100 { frame } else { frame + 1 }) / FPS;
    let found = numbers((0..200).map(gap));
    assert_eq!(found[99], Some(99));
    assert!(found[105..] == (106..201).map(Some).collect::<Vec<_>>()[..], "{found:?}");
}

#[test]
fn a_stall_changes_no_number_once_it_is_over() {
    let at_s = |frame: u32| f64::from(if (100..130).contains(&frame) { 130 } else { frame }) / FPS;
    let found = numbers((0..300).map(|frame| at_s(frame) + f64::from(frame) * 1e-7));
    assert_eq!(found[..100], (0..100).map(Some).collect::<Vec<_>>()[..]);
    assert_eq!(found[140..], (140..300).map(Some).collect::<Vec<_>>()[..]);
}

#[test]
fn a_clock_that_is_a_little_fast_is_followed_and_another_rate_is_refused() {
    let rated = |fps: f64, frames: u32| {
        let (mut numbers, mut random) = (LiveNumbers::new(Stamps::Arrival, FPS, 0.0), Random(3));
        let mut last = None;
        for frame in 0..frames {
            last = numbers.push(f64::from(frame) / fps + random.late_s(), None, None)?.number;
        }
        Ok((last, numbers.pace().map_or(0.0, |pace| pace.frames_per_s)))
    };
    let (last, found): (_, f64) = rated(FPS * 1000.0 / 1001.0, 6000).expect("near enough");
    assert!((29.9..30.05).contains(&found), "{found}");
    assert_eq!(last.map(|last: u64| last.abs_diff(6005) <= 1), Some(true), "{last:?}");
    for (fps, expected) in [(25.0, "films 25."), (29.5, "films 29."), (30.5, "films 30."), (15.0, "films 1")]
    {
        let error: NumberFault = rated(fps, 400).expect_err("another rate");
        let text = error.to_string();
        assert!(text.starts_with(expected) && text.contains("expected 30 as fps"), "{text}");
    }
}

#[test]
fn a_burst_at_the_beginning_is_no_rate() {
    let at_s = |frame: u32| f64::from(frame.max(150)) / FPS + f64::from(frame) * 1e-7;
    let found = numbers((0..400).map(at_s));
    assert_eq!(found[200..], (200..400).map(Some).collect::<Vec<_>>()[..]);
}

#[test]
fn capture_times_number_frames_whatever_the_way_to_us_does() {
    let (mut numbers, mut random) = (LiveNumbers::new(Stamps::Capture, FPS, 0.02), Random(9));
    for frame in 0..400u32 {
        let said_ms = 5e6 + f64::from(frame) * 1e3 / FPS;
        let late_s = if frame < 2 { 0.0 } else { 3.0 * random.late_s() };
        // Frames 50 to 52 are not filmed.
        if (50..53).contains(&frame) {
            continue;
        }
        let found = numbers.push(f64::from(frame) / FPS + 0.02 + late_s, Some(said_ms), None).expect("times");
        assert_eq!(found.number, Some(u64::from(frame)));
        assert!((found.capture_time_s - f64::from(frame) / FPS).abs() < 0.005);
    }
}

#[test]
fn capture_times_that_run_backwards_or_jump_are_refused_in_one_line() {
    let after = |next_ms: f64| {
        let mut numbers = LiveNumbers::new(Stamps::Capture, FPS, 0.0);
        for frame in 0..40 {
            numbers.push(f64::from(frame) / FPS, Some(f64::from(frame) * 1e3 / FPS), None).expect("times");
        }
        numbers.push(40.0 / FPS, Some(next_ms), None).map(|numbered| numbered.number)
    };
    assert_eq!(after(40.0 * 1e3 / FPS), Ok(Some(40)));
    let text = |next_ms| after(next_ms).expect_err("no time").to_string();
    assert_eq!(text(1300.0), "said 1300 after 1300 of the frame before, expected more");
    assert_eq!(text(7.0), "said 7 after 1300 of the frame before, expected more");
    assert_eq!(text(901_333.0), "said 901333 ms, a jump of 900.0 s past when the frame came");
}

#[test]
fn a_counter_is_anchored_once_and_a_gap_is_a_missed_frame() {
    let (mut numbers, mut random) = (LiveNumbers::new(Stamps::Counter, FPS, 0.0), Random(4));
    let mut push = |count: u32, frame: u32, phase| {
        let at_s = f64::from(frame) / FPS + random.late_s();
        numbers.push(at_s, Some(f64::from(count)), phase).expect("counts")
    };
    for frame in (10..200).filter(|frame| !(60..64).contains(frame)) {
        let phase = (frame > 30).then_some(0.0);
        let found = push(700 + frame, frame, phase);
        assert_eq!((found.number, found.anchored_again), (Some(u64::from(frame)), None));
    }
    // The trigger's box was restarted: it counts from somewhere else.
    let found: Vec<_> = (200..300).map(|frame| push(707 + frame, frame, Some(0.0))).collect();
    assert!(found[..4].iter().all(|found| found.number.is_none()), "{found:?}");
    assert_eq!(found[4].anchored_again, Some(-7));
    assert!(found[5..].iter().all(|found| found.anchored_again.is_none()));
    assert_eq!(found[99].number, Some(299));
}
