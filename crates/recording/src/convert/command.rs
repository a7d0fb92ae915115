//! What was asked of a run.

use coordinator::live::{Command, Parameters};
use coordinator::{world_from_bytes, world_to_bytes};
use sim::Scene;

use super::ConvertError;
use super::numbers::{finite, required, vector};
use super::solid::{body_spec, body_spec_from_message};
use crate::messages::{self, Empty, Grab, Push, Release, SceneText, command::Command as Kind};

const NAME: &str = "Command";

/// A command.
pub(crate) fn command_to_message(command: &Command) -> messages::Command {
    let kind = match command {
        Command::Pause => Kind::Pause(Empty {}),
        Command::Resume => Kind::Resume(Empty {}),
        Command::Step(steps) => Kind::Step(*steps),
        Command::Reset => Kind::Reset(Empty {}),
        Command::Choose(scene) => Kind::Choose(scene_text(scene)),
        Command::GoOn(world) => Kind::GoOn(world_to_bytes(world)),
        Command::Spawn(spec) => Kind::Spawn(body_spec(spec)),
        Command::Remove(body) => Kind::Remove(*body),
        Command::Push { body, impulse_n_s, at_m } => {
            Kind::Push(Push { body: *body, impulse_n_s: Some(vector(*impulse_n_s)), at_m: at_m.map(vector) })
        }
        Command::Grab { body, grip_body_m, target_m } => Kind::Grab(Grab {
            body: *body,
            grip_body_m: Some(vector(*grip_body_m)),
            target_m: Some(vector(*target_m)),
        }),
        Command::Release { body, velocity_m_s } => {
            Kind::Release(Release { body: *body, velocity_m_s: velocity_m_s.map(vector) })
        }
        Command::Set(parameters) => Kind::Set(parameters_message(parameters)),
        Command::TakeBackground { seconds } => Kind::TakeBackgroundS(*seconds),
    };
    messages::Command { command: Some(kind) }
}

/// The command of a message.
pub(crate) fn command_from_message(message: messages::Command) -> Result<Command, ConvertError> {
    let kind = message.command.ok_or_else(|| ConvertError::missing(NAME, "command"))?;
    Ok(match kind {
        Kind::Pause(Empty {}) => Command::Pause,
        Kind::Resume(Empty {}) => Command::Resume,
        Kind::Step(steps) => Command::Step(steps),
        Kind::Reset(Empty {}) => Command::Reset,
        Kind::Choose(text) => Command::Choose(scene_of_text(&text)?),
        Kind::GoOn(bytes) => {
            let world = world_from_bytes(&bytes).map_err(|error| ConvertError::new(NAME, error))?;
            Command::GoOn(Box::new(world))
        }
        Kind::Spawn(spec) => Command::Spawn(Box::new(body_spec_from_message(spec)?)),
        Kind::Remove(body) => Command::Remove(body),
        Kind::Push(Push { body, impulse_n_s, at_m }) => Command::Push {
            body,
            impulse_n_s: required(NAME, "impulse_n_s", impulse_n_s.as_ref())?,
            at_m: at_m.map(|at_m| finite(NAME, &at_m)).transpose()?,
        },
        Kind::Grab(Grab { body, grip_body_m, target_m }) => Command::Grab {
            body,
            grip_body_m: required(NAME, "grip_body_m", grip_body_m.as_ref())?,
            target_m: required(NAME, "target_m", target_m.as_ref())?,
        },
        Kind::Release(Release { body, velocity_m_s }) => Command::Release {
            body,
            velocity_m_s: velocity_m_s.map(|velocity| finite(NAME, &velocity)).transpose()?,
        },
        Kind::Set(parameters) => Command::Set(Parameters {
            answers_hull: parameters.answers_hull,
            hull_restitution: parameters.hull_restitution,
            hull_friction: parameters.hull_friction,
            gravity_m_s2: parameters.gravity_m_s2.map(|gravity| finite(NAME, &gravity)).transpose()?,
        }),
        Kind::TakeBackgroundS(seconds) => Command::TakeBackground { seconds },
    })
}

fn parameters_message(parameters: &Parameters) -> messages::Parameters {
    let Parameters { answers_hull, hull_restitution, hull_friction, gravity_m_s2 } = *parameters;
    messages::Parameters {
        answers_hull,
        hull_restitution,
        hull_friction,
        gravity_m_s2: gravity_m_s2.map(vector),
    }
}

pub(super) fn scene_text(scene: &Scene) -> SceneText {
    SceneText {
        name: scene.name().to_owned(),
        toml: scene.text().to_owned(),
        gravity_m_s2: Some(vector(scene.gravity_m_s2())),
    }
}

pub(super) fn scene_of_text(text: &SceneText) -> Result<Scene, ConvertError> {
    let gravity_m_s2 = required("SceneText", "gravity_m_s2", text.gravity_m_s2.as_ref())?;
    let scene = Scene::from_toml(&text.name, &text.toml);
    let scene = scene.and_then(|scene| scene.with_gravity(gravity_m_s2));
    scene.map_err(|error| ConvertError::new("SceneText", error))
}
