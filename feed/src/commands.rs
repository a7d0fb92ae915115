//! Commands as JSON objects, taken apart strictly: every field is known, there, and of its kind, or one line
//! says which is not, what was found and what was expected.

use std::ops::RangeInclusive;

use coordinator::live::{BodyId, Command, Parameters};
use serde_json::{Map, Value};
use sim::{BodyRequest, BodySpec, FRICTION, RESTITUTION, Scene};

/// The longest a background may be learnt, seconds.
const MAX_BACKGROUND_S: f64 = 60.0;
/// The most steps that one command makes.
const MAX_STEPS: u64 = 100_000;
/// The keys of every command beside its own.
const ENVELOPE: [&str; 3] = ["op", "id", "command"];

/// A command and the number that its answer carries.
#[derive(Clone, Debug, PartialEq)]
pub struct Request {
    /// Chosen by whoever asks.
    pub id: u64,
    /// What is asked, or why it is none.
    pub command: Result<Command, String>,
}

/// A `{"op":"command"}` message. An error says why it is none at all; a command that is wrong in itself is in
/// the request, and is refused under its number.
pub fn parse(message: &Map<String, Value>) -> Result<Request, String> {
    let fields = Fields { object: message, of: "command" };
    let id = fields.whole("id", u64::MAX)?;
    Ok(Request { id, command: command(message) })
}

fn command(message: &Map<String, Value>) -> Result<Command, String> {
    let name = Fields { object: message, of: "command" }.text("command")?;
    let fields = Fields { object: message, of: name };
    let only = |own: &[&str]| fields.only(own);
    Ok(match name {
        "pause" | "resume" | "reset" => {
            only(&[])?;
            match name {
                "pause" => Command::Pause,
                "resume" => Command::Resume,
                _ => Command::Reset,
            }
        }
        "step" => {
            only(&["steps"])?;
            let steps = if fields.has("steps") { fields.whole("steps", MAX_STEPS)? } else { 1 };
            Command::Step(steps as u32)
        }
        "choose" => {
            only(&["scene"])?;
            let scene = Scene::named(fields.text("scene")?);
            Command::Choose(scene.map_err(|error| error.to_string())?)
        }
        "spawn" => Command::Spawn(Box::new(spawn(message)?)),
        "remove" => {
            only(&["body"])?;
            Command::Remove(fields.body()?)
        }
        "push" => {
            only(&["body", "impulse", "at"])?;
            Command::Push {
                body: fields.body()?,
                impulse_n_s: fields.vector("impulse")?,
                at_m: fields.optional("at", Fields::vector)?,
            }
        }
        "grab" => {
            only(&["body", "grip", "target"])?;
            Command::Grab {
                body: fields.body()?,
                grip_body_m: fields.vector("grip")?,
                target_m: fields.vector("target")?,
            }
        }
        "release" => {
            only(&["body", "velocity"])?;
            Command::Release {
                body: fields.body()?,
                velocity_m_s: fields.optional("velocity", Fields::vector)?,
            }
        }
        "set" => Command::Set(parameters(&fields)?),
        "take_background" => {
            only(&["seconds"])?;
            Command::TakeBackground { seconds: fields.number("seconds", 0.0..=MAX_BACKGROUND_S)? }
        }
        other => return Err(format!("command is {other:?}, expected {COMMANDS}")),
    })
}

const COMMANDS: &str = "pause, resume, step, reset, choose, spawn, remove, push, grab, release, set or \
    take_background";

fn parameters(fields: &Fields<'_>) -> Result<Parameters, String> {
    fields.only(&["answers_hull", "hull_restitution", "hull_friction", "gravity"])?;
    let set = Parameters {
        answers_hull: fields.optional("answers_hull", Fields::truth)?,
        hull_restitution: fields.optional("hull_restitution", |f, key| f.number(key, RESTITUTION))?,
        hull_friction: fields.optional("hull_friction", |f, key| f.number(key, FRICTION))?,
        gravity_m_s2: fields.optional("gravity", Fields::vector)?,
    };
    if set == Parameters::default() {
        return Err("set has no field, expected one or more".into());
    }
    Ok(set)
}

/// A body with a scene's keys, and a pose of its own.
fn spawn(message: &Map<String, Value>) -> Result<BodySpec, String> {
    let own = message.iter().filter(|(key, _)| !ENVELOPE.contains(&key.as_str()));
    let own = own.map(|(key, value)| (key.clone(), value.clone())).collect();
    let request: BodyRequest =
        serde_json::from_value(Value::Object(own)).map_err(|error| format!("spawn: {error}"))?;
    request.check().map_err(|error| format!("spawn.{error}"))
}

/// The fields of an object, and whose they are.
struct Fields<'a> {
    object: &'a Map<String, Value>,
    of: &'a str,
}

impl<'a> Fields<'a> {
    fn has(&self, key: &str) -> bool {
        self.object.contains_key(key)
    }

    fn value(&self, key: &str) -> Result<&'a Value, String> {
        self.object.get(key).ok_or_else(|| format!("{}.{key} is missing", self.of))
    }

    fn only(&self, own: &[&str]) -> Result<(), String> {
        let known = |key: &str| own.contains(&key) || ENVELOPE.contains(&key);
        match self.object.keys().find(|key| !known(key)) {
            None => Ok(()),
            Some(key) if own.is_empty() => Err(format!("{}.{key} is unknown, expected no fields", self.of)),
            Some(key) => Err(format!("{}.{key} is unknown, expected {}", self.of, own.join(", "))),
        }
    }

    fn wrong<T>(&self, key: &str, found: &Value, expected: &str) -> Result<T, String> {
        Err(format!("{}.{key} is {}, expected {expected}", self.of, short(found)))
    }

    fn optional<T>(
        &self,
        key: &str,
        read: impl Fn(&Self, &str) -> Result<T, String>,
    ) -> Result<Option<T>, String> {
        if self.has(key) { read(self, key).map(Some) } else { Ok(None) }
    }

    fn text(&self, key: &str) -> Result<&'a str, String> {
        let value = self.value(key)?;
        value.as_str().map_or_else(|| self.wrong(key, value, "a text"), Ok)
    }

    fn truth(&self, key: &str) -> Result<bool, String> {
        let value = self.value(key)?;
        value.as_bool().map_or_else(|| self.wrong(key, value, "true or false"), Ok)
    }

    fn whole(&self, key: &str, most: u64) -> Result<u64, String> {
        let value = self.value(key)?;
        match value.as_u64() {
            Some(number) if number <= most => Ok(number),
            _ => self.wrong(key, value, &format!("a whole number from 0 to {most}")),
        }
    }

    fn number(&self, key: &str, allowed: RangeInclusive<f64>) -> Result<f64, String> {
        let value = self.value(key)?;
        match value.as_f64() {
            Some(number) if allowed.contains(&number) => Ok(number),
            _ => {
                let (least, most) = allowed.into_inner();
                self.wrong(key, value, &format!("a number from {least} to {most}"))
            }
        }
    }

    fn body(&self) -> Result<BodyId, String> {
        self.whole("body", u64::from(u32::MAX)).map(|id| id as BodyId)
    }

    fn vector(&self, key: &str) -> Result<[f64; 3], String> {
        self.numbers(key)
    }

    /// Numbers that `f32` can hold: the solver's.
    fn numbers<const N: usize>(&self, key: &str) -> Result<[f64; N], String> {
        let value = self.value(key)?;
        let fits = |value: &Value| value.as_f64().filter(|number| (*number as f32).is_finite());
        let numbers: Option<Vec<f64>> = value.as_array().and_then(|list| list.iter().map(fits).collect());
        let numbers = numbers.and_then(|numbers| numbers.try_into().ok());
        numbers.map_or_else(|| self.wrong(key, value, &format!("{N} numbers")), Ok)
    }
}

/// A value in a line of bearable length.
pub(crate) fn short(value: &Value) -> String {
    const MOST: usize = 60;
    let text = value.to_string();
    if text.chars().count() <= MOST { text } else { text.chars().take(MOST).chain("…".chars()).collect() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;
    use sim::{MassSpec, Solid};

    fn read(message: Value) -> Result<Command, String> {
        let Value::Object(mut object) = message else { panic!("an object") };
        object.insert("op".into(), "command".into());
        object.insert("id".into(), 7.into());
        let request = parse(&object).expect("it has a number");
        assert_eq!(request.id, 7);
        request.command
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
        assert_eq!(ok(background), Command::TakeBackground { seconds: 2.5 });
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
            (json!({"command": "step", "steps": 1e9}), "step.steps is 1000000000.0, expected a whole number"),
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
            let error = read(message.clone()).expect_err("refused");
            assert!(error.contains(expected) && !error.contains('\n'), "{message}: {error}");
        }
    }

    #[test]
    fn a_command_without_a_number_is_none() {
        let Value::Object(object) = json!({"op": "command", "command": "pause"}) else { panic!() };
        assert_eq!(parse(&object), Err("command.id is missing".into()));
    }
}
