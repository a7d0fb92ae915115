//! Solids that move as they are told, and bodies on them.

use super::*;

/// A box on a slab whose top is at 0.8 m.
const ON_SLAB: &str = "
    [[bodies]]
    name = 'box'
    shape.box.size = [0.2, 0.2, 0.2]
    friction = 0.6
    restitution = 0.0
    place.at = [0.0, 0.901, 0.0]";

fn slab(at_m: [f64; 3]) -> [(Solid, Pose); 1] {
    let solid = Solid::Box { size_m: [0.6, 0.1, 0.6] };
    [(solid, Pose::new(at_m, [0.0, 0.0, 0.0, 1.0]).expect("a pose"))]
}

/// Steps while the slab is where a function of time says; returns the box.
fn ride(world: &mut World, seconds: f64, place_m: impl Fn(f64) -> [f64; 3]) -> Body {
    let responses = untouched(world);
    while world.time_s() < seconds - 1e-9 {
        world.set_true_solids(&slab(place_m(world.next_time_s()))).expect("a slab");
        world.step(&responses).expect("a step");
    }
    world.bodies()[0].clone()
}

#[test]
fn bodies_sleep_on_solids_that_stand_still() {
    let mut world = world_of(ON_SLAB, 1);
    let body = ride(&mut world, 4.0, |_| [0.0, 0.75, 0.0]);
    assert!((body.pose.position_m()[1] - 0.9).abs() < 2e-3, "{:?}", body.pose);
    assert!(world.is_asleep(body.id));
}

#[test]
fn bodies_are_carried_by_solids_that_move() {
    let mut world = world_of(ON_SLAB, 1);
    ride(&mut world, 3.0, |_| [0.0, 0.75, 0.0]);
    let body = ride(&mut world, 4.0, |time_s| [0.3 * (time_s - 3.0), 0.75 + 0.4 * (time_s - 3.0), 0.0]);
    let [x, y, _] = body.pose.position_m();
    assert!((x - 0.3).abs() < 0.02 && (y - 1.3).abs() < 5e-3, "{:?}", body.pose);
    assert!((body.velocity_m_s[1] - 0.4).abs() < 0.02, "{:?}", body.velocity_m_s);
}

#[test]
fn a_solid_that_is_another_takes_its_place() {
    let mut world = world_of(ON_SLAB, 1);
    ride(&mut world, 2.0, |_| [0.0, 0.75, 0.0]);
    let low = Solid::Box { size_m: [0.6, 0.06, 0.6] };
    let [(_, pose)] = slab([0.0, 0.75, 0.0]);
    for _ in 0..120 {
        world.set_true_solids(&[(low.clone(), pose)]).expect("a slab");
        world.step(&untouched(&world)).expect("a step");
    }
    let height_m = world.bodies()[0].pose.position_m()[1];
    assert!((height_m - 0.88).abs() < 2e-3, "{height_m}");
    world.set_true_solids(&[]).expect("nothing");
    run(&mut world, 5.0);
    assert!((world.bodies()[0].pose.position_m()[1] - 0.1).abs() < 2e-3, "it falls to the floor");
}
