//! Each rule of the roster, without a node, a thread or a clock.

use std::task::Poll;
use std::time::Duration;

use film_time::{CameraReport, Stamps};

use super::*;

/// When nodes are heard of: after whatever they did.
const LATER_S: f64 = 100.0;

/// So many nodes of one camera each, all of them connected.
fn roster(nodes: u16) -> Roster {
    let mut roster =
        Roster::new((0..nodes).map(|index| RosterNode::new(index.to_string(), vec![index])).collect());
    (0..usize::from(nodes)).for_each(|node| roster.up(node));
    roster
}

pub(crate) fn frame(frame: u64) -> FilmEvent {
    let capture_time_s = frame as f64;
    FilmEvent::Frame(FrameReport { frame, capture_time_s, captured_unix_s: 0.0, cameras: vec![], skipped: 0 })
}

/// A node reports frames.
fn film(roster: &mut Roster, node: usize, frames: impl IntoIterator<Item = u64>) {
    frames.into_iter().for_each(|number| roster.film_event(node, frame(number), LATER_S));
}

#[test]
fn a_node_is_missing_until_it_is_up_and_again_when_it_is_lost() {
    let mut roster = Roster::new(vec![RosterNode::new("a (left)".into(), vec![0])]);
    let missing = |roster: &Roster| roster.missing().map(|missing| missing.to_string()).collect::<Vec<_>>();
    assert_eq!(missing(&roster), ["node a (left) does not answer"]);
    roster.down(0, "connection refused".into());
    assert_eq!(missing(&roster), ["node a (left): connection refused"]);
    roster.up(0);
    assert!(missing(&roster).is_empty());
    roster.down(0, "it closed the stream".into());
    assert_eq!(missing(&roster), ["node a (left): it closed the stream"]);
}

#[test]
fn a_frame_is_common_once_every_node_has_it() {
    let mut roster = roster(2);
    film(&mut roster, 0, [3, 4, 5]);
    assert_eq!(roster.newest_common(9), None);
    film(&mut roster, 1, [2, 4]);
    assert_eq!(roster.newest_common(9), Some(4));
    assert_eq!(roster.newest_common(3), None, "3 is of one node alone");
    assert_eq!(
        (roster.newest(), roster.reports(5), roster.reports(4).map(|all| all.len())),
        (Some(5), None, Some(2))
    );
}

#[test]
fn memory_of_frames_is_bounded() {
    let mut roster = roster(1);
    film(&mut roster, 0, 0..1000);
    assert_eq!((roster.newest_common(935), roster.newest_common(936)), (None, Some(936)));
}

#[test]
fn a_node_that_starts_over_has_none_of_its_old_frames() {
    let mut roster = roster(1);
    film(&mut roster, 0, [7, 8]);
    roster.film_event(0, FilmEvent::Ended, LATER_S);
    film(&mut roster, 0, [0]);
    assert_eq!((roster.newest_common(9), roster.film(9)), (Some(0), FilmState::Running));
    film(&mut roster, 0, [1]);
    roster.up(0);
    assert_eq!(roster.newest_common(9), None, "after another connection too");
    film(&mut roster, 0, [1]);
    roster.begin_run();
    assert_eq!(roster.newest_common(9), None, "and in another run");
}

#[test]
fn film_ends_with_the_shortest_and_no_earlier_than_its_last_frame() {
    let mut roster = roster(2);
    film(&mut roster, 0, 0..=4);
    film(&mut roster, 1, 0..=1);
    roster.film_event(0, FilmEvent::Ended, LATER_S);
    assert_eq!((roster.film(4), roster.film(5)), (FilmState::Running, FilmState::Ended));
    assert_eq!(roster.last_frame(), Some(LastFrame::Frame(4)));
    film(&mut roster, 1, 2..=30);
    assert_eq!(roster.last_frame(), Some(LastFrame::Frame(4)), "longer films change nothing");
}

#[test]
fn film_without_frames_has_ended_at_once() {
    let mut roster = roster(1);
    roster.film_event(0, FilmEvent::Ended, LATER_S);
    assert_eq!((roster.film(0), roster.last_frame()), (FilmState::Ended, Some(LastFrame::None)));
}

#[test]
fn film_that_fails_at_one_node_has_failed() {
    let mut roster = roster(2);
    film(&mut roster, 0, 0..=4);
    roster.film_event(1, FilmEvent::Failed("no disk".into()), LATER_S);
    assert_eq!(roster.film(0), FilmState::Failed("no disk".into()));
}

#[test]
fn cameras_may_film_a_little_ahead_and_not_past_the_end() {
    let mut roster = roster(2);
    assert_eq!(roster.credit(7, 4), 11);
    film(&mut roster, 0, 0..=5);
    roster.film_event(0, FilmEvent::Ended, LATER_S);
    assert_eq!((roster.credit(4, 4), roster.credit(500, 4)), (8, 9), "the other's ring keeps frame 5");
}

#[test]
fn a_lock_step_step_waits_for_its_frame_for_half_a_minute() {
    let (mut roster, mut wait) = (roster(1), FrameWait::default());
    film(&mut roster, 0, [0]);
    assert_eq!(wait.poll(&roster, 0, 0.0, 0.0), Poll::Ready(Ok(())));
    assert_eq!(wait.poll(&roster, 1, 0.0, 30.0), Poll::Pending);
    let late = WaitError::Late { frame: 1 };
    assert_eq!(wait.poll(&roster, 1, 0.0, 31.0), Poll::Ready(Err(late.clone())));
    assert_eq!(late.to_string(), "frame 1 did not come within 30 s");
    roster.film_event(0, FilmEvent::Ended, LATER_S);
    assert_eq!(wait.poll(&roster, 1, 0.0, 0.0), Poll::Ready(Ok(())), "nothing will come");
    roster.film_event(0, FilmEvent::Failed("no disk".into()), LATER_S);
    assert_eq!(wait.poll(&roster, 1, 0.0, 0.0), Poll::Ready(Err(WaitError::FilmFailed("no disk".into()))));
}

#[test]
fn a_lock_step_run_goes_on_without_a_lost_node_and_then_gives_up() {
    let (mut roster, mut wait) = (roster(1), FrameWait::default());
    roster.down(0, "gone".into());
    assert_eq!(wait.poll(&roster, 0, 0.0, 0.0), Poll::Pending, "it may come back");
    assert_eq!(wait.poll(&roster, 0, 0.0, 2.0), Poll::Pending);
    assert_eq!(wait.poll(&roster, 0, 0.0, 3.0), Poll::Ready(Ok(())), "without a hull");
    assert_eq!(wait.poll(&roster, 1, 3.0, 4.0), Poll::Ready(Ok(())), "no step waits again");
    let Poll::Ready(Err(error)) = wait.poll(&roster, 2, 4.0, 31.0) else { panic!("it gives up") };
    assert_eq!(error.to_string(), "node 0: gone");
    roster.up(0);
    assert_eq!(wait.poll(&roster, 2, 31.0, 31.0), Poll::Pending, "it is back");
    roster.down(0, "gone".into());
    assert_eq!(wait.poll(&roster, 2, 31.0, 32.0), Poll::Pending, "counted again");
}

#[test]
fn a_recorded_step_waits_for_the_very_frame() {
    let mut roster = roster(1);
    film(&mut roster, 0, [4, 6]);
    assert_eq!(roster.poll_recorded(6, 0.0, 0.0), Poll::Ready(Ok(())));
    assert_eq!(roster.poll_recorded(5, 0.0, 0.0), Poll::Pending);
    assert_eq!(roster.poll_recorded(5, 0.0, 31.0), Poll::Ready(Err(WaitError::Late { frame: 5 })));
}

#[test]
fn the_hull_is_unavailable_for_one_named_reason() {
    let step = |film_s, frame| StepFilm { film_s, fps: 10.0, frame, is_paced: true };
    let mut roster = roster(2);
    let why =
        |roster: &Roster, step| roster.hull_frame(step).map_err(|why| (why.to_string(), why.is_fault()));
    let reason = |text: &str, is_fault| Err((text.to_owned(), is_fault));
    assert_eq!(why(&roster, step(0.5, None)), reason("the first frame has not come yet", false));
    assert_eq!(why(&roster, step(1.5, None)), reason("no frame has come yet", true));
    assert_eq!(why(&roster, step(1.5, Some(14))), Ok(14));
    assert_eq!(why(&roster, step(2.5, Some(14))), reason("film has stopped at frame 14, 1.1 s ago", true));
    let held = StepFilm { is_paced: false, ..step(2.5, Some(14)) };
    assert_eq!(why(&roster, held), Ok(14), "in lock-step, and while the last frame is held");
    roster.film_event(1, FilmEvent::Failed("no disk".into()), LATER_S);
    assert_eq!(why(&roster, step(1.5, Some(14))), reason("film failed: no disk", true));
    roster.down(0, "gone".into());
    assert_eq!(why(&roster, step(1.5, Some(14))), reason("node 0: gone", true));
}

#[test]
fn a_live_run_begins_with_a_frame_that_every_node_has_or_once_none_will_come() {
    let patience = Duration::from_secs(20);
    let mut roster = roster(2);
    film(&mut roster, 0, [0, 1]);
    assert!(!roster.may_begin(9, 0.3, patience, 3), "the other node has none");
    assert!(roster.may_begin(9, 20.1, patience, 3), "it was waited for long enough");
    film(&mut roster, 1, [1]);
    assert!(roster.may_begin(9, 0.3, patience, 3));
    assert!(!roster.may_begin(0, 0.0, patience, 3), "the first frame that both have is not due yet");
    roster.begin_run();
    roster.film_event(1, FilmEvent::Failed("no disk".into()), LATER_S);
    assert!(roster.may_begin(0, 0.0, patience, 3), "film has failed");
    roster.begin_run();
    roster.film_event(0, FilmEvent::Ended, LATER_S);
    assert!(roster.may_begin(0, 0.0, patience, 3), "film has ended");
}

#[test]
fn a_live_run_begins_without_a_node_that_never_films_if_enough_cameras_are_left() {
    let patience = Duration::from_secs(20);
    let mut roster = roster(4);
    [0, 1, 2].into_iter().for_each(|node| film(&mut roster, node, 0..=5));
    assert!(!roster.may_begin(5, 2.0, patience, 3), "the last node has no frame");
    assert_eq!(roster.leave_out(5, LeaveOut::Late, 4, 0.0), [], "too few would be left");
    assert_eq!(roster.leave_out(5, LeaveOut::Late, 3, 0.0), [(3, false)]);
    assert_eq!(roster.why_left_out(3, 0.0), "node 3: no frame has come from it");
    assert!(roster.may_begin(5, 2.0, patience, 3));
    film(&mut roster, 3, [5]);
    assert_eq!(roster.leave_out(5, LeaveOut::Late, 3, 0.0), [(3, true)], "it films at last");
}

#[test]
fn a_live_run_does_not_begin_with_a_frame_of_too_few_cameras() {
    let patience = Duration::from_secs(20);
    let mut roster = Roster::new(vec![RosterNode::new("all".into(), vec![0, 1, 2, 3])]);
    roster.up(0);
    let FilmEvent::Frame(mut report) = frame(5) else { panic!("a frame") };
    let camera = |rig_index| CameraReport {
        rig_index,
        admitted: None,
        area: 0,
        silhouette_bytes: 0,
        segment_ms: 0.0,
        late_s: 0.0,
        stamps: Stamps::default(),
        pace: None,
    };
    report.cameras = vec![camera(0), camera(2)];
    roster.film_event(0, FilmEvent::Frame(report), LATER_S);
    assert_eq!(roster.filming(), [0, 2]);
    assert!(!roster.may_begin(9, 2.0, patience, 3) && roster.may_begin(9, 2.0, patience, 2));
    assert!(roster.may_begin(9, 20.1, patience, 3), "it was waited for long enough");
}

/// Whom a live step goes on without.
fn left_out(roster: &Roster) -> Vec<usize> {
    (0..roster.nodes().len()).filter(|&node| roster.nodes()[node].is_left_out()).collect()
}

#[test]
fn a_node_that_is_lost_is_left_out_and_taken_back_once_it_is_as_new_as_the_others() {
    let mut roster = roster(4);
    (0..4).for_each(|node| film(&mut roster, node, 0..=5));
    assert_eq!(roster.leave_out(5, LeaveOut::Late, 3, 0.0), []);
    roster.down(2, "it closed the stream".into());
    assert_eq!(roster.leave_out(5, LeaveOut::Late, 3, 0.0), [(2, false)]);
    assert_eq!(roster.leave_out(5, LeaveOut::Late, 3, 0.0), [], "once");
    assert_eq!(roster.newest_common(9), Some(5));
    assert_eq!(roster.reports(5).map(|reports| reports.len()), Some(3));
    [0, 1, 3].into_iter().for_each(|node| film(&mut roster, node, 6..=9));
    assert_eq!(roster.newest_common(9), Some(9), "the others go on");
    roster.up(2);
    film(&mut roster, 2, [8]);
    assert_eq!(roster.leave_out(9, LeaveOut::Late, 3, 0.0), [], "it is not as new");
    film(&mut roster, 2, [9]);
    assert_eq!(roster.leave_out(9, LeaveOut::Late, 3, 0.0), [(2, true)]);
    assert_eq!(roster.newest_common(9), Some(9));
}

#[test]
fn late_and_silent_nodes_are_left_out_and_a_frame_late_is_not() {
    let mut roster = roster(4);
    (0..4).for_each(|node| film(&mut roster, node, 0..=5));
    [0, 1, 2].into_iter().for_each(|node| film(&mut roster, node, [6]));
    assert_eq!(roster.leave_out(6, LeaveOut::Late, 3, 0.0), [], "a frame late");
    [0, 1, 2].into_iter().for_each(|node| film(&mut roster, node, [7]));
    assert_eq!(roster.leave_out(6, LeaveOut::Late, 3, 0.0), [], "no step wants the seventh yet");
    assert_eq!(roster.leave_out(7, LeaveOut::Missing, 3, 0.0), [], "lock-step waits for it");
    assert_eq!(roster.leave_out(7, LeaveOut::Late, 3, 0.0), [(3, false)]);
    film(&mut roster, 3, [6, 7]);
    assert_eq!(roster.leave_out(7, LeaveOut::Late, 3, 0.0), [(3, true)]);
    roster.record_late(&[0], 0.0, "no answer within 39 ms");
    assert_eq!(roster.leave_out(7, LeaveOut::Late, 3, 0.0), [(0, false)]);
    film(&mut roster, 0, [8]);
    assert_eq!(roster.leave_out(7, LeaveOut::Late, 3, 0.0), [(0, true)], "it was heard of");
}

#[test]
fn what_was_heard_of_a_node_before_it_failed_does_not_bring_it_back() {
    type Fails = fn(&mut Roster, usize, f64);
    let late: Fails = |roster, node, now_s| roster.record_late(&[node], now_s, "no answer within 39 ms");
    let refuses: Fails = |roster, node, now_s| roster.fault(node, now_s, "it does not know frame 5".into());
    for fails in [late, refuses] {
        let mut roster = roster(4);
        (0..4).for_each(|node| film(&mut roster, node, 0..=5));
        fails(&mut roster, 0, 2.0);
        // Its report waited while it was asked.
        roster.film_event(0, frame(6), 1.9);
        assert_eq!(roster.leave_out(5, LeaveOut::Late, 3, 2.0), [(0, false)]);
        roster.film_event(0, frame(7), 2.1);
        assert_eq!(roster.leave_out(5, LeaveOut::Late, 3, 2.1), [(0, true)]);
    }
}

#[test]
fn no_node_is_left_out_where_too_few_cameras_would_remain() {
    let mut roster = roster(4);
    (0..4).for_each(|node| film(&mut roster, node, 0..=5));
    roster.down(0, "gone".into());
    assert_eq!(roster.leave_out(5, LeaveOut::Late, 3, 0.0), [(0, false)]);
    roster.down(1, "gone too".into());
    assert_eq!(roster.leave_out(5, LeaveOut::Late, 3, 0.0), [(0, true)]);
    assert_eq!(left_out(&roster), [0; 0]);
    let step = StepFilm { film_s: 0.1, fps: 30.0, frame: Some(5), is_paced: true };
    let why = roster.hull_frame(step).expect_err("there is no hull").to_string();
    assert_eq!(why, "2 of 4 cameras, 3 needed: node 0: gone");
    roster.up(0);
    film(&mut roster, 0, [5]);
    assert_eq!(roster.leave_out(5, LeaveOut::Late, 3, 0.0), [(1, false)]);
    assert_eq!(roster.hull_frame(step), Ok(5));
}

#[test]
fn a_node_that_refuses_again_and_again_is_left_out_for_a_while() {
    let mut roster = roster(4);
    (0..4).for_each(|node| film(&mut roster, node, 0..=5));
    let faulty = |roster: &mut Roster, now_s: f64| {
        roster.fault(1, now_s, "too many questions wait".into());
        assert_eq!(roster.leave_out(5, LeaveOut::Late, 3, now_s), [(1, false)], "from the same step on");
        film(roster, 1, [5]);
    };
    for now_s in [0.0, 0.1] {
        faulty(&mut roster, now_s);
        assert_eq!(roster.leave_out(5, LeaveOut::Late, 3, now_s), [(1, true)], "it was heard of");
    }
    faulty(&mut roster, 0.2);
    assert_eq!(roster.leave_out(5, LeaveOut::Late, 3, 1.1), [], "still out, for a second");
    assert_eq!(
        roster.why_left_out(1, 1.1),
        "node 1: excluded for 0.1 s after repeated faults: too many questions wait"
    );
    assert_eq!(roster.leave_out(5, LeaveOut::Late, 3, 1.3), [(1, true)], "another chance");
    assert_eq!(roster.leave_out(5, LeaveOut::Missing, 3, 0.3), [], "lock-step waits");
}

#[test]
fn a_late_question_is_no_fault_of_the_node() {
    let mut roster = roster(1);
    film(&mut roster, 0, 0..=20);
    let excuses = |reason, frame| roster.excuses(0, reason, frame);
    assert!(excuses(RefusalReason::Gone, 10) && !excuses(RefusalReason::Gone, 18));
    assert!(excuses(RefusalReason::NotYet, 21) && !excuses(RefusalReason::NotYet, 20));
    assert!(!excuses(RefusalReason::Busy, 20));
}

#[test]
fn one_node_alone_does_not_move_the_newest_frame() {
    let mut roster = roster(3);
    assert_eq!(roster.newest_of_two(), None);
    film(&mut roster, 1, [1000]);
    assert_eq!(roster.newest_of_two(), None);
    film(&mut roster, 0, [5]);
    film(&mut roster, 2, [6]);
    assert_eq!(roster.newest_of_two(), Some(6));
}

#[test]
fn frames_of_the_future_are_late() {
    let mut roster = roster(4);
    (0..4).for_each(|node| film(&mut roster, node, 0..=5));
    (0..4).for_each(|node| film(&mut roster, node, [if node == 2 { 1006 } else { 6 }]));
    assert_eq!(roster.leave_out(7, LeaveOut::Late, 3, 0.0), [], "a frame late");
    (0..4).for_each(|node| film(&mut roster, node, [if node == 2 { 1007 } else { 7 }]));
    assert_eq!(roster.leave_out(7, LeaveOut::Late, 3, 0.0), [(2, false)]);
    assert_eq!(roster.newest_common(7), Some(7));
}

#[test]
fn film_without_end_that_ends_is_a_fault_of_its_node() {
    let node = |index: u16| RosterNode::new(index.to_string(), vec![index]).endless(true);
    let mut roster = Roster::new((0..4).map(node).collect());
    (0..4).for_each(|node| roster.up(node));
    (0..4).for_each(|node| film(&mut roster, node, 0..=5));
    roster.film_event(3, FilmEvent::Ended, LATER_S);
    assert_eq!(roster.last_frame(), None);
    assert_eq!(roster.leave_out(6, LeaveOut::Late, 3, 0.0), [(3, false)]);
    assert_eq!(roster.film(6), FilmState::Running);
    (0..4).for_each(|node| film(&mut roster, node, [6]));
    assert_eq!(roster.leave_out(6, LeaveOut::Late, 3, 0.0), [(3, true)], "it films on");
}

#[test]
fn one_node_alone_does_not_displace_us() {
    let mut roster = roster(3);
    roster.held(0, "held by another".into());
    assert_eq!(roster.displaced(), None);
    assert_eq!(roster.leave_out(0, LeaveOut::Late, 2, 0.0), [(0, false)]);
    assert!(roster.may_begin_without_missing(2));
    roster.held(2, "held by another".into());
    assert!(!roster.may_begin_without_missing(1));
    assert_eq!(roster.displaced().map(|held| held.to_string()).as_deref(), Some("node 0: held by another"));
}

#[test]
fn half_of_the_nodes_displace_no_run_and_keep_one_from_beginning() {
    for (nodes, held_before) in [(2_u16, 2), (4, 2)] {
        let mut roster = roster(nodes);
        (0..held_before - 1).for_each(|node| roster.held(node, "held by another".into()));
        assert_eq!(roster.displaced(), None, "{nodes} nodes, before the run");
        roster.held(held_before - 1, "held by another".into());
        assert!(roster.displaced().is_some(), "{nodes} nodes, before the run");
    }
    for nodes in [2_u16, 4] {
        let mut roster = roster(nodes);
        roster.begin_run();
        let half = usize::from(nodes) / 2;
        (0..half).for_each(|node| roster.held(node, "held by another".into()));
        assert_eq!(roster.displaced(), None, "{nodes} nodes: a cable between us and half of them may be out");
        roster.held(half, "held by another".into());
        assert!(roster.displaced().is_some(), "{nodes} nodes");
    }
    let mut alone = roster(1);
    alone.begin_run();
    alone.held(0, "held by another".into());
    assert!(alone.displaced().is_some());
}

#[test]
fn a_node_that_fails_before_the_first_frame_lets_no_run_begin_blind() {
    let mut roster = roster(5);
    let patience = Duration::from_secs(20);
    roster.film_event(4, FilmEvent::Failed("no camera".into()), LATER_S);
    assert!(!roster.may_begin(60, 2.0, patience, 3), "four others may still film");
    (0..4).for_each(|node| film(&mut roster, node, [59, 60]));
    assert_eq!(roster.leave_out(60, LeaveOut::Late, 3, 0.0), [(4, false)]);
    assert!(roster.may_begin(60, 2.0, patience, 3));
    (0..2).for_each(|node| roster.film_event(node, FilmEvent::Failed("no camera".into()), LATER_S));
    assert!(roster.may_begin(70, 3.0, patience, 3), "no hull will be");
}

#[test]
fn film_that_is_late_in_every_other_frame_is_left_out_for_longer() {
    let mut roster = roster(4);
    let mut changes = 0;
    for number in 0..300 {
        (0..3).for_each(|node| film(&mut roster, node, [number]));
        // It has all frames of the others, three at a time.
        if number % 3 == 2 {
            film(&mut roster, 3, number - 2..=number);
        }
        changes += roster.leave_out(number, LeaveOut::Late, 3, number as f64 * 0.1).len();
    }
    assert!((3..60).contains(&changes), "{changes} changes in 30 s");
}

#[test]
fn a_node_that_was_left_out_for_late_film_counts_for_the_latency_after_a_second() {
    let mut roster = roster(4);
    for number in 0..10 {
        (0..3).for_each(|node| film(&mut roster, node, [number]));
        roster.leave_out(number, LeaveOut::Late, 3, number as f64 * 0.1);
    }
    film(&mut roster, 3, [5]);
    assert!(roster.nodes()[3].is_left_out());
    assert_eq!(roster.take_arrivals(0.9).1, [true, true, true, false]);
    assert_eq!(roster.take_arrivals(1.5).1, [true; 4]);
    (0..3).for_each(|node| film(&mut roster, node, 10..200));
    assert_eq!(roster.take_arrivals(9.0).1, [true, true, true, false], "it films no more");
}
