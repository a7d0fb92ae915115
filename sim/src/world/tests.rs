use super::*;
use crate::response::BodyResponse;

fn world_of(text: &str, seed: u64) -> World {
    let scene = Scene::from_toml("test", text).expect("a scene");
    World::new(&scene, WorldSettings { seed, ..WorldSettings::default() }).expect("a world")
}

fn untouched(world: &World) -> Vec<BodyResponse> {
    vec![BodyResponse::UNTOUCHED; world.moving_bodies().len()]
}

fn run(world: &mut World, seconds: f64) {
    let responses = untouched(world);
    while world.time_s() < seconds - 1e-9 {
        let report = world.step(&responses).expect("a step");
        assert_eq!(report, StepReport::default());
    }
}

const STACK: &str = "
    [[bodies]]
    name = 'box'
    shape.box.size = [0.28, 0.28, 0.28]
    count = 4
    place.stack.foot = [0.0, 0.0, 0.0]";

const BOX_IN_SPACE: &str = "
    gravity = [0.0, 0.0, 0.0]
    floor.enabled = false
    [[bodies]]
    name = 'box'
    shape.box.size = [0.3, 0.3, 0.3]
    place.at = [0.0, 1.0, 0.0]";

#[test]
fn a_stack_of_four_stands_for_ten_seconds() {
    for seed in 1..=3 {
        let mut world = world_of(STACK, seed);
        run(&mut world, 10.0);
        for record in world.records() {
            assert!(record.moved_before_touch_m < 0.02, "{record:?}");
            assert!(record.max_tilt_deg < 2.0, "{record:?}");
        }
    }
}

#[test]
fn the_same_stack_stands_where_up_is_z() {
    let mut world = world_of(&format!("gravity = [0.0, 0.0, -9.81]\n{STACK}"), 1);
    run(&mut world, 3.0);
    assert!(world.bodies()[3].pose.position_m()[2] > 0.9);
    assert!(world.records().iter().all(|record| record.moved_m < 0.02));
}

#[test]
fn every_shape_falls_and_rests_on_the_floor() {
    let mut text = String::from("[floor]\nheight = 0.2\n");
    let shapes = [
        ("box.size = [0.2, 0.3, 0.25]", 0.1),
        ("ball.radius = 0.12", 0.12),
        ("capsule = { radius = 0.08, length = 0.2 }", 0.08),
        ("cylinder = { radius = 0.1, height = 0.2 }", 0.1),
        ("cone = { radius = 0.12, height = 0.24 }", 0.0),
        ("hull.points = [[0.1, 0.0, 0.0], [-0.1, 0.0, 0.1], [-0.1, 0.0, -0.1], [0.0, 0.2, 0.0]]", -0.05),
    ];
    for (index, (shape, _)) in shapes.iter().enumerate() {
        text += &format!(
            "[[bodies]]\nname = 'b{index}'\nshape.{shape}\nplace.at = [{index}.0, 0.9, 0.0]\nrotation_deg = [20.0, 0.0, 10.0]\n"
        );
    }
    let mut world = world_of(&text, 1);
    run(&mut world, 4.0);
    for (body, (_, least_m)) in world.bodies().iter().zip(shapes) {
        let height_m = body.pose.position_m()[1] - 0.2;
        assert!(height_m > least_m - 0.003 && height_m < 0.2, "{} at {height_m}", body.solid.kind());
        let speed_m_s = Vector3::from(body.velocity_m_s).norm();
        assert!(speed_m_s < 0.2, "{} at {speed_m_s} m/s", body.solid.kind());
        let lowest = body.shape.samples_body().iter().map(|s| body.pose.world_from_body()(*s).y);
        assert!(lowest.fold(f64::INFINITY, f64::min) > 0.2 - 0.003, "{} in the floor", body.solid.kind());
    }
}

#[test]
fn a_response_moves_the_body_and_mirrors_what_points_in() {
    let mut world = world_of(BOX_IN_SPACE, 1);
    world.solver.set_velocity(0, [1.0, -2.0, 0.5]);
    let start = world.bodies()[0].pose.position_m();
    let response = BodyResponse { response_m: Some([0.0, 0.05, 0.0]), inside_samples: 12 };
    let report = world.step(&[response]).expect("a step");
    let expected = StepReport { touched: 1, inside_samples: 12, translated: 1, mirrored: 1, faults: vec![] };
    assert_eq!(report, expected);
    let body = &world.bodies()[0];
    // Mirrored with the default restitution of 0.3, then flown for one step.
    let velocity_m_s = [1.0, 0.6, 0.5];
    for axis in 0..3 {
        let flown = start[axis] + [0.0, 0.05, 0.0][axis] + velocity_m_s[axis] / 120.0;
        assert!((body.pose.position_m()[axis] - flown).abs() < 1e-6);
        assert!((body.velocity_m_s[axis] - velocity_m_s[axis]).abs() < 1e-6);
    }
    assert_eq!(body.spin_rad_s, [0.0; 3]);
    assert!((world.records()[0].hull_moved_m - 0.05).abs() < 1e-12);
    assert_eq!(world.records()[0].first_touch_s, Some(1.0 / 120.0));
}

#[test]
fn a_push_leaves_a_body_at_rest_at_rest() {
    let mut world = world_of(BOX_IN_SPACE, 1);
    let start = world.bodies()[0].pose.position_m();
    for _ in 0..20 {
        world
            .step(&[BodyResponse { response_m: Some([0.05, 0.0, 0.0]), inside_samples: 1 }])
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
    let report = world.step(&[BodyResponse { response_m: None, inside_samples: 3 }]).expect("a step");
    assert_eq!((report.touched, report.inside_samples, report.translated), (1, 3, 0));
    assert_eq!(world.bodies()[0].pose, start);
    assert_eq!(world.records()[0].first_touch_s, Some(1.0 / 120.0));
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
    assert_eq!(world.records()[2].first_touch_s, None);
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
    assert_eq!(world.step(&push).expect("a step").translated, 1);
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
fn fixed_bodies_carry_others_and_are_not_asked() {
    let pedestal = "
        [[bodies]]
        name = 'pedestal'
        fixed = true
        shape.box.size = [0.5, 0.8, 0.5]
        place.stack.foot = [0.0, 0.0, 0.0]";
    let text = format!("{pedestal}\n{}", STACK.replace("0.0, 0.0, 0.0", "0.0, 0.8, 0.0"));
    let mut world = world_of(&text, 1);
    assert_eq!((world.bodies().len(), world.moving_bodies().len()), (5, 4));
    run(&mut world, 3.0);
    assert_eq!(world.records()[0].moved_m, 0.0);
    assert!(world.moving_bodies().all(|body| body.pose.position_m()[1] > 0.9));
}

#[test]
fn equal_solids_share_one_shape() {
    let world = world_of(STACK, 1);
    assert!(world.bodies().iter().all(|body| Arc::ptr_eq(&body.shape, &world.bodies()[0].shape)));
}

#[test]
fn a_push_into_a_neighbour_throws_nothing() {
    for push_m in [[0.05, 0.0, 0.0], [0.2, 0.0, 0.0], [0.0, -0.05, 0.0], [0.0, -0.2, 0.0], [0.1, 0.1, 0.05]] {
        let text =
            format!("{STACK}\n{}", STACK.replace("'box'", "'next'").replace("[0.0, 0.0", "[0.285, 0.0"));
        let mut world = world_of(&text, 1);
        run(&mut world, 1.5);
        let mut push = untouched(&world);
        push[1].response_m = Some(push_m);
        world.step(&push).expect("a step");
        let mut fastest: f64 = 0.0;
        for _ in 0..60 {
            let resting = untouched(&world);
            world.step(&resting).expect("a step");
            let speeds = world.bodies().iter().map(|body| Vector3::from(body.velocity_m_s).norm());
            fastest = speeds.fold(fastest, f64::max);
        }
        eprintln!("{push_m:?} {fastest}");
    }
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

#[test]
fn runs_repeat_bit_for_bit_and_seeds_differ() {
    let digest = |seed, push_m: f64| {
        let mut world = world_of(STACK, seed);
        for step in 0..240 {
            let mut responses = untouched(&world);
            if (60..80).contains(&step) {
                responses[2] = BodyResponse { response_m: Some([push_m, 0.0, 0.001]), inside_samples: 9 };
            }
            world.step(&responses).expect("a step");
        }
        world.digest()
    };
    assert_eq!(digest(1, 0.02), digest(1, 0.02));
    assert_ne!(digest(1, 0.02), digest(2, 0.02));
    assert_ne!(digest(1, 0.02), digest(1, 0.021));
}

#[test]
fn a_crowd_settles_and_nothing_is_faster_than_its_fall() {
    let scene = Scene::named("crowd").expect("a shipped scene");
    let mut world = World::new(&scene, WorldSettings::default()).expect("a world");
    let top_m = world.bodies().iter().map(|body| body.pose.position_m()[1]).fold(0.0, f64::max);
    run(&mut world, 6.0);
    let fall_m_s = (2.0 * 9.81 * top_m).sqrt();
    for (body, record) in world.bodies().iter().zip(world.records()) {
        assert!(record.max_speed_m_s < 1.05 * fall_m_s, "{record:?}");
        assert!(body.pose.position_m()[1] > 0.0, "{record:?}");
        let speed_m_s = Vector3::from(body.velocity_m_s).norm();
        assert!(speed_m_s < 1.0, "{} still at {speed_m_s} m/s", body.name);
    }
}
