//! What nodes remember of a world: as bytes and back. Every number is checked when it is read, by the checks of a scene's
//! bodies.

pub(crate) mod error;
pub mod message;

use hull::Pose;
use prost::Message as _;
use proto::codec::{Entries, check_entries};
use proto::text::{MAX_NAME_CHARS, clean};
use sim::scene::MAX_BODIES;
use sim::{
    BodyRequest, BodySnapshot, BodySpec, MassSpec, Parameters, Scene, ShapeRequest, Solid, WorldSnapshot,
};

use self::message::{Mass, numbers};
use crate::shape;

pub use error::WorldBytesError;

/// Counted before a message is decoded: an empty one takes two bytes in it and two hundred in memory.
const ENTRIES: [Entries; 2] =
    [Entries::new("World.solids", &[10], MAX_BODIES), Entries::new("World.bodies", &[11], MAX_BODIES)];

/// The bytes of a world.
pub fn world_to_bytes(world: &WorldSnapshot) -> Vec<u8> {
    world_to_message(world).encode_to_vec()
}

/// The world of such bytes.
pub fn world_from_bytes(bytes: &[u8]) -> Result<WorldSnapshot, WorldBytesError> {
    check_entries(&ENTRIES, bytes)?;
    world_from_message(message::World::decode(bytes)?)
}

/// The message of a world.
pub fn world_to_message(world: &WorldSnapshot) -> message::World {
    let scene = world.scene();
    let Parameters { answers_hull, hull_restitution, hull_friction, gravity_m_s2 } = world.parameters();
    let mut solids: Vec<&Solid> = vec![];
    let mut place = |solid| {
        let known = solids.iter().position(|known| *known == solid);
        known.unwrap_or_else(|| {
            solids.push(solid);
            solids.len() - 1
        })
    };
    let bodies = world.bodies().iter().map(|body| body_to_message(body, place(&body.spec.solid))).collect();
    message::World {
        scene_name: scene.name().to_owned(),
        scene_toml: scene.text().to_owned(),
        scene_gravity_m_s2: scene.gravity_m_s2().into(),
        answers_hull: answers_hull.unwrap_or(true),
        hull_restitution: hull_restitution.unwrap_or_default(),
        hull_friction: hull_friction.unwrap_or_default(),
        gravity_m_s2: gravity_m_s2.unwrap_or_default().into(),
        steps: world.steps(),
        next_id: world.next_id(),
        solids: solids.into_iter().map(shape::to_checkpoint).collect(),
        bodies,
    }
}

fn body_to_message(body: &BodySnapshot, solid: usize) -> message::Body {
    let BodySnapshot { id, spec, spin_rad_s } = body;
    let BodySpec { name, solid: _, pose, velocity_m_s, mass, friction, restitution, fixed, color } = spec;
    message::Body {
        id: *id,
        name: name.clone(),
        solid: solid as u32,
        color: color.to_vec(),
        fixed: *fixed,
        friction: *friction,
        restitution: *restitution,
        mass: Some(match *mass {
            MassSpec::MassKg(kg) => Mass::Kg(kg),
            MassSpec::DensityKgM3(kg_m3) => Mass::KgM3(kg_m3),
        }),
        position_m: pose.position_m().into(),
        rotation_xyzw: pose.rotation_xyzw().into(),
        velocity_m_s: velocity_m_s.to_vec(),
        spin_rad_s: spin_rad_s.to_vec(),
    }
}

/// The world of a message, every number of it checked.
pub fn world_from_message(found: message::World) -> Result<WorldSnapshot, WorldBytesError> {
    // It is shown, and came from a peer.
    let scene = Scene::from_toml(&clean(&found.scene_name, MAX_NAME_CHARS), &found.scene_toml)?
        .with_gravity(numbers("scene_gravity_m_s2", &found.scene_gravity_m_s2)?)?;
    let parameters = Parameters {
        answers_hull: Some(found.answers_hull),
        hull_restitution: Some(found.hull_restitution),
        hull_friction: Some(found.hull_friction),
        gravity_m_s2: Some(numbers("gravity_m_s2", &found.gravity_m_s2)?),
    };
    // Bodies of one form share it.
    let solid = |solid| Ok(shape::from_checkpoint(solid)?.check()?);
    let solids = found.solids.iter().map(solid).collect::<Result<Vec<Solid>, WorldBytesError>>()?;
    let bodies = found.bodies.into_iter().map(|body| body_from_message(body, &solids));
    let bodies = bodies.collect::<Result<_, _>>()?;
    Ok(WorldSnapshot::new(scene, parameters, found.steps, found.next_id, bodies)?)
}

fn body_from_message(found: message::Body, solids: &[Solid]) -> Result<BodySnapshot, WorldBytesError> {
    let body = found.id;
    let solid = solids.get(found.solid as usize).cloned().ok_or(WorldBytesError::Solid { body })?;
    let (mass, density) = match found.mass.ok_or(WorldBytesError::Missing("mass"))? {
        Mass::Kg(kg) => (Some(kg), None),
        Mass::KgM3(kg_m3) => (None, Some(kg_m3)),
    };
    let color: [f32; 3] = numbers("color", &found.color)?;
    // Its form is checked already, its pose and velocities may be what no request may ask for.
    let request = BodyRequest {
        name: None,
        shape: ShapeRequest::Ball { radius: 1.0 },
        position: [0.0; 3],
        rotation_xyzw: None,
        velocity: None,
        mass,
        density,
        friction: Some(found.friction),
        restitution: Some(found.restitution),
        fixed: found.fixed,
        color: Some(color.map(f64::from)),
    };
    let checked = request.check()?;
    let rotation_xyzw = numbers("rotation_xyzw", &found.rotation_xyzw)?;
    let pose = Pose::new(numbers("position_m", &found.position_m)?, rotation_xyzw);
    let pose = pose.map_err(|error| WorldBytesError::Pose { body, error })?;
    let velocity_m_s = numbers("velocity_m_s", &found.velocity_m_s)?;
    let spec = BodySpec { name: found.name, solid, pose, velocity_m_s, ..checked };
    Ok(BodySnapshot { id: body, spec, spin_rad_s: numbers("spin_rad_s", &found.spin_rad_s)? })
}

#[cfg(test)]
mod tests {
    use sim::{World, WorldSettings};

    use super::*;

    fn world() -> message::World {
        let scene = Scene::named("topple").expect("a scene");
        world_to_message(&World::new(&scene, WorldSettings::default()).expect("a world").snapshot())
    }

    fn error_of(change: fn(&mut message::World)) -> String {
        let mut changed = world();
        change(&mut changed);
        world_from_bytes(&changed.encode_to_vec()).expect_err("refused").to_string()
    }

    #[test]
    fn a_world_is_read_as_it_was_written() {
        let read = world_from_bytes(&world().encode_to_vec()).expect("a world");
        assert_eq!(world_to_message(&read), world());
    }

    #[test]
    fn half_a_million_empty_bodies_are_counted_before_they_are_decoded() {
        // Field 11 so often, each time an empty message.
        let error = world_from_bytes(&[0x5a, 0x00].repeat(500_000)).expect_err("refused").to_string();
        assert_eq!(error, "World.bodies: 500000 entries, expected at most 1000");
    }

    #[test]
    fn solids_that_are_none_are_refused() {
        assert_eq!(error_of(|world| world.solids[0].kind = "torus".into()), "kind is missing");
        let error = error_of(|world| world.solids[0].extents_m.truncate(1));
        assert_eq!(error, "extents_m holds 1 numbers, expected 3");
        let error = error_of(|world| world.bodies[0].solid = 99);
        assert_eq!(error, "body 0: no form of a body has this place");
    }
}
