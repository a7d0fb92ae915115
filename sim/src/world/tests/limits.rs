//! What a world may hold: the same limits for scenes, kept worlds and bodies that come later.

use super::*;
use crate::scene::{BodyRequest, BodySpec};

fn request(text: &str) -> BodySpec {
    let request: BodyRequest = toml::from_str(text).expect("the keys of a request");
    request.check().expect("a body")
}

/// So many boxes of an edge, metres, each where `place` says.
fn boxes(count: usize, edge_m: f64, place: impl Fn(usize) -> [f64; 3]) -> String {
    let table = |index| {
        let at = place(index);
        format!("[[bodies]]\nname = 'box_{index}'\nshape.box.size = {:?}\nplace.at = {at:?}\n", [edge_m; 3])
    };
    (0..count).map(table).collect()
}

fn refused(scene: &str) -> String {
    let scene = Scene::from_toml("test", scene).expect("a scene");
    let error = World::new(&scene, WorldSettings::default()).map(drop).expect_err("too much").to_string();
    assert_eq!(error.lines().count(), 1, "{error}");
    error
}

/// The error of a world that goes on from the bodies of another scene.
fn going_on_from(scene: &str) -> String {
    let scene = Scene::from_toml("test", scene).expect("a scene");
    let mut bodies = vec![];
    for (id, spec) in scene.bodies(1).into_iter().enumerate() {
        bodies.push(BodySnapshot { id: id as BodyId, spec, spin_rad_s: [0.0; 3] });
    }
    let empty = world_of("", 1);
    let next_id = bodies.len() as BodyId;
    let kept = WorldSnapshot::new(empty.scene().clone(), empty.parameters(), 0, next_id, bodies);
    empty.going_on(&kept.expect("numbers that can be")).map(drop).expect_err("too much").to_string()
}

#[test]
fn a_thousand_bodies_at_one_place_are_refused_in_scenes_and_kept_worlds() {
    let heap = boxes(1000, 0.2, |_| [0.0, 1.0, 0.0]);
    let expected =
        "499500 pairs of overlapping bodies, expected at most 5000: body `box_999` overlaps 999 others";
    assert_eq!(refused(&heap), expected);
    assert_eq!(going_on_from(&heap), expected);
}

#[test]
fn a_body_that_makes_too_many_pairs_is_not_spawned() {
    let mut world = world_of("", 1);
    let ball = "shape.ball.radius = 0.1\nposition = [0, 2, 0]";
    let error = loop {
        match world.prepare(request(ball)) {
            Ok(prepared) => world.spawn(prepared).map(drop).expect("room"),
            Err(error) => break error.to_string(),
        }
    };
    // A hundred make 4,950 pairs.
    assert_eq!(world.bodies().len(), 100);
    let expected =
        "5050 pairs of overlapping bodies, expected at most 5000: body `ball_100` overlaps 100 others";
    assert_eq!(error, expected);
    world.prepare(request("shape.ball.radius = 0.1\nposition = [9, 2, 0]")).expect("apart from all others");
}

#[test]
fn a_thousand_bodies_apart_or_stacked_or_fixed_are_a_world() {
    let grid = |index: usize| {
        [(index % 10) as f64, 0.2 + (index / 100) as f64, (index / 10 % 10) as f64].map(|m| 0.21 * m)
    };
    let mut apart = world_of(&boxes(1000, 0.2, grid), 1);
    apart.step(&untouched(&apart)).expect("few pairs");
    let stack = "[[bodies]]\nname = 'box'\nshape.box.size = [0.2, 0.2, 0.2]\ncount = 1000\nplace.stack.foot = [0, 0, 0]";
    world_of(stack, 1);
    let walls = boxes(1000, 0.2, |_| [0.0, 1.0, 0.0]).replace("place.at", "fixed = true\nplace.at");
    world_of(&walls, 1);
}

#[test]
fn bodies_that_meet_at_one_place_end_at_an_error_before_the_step() {
    // Each is a step away from the middle, and flies there.
    let scene = "gravity = [0, 0, 0]\nfloor.enabled = false\n".to_owned()
        + &boxes(200, 0.027, |index| [0.03 * index as f64, 0.0, 0.0]);
    let mut kept = world_of(&scene, 1).snapshot();
    let dt_s = WorldSettings::default().dt_s;
    let bodies: Vec<BodySnapshot> = kept
        .bodies()
        .iter()
        .cloned()
        .map(|mut body| {
            body.spec.velocity_m_s[0] = (3.0 - body.spec.pose.position_m()[0]) / dt_s;
            body
        })
        .collect();
    kept = WorldSnapshot::new(kept.scene().clone(), kept.parameters(), 0, 200, bodies).expect("possible");
    let mut world = world_of("", 1).going_on(&kept).expect("few overlap yet");
    assert_eq!(world.poses_ahead(10).len(), 1, "nothing is foreseen of the heap");
    world.step(&untouched(&world)).expect("the step that brings them together");
    let (before, steps) = (world.digest(), world.steps());
    let error = world.step(&untouched(&world)).expect_err("too many").to_string();
    assert!(error.contains("pairs of overlapping bodies, expected at most 5000"), "{error}");
    assert_eq!((world.digest(), world.steps()), (before, steps), "the step was not made");
    world.again().expect("its scene starts again");
}

#[test]
fn boxes_of_five_metres_are_bounded_by_their_samples_in_scenes_and_kept_worlds() {
    let large = boxes(1000, 5.0, |index| [6.0 * (index % 100) as f64, 2.5, 6.0 * (index / 100) as f64]);
    for error in [refused(&large), going_on_from(&large)] {
        assert!(
            error.starts_with("body `box_")
                && error.ends_with("samples of all moving bodies, expected at most 500000"),
            "{error}"
        );
    }
}

#[test]
fn bodies_and_samples_are_bounded() {
    let mut world = world_of("", 1);
    let large = "shape.box.size = [5, 5, 5]\nposition = [0, 3, 0]";
    let mut count = 0;
    let error = loop {
        match world.prepare(request(large)) {
            Ok(prepared) => world.spawn(prepared).map(drop).expect("room"),
            Err(error) => break error.to_string(),
        }
        count += 1;
    };
    assert!((2..20).contains(&count), "{count}");
    assert!(error.contains("samples of all moving bodies, expected at most 500000"), "{error}");
    // Fixed ones are never asked about, but their samples are there.
    let error = (1..500).find_map(|size| {
        let edge = 5.0 - 0.001 * f64::from(size);
        let fixed = format!("fixed = true\nshape.box.size = [{edge}, 5, 5]\nposition = [0, 3, 0]");
        let prepared = world.prepare(request(&fixed));
        prepared.map(|prepared| world.spawn(prepared).expect("room")).err()
    });
    let error = error.expect("a bound").to_string();
    assert!(error.contains("samples of all different shapes, expected at most 2000000"), "{error}");
}
