//! The world after a step, as other tools like to read it.

use coordinator::hooks::StepRecord;
use nalgebra::Point3;
use proto::recording::{self as messages, Bodies, BodyLook, Patch, Patches, Touch, Touches};
use sim::{Body, HullPatch, World};
use world_encodings::recording::{colour, rotation, vector};
use world_encodings::shape;

/// What bodies there are.
pub(crate) fn scene(generation: u32, world: &World) -> messages::Scene {
    let look = |body: &Body| BodyLook {
        id: body.id,
        name: body.name.clone(),
        solid: Some(shape::to_recording(&body.solid)),
        colour: Some(colour(body.color)),
        fixed: body.fixed,
    };
    messages::Scene {
        generation,
        name: world.scene().name().to_owned(),
        bodies: world.bodies().iter().map(look).collect(),
        up: Some(vector(world.up())),
        floor_m: world.scene().floor().map(|floor| floor.height_m),
    }
}

/// Where all bodies are.
pub(crate) fn bodies(record: &StepRecord<'_>) -> Bodies {
    let mut responses = record.responses.iter();
    let body = |body: &Body| {
        let response = if body.fixed { None } else { responses.next() };
        messages::Body {
            id: body.id,
            position_m: Some(vector(body.pose.position_m())),
            rotation: Some(rotation(body.pose.rotation_xyzw())),
            velocity_m_s: Some(vector(body.velocity_m_s)),
            spin_rad_s: Some(vector(body.spin_rad_s)),
            inside_samples: response.map_or(0, |response| response.inside_samples as u32),
            response_m: response.and_then(|response| response.response_m).map(vector),
        }
    };
    Bodies {
        generation: record.generation,
        step: record.step,
        film_s: record.film_s,
        frame: record.frame,
        bodies: record.world.bodies().iter().map(body).collect(),
    }
}

/// The samples that were inside the hull, where their bodies are after the step; `None` without any.
pub(crate) fn touches(record: &StepRecord<'_>) -> Option<Touches> {
    let mut found = Vec::new();
    for (body, collision) in record.world.moving_bodies().zip(record.collisions.unwrap_or_default()) {
        let world_from_body = body.pose.world_from_body();
        let samples = body.shape.samples_body();
        found.extend(collision.inside().map(|(sample, way_out_m)| {
            let point: Point3<f64> = world_from_body(samples[sample as usize]);
            Touch { body: body.id, point_m: Some(vector(point.into())), response_m: Some(vector(way_out_m)) }
        }));
    }
    let is_any = !found.is_empty();
    is_any.then_some(Touches { step: record.step, film_s: record.film_s, touches: found })
}

/// The hull's surface at the bodies after the step; `None` without any.
pub(crate) fn patches(record: &StepRecord<'_>) -> Option<Patches> {
    let bodies = record.world.bodies();
    let patch = |patch: HullPatch| {
        let HullPatch { body, point_m, normal_world, velocity_m_s, depth_m, radius_m, samples } = patch;
        let widened = |parts: [f32; 3]| Some(vector(parts.map(f64::from)));
        Patch {
            body: bodies[body as usize].id,
            point_m: widened(point_m),
            normal: widened(normal_world),
            velocity_m_s: widened(velocity_m_s),
            depth_m: depth_m.into(),
            radius_m: radius_m.into(),
            samples,
        }
    };
    let patches: Vec<Patch> = record.world.patches().map(patch).collect();
    let is_any = !patches.is_empty();
    is_any.then_some(Patches { step: record.step, film_s: record.film_s, patches })
}

#[cfg(test)]
mod tests {
    use sim::{BodyResponse, HullContact, ResponseMode, Scene, WorldSettings};

    use super::*;

    const BOX: &str =
        "[[bodies]]\nname = 'box'\nshape.box.size = [0.2, 0.2, 0.2]\nplace.at = [1.0, 2.0, 0.0]";

    /// A box of which one corner touches a surface that rises.
    fn stepped(response: ResponseMode) -> (World, Vec<BodyResponse>) {
        let scene = Scene::from_toml("test", BOX).expect("a scene");
        let settings = WorldSettings { response, ..WorldSettings::default() };
        let mut world = World::new(&scene, settings).expect("a world");
        let contact = HullContact {
            sample: 0,
            point_body_m: [-0.1; 3],
            normal_world: [0.0, 1.0, 0.0],
            depth_m: 0.0,
            speed_m_s: Some(0.5),
            slide_m_s: [0.0; 3],
        };
        let responses = vec![BodyResponse { contacts: vec![contact], ..BodyResponse::UNTOUCHED }];
        world.step(&responses).expect("a step");
        (world, responses)
    }

    fn recorded(world: &World, responses: &[BodyResponse]) -> Option<Patches> {
        patches(&StepRecord {
            generation: 0,
            step: 7,
            commands: &[],
            film_s: 0.5,
            slipped_s: 0.0,
            frame: Some(3),
            responses,
            collisions: None,
            step_ms: 0.0,
            world,
        })
    }

    #[test]
    fn the_surface_at_a_body_is_kept_under_contacts_alone() {
        let (world, responses) = stepped(ResponseMode::Contacts);
        let found = recorded(&world, &responses).expect("a patch");
        assert_eq!((found.step, found.film_s, found.patches.len()), (7, 0.5, 1));
        let patch = &found.patches[0];
        assert_eq!((patch.body, patch.samples, patch.radius_m), (world.bodies()[0].id, 1, 0.0));
        assert_eq!(
            (patch.normal, patch.velocity_m_s),
            (Some(vector([0.0, 1.0, 0.0])), Some(vector([0.0, 0.5, 0.0])))
        );
        // Below the corner, on the surface that has risen for a step.
        let point = patch.point_m.expect("a point");
        let corner: Point3<f64> = world.bodies()[0].pose.world_from_body()([-0.1; 3]);
        let surface_m = 1.9 + 0.5 * world.settings().dt_s;
        assert!((point.x - corner.x).abs() < 1e-6 && (point.y - surface_m).abs() < 1e-6, "{point:?}");
        assert!((patch.depth_m - (surface_m - corner.y)).abs() < 1e-6, "{patch:?}");
        let (world, responses) = stepped(ResponseMode::Paper);
        assert_eq!(recorded(&world, &responses), None);
    }
}
