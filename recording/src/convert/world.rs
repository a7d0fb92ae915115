//! The world after a step, as other tools like to read it.

use coordinator::hooks::StepRecord;
use nalgebra::Point3;
use sim::{Body, World};

use super::numbers::{colour, rotation, vector};
use super::solid::solid;
use crate::messages::{self, Bodies, BodyLook, Touch, Touches};

/// What bodies there are.
pub(crate) fn scene(generation: u32, world: &World) -> messages::Scene {
    let look = |body: &Body| BodyLook {
        id: body.id,
        name: body.name.clone(),
        solid: Some(solid(&body.solid)),
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
    for (body, result) in record.world.moving_bodies().zip(record.results.unwrap_or_default()) {
        let world_from_body = body.pose.world_from_body();
        let samples = body.shape.samples_body();
        found.extend(result.touches.iter().filter(|touch| touch.is_inside()).map(|touch| {
            let point: Point3<f64> = world_from_body(samples[touch.sample as usize]);
            Touch {
                body: body.id,
                point_m: Some(vector(point.into())),
                response_m: Some(vector(touch.response_m().unwrap_or_default())),
            }
        }));
    }
    let is_any = !found.is_empty();
    is_any.then_some(Touches { step: record.step, film_s: record.film_s, touches: found })
}
