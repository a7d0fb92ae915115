//! Hulls that are a few lines of arithmetic: what the paper's response makes of surfaces that move.

use super::*;

/// A hull that fills a box of the world; bodies leave it along `out`, where it ends at `face_m`.
struct Slab {
    low_m: [f64; 3],
    high_m: [f64; 3],
    out: usize,
}

impl Slab {
    /// The response of every body: its deepest sample to the face.
    fn responses(&self, world: &World) -> Vec<BodyResponse> {
        let depths = |body: &Body| {
            let world_from_body = body.pose.world_from_body();
            let inside = |sample: &&[f32; 3]| {
                let point = world_from_body(**sample);
                (0..3).all(|axis| (self.low_m[axis]..self.high_m[axis]).contains(&point[axis]))
            };
            let samples = body.shape.samples_body().iter().filter(inside);
            samples
                .map(|sample| self.high_m[self.out] - world_from_body(*sample)[self.out])
                .collect::<Vec<_>>()
        };
        let answer = |depths: Vec<f64>| {
            let mut response_m = [0.0; 3];
            response_m[self.out] = depths.iter().copied().fold(0.0, f64::max);
            let response_m = (!depths.is_empty()).then_some(response_m);
            BodyResponse { response_m, inside_samples: depths.len(), ..BodyResponse::UNTOUCHED }
        };
        world.moving_bodies().map(|body| answer(depths(body))).collect()
    }
}

#[test]
fn an_arm_knocks_a_stack_over_and_throws_nothing() {
    const ARM_M_S: f64 = 2.0;
    let mut world = world_of(STACK, 1);
    // The arm comes along +X at the height of the third box and stops after 0.6 m.
    let mut arm = Slab { low_m: [-1.0, 0.62, -0.1], high_m: [-0.5, 0.72, 0.1], out: 0 };
    while world.time_s() < 3.0 {
        arm.high_m[0] = (-0.6 + ARM_M_S * (world.next_time_s() - 1.0).max(0.0)).min(0.0);
        let responses = arm.responses(&world);
        assert_eq!(world.step(&responses).expect("a step").faults, []);
    }
    let third = &world.summaries()[2];
    assert!(third.moved_before_touch_m < 0.02 && third.max_tilt_deg > 60.0, "{third:?}");
    assert!(third.first_touch_s.is_some_and(|touch_s| (1.2..1.3).contains(&touch_s)), "{third:?}");
    // A fall from the top of the stack, and the arm.
    let fastest_m_s = (2.0 * 9.81 * 1.12f64).sqrt() + ARM_M_S;
    for summary in world.summaries() {
        assert!(summary.max_speed_m_s < fastest_m_s, "{summary:?}");
    }
    assert!(world.bodies()[3].pose.position_m()[1] < 0.75, "the top box fell");
}

#[test]
fn boxes_rest_on_a_lid_and_rise_with_it() {
    const RISE_M: f64 = 0.35;
    let boxes = [-0.155, 0.0, 0.155].map(|x: f64| {
        format!(
            "[[bodies]]\nname = 'at {x}'\nshape.box.size = [0.12, 0.16, 0.18]\n\
             place.stack.foot = [{x:?}, 1.15, 0.48]\nfriction = 0.8\nrestitution = 0.0\n"
        )
    });
    let scene = Scene::from_toml("lid", &boxes.concat()).expect("a scene");
    // The paper's perfect mirror keeps them hopping; less than that lets them lie.
    for (mirror_restitution, most_m, most_m_s) in [(0.0, 0.005, 0.3), (0.3, 0.005, 0.3), (1.0, 0.05, 1.0)] {
        let settings = WorldSettings { mirror_restitution, ..WorldSettings::default() };
        let mut world = World::new(&scene, settings).expect("a world");
        let mut lid = Slab { low_m: [-0.25, 0.8, 0.26], high_m: [0.25, 1.15, 0.66], out: 1 };
        let mut noise = crate::seeded::Seeded::new(1, "silhouettes");
        let mut farthest_m: f64 = 0.0;
        while world.time_s() < 5.0 {
            let shiver_m = 0.001 * noise.signed();
            lid.high_m[1] = 1.15 + shiver_m + RISE_M * (0.5 * (world.next_time_s() - 2.0)).clamp(0.0, 1.0);
            let responses = lid.responses(&world);
            world.step(&responses).expect("a step");
            for body in world.bodies() {
                farthest_m = farthest_m.max((body.pose.position_m()[1] - 0.08 - lid.high_m[1]).abs());
            }
        }
        assert!(farthest_m < most_m, "{farthest_m} m off the lid with {mirror_restitution}");
        for summary in world.summaries() {
            assert!(summary.max_tilt_deg < 1.0 && summary.max_speed_m_s < most_m_s, "{summary:?}");
            assert!((summary.moved_m - RISE_M).abs() < most_m, "{summary:?}");
        }
    }
}

#[test]
fn a_push_into_neighbours_or_the_floor_is_undone_gently() {
    let neighbour = STACK.replace("'box'", "'next'").replace("[0.0, 0.0", "[0.285, 0.0");
    for push_m in [[0.05, 0.0, 0.0], [0.2, 0.0, 0.0], [0.0, -0.05, 0.0], [0.0, -0.2, 0.0], [0.1, 0.1, 0.05]] {
        let mut world = world_of(&format!("{STACK}\n{neighbour}"), 1);
        run(&mut world, 1.5);
        let mut push = untouched(&world);
        push[1] = BodyResponse { response_m: Some(push_m), inside_samples: 1, ..BodyResponse::UNTOUCHED };
        world.step(&push).expect("a step");
        let resting = untouched(&world);
        for _ in 0..60 {
            world.step(&resting).expect("a step");
            for body in world.bodies() {
                assert!(body.velocity_m_s[1] < 1.0, "{} is thrown after {push_m:?}: {body:?}", body.name);
            }
        }
    }
}
