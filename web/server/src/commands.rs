//! Commands as JSON objects.

use std::ops::RangeInclusive;

use coordinator::live::{BodyId, Command, Parameters, SPEEDS};
use serde_json::{Map, Value};
use sim::{BodyRequest, BodySpec, FRICTION, RESTITUTION, Scene};

use crate::fields::{Fields, InputError, wrong};

/// The keys of every command beside its own.
const ENVELOPE: [&str; 3] = ["op", "id", "command"];
const COMMANDS: &str = "pause, resume, step, reset, choose, spawn, remove, push, grab, release, set, undo, \
    take_background, seek, speed or loop";
/// Film times of a recording, seconds; how long it is, the run knows.
const FILM_S: RangeInclusive<f64> = 0.0..=1e9;

/// A command and the number that its answer carries.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Request {
    /// Chosen by the client.
    pub id: u64,
    /// The command, or why it is none.
    pub command: Result<Ask, InputError>,
}

/// What a client asks for.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Ask {
    /// A command to the run.
    Run(Command),
    /// That what an earlier command took away comes back.
    Undo {
        /// The number of that command.
        of: u64,
    },
}

/// A `{"op":"command"}` message. An error means that it has no number; a command that is wrong in itself is in the
/// request, and is refused under its number.
pub(crate) fn parse(message: &Map<String, Value>) -> Result<Request, InputError> {
    let id = Fields { object: message, of: "command" }.whole("id", 0..=u64::MAX)?;
    Ok(Request { id, command: ask(message) })
}

fn ask(message: &Map<String, Value>) -> Result<Ask, InputError> {
    let name = Fields { object: message, of: "command" }.text("command")?;
    let fields = Fields { object: message, of: name };
    if name == "undo" {
        fields.only(&["of"], &ENVELOPE)?;
        return Ok(Ask::Undo { of: fields.whole("of", 0..=u64::MAX)? });
    }
    command(name, &fields).map(Ask::Run)
}

fn command(name: &str, fields: &Fields<'_>) -> Result<Command, InputError> {
    let only = |own: &[&str]| fields.only(own, &ENVELOPE);
    Ok(match name {
        "pause" => only(&[]).map(|()| Command::Pause)?,
        "resume" => only(&[]).map(|()| Command::Resume)?,
        "reset" => only(&[]).map(|()| Command::Reset)?,
        "step" => {
            only(&["steps"])?;
            let steps = fields.optional("steps", |f, key| f.whole(key, 0..=u32::MAX.into()))?;
            Command::Step(steps.unwrap_or(1) as u32)
        }
        "choose" => {
            only(&["scene"])?;
            Command::Choose(Scene::named(fields.text("scene")?)?)
        }
        "spawn" => Command::Spawn(Box::new(spawn(fields.object)?)),
        "remove" => {
            only(&["body"])?;
            Command::Remove(body(fields)?)
        }
        "push" => {
            only(&["body", "impulse", "at"])?;
            Command::Push {
                body: body(fields)?,
                impulse_n_s: fields.vector("impulse")?,
                at_m: fields.optional("at", Fields::vector)?,
            }
        }
        "grab" => {
            only(&["body", "grip", "target"])?;
            Command::Grab {
                body: body(fields)?,
                grip_body_m: fields.vector("grip")?,
                target_m: fields.vector("target")?,
            }
        }
        "release" => {
            only(&["body", "velocity"])?;
            Command::Release {
                body: body(fields)?,
                velocity_m_s: fields.optional("velocity", Fields::vector)?,
            }
        }
        "set" => Command::Set(parameters(fields)?),
        "take_background" => {
            only(&["seconds", "allow_foreground"])?;
            Command::TakeBackground {
                seconds: fields.number("seconds", film_time::BACKGROUND_S)?,
                allow_foreground: fields.optional("allow_foreground", Fields::truth)?.unwrap_or(false),
            }
        }
        "seek" => {
            only(&["film_s"])?;
            Command::Seek { film_s: fields.number("film_s", FILM_S)? }
        }
        "speed" => {
            only(&["factor"])?;
            Command::SetSpeed(fields.number("factor", SPEEDS)?)
        }
        "loop" => {
            only(&["on"])?;
            Command::SetLoop(fields.truth("on")?)
        }
        _ => return Err(wrong("command", &name.into(), COMMANDS)),
    })
}

fn body(fields: &Fields<'_>) -> Result<BodyId, InputError> {
    fields.whole("body", 0..=u32::MAX.into()).map(|id| id as BodyId)
}

fn parameters(fields: &Fields<'_>) -> Result<Parameters, InputError> {
    fields.only(&["answers_hull", "hull_restitution", "hull_friction", "gravity"], &ENVELOPE)?;
    let parameters = Parameters {
        answers_hull: fields.optional("answers_hull", Fields::truth)?,
        hull_restitution: fields.optional("hull_restitution", |f, key| f.number(key, RESTITUTION))?,
        hull_friction: fields.optional("hull_friction", |f, key| f.number(key, FRICTION))?,
        gravity_m_s2: fields.optional("gravity", Fields::vector)?,
    };
    if parameters == Parameters::default() {
        return Err(InputError::NothingToSet);
    }
    Ok(parameters)
}

/// A body with a scene's keys, and a pose of its own.
fn spawn(message: &Map<String, Value>) -> Result<BodySpec, InputError> {
    let own = message.iter().filter(|(key, _)| !ENVELOPE.contains(&key.as_str()));
    let own = own.map(|(key, value)| (key.clone(), value.clone())).collect();
    let request: BodyRequest = serde_json::from_value(Value::Object(own))
        .map_err(|error| InputError::BodyKeys(error.to_string()))?;
    request.check().map_err(|error| InputError::Body { of: "spawn.", error })
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;
    use sim::{MassSpec, Solid};

    fn read(message: Value) -> Result<Command, InputError> {
        let Value::Object(mut object) = message else { panic!("an object") };
        object.insert("op".into(), "command".into());
        object.insert("id".into(), 7.into());
        let request = parse(&object).expect("it has a number");
        assert_eq!(request.id, 7);
        request.command.map(|ask| match ask {
            Ask::Run(command) => command,
            Ask::Undo { of } => panic!("undo of {of}"),
        })
    }

    #[test]
    fn every_command_is_read() {
        let ok = |message| read(message).expect("a command");
        assert_eq!(ok(json!({"command": "pause"})), Command::Pause);
        assert_eq!(ok(json!({"command": "resume"})), Command::Resume);
        assert_eq!(ok(json!({"command": "reset"})), Command::Reset);
        assert_eq!(ok(json!({"command": "step"})), Command::Step(1));
        assert_eq!(ok(json!({"command": "step", "steps": 12})), Command::Step(12));
        let Command::Choose(scene) = ok(json!({"command": "choose", "scene": "crowd"})) else { panic!() };
        assert_eq!(scene.name(), "crowd");
        assert_eq!(ok(json!({"command": "remove", "body": 3})), Command::Remove(3));
        let push = json!({"command": "push", "body": 3, "impulse": [0, 1.5, 0], "at": [1, 2, 3]});
        let expected = Command::Push { body: 3, impulse_n_s: [0.0, 1.5, 0.0], at_m: Some([1.0, 2.0, 3.0]) };
        assert_eq!(ok(push), expected);
        let grab = json!({"command": "grab", "body": 1, "grip": [0, 0, 0.1], "target": [1, 1, 1]});
        let expected = Command::Grab { body: 1, grip_body_m: [0.0, 0.0, 0.1], target_m: [1.0; 3] };
        assert_eq!(ok(grab), expected);
        let release = json!({"command": "release", "body": 1, "velocity": [0, 3, 0]});
        assert_eq!(ok(release), Command::Release { body: 1, velocity_m_s: Some([0.0, 3.0, 0.0]) });
        let set = json!({"command": "set", "answers_hull": false, "gravity": [0, 0, 0]});
        let expected =
            Parameters { answers_hull: Some(false), gravity_m_s2: Some([0.0; 3]), ..Parameters::default() };
        assert_eq!(ok(set), Command::Set(expected));
        let background = json!({"command": "take_background", "seconds": 2.5});
        assert_eq!(ok(background), Command::TakeBackground { seconds: 2.5, allow_foreground: false });
        assert_eq!(ok(json!({"command": "seek", "film_s": 2.5})), Command::Seek { film_s: 2.5 });
        assert_eq!(ok(json!({"command": "speed", "factor": 4})), Command::SetSpeed(4.0));
        assert_eq!(ok(json!({"command": "loop", "on": true})), Command::SetLoop(true));
        let background = json!({"command": "take_background", "seconds": 2.5, "allow_foreground": true});
        assert_eq!(ok(background), Command::TakeBackground { seconds: 2.5, allow_foreground: true });
    }

    #[test]
    fn whole_numbers_of_every_command_may_be_written_as_floats() {
        let ok = |message| read(message).expect("a command");
        assert_eq!(ok(json!({"command": "step", "steps": 1e3})), Command::Step(1000));
        assert_eq!(ok(json!({"command": "remove", "body": 12.0})), Command::Remove(12));
        assert_eq!(ok(json!({"command": "remove", "body": -0.0})), Command::Remove(0));
        let push = ok(json!({"command": "push", "body": 3.0, "impulse": [0, 1, 0]}));
        assert!(matches!(push, Command::Push { body: 3, .. }), "{push:?}");
        let grab = ok(json!({"command": "grab", "body": 3.0, "grip": [0, 0, 0], "target": [0, 0, 0]}));
        assert!(matches!(grab, Command::Grab { body: 3, .. }), "{grab:?}");
        let release = ok(json!({"command": "release", "body": 3.0}));
        assert!(matches!(release, Command::Release { body: 3, .. }), "{release:?}");
        let Value::Object(numbered) = json!({"id": 7.0, "command": "pause"}) else { panic!("an object") };
        assert_eq!(parse(&numbered), Ok(Request { id: 7, command: Ok(Ask::Run(Command::Pause)) }));
        let Value::Object(between) = json!({"id": 7.5, "command": "pause"}) else { panic!("an object") };
        let error = parse(&between).expect_err("refused").to_string();
        assert!(error.starts_with("command.id is 7.5, expected a whole number"), "{error}");
    }

    #[test]
    fn a_body_is_spawned_as_a_scene_file_would_have_it() {
        let spawn = json!({"command": "spawn", "shape": {"box": {"size": [0.2, 0.3, 0.4]}},
            "position": [0, 2, 1], "rotation_xyzw": [0, 1, 0, 0], "mass": 2, "velocity": [0, 0, 3], "color": [1, 0, 0.5]});
        let Command::Spawn(body) = read(spawn).expect("a command") else { panic!("a spawn") };
        assert_eq!(body.solid, Solid::Box { size_m: [0.2, 0.3, 0.4] });
        assert_eq!(
            (body.pose.position_m(), body.pose.rotation_xyzw()),
            ([0.0, 2.0, 1.0], [0.0, 1.0, 0.0, 0.0])
        );
        assert_eq!(body.velocity_m_s, [0.0, 0.0, 3.0]);
        assert_eq!((body.mass, body.color), (MassSpec::MassKg(2.0), [1.0, 0.0, 0.5]));
        let hull = json!({"command": "spawn", "position": [0, 1, 0], "name": "rock",
            "shape": {"hull": {"points": [[0, 0, 0], [0.2, 0, 0], [0, 0.2, 0], [0, 0, 0.2]]}}});
        let Command::Spawn(body) = read(hull).expect("a command") else { panic!("a spawn") };
        assert_eq!((&body.name[..], body.solid.kind()), ("rock", "hull"));
    }

    #[test]
    fn what_is_wrong_is_said_in_one_line_with_field_found_and_expected() {
        for (message, expected) in [
            (json!({}), "command.command is missing"),
            (json!({"command": 3}), "command.command is 3, expected a text"),
            (json!({"command": "pause", "x": 1}), "pause.x is unknown, expected no fields"),
            (
                json!({"command": "remove", "body": -1}),
                "remove.body is -1, expected a whole number from 0 to",
            ),
            (json!({"command": "remove"}), "remove.body is missing"),
            (
                json!({"command": "push", "body": 1, "impulse": [1, "x", 2]}),
                "push.impulse is [1,\"x\",2], expected 3 numbers",
            ),
            (
                json!({"command": "push", "body": 1, "impulse": [1, 1e60, 2]}),
                "push.impulse is [1,1e+60,2], expected 3 numbers",
            ),
            (json!({"command": "choose", "scene": "tople"}), "no scene is called `tople`, expected one of"),
            (json!({"command": "set"}), "set has no field"),
            (
                json!({"command": "set", "hull_friction": 11}),
                "set.hull_friction is 11, expected a number from 0",
            ),
            (
                json!({"command": "step", "steps": 1e10}),
                "step.steps is 10000000000.0, expected a whole number",
            ),
            (json!({"command": "step", "steps": 12.5}), "step.steps is 12.5, expected a whole number"),
            (json!({"command": "remove", "body": 3.25}), "remove.body is 3.25, expected a whole number"),
            (json!({"command": "remove", "body": "3"}), "remove.body is \"3\", expected a whole number"),
            (
                json!({"command": "take_background", "seconds": 31}),
                "take_background.seconds is 31, expected a number from 0.2 to 30",
            ),
            (json!({"command": "seek", "film_s": -0.5}), "seek.film_s is -0.5, expected a number from 0 to"),
            (json!({"command": "seek", "film_s": null}), "seek.film_s is null, expected a number from 0 to"),
            (json!({"command": "seek"}), "seek.film_s is missing"),
            (
                json!({"command": "speed", "factor": 11}),
                "speed.factor is 11, expected a number from 0.1 to 10",
            ),
            (json!({"command": "loop", "on": 1}), "loop.on is 1, expected true or false"),
            (
                json!({"command": "spawn", "position": [0, 0, 0], "shape": {"ball": {"radius": 90}}}),
                "spawn.shape.ball.radius: 90",
            ),
            (json!({"command": "spawn", "position": [0, 0, 0], "shape": {"torus": {}}}), "torus"),
            (
                json!({"command": "spawn", "position": [0, 0, 0], "shape": {"ball": {"radius": 0.1}}, "mass": -1}),
                "spawn.mass: -1",
            ),
            (json!({"command": "spawn", "position": [0, 0, 0], "shape": null}), "spawn: "),
        ] {
            let error = read(message.clone()).expect_err("refused").to_string();
            assert!(error.contains(expected) && !error.contains('\n'), "{message}: {error}");
        }
    }

    #[test]
    fn an_undo_names_the_command_that_it_is_of() {
        let read = |message: Value| {
            let Value::Object(object) = message else { panic!("an object") };
            parse(&object).expect("it has a number").command
        };
        let undo = json!({"op": "command", "id": 8, "command": "undo", "of": 7});
        assert_eq!(read(undo), Ok(Ask::Undo { of: 7 }));
        let error = read(json!({"op": "command", "id": 8, "command": "undo"})).expect_err("refused");
        assert!(error.to_string().starts_with("undo.of is missing, expected a whole number"), "{error}");
    }

    #[test]
    fn a_command_without_a_number_is_none() {
        let Value::Object(object) = json!({"op": "command", "command": "pause"}) else { panic!() };
        let error = parse(&object).expect_err("refused").to_string();
        assert!(error.starts_with("command.id is missing, expected a whole number"), "{error}");
    }
}
