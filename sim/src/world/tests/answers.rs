//! Responses handed in one by one.

use super::*;

const BOX_IN_SPACE: &str = "
    gravity = [0.0, 0.0, 0.0]
    floor.enabled = false
    [[bodies]]
    name = 'box'
    shape.box.size = [0.3, 0.3, 0.3]
    place.at = [0.0, 1.0, 0.0]";

#[test]
fn a_response_moves_the_body_and_mirrors_what_points_in() {
    let mut world = world_of(BOX_IN_SPACE, 1);
    world.solver.set_velocity(0, [1.0, -0.2, 0.5]);
    let start = world.bodies()[0].pose.position_m();
    let response =
        BodyResponse { response_m: Some([0.0, 0.05, 0.0]), inside_samples: 12, ..BodyResponse::UNTOUCHED };
    let report = world.step(&[response]).expect("a step");
    let expected = StepReport { touched: 1, faults: vec![] };
    assert_eq!(report, expected);
    let body = &world.bodies()[0];
    // Mirrored with the default restitution of 0.3, braked by half of the change, flown for one step.
    let kept = 1.0 - 0.5 * 1.3 * 0.2 / 1.25f64.sqrt();
    let velocity_m_s = [kept, 0.06, 0.5 * kept];
    for axis in 0..3 {
        let flown = start[axis] + [0.0, 0.05, 0.0][axis] + velocity_m_s[axis] / 120.0;
        assert!((body.pose.position_m()[axis] - flown).abs() < 1e-6);
        assert!((body.velocity_m_s[axis] - velocity_m_s[axis]).abs() < 1e-6);
    }
    assert_eq!(body.spin_rad_s, [0.0; 3]);
    assert!((world.summaries()[0].hull_moved_m - 0.05).abs() < 1e-12);
    assert_eq!(world.summaries()[0].first_touch_s, Some(1.0 / 120.0));
}

#[test]
fn a_push_leaves_a_body_at_rest_at_rest() {
    let mut world = world_of(BOX_IN_SPACE, 1);
    let start = world.bodies()[0].pose.position_m();
    for _ in 0..20 {
        world
            .step(&[BodyResponse {
                response_m: Some([0.05, 0.0, 0.0]),
                inside_samples: 1,
                ..BodyResponse::UNTOUCHED
            }])
            .expect("a step");
    }
    let body = &world.bodies()[0];
    assert!((body.pose.position_m()[0] - start[0] - 1.0).abs() < 1e-5);
    assert_eq!(body.velocity_m_s, [0.0; 3]);
}

#[test]
fn a_body_without_a_way_out_is_touched_and_not_moved() {
    let mut world = world_of(BOX_IN_SPACE, 1);
    let start = world.bodies()[0].pose;
    let report = world
        .step(&[BodyResponse { response_m: None, inside_samples: 3, ..BodyResponse::UNTOUCHED }])
        .expect("a step");
    assert_eq!(report.touched, 1);
    assert_eq!(world.bodies()[0].pose, start);
    assert_eq!(world.summaries()[0].first_touch_s, Some(1.0 / 120.0));
}

#[test]
fn responses_that_are_no_numbers_are_reported_and_do_no_harm() {
    let mut world = world_of(STACK, 1);
    let mut reference = world_of(STACK, 1);
    let fault = Fault { body: "box_2".to_owned(), kind: FaultKind::Response };
    for wild in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e300, 1e39] {
        let mut responses = untouched(&world);
        responses[2].response_m = Some([0.0, wild, 0.0]);
        let report = world.step(&responses).expect("a step");
        assert_eq!(report, StepReport { faults: vec![fault.clone()], ..StepReport::default() });
        reference.step(&untouched(&reference)).expect("a step");
    }
    assert_eq!(world.digest(), reference.digest());
    assert_eq!(world.summaries()[2].first_touch_s, None);
}

#[test]
fn a_state_that_is_no_number_is_put_back_and_falls_on() {
    let mut world = world_of(STACK, 1);
    run(&mut world, 0.5);
    let before = world.bodies()[3].pose;
    world.solver.poison(3);
    let report = world.step(&untouched(&world)).expect("a step");
    assert_eq!(report.faults, [Fault { body: "box_3".to_owned(), kind: FaultKind::Solver }]);
    assert_eq!(world.bodies()[3].pose, before);
    // It is still a body: a push takes it off the stack, and it falls.
    let mut push = untouched(&world);
    push[3].response_m = Some([0.6, 0.0, 0.0]);
    assert_eq!(world.step(&push).expect("a step").touched, 1);
    let resting = untouched(&world);
    for _ in 0..240 {
        assert_eq!(world.step(&resting).expect("a step"), StepReport::default());
    }
    assert!(world.bodies()[3].pose.position_m()[1] < 0.2, "{:?}", world.bodies()[3].pose);
    assert!(world.bodies()[2].pose.position_m()[1] > 0.6);
}

#[test]
fn the_wrong_number_of_responses_is_refused() {
    let mut world = world_of(STACK, 1);
    let error = world.step(&[BodyResponse::UNTOUCHED; 3]).expect_err("four bodies move");
    assert_eq!(error.to_string(), "3 responses, expected 4: one per moving body");
    assert_eq!(world.steps(), 0);
}

#[test]
fn a_sleeping_stack_notices_that_its_foot_was_pushed_away() {
    let mut world = world_of(STACK, 1);
    run(&mut world, 3.0);
    assert!((0..4).all(|index| world.solver.sleeps(index)));
    let mut push = untouched(&world);
    push[0].response_m = Some([1.0, 0.0, 0.0]);
    world.step(&push).expect("a step");
    let resting = untouched(&world);
    for _ in 0..120 {
        world.step(&resting).expect("a step");
    }
    let heights: Vec<f64> = world.bodies().iter().map(|body| body.pose.position_m()[1]).collect();
    for (height_m, expected_m) in heights.iter().zip([0.14, 0.14, 0.42, 0.7]) {
        assert!((height_m - expected_m).abs() < 0.02, "{heights:?}");
    }
}
