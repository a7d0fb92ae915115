//! Bodies and parameters of the gRPC service `World`.

pub(crate) mod values;

use proto::v1;
use sim::{BodyRequest, Parameters};

use crate::shape;

pub use values::{Missing, needed, numbers, vector};

/// A body to spawn. Only the presence of shape and position is checked.
pub fn body_request(request: v1::SpawnRequest) -> Result<BodyRequest, Missing> {
    let v1::SpawnRequest {
        name,
        shape,
        position,
        rotation,
        velocity,
        mass,
        density,
        friction,
        restitution,
        fixed,
        color,
    } = request;
    Ok(BodyRequest {
        name: Some(name),
        shape: shape::from_service(shape)?,
        position: needed("position", position)?,
        rotation_xyzw: rotation.map(|v1::Quaternion { x, y, z, w }| [x, y, z, w]),
        velocity: velocity.map(numbers),
        mass,
        density,
        friction,
        restitution,
        fixed,
        color: color.map(|v1::Color { red, green, blue }| [red, green, blue]),
    })
}

/// A rotation.
pub fn quaternion([x, y, z, w]: [f64; 4]) -> v1::Quaternion {
    v1::Quaternion { x, y, z, w }
}

/// A colour.
pub fn color(srgb: [f32; 3]) -> v1::Color {
    let [red, green, blue] = srgb.map(f64::from);
    v1::Color { red, green, blue }
}

/// Parameters of the world.
pub fn parameters(parameters: &Parameters) -> v1::Parameters {
    let Parameters { answers_hull, hull_restitution, hull_friction, gravity_m_s2 } = *parameters;
    v1::Parameters { answers_hull, hull_restitution, hull_friction, gravity: gravity_m_s2.map(vector) }
}

/// Parameters as a caller asks for them; the world checks them.
pub fn parameters_from_message(message: v1::Parameters) -> Parameters {
    let v1::Parameters { answers_hull, hull_restitution, hull_friction, gravity } = message;
    Parameters { answers_hull, hull_restitution, hull_friction, gravity_m_s2: gravity.map(numbers) }
}
