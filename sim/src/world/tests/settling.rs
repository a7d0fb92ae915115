//! Bodies that the hull does not touch.

use super::*;

#[test]
fn a_stack_of_four_stands_for_ten_seconds() {
    for seed in 1..=3 {
        let mut world = world_of(STACK, seed);
        run(&mut world, 10.0);
        for summary in world.summaries() {
            assert!(summary.moved_before_touch_m < 0.02, "{summary:?}");
            assert!(summary.max_tilt_deg < 2.0, "{summary:?}");
        }
    }
}

#[test]
fn the_same_stack_stands_where_up_is_z() {
    let mut world = world_of(&format!("gravity = [0.0, 0.0, -9.81]\n{STACK}"), 1);
    run(&mut world, 3.0);
    assert!(world.bodies()[3].pose.position_m()[2] > 0.9);
    assert!(world.summaries().iter().all(|summary| summary.moved_m < 0.02));
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
    assert_eq!(world.summaries()[0].moved_m, 0.0);
    assert!(world.moving_bodies().all(|body| body.pose.position_m()[1] > 0.9));
}

#[test]
fn equal_solids_share_one_shape() {
    let world = world_of(STACK, 1);
    assert!(world.bodies().iter().all(|body| Arc::ptr_eq(&body.shape, &world.bodies()[0].shape)));
}

#[test]
fn runs_repeat_bit_for_bit_and_seeds_differ() {
    let digest = |seed, push_m: f64| {
        let mut world = world_of(STACK, seed);
        for step in 0..240 {
            let mut responses = untouched(&world);
            if (60..80).contains(&step) {
                responses[2] = BodyResponse {
                    response_m: Some([push_m, 0.0, 0.001]),
                    inside_samples: 9,
                    ..BodyResponse::UNTOUCHED
                };
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
    for (body, summary) in world.bodies().iter().zip(world.summaries()) {
        assert!(summary.max_speed_m_s < 1.05 * fall_m_s, "{summary:?}");
        assert!(body.pose.position_m()[1] > 0.0, "{summary:?}");
        let speed_m_s = Vector3::from(body.velocity_m_s).norm();
        assert!(speed_m_s < 1.0, "{} still at {speed_m_s} m/s", body.name);
    }
}

#[test]
fn a_world_can_be_handed_to_another_thread() {
    let mut world = world_of(STACK, 1);
    let moved = std::thread::spawn(move || {
        run(&mut world, 0.1);
        world.steps()
    });
    assert_eq!(moved.join().expect("no panic"), 12);
}
