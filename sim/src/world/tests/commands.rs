//! Bodies that come, go, are pushed and held.

use super::*;
use crate::scene::BodyRequest;
use crate::world::{CommandError, Parameters};

fn request(text: &str) -> BodySpec {
    let request: BodyRequest = toml::from_str(text).expect("the keys of a request");
    request.check().expect("a body")
}

fn spawn(world: &mut World, text: &str) -> u32 {
    let prepared = world.prepare(request(text)).expect("it can be");
    world.spawn(prepared).expect("it comes")
}

fn steps(world: &mut World, count: usize) {
    for _ in 0..count {
        let responses = untouched(world);
        world.step(&responses).expect("a step");
    }
}

fn position(world: &World, id: u32) -> Vector3<f64> {
    world.body(id).expect("it is there").pose.position_m().into()
}

const BALL: &str = "shape.ball.radius = 0.1\nposition = [1, 1, 0]";
const ROD: &str = "shape.box.size = [0.05, 0.8, 0.05]\nposition = [1, 1, 0]";

#[test]
fn a_spawned_body_falls_and_lies_and_its_number_is_never_given_again() {
    let mut world = world_of(STACK, 1);
    steps(&mut world, 30);
    let ball = spawn(&mut world, BALL);
    assert_eq!((ball, world.bodies().len(), world.moving_bodies().len()), (4, 5, 5));
    assert_eq!(world.body(ball).expect("there").name, "ball_4");
    steps(&mut world, 240);
    assert!((position(&world, ball).y - 0.1).abs() < 0.005, "{}", position(&world, ball));
    world.remove(ball).expect("there");
    assert!(world.body(ball).is_none());
    assert_eq!(spawn(&mut world, BALL), 5);
    assert_eq!(world.summaries().len(), world.bodies().len());
}

#[test]
fn who_rested_on_a_body_that_goes_falls() {
    let mut world = world_of(STACK, 1);
    steps(&mut world, 360);
    assert!((0..4).all(|id| world.is_asleep(id)));
    let before = position(&world, 3).y;
    world.remove(0).expect("there");
    steps(&mut world, 120);
    assert!((before - position(&world, 3).y - 0.28).abs() < 0.01, "{before} {}", position(&world, 3).y);
}

#[test]
fn equal_commands_at_equal_steps_are_one_run_and_others_another() {
    let digest = |at: usize, foresees: bool| {
        let mut world = world_of(STACK, 1);
        for step in 0..200 {
            if step == at {
                let rod = spawn(&mut world, ROD);
                world.push(rod, [0.3, 0.0, 0.1], Some([1.0, 1.2, 0.0])).expect("light");
                world.grab(2, [0.1, 0.0, 0.0], [0.5, 1.0, 0.5]).expect("there");
            }
            if step == at + 60 {
                world.release(2, Some([1.0, 2.0, 0.0])).expect("there");
                world.remove(1).expect("there");
            }
            if foresees {
                let ahead = world.poses_ahead(3);
                assert_eq!(ahead.len(), 3);
                steps(&mut world, 1);
                let poses: Vec<_> = world.moving_bodies().map(|body| body.pose).collect();
                assert_eq!(ahead[0], poses, "step {step}");
            } else {
                steps(&mut world, 1);
            }
        }
        world.digest()
    };
    assert_eq!(digest(20, false), digest(20, true));
    assert_ne!(digest(20, false), digest(21, false));
}

#[test]
fn the_digest_knows_bodies_that_came_and_went_between_two_steps() {
    let mut world = world_of(STACK, 1);
    let before = world.digest();
    let ball = spawn(&mut world, BALL);
    world.remove(ball).expect("there");
    assert_ne!(world.digest(), before);
}

#[test]
fn a_held_body_comes_to_the_target_by_its_grip_and_stays_without_swinging() {
    for (text, grip) in [(BALL, [0.0; 3]), (ROD, [0.0, 0.4, 0.0]), (ROD, [0.02, -0.4, 0.02])] {
        let mut world = world_of("", 1);
        let body = spawn(&mut world, text);
        let target = Vector3::new(0.5, 1.5, 0.2);
        world.grab(body, grip, target.into()).expect("there");
        assert!(world.is_grabbed(body));
        let grip_now = |world: &World| {
            let body = world.body(body).expect("there");
            Vector3::from(body.pose.position_m()) + body.pose.rotation() * Vector3::from(grip)
        };
        let mut farthest_m: f64 = 0.0;
        for step in 0..720 {
            steps(&mut world, 1);
            if step >= 600 {
                farthest_m = farthest_m.max((grip_now(&world) - target).norm());
            }
        }
        assert!(farthest_m < 0.01, "{text}: {farthest_m} m off after five seconds");
        let spin = Vector3::from(world.body(body).expect("there").spin_rad_s).norm();
        assert!(spin < 0.3, "{text}: it swings with {spin} rad/s");
    }
}

#[test]
fn who_lets_go_may_throw() {
    let mut world = world_of("", 1);
    let ball = spawn(&mut world, BALL);
    world.grab(ball, [0.0; 3], [1.0, 1.0, 0.0]).expect("there");
    steps(&mut world, 60);
    world.release(ball, Some([2.0, 3.0, 0.0])).expect("held");
    assert!(!world.is_grabbed(ball));
    steps(&mut world, 12);
    let flown = position(&world, ball) - Vector3::new(1.0, 1.0, 0.0);
    assert!((flown - Vector3::new(0.2, 0.3 - 0.5 * 9.81 * 0.01, 0.0)).norm() < 0.01, "{flown}");
}

#[test]
fn a_body_that_is_held_into_the_floor_stays_above_it() {
    let mut world = world_of(STACK, 1);
    world.grab(0, [0.0; 3], [0.0, -3.0, 0.0]).expect("there");
    steps(&mut world, 240);
    assert!(position(&world, 0).y > 0.13, "{}", position(&world, 0).y);
    assert!(position(&world, 3).y > 0.9, "the stack stands: {}", position(&world, 3).y);
}

#[test]
fn a_push_moves_by_impulse_over_mass_even_before_the_first_step() {
    let mut world = world_of("gravity = [0, 0, 0]", 1);
    let ball = spawn(&mut world, &format!("{BALL}\nmass = 2"));
    world.push(ball, [4.0, 0.0, 0.0], None).expect("light");
    assert_eq!(world.body(ball).expect("there").velocity_m_s, [2.0, 0.0, 0.0]);
    world.push(ball, [0.0, 0.0, 1.0], Some([1.0, 1.1, 0.0])).expect("light");
    steps(&mut world, 1);
    let spin = world.body(ball).expect("there").spin_rad_s;
    assert!(spin[0] > 5.0 && spin[1].abs() < 0.1, "{spin:?}");
}

#[test]
fn parameters_hold_from_the_next_step_on() {
    let mut world = world_of(STACK, 1);
    world.set(Parameters { gravity_m_s2: Some([0.0, 1.0, 0.0]), ..Parameters::default() }).expect("possible");
    steps(&mut world, 120);
    assert!(position(&world, 3).y > 1.3, "it floats: {}", position(&world, 3).y);
    world.set(Parameters { answers_hull: Some(false), ..Parameters::default() }).expect("possible");
    let mut responses = untouched(&world);
    responses[3] =
        BodyResponse { response_m: Some([0.3, 0.0, 0.0]), inside_samples: 4, ..BodyResponse::UNTOUCHED };
    let before = position(&world, 3).x;
    assert_eq!(world.step(&responses).expect("a step").touched, 1);
    assert!((position(&world, 3).x - before).abs() < 1e-3);
    let again = world.again().expect("as before");
    assert_eq!(again.parameters().gravity_m_s2, Some([0.0, -9.81, 0.0]));
    assert_eq!(again.digest(), world_of(STACK, 1).digest());
}

#[test]
fn what_cannot_be_is_refused_in_one_line_and_changes_nothing() {
    let mut world = world_of(&format!("{STACK}\nfixed = true"), 1);
    let ball = spawn(&mut world, BALL);
    let before = world.digest();
    let far = [9.0, 0.0, 0.0];
    let refused: [(Result<(), CommandError>, &str); 10] = [
        (world.remove(99), "there is no body 99"),
        (world.push(0, [1.0; 3], None), "body `box_0` is fixed and never moves"),
        (
            world.push(ball, [1e9, 0.0, 0.0], None),
            "impulse: 1000000000 N s, expected at most 25.133 N s for a body of this mass",
        ),
        (
            world.push(ball, [f64::NAN, 0.0, 0.0], None),
            "impulse: NaN N s, expected at most 25.133 N s for a body of this mass",
        ),
        (
            world.push(ball, [0.1; 3], Some(far)),
            "at: 8.06 m from the body's origin, expected at most 0.60 m for body `ball_4`",
        ),
        (
            world.grab(ball, far, [0.0; 3]),
            "grip: 9.00 m from the body's origin, expected at most 0.60 m for body `ball_4`",
        ),
        (
            world.grab(ball, [0.0; 3], [0.0, f64::INFINITY, 0.0]),
            "target: inf, expected a number from -1000 to 1000",
        ),
        (world.release(ball, Some([99.0, 0.0, 0.0])), "velocity: [99.0, 0.0, 0.0], expected at most 50 m/s"),
        (
            world.set(Parameters { hull_friction: Some(-1.0), ..Parameters::default() }),
            "hull_friction is -1, expected 0 to 10",
        ),
        (
            world.prepare(request(&format!("{BALL}\nname = 'box_1'"))).map(drop),
            "name: `box_1`, expected one that no body has",
        ),
    ];
    for (found, expected) in refused {
        assert_eq!(found.expect_err(expected).to_string(), expected);
    }
    assert_eq!(world.digest(), before);
}
