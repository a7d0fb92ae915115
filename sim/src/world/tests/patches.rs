//! What the world says of the hull's surface at its bodies.

use super::contacts::{below, contact_world, responses, run_on, tower};
use super::*;
use crate::{HullPatch, MAX_PATCHES};

#[test]
fn a_box_that_rides_has_one_patch_below_it_that_moves_as_the_surface_does() {
    let mut world = tower(1);
    let table = below(1.0, 0.0);
    run_on(&mut world, 1.0, &table);
    assert_eq!(world.patches().map(|patch| patch.velocity_m_s).collect::<Vec<_>>(), [[0.0; 3]]);
    let mut response = responses(&world, &table);
    for contact in &mut response[0].contacts {
        (contact.speed_m_s, contact.slide_m_s) = (Some(0.25), [0.5, 0.0, 0.0]);
    }
    world.step(&response).expect("a step");
    let [patch] = world.patches().collect::<Vec<_>>()[..] else { panic!("expected one patch") };
    let at_m = world.bodies()[0].pose.position_m();
    assert!(patch.body == 0 && patch.normal_world[1] > 0.999, "{patch:?}");
    assert_eq!(patch.samples as usize, response[0].contacts.len());
    let off_m_s = [0.5, 0.25, 0.0].iter().zip(patch.velocity_m_s).map(|(told, found)| (told - found).abs());
    assert!(off_m_s.fold(0.0, f32::max) < 1e-4, "{patch:?}");
    let off_m = [0, 2].map(|axis| (f64::from(patch.point_m[axis]) - at_m[axis]).abs());
    assert!(off_m.iter().all(|&off_m| off_m < 5e-3), "{patch:?}, the box at {at_m:?}");
    // The surface rises with its proxy.
    assert!((patch.point_m[1] - (1.0 + 0.25 / 120.0)).abs() < 1e-3, "{patch:?}");
    assert!((0.1..0.15).contains(&patch.radius_m), "{patch:?}: the corners of a side of 20 cm");
    assert!(patch.depth_m.abs() < 5e-3, "{patch:?}");
    // The hull goes, and its surface with it.
    run_on(&mut world, 0.1, &|_| None);
    assert_eq!(world.patches().count(), 0);
}

#[test]
fn patches_are_of_their_bodies_and_bounded() {
    let mut world = contact_world(
        "[floor]
        enabled = false
        [[bodies]]
        name = 'ball'
        shape.ball.radius = 0.1
        count = 2
        place.stack.foot = [0.0, 1.0, 0.0]",
    );
    // Surface all round the ball above, as a clenched hand is; the other hangs free.
    let hull = |point: Vector3<f64>| {
        let out = point - Vector3::y() * 1.3;
        (point.y > 1.2).then(|| (-out.normalize(), 0.001))
    };
    let answers = responses(&world, &hull);
    assert!(answers[1].contacts.len() > 20 && answers[0].contacts.is_empty());
    world.step(&answers).expect("a step");
    let patches: Vec<HullPatch> = world.patches().collect();
    assert_eq!(patches.len(), MAX_PATCHES);
    assert!(patches.iter().all(|patch| patch.body == 1), "{patches:?}");
    // The one below goes: the other has its place now.
    world.remove(world.bodies()[0].id).expect("it is there");
    assert!(world.patches().all(|patch| patch.body == 0));
}

#[test]
fn without_contacts_there_is_no_patch() {
    let mut world = world_of(STACK, 1);
    let push = BodyResponse { response_m: Some([0.0, 0.01, 0.0]), inside_samples: 3, ..Default::default() };
    let mut pushed = untouched(&world);
    pushed[0] = push;
    world.step(&pushed).expect("a step");
    assert_eq!(world.patches().count(), 0);
}
