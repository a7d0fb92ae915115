//! Bodies under true contacts with hulls that are simple enough to work out.

use super::*;
use crate::response::{HullContact, ResponseMode};
use crate::world::FaultKind;
use nalgebra::Vector3;

/// Contacts are found up to here above a surface, metres.
const NEAR_M: f64 = 0.019;

/// Where the hull's surface is near a point: its outward normal, and how deep the point is below it, metres.
pub(super) type Hull<'a> = &'a dyn Fn(Vector3<f64>) -> Option<(Vector3<f64>, f64)>;

pub(super) fn contact_world(text: &str) -> World {
    let scene = Scene::from_toml("test", text).expect("a scene");
    let settings = WorldSettings { response: ResponseMode::Contacts, ..WorldSettings::default() };
    World::new(&scene, settings.on(scene.hull())).expect("a world")
}

/// What a hull that is known says of every moving body.
pub(super) fn responses(world: &World, hull: Hull) -> Vec<BodyResponse> {
    let respond = |body: &Body| {
        let (rotation, position) = (body.pose.rotation(), Vector3::from(body.pose.position_m()));
        let faces = body.faces.as_ref().expect("faces");
        let contact = |(index, &point_body_m): (usize, &[f32; 3])| {
            let (normal, depth_m) = hull(rotation * Vector3::from(point_body_m.map(f64::from)) + position)?;
            let faces_it = faces.at(index).iter().any(|face| (rotation * face).dot(&normal) < -0.3);
            let normal_world = [normal.x, normal.y, normal.z].map(|part| part as f32);
            let contact = HullContact {
                sample: index as u32,
                point_body_m,
                normal_world,
                depth_m: depth_m as f32,
                speed_m_s: None,
                slide_m_s: [0.0; 3],
            };
            (faces_it && depth_m > -NEAR_M).then_some(contact)
        };
        let contacts: Vec<HullContact> =
            body.shape.samples_body().iter().enumerate().filter_map(contact).collect();
        let inside_samples = contacts.iter().filter(|contact| contact.depth_m > 0.0).count();
        BodyResponse { inside_samples, contacts, ..BodyResponse::UNTOUCHED }
    };
    world.moving_bodies().map(respond).collect()
}

pub(super) fn run_on(world: &mut World, seconds: f64, hull: Hull) {
    let end_s = world.time_s() + seconds;
    while world.time_s() < end_s - 1e-9 {
        let responses = responses(world, hull);
        let report = world.step(&responses).expect("a step");
        assert!(report.faults.is_empty(), "{report:?}");
    }
}

/// Everything below a plane.
pub(super) fn below(height_m: f64, lean_rad: f64) -> impl Fn(Vector3<f64>) -> Option<(Vector3<f64>, f64)> {
    let (sine, cosine) = libm::sincos(lean_rad);
    let normal = Vector3::new(sine, cosine, 0.0);
    move |point| Some((normal, normal.dot(&(Vector3::y() * height_m - point))))
}

fn up_of(body: &Body) -> f64 {
    (body.pose.rotation() * Vector3::y()).y
}

fn tilt_deg(body: &Body) -> f64 {
    libm::acos(up_of(body).clamp(-1.0, 1.0)).to_degrees()
}

const NO_FLOOR: &str = "
    [floor]
    enabled = false
    [hull]
    restitution = 0.0
    friction = 0.8";

pub(super) fn tower(count: usize) -> World {
    contact_world(&format!(
        "{NO_FLOOR}
        [[bodies]]
        name = 'box'
        shape.box.size = [0.2, 0.2, 0.2]
        density = 80.0
        friction = 0.8
        restitution = 0.0
        count = {count}
        place.stack.foot = [0.0, 1.0, 0.0]"
    ))
}

#[test]
fn a_tower_on_a_still_hull_stands_and_falls_asleep() {
    let mut world = tower(5);
    let table = below(1.0, 0.0);
    run_on(&mut world, 2.0, &table);
    let before: Vec<_> = world.bodies().iter().map(|body| body.pose).collect();
    run_on(&mut world, 10.0, &table);
    for (body, before) in world.bodies().iter().zip(before) {
        let drift = Vector3::from(body.pose.position_m()) - Vector3::from(before.position_m());
        assert!(drift.norm() < 1e-4 && tilt_deg(body) < 0.2, "{}: {drift} m", body.name);
        assert!(world.is_asleep(body.id), "{}", body.name);
    }
    // The table goes: they wake and fall.
    run_on(&mut world, 1.0, &|_| None);
    assert!(world.bodies().iter().all(|body| body.pose.position_m()[1] < 0.0));
}

#[test]
fn on_a_slope_friction_decides() {
    for (friction, stays) in [(0.3, false), (0.8, true)] {
        let mut world = contact_world(&format!(
            "[floor]
            enabled = false
            [hull]
            restitution = 0.0
            friction = {friction}
            [[bodies]]
            name = 'box'
            shape.box.size = [0.2, 0.2, 0.2]
            density = 80.0
            friction = {friction}
            restitution = 0.0
            place.at = [0.0, 0.1, 0.0]"
        ));
        // The ground tips slowly to 24 degrees, and the box with it.
        let lean = |time_s: f64| (6.0 * time_s).min(24.0).to_radians();
        while world.time_s() < 6.0 {
            let ground = below(0.0, lean(world.next_time_s()));
            let responses = responses(&world, &ground);
            world.step(&responses).expect("a step");
        }
        let body = &world.bodies()[0];
        let slid_m = Vector3::from(body.pose.position_m()).norm();
        if stays {
            assert!(slid_m < 0.15 && (tilt_deg(body) - 24.0).abs() < 2.0, "{slid_m} m, {}", tilt_deg(body));
        } else {
            assert!(slid_m > 0.5, "{slid_m} m");
        }
    }
}

#[test]
fn pushed_low_a_box_slides_and_pushed_high_it_tips() {
    for (height_m, tips) in [(0.05, false), (0.35, true)] {
        let mut world = contact_world(
            "[floor]
            friction = 0.6
            [hull]
            restitution = 0.0
            friction = 0.6
            [[bodies]]
            name = 'box'
            shape.box.size = [0.2, 0.4, 0.2]
            density = 80.0
            friction = 0.6
            restitution = 0.0
            place.at = [0.0, 0.2, 0.0]",
        );
        let mut most_deg: f64 = 0.0;
        while world.time_s() < 1.5 {
            let hand_m = -0.15 + 0.2 * world.next_time_s();
            let hand = move |point: Vector3<f64>| {
                let is_level = (point.y - height_m).abs() < 0.03;
                is_level.then(|| (Vector3::x(), hand_m - point.x))
            };
            let responses = responses(&world, &hand);
            world.step(&responses).expect("a step");
            most_deg = most_deg.max(tilt_deg(&world.bodies()[0]));
        }
        assert_eq!(most_deg > 45.0, tips, "pushed at {height_m} m it tilts by {most_deg} degrees");
        if !tips {
            assert!(most_deg < 5.0 && world.bodies()[0].pose.position_m()[0] > 0.1, "{most_deg} degrees");
        }
    }
}

#[test]
fn two_hands_hold_a_ball_and_what_they_crush_does_not_burst_free() {
    let mut world = contact_world(&format!(
        "{NO_FLOOR}
        [[bodies]]
        name = 'ball'
        shape.ball.radius = 0.1
        density = 80.0
        friction = 0.8
        restitution = 0.0
        place.at = [0.0, 1.0, 0.0]"
    ));
    let hands = |gap_m: f64| {
        move |point: Vector3<f64>| {
            let side = point.x.signum();
            Some((Vector3::x() * -side, point.x.abs() - 0.5 * gap_m))
        }
    };
    run_on(&mut world, 2.0, &hands(0.196));
    let fallen_m = 1.0 - world.bodies()[0].pose.position_m()[1];
    assert!(fallen_m < 0.02, "it fell by {fallen_m} m");
    run_on(&mut world, 1.0, &hands(0.05));
    let ball = &world.bodies()[0];
    assert!(Vector3::from(ball.velocity_m_s).norm() < 0.3, "{:?}", ball.velocity_m_s);
    run_on(&mut world, 0.5, &|_| None);
    let speed_m_s = Vector3::from(world.bodies()[0].velocity_m_s).norm();
    assert!(speed_m_s < 0.5 * 9.81 + 0.5, "{speed_m_s} m/s after half a second of fall");
}

#[test]
fn a_dropped_box_gains_no_energy() {
    for seed in 0..12 {
        let turn = f64::from(seed) * 14.0;
        let mut world = contact_world(&format!(
            "{NO_FLOOR}
            [[bodies]]
            name = 'box'
            shape.box.size = [0.16, 0.2, 0.12]
            density = 80.0
            friction = 0.6
            restitution = 0.2
            rotation_deg = [{turn}, {}, {}]
            place.at = [0.0, 0.5, 0.0]",
            2.0 * turn,
            0.7 * turn
        ));
        let ground = below(0.0, 0.0);
        let mut least_m = f64::INFINITY;
        while world.time_s() < 2.0 {
            let responses = responses(&world, &ground);
            world.step(&responses).expect("a step");
            let energy_m = world.solver.energy_m(0);
            assert!(
                energy_m < least_m + 5e-3,
                "seed {seed}, {} s: {energy_m} over {least_m}",
                world.time_s()
            );
            least_m = least_m.min(energy_m);
        }
    }
}

#[test]
fn a_ball_bounces_straight_up_as_high_as_its_restitution_says_and_gains_nothing() {
    for restitution in [0.5, 0.8, 1.0] {
        for height_m in [0.3, 0.71, 1.4] {
            let mut world = contact_world(&format!(
                "floor.enabled = false
                [hull]
                restitution = {restitution:?}
                friction = 0.5
                [[bodies]]
                name = 'ball'
                shape.ball.radius = 0.06
                restitution = {restitution:?}
                place.at = [0.0, {height_m}, 0.0]"
            ));
            let ground = below(0.0, 0.0);
            let start_m = world.solver.energy_m(0);
            let (mut least_m, mut falls, mut bounces) = (start_m, true, 0);
            while world.time_s() < 4.0 {
                let responses = responses(&world, &ground);
                world.step(&responses).expect("a step");
                let (energy_m, ball) = (world.solver.energy_m(0), &world.bodies()[0]);
                assert!(energy_m < least_m + 2e-3, "{restitution}: {energy_m} m over {least_m} m");
                least_m = least_m.min(energy_m);
                assert!(Vector3::from(ball.spin_rad_s).norm() < 0.1, "{:?}", ball.spin_rad_s);
                let rises = ball.velocity_m_s[1] > 0.0;
                bounces += i32::from(falls && rises);
                if falls && rises && bounces == 1 {
                    let expected = restitution * restitution * (start_m - 0.06);
                    let found = energy_m - 0.06;
                    assert!(
                        (found / expected - 1.0).abs() < 0.05,
                        "{restitution}: {found}, expected {expected}"
                    );
                }
                falls = !rises;
            }
            assert!(bounces > 2, "{bounces}");
        }
    }
}

#[test]
fn contacts_that_are_no_numbers_do_no_harm() {
    let mut world = tower(1);
    let table = below(1.0, 0.0);
    run_on(&mut world, 0.5, &table);
    let mut wrong = responses(&world, &table);
    wrong[0].contacts[0].normal_world[1] = f32::NAN;
    let report = world.step(&wrong).expect("a step");
    assert_eq!(report.faults.len(), 1);
    assert_eq!(report.faults[0].kind, FaultKind::Response);
    run_on(&mut world, 1.0, &table);
    assert!((world.bodies()[0].pose.position_m()[1] - 1.1).abs() < 2e-3);
}

#[test]
fn contacts_whose_normals_have_no_length_or_any_other_do_no_harm() {
    for length in [0.0, 1e-30, 1e3, 1e30] {
        let mut world = tower(1);
        let table = below(1.0, 0.0);
        run_on(&mut world, 0.5, &table);
        // For as long as it would fall by a few centimetres without them.
        for _ in 0..12 {
            let mut wrong = responses(&world, &table);
            for contact in &mut wrong[0].contacts {
                contact.normal_world = contact.normal_world.map(|part| part * length);
            }
            world.step(&wrong).expect("a step");
            let speed_m_s = Vector3::from(world.bodies()[0].velocity_m_s).norm();
            assert!(speed_m_s < 1.1, "{speed_m_s} m/s with normals of length {length}");
        }
        run_on(&mut world, 1.0, &table);
        assert!((world.bodies()[0].pose.position_m()[1] - 1.1).abs() < 2e-3, "{length}");
    }
}

#[test]
fn a_body_that_is_taken_away_takes_its_contacts_along() {
    let mut world = tower(2);
    let table = below(1.0, 0.0);
    run_on(&mut world, 1.0, &table);
    world.remove(world.bodies()[0].id).expect("it is there");
    run_on(&mut world, 2.0, &table);
    assert!(
        (world.bodies()[0].pose.position_m()[1] - 1.1).abs() < 2e-3,
        "the other came down onto the table"
    );
}

#[test]
fn bodies_that_do_not_answer_fall_through() {
    let mut world = tower(1);
    let table = below(1.0, 0.0);
    run_on(&mut world, 0.5, &table);
    world.set(Parameters { answers_hull: Some(false), ..Default::default() }).expect("set");
    run_on(&mut world, 1.0, &table);
    assert!(world.bodies()[0].pose.position_m()[1] < 0.0);
}

#[test]
fn bodies_of_any_weight_rest() {
    for mass_kg in [0.001, 10_000.0] {
        let mut world = contact_world(&format!(
            "{NO_FLOOR}
            [[bodies]]
            name = 'box'
            shape.box.size = [0.2, 0.2, 0.2]
            mass = {mass_kg}
            friction = 0.8
            restitution = 0.0
            place.at = [0.0, 1.12, 0.0]"
        ));
        run_on(&mut world, 4.0, &below(1.0, 0.0));
        let body = &world.bodies()[0];
        assert!((body.pose.position_m()[1] - 1.1).abs() < 3e-3, "{mass_kg} kg: {:?}", body.pose);
        assert!(world.is_asleep(body.id), "{mass_kg} kg");
    }
}

#[test]
fn a_body_that_is_born_inside_or_swallowed_glides_out() {
    let table = below(1.0, 0.0);
    for (depth_m, absent_s) in [(0.1, 0.0), (0.25, 0.0), (0.0, 0.2)] {
        let mut world = tower(1);
        let start_m = world.bodies()[0].pose.position_m()[1];
        let hull = below(1.0 + depth_m, 0.0);
        run_on(&mut world, 0.5, &table);
        // The hull is gone for a while (a camera is lost), or is suddenly higher.
        run_on(&mut world, absent_s, &|_| None);
        let mut fastest_m_s: f64 = 0.0;
        for _ in 0..100 {
            run_on(&mut world, 0.02, &hull);
            let velocity = Vector3::from(world.bodies()[0].velocity_m_s);
            fastest_m_s = fastest_m_s.max(velocity.y);
        }
        let height_m = world.bodies()[0].pose.position_m()[1] - start_m - depth_m;
        assert!(height_m.abs() < 5e-3, "{depth_m} m: {height_m} m off");
        assert!(fastest_m_s < 1.2, "{depth_m} m: thrown at {fastest_m_s} m/s");
    }
}

#[test]
fn a_board_wider_than_the_hull_lies_on_it() {
    let mut world = contact_world(&format!(
        "{NO_FLOOR}
        [[bodies]]
        name = 'board'
        shape.box.size = [1.6, 0.04, 1.2]
        density = 80.0
        friction = 0.8
        restitution = 0.0
        place.at = [0.05, 1.03, 0.03]"
    ));
    let table = below(1.0, 0.0);
    let post = move |point: Vector3<f64>| table(point).filter(|_| point.x.abs() < 0.2 && point.z.abs() < 0.2);
    run_on(&mut world, 4.0, &post);
    let board = &world.bodies()[0];
    assert!(tilt_deg(board) < 0.5 && (board.pose.position_m()[1] - 1.02).abs() < 3e-3, "{:?}", board.pose);
}

#[test]
fn what_stands_on_a_surface_that_slides_and_turns_goes_along_and_stops_with_it() {
    let text = "gravity = [0, -9.81, 0]\n[hull]\nfriction = 0.8\n[[bodies]]\nname = \"box\"\n\
                shape.box.size = [0.2, 0.2, 0.2]\nplace.stack.foot = [0, 1, 0]\nfriction = 0.8\nrestitution = 0";
    let mut world = contact_world(text);
    let hull = below(1.0, 0.0);
    let mut ride = |slide_m_s: [f32; 3], spin_rad_s: [f32; 3]| {
        for _ in 0..120 {
            let mut responses = responses(&world, &hull);
            responses[0].spin_rad_s = spin_rad_s;
            responses[0].contacts.iter_mut().for_each(|contact| contact.slide_m_s = slide_m_s);
            assert!(world.step(&responses).expect("a step").faults.is_empty());
        }
        let body = world.moving_bodies().next().expect("the box");
        (Vector3::from(body.velocity_m_s), Vector3::from(body.spin_rad_s))
    };
    let (velocity_m_s, _) = ride([0.5, 0.0, -0.2], [0.0; 3]);
    assert!((velocity_m_s - Vector3::new(0.5, 0.0, -0.2)).norm() < 0.01, "{velocity_m_s}");
    let (_, spin_rad_s) = ride([0.0; 3], [0.0, 0.6, 0.0]);
    assert!((spin_rad_s - Vector3::new(0.0, 0.6, 0.0)).norm() < 0.03, "{spin_rad_s}");
    // Still to the bit once nothing moves.
    ride([0.0; 3], [0.0; 3]);
    let rests = ride([0.0; 3], [0.0; 3]);
    assert_eq!(rests, (Vector3::zeros(), Vector3::zeros()));
}

#[test]
fn a_motion_that_is_no_number_is_a_fault_and_does_nothing() {
    let text = "[[bodies]]\nname = \"box\"\nshape.box.size = [0.2, 0.2, 0.2]\nplace.stack.foot = [0, 1, 0]";
    let mut world = contact_world(text);
    let spoil: [fn(&mut BodyResponse); 2] = [
        |response| response.contacts[0].slide_m_s[1] = f32::NAN,
        |response| response.spin_rad_s[2] = f32::INFINITY,
    ];
    for spoil in spoil {
        let mut responses = responses(&world, &below(1.0, 0.0));
        spoil(&mut responses[0]);
        let report = world.step(&responses).expect("a step");
        assert_eq!(report.faults.len(), 1);
        assert_eq!(report.faults[0].kind, FaultKind::Response);
        assert_eq!(world.patches().count(), 0);
        assert!(world.bodies()[0].velocity_m_s.iter().all(|part| part.is_finite()));
    }
}
