//! What is asked, what is used again, and that nothing deep is missed.

use hull::pass::{NoResponse, Touch};
use nalgebra::{Point3, Quaternion, UnitQuaternion, Vector3};
use proptest::prelude::*;

use super::*;

/// A ball of the world: the hull of these tests.
#[derive(Clone, Copy, Debug)]
struct Ball {
    centre_m: [f64; 3],
    radius_m: f64,
}

impl Ball {
    /// How deep each sample of a body is in the ball, metres; negative outside.
    fn depths_m(&self, shape: &Shape, pose: &Pose) -> Vec<f64> {
        let world_from_body = pose.world_from_body();
        let away_m = |sample: &[f32; 3]| (world_from_body(*sample) - Point3::from(self.centre_m)).norm();
        shape.samples_body().iter().map(|sample| self.radius_m - away_m(sample)).collect()
    }

    /// What a pass would find, as far as it matters here.
    fn result(&self, shape: &Shape, pose: &Pose) -> BodyResult {
        let depths_m = self.depths_m(shape, pose);
        let inside = depths_m.iter().enumerate().filter(|(_, depth_m)| **depth_m > 0.0);
        let touch = |(sample, _)| Touch { sample: sample as u32, inside_count: 2, edge: None, exit_m: None };
        let touches: Vec<Touch> = inside.map(touch).collect();
        let deepest_m = depths_m.iter().copied().fold(0.0, f64::max);
        let response_m = if touches.is_empty() { Err(NoResponse::Clear) } else { Ok([deepest_m, 0.0, 0.0]) };
        BodyResult { left_inside: touches.len(), touches, response_m }
    }
}

/// Samples all over a box with these edges, metres.
fn box_shape(edges_m: [f64; 3]) -> Arc<Shape> {
    let at = |step: usize, edge_m: f64| ((step as f64 / 4.0 - 0.5) * edge_m) as f32;
    let samples = (0..125)
        .map(|index| [at(index / 25, edges_m[0]), at(index / 5 % 5, edges_m[1]), at(index % 5, edges_m[2])]);
    Arc::new(Shape::new(samples.collect()).expect("a shape"))
}

fn pose(position_m: [f64; 3], turn_rad: [f64; 3]) -> Pose {
    let turn: UnitQuaternion<f64> = UnitQuaternion::from_scaled_axis(Vector3::from(turn_rad));
    let Quaternion { coords } = turn.into_inner();
    Pose::new(position_m, [coords.x, coords.y, coords.z, coords.w]).expect("a pose")
}

fn at(x_m: f64) -> Pose {
    pose([x_m, 0.0, 0.0], [0.0; 3])
}

fn answers(bodies: usize, reuse_within_m: f64) -> Answers {
    Answers::new((0..bodies).map(|_| box_shape([0.2; 3])), Asks::EachFrame, reuse_within_m)
}

const NOWHERE: Ball = Ball { centre_m: [100.0, 0.0, 0.0], radius_m: 0.5 };

/// One step: asks `hull` what the answers lack. Returns what was asked and what the step takes.
fn step(
    answers: &mut Answers,
    frame: u64,
    hull: &Ball,
    present: &[Pose],
    ahead: &[Vec<Pose>],
) -> (Vec<Asked>, StepAnswers) {
    answers.begin_step(frame);
    let lacks = answers.missing(present).next().is_some();
    let ahead = if answers.may_foresee() { ahead } else { &[] };
    let asked = if lacks { answers.questions(present, ahead) } else { vec![] };
    let results: Vec<BodyResult> =
        asked.iter().map(|asked| hull.result(&answers.bodies[asked.body].shape, &asked.pose)).collect();
    answers.add(&asked, &results);
    let taken = answers.take(present).expect("nothing is missing once all was asked");
    (asked, taken)
}

#[test]
fn one_question_answers_all_steps_of_a_frame() {
    let mut answers = answers(2, 0.0);
    let moves: Vec<Vec<Pose>> = (0..4).map(|k| vec![at(1.0), at(0.1 * f64::from(k))]).collect();
    let (asked, taken) = step(&mut answers, 7, &NOWHERE, &moves[0], &moves[1..]);
    // The body that stands still is asked once, the one that moves once a step.
    let bodies: Vec<usize> = asked.iter().map(|asked| asked.body).collect();
    assert_eq!((bodies, taken.reused), (vec![0, 1, 1, 1, 1], 0));
    for poses in &moves[1..] {
        let (asked, taken) = step(&mut answers, 7, &NOWHERE, poses, &[]);
        assert_eq!((asked.len(), taken.reused), (0, 2));
    }
}

#[test]
fn another_frame_is_asked_anew() {
    let mut answers = answers(1, 0.05);
    assert_eq!(step(&mut answers, 7, &NOWHERE, &[at(0.0)], &[]).0.len(), 1);
    assert_eq!(step(&mut answers, 7, &NOWHERE, &[at(0.0)], &[]).0.len(), 0);
    assert_eq!(step(&mut answers, 8, &NOWHERE, &[at(0.0)], &[]).0.len(), 1);
}

#[test]
fn only_bodies_that_went_elsewhere_are_asked_again() {
    let mut answers = answers(3, 0.0);
    let first = [at(0.0), at(1.0), at(2.0)];
    step(&mut answers, 1, &NOWHERE, &first, &[vec![at(0.01), at(1.01), at(2.01)]]);
    let (asked, taken) = step(&mut answers, 1, &NOWHERE, &[at(0.01), at(1.02), at(2.01)], &[]);
    assert_eq!((asked.len(), asked[0].body, asked[0].pose, taken.reused), (1, 1, at(1.02), 2));
}

#[test]
fn while_somebody_is_touched_nothing_is_foreseen() {
    let mut answers = answers(2, 0.0);
    let hull = Ball { centre_m: [0.0; 3], radius_m: 0.5 };
    let ahead = [vec![at(0.41), at(3.1)]];
    assert_eq!(step(&mut answers, 1, &hull, &[at(0.4), at(3.0)], &ahead).0.len(), 4);
    // It was touched: the next step asks what it must, and the clear one is not asked for its answer.
    let (asked, taken) = step(&mut answers, 1, &hull, &[at(0.5), at(3.1)], &ahead);
    assert_eq!((asked.len(), asked[0].body, taken.reused), (1, 0, 1));
    assert!(!answers.may_foresee());
    let (asked, _) = step(&mut answers, 2, &hull, &[at(0.9), at(3.2)], &ahead);
    assert_eq!(asked.len(), 2);
    assert!(answers.may_foresee(), "nobody is touched any more");
}

#[test]
fn asking_each_step_keeps_nothing() {
    let mut answers = Answers::new([box_shape([0.2; 3])].into_iter(), Asks::EachStep, 0.05);
    for _ in 0..3 {
        let (asked, taken) = step(&mut answers, 1, &NOWHERE, &[at(0.0)], &[vec![at(0.1)]]);
        assert_eq!((asked.len(), taken.reused), (1, 0));
    }
}

#[test]
fn poses_within_the_tolerance_are_asked_once_and_touches_never_used_for_others() {
    let mut answers = answers(1, 0.05);
    let ahead: Vec<Vec<Pose>> = (1..=3).map(|k| vec![at(2.0 + 0.02 * f64::from(k))]).collect();
    let (asked, _) = step(&mut answers, 1, &NOWHERE, &[at(2.0)], &ahead);
    assert_eq!(asked.iter().map(|asked| asked.pose).collect::<Vec<_>>(), [at(2.0), at(2.06)]);
    let hull = Ball { centre_m: [0.0; 3], radius_m: 0.5 };
    assert_eq!(step(&mut answers, 2, &hull, &[at(0.5)], &[]).0.len(), 1);
    assert_eq!(step(&mut answers, 2, &hull, &[at(0.501)], &[]).0.len(), 1, "a touch is no clear answer");
    assert_eq!(step(&mut answers, 2, &hull, &[at(0.5)], &[]).0.len(), 0, "but holds for its own pose");
}

#[test]
fn a_question_and_what_is_kept_are_bounded() {
    let many = MAX_SAMPLES_AHEAD / 125 / 4;
    let mut answers = answers(many, 0.0);
    let poses = |k: usize| -> Vec<Pose> { (0..many).map(|body| at((body * 100 + k) as f64)).collect() };
    let ahead: Vec<Vec<Pose>> = (1..=MAX_STEPS_AHEAD).map(poses).collect();
    let (asked, _) = step(&mut answers, 1, &NOWHERE, &poses(0), &ahead);
    assert_eq!(asked.len(), many + MAX_SAMPLES_AHEAD / 125, "all that stand and four steps ahead");
    for k in 0..3 * MAX_KNOWN {
        step(&mut answers, 1, &NOWHERE, &poses(k), &[]);
    }
    assert!(answers.bodies.iter().all(|body| body.known.len() <= MAX_KNOWN));
}

/// A body's poses, a list a frame of four steps each: it flies and tumbles.
fn flights() -> impl Strategy<Value = Vec<Vec<Pose>>> {
    let number = |range: core::ops::Range<f64>| [range.clone(), range.clone(), range];
    let flight = (number(-0.6..0.6), number(-0.03..0.03), number(-3.0..3.0), number(-0.2..0.2), 0.0..1.0);
    flight.prop_map(|(start_m, step_m, turned_rad, turn_rad, turning)| {
        let pose_of = |k: usize| {
            let k = k as f64;
            let position_m = core::array::from_fn(|axis| start_m[axis] + k * step_m[axis]);
            pose(position_m, core::array::from_fn(|axis| turned_rad[axis] + turning * k * turn_rad[axis]))
        };
        (0..3).map(|frame| (0..4).map(|k| pose_of(4 * frame + k)).collect()).collect()
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn no_sample_moves_farther_than_the_bound(
        edges_m in [0.02..0.5f64, 0.02..0.5, 0.02..0.5],
        flight in flights(),
    ) {
        let shape = box_shape(edges_m);
        for (from, to) in flight.iter().flatten().zip(flight.iter().flatten().skip(1)) {
            let bound_m = moved_at_most_m(&shape, from, to);
            let (a, b) = (from.world_from_body(), to.world_from_body());
            let moved_m = |sample: &[f32; 3]| (a(*sample) - b(*sample)).norm();
            let most_m = shape.samples_body().iter().map(moved_m).fold(0.0, f64::max);
            // The box's corners are samples here, so the bound is also the least there is.
            prop_assert!((most_m - bound_m).abs() <= 1e-12, "{most_m} m, bound {bound_m} m");
        }
    }

    #[test]
    fn without_a_tolerance_every_step_takes_what_it_would_have_asked(
        flights in proptest::collection::vec(flights(), 1..4),
        wrong_at in 0usize..12,
    ) {
        check_flights(&flights, 0.0, wrong_at)?;
    }

    #[test]
    fn with_a_tolerance_no_sample_deeper_than_it_is_missed(
        flights in proptest::collection::vec(flights(), 1..4),
        reuse_within_m in 0.0..0.1f64,
        wrong_at in 0usize..12,
    ) {
        check_flights(&flights, reuse_within_m, wrong_at)?;
    }
}

/// Flies bodies through a hull that grows from frame to frame; at one step what was foreseen is wrong.
fn check_flights(
    flights: &[Vec<Vec<Pose>>],
    reuse_within_m: f64,
    wrong_at: usize,
) -> Result<(), TestCaseError> {
    let shape = box_shape([0.3, 0.1, 0.2]);
    let shapes = flights.iter().map(|_| Arc::clone(&shape));
    let mut answers = Answers::new(shapes, Asks::EachFrame, reuse_within_m);
    for frame in 0..3 {
        let hull = Ball { centre_m: [0.0; 3], radius_m: 0.2 + 0.1 * frame as f64 };
        let poses_at = |k: usize| flights.iter().map(|flight| flight[frame][k]).collect::<Vec<Pose>>();
        for k in 0..4 {
            let mut ahead: Vec<Vec<Pose>> = (k + 1..4).map(poses_at).collect();
            if let Some(wrong) = ahead.first_mut().filter(|_| 4 * frame + k == wrong_at) {
                wrong[0] = wrong[0].moved([0.02, 0.0, 0.0]);
            }
            let present = poses_at(k);
            let (_, taken) = step(&mut answers, frame as u64, &hull, &present, &ahead);
            for (result, pose) in taken.results.iter().zip(&present) {
                let exact = hull.result(&shape, pose);
                if *result != exact {
                    prop_assert!(result.touches.is_empty(), "a touch that is not there");
                    let deepest_m = hull.depths_m(&shape, pose).into_iter().fold(0.0, f64::max);
                    prop_assert!(deepest_m <= reuse_within_m + 1e-12, "missed at {deepest_m} m");
                }
            }
        }
    }
    Ok(())
}
