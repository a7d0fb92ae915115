//! Each rule of asking, over one camera group in memory: no node, no thread, no clock.

use hull::question::Answer;
use hull::silhouette::PixelRect;
use hull::view_set::Scratch;

use super::*;
use crate::core::room::{self, SEEN, observers};

fn report(frame: u64, admitted: Option<PixelRect>) -> FrameReport {
    room::report(frame, [0, 1], admitted)
}

fn at(x_m: f64) -> Pose {
    Pose::new([x_m, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]).expect("a pose")
}

fn query() -> HullQuery {
    query_of(0.05)
}

/// About one body of two samples, so far on either side of its centre.
fn query_of(reach_m: f32) -> HullQuery {
    let shape = Arc::new(Shape::new(vec![[reach_m, 0.0, 0.0], [-reach_m, 0.0, 0.0]]).expect("a shape"));
    let mut query = HullQuery::new(observers(2), ProbeSettings::default(), 1, AskEvery::Frame);
    query.set_bodies(vec![QueryBody { shape, around: None, faces: None }], 0.0);
    query
}

/// One step; returns how many poses were asked about, and how many samples are inside.
fn step(query: &mut HullQuery, frame: u64, pose: Pose, ahead: &[Vec<Pose>]) -> (usize, usize) {
    query.begin_step(frame, &[&report(frame, Some(SEEN))], [PoseToAsk::plain(pose)].into_iter());
    let mut asked = 0;
    if query.must_ask() {
        let ahead = if query.may_foresee() { ahead } else { &[] };
        let pass = query.ask(ahead);
        let (mut scratch, mut answer, views) =
            (Scratch::default(), Answer::default(), room::views(&observers(2)));
        while let Some(question) = pass.question() {
            views.answer(question, &mut scratch, &mut answer);
            pass.answer(0, &answer).expect("one answer a question");
        }
        query.answered();
        asked = query.poses_asked();
    }
    let answers = query.take().expect("nothing is missing once all was asked");
    (asked, answers.results[0].inside_count())
}

#[test]
fn a_body_in_the_hull_is_asked_about_and_has_its_samples_inside() {
    assert_eq!(step(&mut query(), 0, at(0.0), &[]), (1, 2));
}

#[test]
fn a_body_beyond_the_hulls_bounds_needs_no_question() {
    assert_eq!(step(&mut query(), 0, at(1.0), &[]), (0, 0));
}

#[test]
fn a_frame_without_a_person_needs_no_question() {
    let mut query = query();
    query.begin_step(0, &[&report(0, None)], [PoseToAsk::plain(at(0.0))].into_iter());
    assert!(!query.must_ask());
    assert_eq!(query.take().expect("known").results, [query.pass().clear_result()]);
}

#[test]
fn bounds_are_those_of_the_frame() {
    let mut query = query();
    query.begin_step(0, &[&report(0, None)], [PoseToAsk::plain(at(0.0))].into_iter());
    assert!(!query.must_ask());
    query.begin_step(1, &[&report(1, Some(SEEN))], [PoseToAsk::plain(at(0.0))].into_iter());
    assert!(query.must_ask(), "a person has come");
}

#[test]
fn a_pose_is_asked_about_once_a_frame() {
    let mut query = query();
    assert_eq!(step(&mut query, 0, at(0.0), &[]).0, 1);
    assert_eq!(step(&mut query, 0, at(0.0), &[]), (0, 2), "known");
    assert_eq!(step(&mut query, 0, at(0.001), &[]).0, 1, "elsewhere");
    assert_eq!(step(&mut query, 1, at(0.001), &[]).0, 1, "another frame");
}

#[test]
fn poses_of_later_steps_go_into_the_same_question() {
    // Around the hull: within its bounds, and no sample is inside.
    let mut query = query_of(0.4);
    let ahead = [vec![at(0.01)], vec![at(0.02)]];
    assert_eq!(step(&mut query, 0, at(0.0), &ahead), (3, 0));
    assert_eq!(step(&mut query, 0, at(0.01), &[]), (0, 0));
    assert_eq!(step(&mut query, 0, at(0.02), &[]), (0, 0));
}

#[test]
fn where_bodies_are_touched_nothing_is_foreseen() {
    let mut query = query();
    step(&mut query, 0, at(0.0), &[]);
    query.begin_step(1, &[&report(1, Some(SEEN))], [PoseToAsk::plain(at(0.0))].into_iter());
    assert!(!query.may_foresee());
}

#[test]
fn other_bodies_are_asked_about_again() {
    let mut query = query();
    step(&mut query, 0, at(0.0), &[]);
    let other = Arc::new(Shape::new(vec![[0.0; 3]]).expect("a shape"));
    query.set_bodies(vec![QueryBody { shape: other, around: None, faces: None }], 0.0);
    assert_eq!(step(&mut query, 0, at(0.0), &[]), (1, 1));
}

#[test]
fn while_an_answer_is_missing_there_are_none() {
    let mut query = query();
    query.begin_step(0, &[&report(0, Some(SEEN))], [PoseToAsk::plain(at(0.0))].into_iter());
    query.ask(&[]);
    assert_eq!(query.take(), None, "the pass failed");
}
