//! What was asked of a run.

use coordinator::live::Command;
use proto::recording::{
    self as messages, Empty, Grab, Push, Release, TakeBackground, command::Command as Kind,
};
use world_encodings::recording::{
    ConvertError, body_spec, body_spec_from_message, finite, parameters, parameters_from_message, required,
    scene_of_text, scene_text, vector,
};
use world_encodings::{world_from_bytes, world_to_bytes};

const NAME: &str = "Command";

/// A command.
pub(crate) fn command_to_message(command: &Command) -> messages::Command {
    let kind = match command {
        Command::Pause => Kind::Pause(Empty {}),
        Command::Resume => Kind::Resume(Empty {}),
        Command::Step(steps) => Kind::Step(*steps),
        // How a recording is played is in no recording.
        Command::Seek { .. } | Command::SetSpeed(_) | Command::SetLoop(_) => {
            return messages::Command { command: None };
        }
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
        Command::Set(set) => Kind::Set(parameters(set)),
        Command::TakeBackground { seconds, allow_foreground } => {
            Kind::TakeBackground(TakeBackground { seconds: *seconds, allow_foreground: *allow_foreground })
        }
        Command::RestoreBackground { id } => Kind::RestoreBackground(*id),
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
        Kind::Set(set) => Command::Set(parameters_from_message(NAME, set)?),
        Kind::TakeBackgroundS(seconds) => Command::TakeBackground { seconds, allow_foreground: false },
        Kind::TakeBackground(TakeBackground { seconds, allow_foreground }) => {
            Command::TakeBackground { seconds, allow_foreground }
        }
        Kind::RestoreBackground(id) => Command::RestoreBackground { id },
    })
}
