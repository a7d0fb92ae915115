//! A world as bytes and back. Every number is checked when it is read, by the checks of a scene's bodies.

use hull::Pose;
use prost::Message as _;
use proto::codec::{Entries, TooManyEntries, check_entries};
use proto::text::{MAX_NAME_CHARS, clean};
use sim::scene::MAX_BODIES;
use sim::{
    BodyRequest, BodySnapshot, BodySpec, MassSpec, Parameters, Scene, SceneError, ShapeRequest, Solid,
    ValueError, WorldSnapshot,
};
use thiserror::Error;

use super::message::{self, Mass};

/// Counted before a message is decoded: an empty one takes two bytes in it and two hundred in memory.
const ENTRIES: [Entries; 2] =
    [Entries::new("World.solids", &[10], MAX_BODIES), Entries::new("World.bodies", &[11], MAX_BODIES)];

/// Why bytes make no world. Every message is one line.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum WorldBytesError {
    /// They are no message.
    #[error("no world: {0}")]
    Message(#[from] prost::DecodeError),
    /// More bodies, or forms of them, than a world has.
    #[error(transparent)]
    Entries(#[from] TooManyEntries),
    /// A field that is not there, or holds another count of numbers.
    #[error("{field} holds {found} numbers, expected {expected}")]
    Count {
        /// Its name in the message.
        field: &'static str,
        /// Numbers found.
        found: usize,
        /// Numbers expected.
        expected: usize,
    },
    /// A field that must be there is not.
    #[error("{0} is missing")]
    Missing(&'static str),
    /// A form that no body has.
    #[error("body {body}: no form of a body has this place")]
    Solid {
        /// The body's number.
        body: u32,
    },
    /// A pose without numbers, or with a quaternion of another length than 1.
    #[error("body {body}: {error}")]
    Pose {
        /// The body's number.
        body: u32,
        /// What was found and expected.
        error: hull::body::BodyError,
    },
    /// A value that cannot be.
    #[error(transparent)]
    Value(#[from] ValueError),
    /// A scene that cannot be.
    #[error(transparent)]
    Scene(#[from] SceneError),
}

/// The bytes of a world.
pub fn world_to_bytes(world: &WorldSnapshot) -> Vec<u8> {
    world_to_message(world).encode_to_vec()
}

/// The world of such bytes.
pub fn world_from_bytes(bytes: &[u8]) -> Result<WorldSnapshot, WorldBytesError> {
    check_entries(&ENTRIES, bytes)?;
    world_from_message(message::World::decode(bytes)?)
}

pub(super) fn world_to_message(world: &WorldSnapshot) -> message::World {
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
        solids: solids.into_iter().map(solid_to_message).collect(),
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

fn solid_to_message(solid: &Solid) -> message::Solid {
    let extents_m = match solid {
        Solid::Box { size_m } => size_m.to_vec(),
        Solid::Ball { radius_m } => vec![*radius_m],
        Solid::Capsule { radius_m, length_m: long_m }
        | Solid::Cylinder { radius_m, height_m: long_m }
        | Solid::Cone { radius_m, height_m: long_m } => vec![*radius_m, *long_m],
        Solid::Hull(hull) => hull.points_m().as_flattened().to_vec(),
    };
    message::Solid { kind: solid.kind().to_owned(), extents_m }
}

pub(super) fn world_from_message(found: message::World) -> Result<WorldSnapshot, WorldBytesError> {
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
    let solids = found.solids.iter().map(solid_from_message).collect::<Result<Vec<Solid>, _>>()?;
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

fn solid_from_message(found: &message::Solid) -> Result<Solid, WorldBytesError> {
    let extents_m = &found.extents_m[..];
    let round = || numbers::<f64, 2>("extents_m", extents_m);
    let shape = match &found.kind[..] {
        "box" => ShapeRequest::Box { size: numbers("extents_m", extents_m)? },
        "ball" => {
            let [radius] = numbers("extents_m", extents_m)?;
            ShapeRequest::Ball { radius }
        }
        "capsule" => round().map(|[radius, length]| ShapeRequest::Capsule { radius, length })?,
        "cylinder" => round().map(|[radius, height]| ShapeRequest::Cylinder { radius, height })?,
        "cone" => round().map(|[radius, height]| ShapeRequest::Cone { radius, height })?,
        "hull" => {
            let points = extents_m.chunks(3).map(|point| numbers("extents_m", point));
            ShapeRequest::Hull { points: points.collect::<Result<_, _>>()? }
        }
        _ => return Err(WorldBytesError::Missing("kind")),
    };
    Ok(shape.check()?)
}

/// So many numbers.
fn numbers<T: Copy, const N: usize>(field: &'static str, found: &[T]) -> Result<[T; N], WorldBytesError> {
    let wrong = |_| WorldBytesError::Count { field, found: found.len(), expected: N };
    found.try_into().map_err(wrong)
}
