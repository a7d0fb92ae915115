//! What the world foresees is what it does.

use super::*;

/// The moving bodies' poses now.
fn poses(world: &World) -> Vec<Pose> {
    world.moving_bodies().map(|body| body.pose).collect()
}

#[test]
fn what_is_foreseen_comes_true_bit_for_bit() {
    for name in Scene::names() {
        let scene = Scene::named(name).expect("a shipped scene");
        let mut world = World::new(&scene, WorldSettings::default()).expect("a world");
        let resting = untouched(&world);
        for _ in 0..60 {
            let ahead = world.poses_ahead(4);
            assert_eq!(ahead.len(), 4);
            for expected in ahead {
                world.step(&resting).expect("a step");
                assert_eq!(poses(&world), expected, "{name} at {} s", world.time_s());
            }
        }
    }
}

#[test]
fn sleeping_bodies_are_foreseen_to_stay() {
    let mut world = world_of(STACK, 1);
    run(&mut world, 3.0);
    assert!((0..4).all(|index| world.solver.sleeps(index)));
    let ahead = world.poses_ahead(3);
    assert_eq!(ahead, vec![poses(&world); 3]);
    run(&mut world, 3.1);
    assert_eq!(ahead[0], poses(&world));
}

#[test]
fn to_foresee_changes_nothing() {
    let digest = |foresees: bool| {
        let mut world = world_of(STACK, 1);
        for step in 0..120 {
            let mut responses = untouched(&world);
            if (60..70).contains(&step) {
                responses[2] = BodyResponse {
                    response_m: Some([0.03, 0.0, 0.001]),
                    inside_samples: 9,
                    ..BodyResponse::UNTOUCHED
                };
            }
            if foresees {
                assert_eq!(world.poses_ahead(step % 5).len(), step % 5);
            }
            world.step(&responses).expect("a step");
        }
        world.digest()
    };
    assert_eq!(digest(true), digest(false));
}

#[test]
fn nothing_is_foreseen_of_a_solver_out_of_the_numbers() {
    let mut world = world_of(STACK, 1);
    world.solver.poison(3);
    assert_eq!(world.poses_ahead(2), Vec::<Vec<Pose>>::new());
}
