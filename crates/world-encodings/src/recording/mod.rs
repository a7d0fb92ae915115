//! Bodies, parameters and scenes of a recording.

pub(crate) mod values;

use proto::recording::{self as messages, SceneText, body_spec};
use sim::{BodyRequest, BodySpec, MassSpec, Parameters, Scene};

use self::values::{colour_from_message, pose_from_message};
use crate::shape;

pub use values::{ConvertError, colour, finite, required, rotation, vector};

/// A body as it is put down.
pub fn body_spec(spec: &BodySpec) -> messages::BodySpec {
    let BodySpec { name, solid, pose, velocity_m_s, mass, friction, restitution, fixed, color } = spec;
    messages::BodySpec {
        name: name.clone(),
        solid: Some(shape::to_recording(solid)),
        position_m: Some(vector(pose.position_m())),
        rotation: Some(rotation(pose.rotation_xyzw())),
        velocity_m_s: Some(vector(*velocity_m_s)),
        mass_spec: Some(match *mass {
            MassSpec::MassKg(kg) => body_spec::MassSpec::MassKg(kg),
            MassSpec::DensityKgM3(kg_m3) => body_spec::MassSpec::DensityKgM3(kg_m3),
        }),
        friction: *friction,
        restitution: *restitution,
        fixed: *fixed,
        colour: Some(colour(*color)),
    }
}

/// The body of a message, with the checks of a scene's bodies.
pub fn body_spec_from_message(spec: messages::BodySpec) -> Result<BodySpec, ConvertError> {
    const NAME: &str = "BodySpec";
    let pose = pose_from_message(NAME, spec.position_m.as_ref(), spec.rotation.as_ref())?;
    let (mass, density) = match spec.mass_spec.ok_or_else(|| ConvertError::missing(NAME, "mass_spec"))? {
        body_spec::MassSpec::MassKg(kg) => (Some(kg), None),
        body_spec::MassSpec::DensityKgM3(kg_m3) => (None, Some(kg_m3)),
    };
    let request = BodyRequest {
        name: Some(spec.name),
        shape: shape::from_recording(spec.solid)?,
        position: pose.position_m(),
        rotation_xyzw: None,
        velocity: Some(required(NAME, "velocity_m_s", spec.velocity_m_s.as_ref())?),
        mass,
        density,
        friction: Some(spec.friction),
        restitution: Some(spec.restitution),
        fixed: spec.fixed,
        color: Some(colour_from_message(spec.colour.as_ref()).map(f64::from)),
    };
    let checked = request.check().map_err(|error| ConvertError::new(NAME, error))?;
    // A rotation that was normalised once is not normalised again: every bit counts.
    Ok(BodySpec { pose, ..checked })
}

/// Parameters of the world.
pub fn parameters(parameters: &Parameters) -> messages::Parameters {
    let Parameters { answers_hull, hull_restitution, hull_friction, gravity_m_s2 } = *parameters;
    messages::Parameters {
        answers_hull,
        hull_restitution,
        hull_friction,
        gravity_m_s2: gravity_m_s2.map(vector),
    }
}

/// The parameters of a message, which stand in the message that errors name; the world checks their ranges.
pub fn parameters_from_message(
    message_name: &'static str,
    message: messages::Parameters,
) -> Result<Parameters, ConvertError> {
    let messages::Parameters { answers_hull, hull_restitution, hull_friction, gravity_m_s2 } = message;
    let gravity_m_s2 = gravity_m_s2.map(|gravity| finite(message_name, &gravity)).transpose()?;
    Ok(Parameters { answers_hull, hull_restitution, hull_friction, gravity_m_s2 })
}

/// A scene by its text.
pub fn scene_text(scene: &Scene) -> SceneText {
    SceneText {
        name: scene.name().to_owned(),
        toml: scene.text().to_owned(),
        gravity_m_s2: Some(vector(scene.gravity_m_s2())),
    }
}

/// The scene of a text.
pub fn scene_of_text(text: &SceneText) -> Result<Scene, ConvertError> {
    const NAME: &str = "SceneText";
    let gravity_m_s2 = required(NAME, "gravity_m_s2", text.gravity_m_s2.as_ref())?;
    let scene = Scene::from_toml(&text.name, &text.toml);
    let scene = scene.and_then(|scene| scene.with_gravity(gravity_m_s2));
    scene.map_err(|error| ConvertError::new(NAME, error))
}
