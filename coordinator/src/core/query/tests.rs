//! Each rule of asking, over one camera group in memory: no node, no thread, no clock.

use std::f64::consts::FRAC_PI_2;

use film_time::{CameraReport, Stamps};
use hull::question::Answer;
use hull::silhouette::PixelRect;
use hull::view_set::Scratch;
use hull::{Camera, Silhouette, View, ViewSet};
use nalgebra::{Matrix3, Vector3};

use super::*;

const SIDE: u32 = 101;
/// What both cameras see of a person in the middle: a cube of about half a metre.
const SEEN: PixelRect = PixelRect { left: 42, top: 42, right: 59, bottom: 59 };

/// Two cameras at 3 m that look at the origin, along z and along x.
fn observers() -> Vec<Arc<Observer>> {
    let k = Matrix3::new(100.0, 0.0, 50.0, 0.0, 100.0, 50.0, 0.0, 0.0, 1.0);
    let turns = [Vector3::zeros(), Vector3::new(0.0, FRAC_PI_2, 0.0)];
    let camera = |turn| Camera::new("camera", (SIDE, SIDE), k, [0.0; 5], turn, Vector3::new(0.0, 0.0, 3.0));
    let observer = |(index, turn): (usize, Vector3<f64>)| {
        let camera = camera(turn).expect("a camera");
        Arc::new(Observer::new(camera, index as u16, ProbeSettings::default(), None))
    };
    turns.into_iter().enumerate().map(observer).collect()
}

fn views() -> ViewSet {
    let rows = (0..SIDE).map(|row| {
        let inside = (SEEN.top..SEEN.bottom).contains(&row);
        (0..SIDE).map(move |column| inside && (SEEN.left..SEEN.right).contains(&column))
    });
    let mask: Vec<u8> = rows.flatten().map(|seen| if seen { 255 } else { 0 }).collect();
    let silhouette = Silhouette::from_mask(SIDE, SIDE, &mask).expect("a silhouette");
    ViewSet::new(observers().into_iter().map(|observer| View::new(observer, &silhouette)).collect())
}

fn report(frame: u64, admitted: Option<PixelRect>) -> FrameReport {
    let camera = |rig_index| CameraReport {
        rig_index,
        admitted,
        area: 0,
        silhouette_bytes: 0,
        segment_ms: 0.0,
        late_s: 0.0,
        stamps: Stamps::Index,
        pace: None,
    };
    let cameras = vec![camera(0), camera(1)];
    FrameReport { frame, capture_time_s: 0.0, captured_unix_s: 0.0, cameras, skipped: 0 }
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
    let mut query = HullQuery::new(observers(), ProbeSettings::default(), 1, AskEvery::Frame);
    query.set_bodies(vec![QueryBody { shape, around: None, faces: None }], 0.0);
    query
}

/// One step; returns how many poses were asked about, and how many samples are inside.
fn step(query: &mut HullQuery, frame: u64, pose: Pose, ahead: &[Vec<Pose>]) -> (usize, usize) {
    query.begin_step(frame, &[&report(frame, Some(SEEN))], [pose].into_iter());
    let mut asked = 0;
    if query.must_ask() {
        let ahead = if query.may_foresee() { ahead } else { &[] };
        let pass = query.ask(ahead);
        let (mut scratch, mut answer, views) = (Scratch::default(), Answer::default(), views());
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
    query.begin_step(0, &[&report(0, None)], [at(0.0)].into_iter());
    assert!(!query.must_ask());
    assert_eq!(query.take().expect("known").results, [query.pass().clear_result()]);
}

#[test]
fn bounds_are_those_of_the_frame() {
    let mut query = query();
    query.begin_step(0, &[&report(0, None)], [at(0.0)].into_iter());
    assert!(!query.must_ask());
    query.begin_step(1, &[&report(1, Some(SEEN))], [at(0.0)].into_iter());
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
    query.begin_step(1, &[&report(1, Some(SEEN))], [at(0.0)].into_iter());
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
    query.begin_step(0, &[&report(0, Some(SEEN))], [at(0.0)].into_iter());
    query.ask(&[]);
    assert_eq!(query.take(), None, "the pass failed");
}
