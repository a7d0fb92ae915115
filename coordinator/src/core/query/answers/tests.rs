//! What is asked, what is used again, and that nothing deep is missed.

use hull::pass::InsideSample;
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

    /// What a pass would find, as far as it matters here: the body is moved along x until what is inside
    /// is out, but no farther than `MAX_DEPTH_M`.
    fn result(&self, shape: &Shape, pose: &Pose) -> BodyResult {
        let depths_m = self.depths_m(shape, pose);
        let inside = depths_m.iter().enumerate().filter(|(_, depth_m)| **depth_m > 0.0);
        let sample =
            |(sample, _)| InsideSample { sample: sample as u32, inside_count: 2, edge: None, exit_m: None };
        let inside: Vec<InsideSample> = inside.map(sample).collect();
        if inside.is_empty() {
            return clear();
        }
        let left_at = |response_m: f64| {
            let depths_m = self.depths_m(shape, &pose.moved([response_m, 0.0, 0.0]));
            inside.iter().filter(|inside| depths_m[inside.sample as usize] > 0.0).count()
        };
        let mut steps_m = (1..).map(|step| 1e-3 * f64::from(step));
        let response_m = steps_m.find(|&m| m > MAX_DEPTH_M || left_at(m) == 0).unwrap_or(MAX_DEPTH_M);
        let left_inside = left_at(response_m);
        BodyResult::Paper(PaperResult { inside, response_m: Ok([response_m, 0.0, 0.0]), left_inside })
    }
}

fn clear() -> BodyResult {
    BodyResult::Paper(PaperResult::default())
}

fn paper(result: &BodyResult) -> &PaperResult {
    result.paper().expect("the paper's response")
}

/// Bodies deeper than this are not freed by their response.
const MAX_DEPTH_M: f64 = 0.05;

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
    Answers::new((0..bodies).map(|_| box_shape([0.2; 3])), AskEvery::Frame, reuse_within_m)
}

const NOWHERE: Ball = Ball { centre_m: [100.0, 0.0, 0.0], radius_m: 0.5 };

/// One step: asks `hull` what the answers lack. Returns what was asked and what the step takes.
fn step(
    answers: &mut Answers,
    frame: u64,
    hull: &Ball,
    present: &[Pose],
    ahead: &[Vec<Pose>],
) -> (Vec<PoseQuery>, StepAnswers) {
    let may_meet = |_: &Shape, pose: &Pose| pose.position_m()[1] < 10.0;
    answers.begin_step(frame, present.iter().copied().map(PoseToAsk::plain), may_meet);
    let ahead = if answers.may_foresee() { ahead } else { &[] };
    let asked = if answers.lacks_any() { answers.questions(ahead, may_meet) } else { vec![] };
    let results: Vec<BodyResult> =
        asked.iter().map(|asked| hull.result(&answers.bodies[asked.body].shape, &asked.asked.pose)).collect();
    answers.add(&asked, &results);
    let taken = answers.take(&clear()).expect("nothing is missing once all was asked");
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
fn another_frame_is_asked_again() {
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
    assert_eq!((asked.len(), asked[0].body, asked[0].asked.pose, taken.reused), (1, 1, at(1.02), 2));
}

#[test]
fn bodies_beyond_the_bounds_are_clear_without_a_question() {
    let mut answers = answers(2, 0.0);
    let high = at(0.0).moved([0.0, 11.0, 0.0]);
    let hull = Ball { centre_m: [0.0, 11.0, 0.0], radius_m: 1.0 };
    let (asked, taken) = step(&mut answers, 1, &hull, &[at(0.0), high], &[vec![at(0.1), high]]);
    assert_eq!(asked.iter().map(|asked| asked.body).collect::<Vec<_>>(), [0, 0]);
    assert_eq!((taken.asked, taken.reused, &taken.results[1]), (1, 0, &clear()));
    // It has come within them since: only now it is asked about.
    let low = high.moved([0.0, -1.05, 0.0]);
    let (asked, taken) = step(&mut answers, 1, &hull, &[at(0.1), low], &[]);
    assert_eq!((asked.len(), asked[0].body, taken.asked, taken.reused), (1, 1, 2, 1));
    assert!(!taken.results[1].is_clear());
}

/// How many poses are asked at each of four steps of four frames about a body that moves by a millimetre
/// a step, and is inside the hull at the steps for which `is_touched` holds.
fn asked_of(is_touched: impl Fn(usize, usize) -> bool) -> Vec<[usize; 4]> {
    let mut answers = answers(1, 0.0);
    let pose_at = |frame: usize, k: usize| at(if is_touched(frame, k) { 0.0 } else { 5.0 } + 1e-3 * k as f64);
    let hull = Ball { centre_m: [0.0; 3], radius_m: 0.5 };
    let mut counts = |frame: usize, k: usize| {
        // The world foresees that no body is touched.
        let ahead: Vec<Vec<Pose>> = (k + 1..4).map(|later| vec![at(5.0 + 1e-3 * later as f64)]).collect();
        step(&mut answers, frame as u64, &hull, &[pose_at(frame, k)], &ahead).0.len()
    };
    (0..4).map(|frame| [0, 1, 2, 3].map(|k| counts(frame, k))).collect()
}

#[test]
fn steps_that_expect_touches_ask_about_present_poses_alone() {
    assert_eq!(asked_of(|_, _| false), [[4, 0, 0, 0]; 4], "no body is touched");
    // Pushed by every frame: once for the push, and once for the rest of the frame.
    assert_eq!(asked_of(|_, k| k == 0), [[4, 0, 0, 0], [1, 3, 0, 0], [1, 3, 0, 0], [1, 3, 0, 0]]);
    // At rest on a person: every step, as it is needed.
    assert_eq!(asked_of(|_, _| true), [[4, 1, 1, 1], [1; 4], [1; 4], [1; 4]]);
    // RecentTouches once: the next frame is cautious, the one after is not.
    let once = asked_of(|frame, k| (frame, k) == (1, 0));
    assert_eq!(once, [[4, 0, 0, 0], [4, 0, 0, 0], [1, 3, 0, 0], [4, 0, 0, 0]]);
}

#[test]
fn asking_each_step_keeps_nothing() {
    let mut answers = Answers::new([box_shape([0.2; 3])].into_iter(), AskEvery::Step, 0.05);
    for _ in 0..3 {
        let (asked, taken) = step(&mut answers, 1, &NOWHERE, &[at(0.0)], &[vec![at(0.1)]]);
        assert_eq!((asked.len(), taken.reused), (1, 0));
    }
}

#[test]
fn poses_within_the_tolerance_are_asked_once() {
    let mut answers = answers(1, 0.05);
    let ahead: Vec<Vec<Pose>> = (1..=3).map(|k| vec![at(2.0 + 0.02 * f64::from(k))]).collect();
    let (asked, _) = step(&mut answers, 1, &NOWHERE, &[at(2.0)], &ahead);
    assert_eq!(asked.iter().map(|asked| asked.asked.pose).collect::<Vec<_>>(), [at(2.0), at(2.06)]);
}

#[test]
fn a_body_that_its_response_freed_counts_as_clear_near_there() {
    let hull = Ball { centre_m: [0.0; 3], radius_m: 0.5 };
    let mut answers = answers(1, 0.05);
    let touch = |answers: &mut Answers, frame, x_m| step(answers, frame, &hull, &[at(x_m)], &[]);
    // Freed by a centimetre: then it counts as clear within the tolerance of both places.
    let (asked, taken) = touch(&mut answers, 1, 0.59);
    assert_eq!((asked.len(), paper(&taken.results[0]).left_inside), (1, 0));
    assert!(!taken.results[0].is_clear());
    for (x_m, asks) in [(0.6, 0), (0.58, 0), (0.638, 0), (0.65, 1), (0.545, 1)] {
        let (asked, taken) = touch(&mut answers, 1, x_m);
        assert_eq!(asked.len(), asks, "at {x_m} m");
        assert!(asks == 1 || taken.results[0] == clear(), "no touch is used for another pose");
    }
    // What its response did not free is asked again wherever it goes.
    assert!(paper(&touch(&mut answers, 2, 0.4).1.results[0]).left_inside > 0);
    assert_eq!(touch(&mut answers, 2, 0.401).0.len(), 1);
    // And so is what was not freed near enough.
    assert_eq!(paper(&touch(&mut answers, 3, 0.551).1.results[0]).left_inside, 0);
    assert_eq!(touch(&mut answers, 3, 0.602).0.len(), 1);
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
            let bound_m = shape.moved_at_most_m(from, to);
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
    let mut answers = Answers::new(shapes, AskEvery::Frame, reuse_within_m);
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
                    prop_assert!(result.is_clear(), "a touch that is not there");
                    let deepest_m = hull.depths_m(&shape, pose).into_iter().fold(0.0, f64::max);
                    prop_assert!(deepest_m <= reuse_within_m + 1e-12, "missed at {deepest_m} m");
                }
            }
        }
    }
    Ok(())
}
