//! What a page says.

use serde_json::{Map, Value};

use crate::commands::{self, Request};
use crate::tier::Tier;

/// The highest rates that a page may ask for, a second.
const MAX_FPS: f64 = 240.0;
const MAX_STATE_HZ: f64 = 240.0;
const MAX_THUMBNAILS_HZ: f64 = 5.0;
/// Whoever wants some wants one in ten seconds at least.
const LEAST_HZ: f64 = 0.1;

/// What a page wants to see.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Want {
    /// The most of the colours.
    pub colour: Tier,
    /// Frame sets a second, at most; none at 0.
    pub fps: f64,
    /// Worlds a second, at most; none at 0.
    pub state_hz: f64,
    /// Whether worlds carry the samples that touch.
    pub touches: bool,
    /// Thumbnails a second; none at 0.
    pub thumbnails_hz: f64,
    /// The camera whose whole image is wanted.
    pub image_of: Option<String>,
    /// Whether frame sets carry silhouettes.
    pub silhouettes: bool,
}

impl Default for Want {
    fn default() -> Want {
        Want {
            colour: Tier::Full,
            fps: 30.0,
            state_hz: 60.0,
            touches: true,
            thumbnails_hz: 0.0,
            image_of: None,
            silhouettes: true,
        }
    }
}

/// A message of a page.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Incoming {
    Want(Want),
    /// A frame set was drawn.
    Shown(u32),
    Command(Request),
}

/// Reads a text; `want` is what the page wanted so far, of which it may change parts. The error is one line.
pub(crate) fn parse(text: &str, want: &Want) -> Result<Incoming, String> {
    let value: Value = serde_json::from_str(text).map_err(|error| format!("no JSON: {error}"))?;
    let Value::Object(object) = value else { return Err("no JSON object, expected one with \"op\"".into()) };
    match object.get("op").and_then(Value::as_str) {
        Some("want") => change(want.clone(), &object).map(Incoming::Want),
        Some("shown") => {
            let seq = object.get("seq").and_then(Value::as_u64).and_then(|seq| u32::try_from(seq).ok());
            seq.map(Incoming::Shown).ok_or_else(|| wrong("shown.seq", object.get("seq"), "a frame set's seq"))
        }
        Some("command") => commands::parse(&object).map(Incoming::Command),
        _ => Err(wrong("op", object.get("op"), "\"want\", \"shown\" or \"command\"")),
    }
}

fn change(mut want: Want, object: &Map<String, Value>) -> Result<Want, String> {
    for (key, value) in object {
        let rate = |most: f64| {
            let found = value.as_f64().filter(|&rate| rate == 0.0 || (LEAST_HZ..=most).contains(&rate));
            found.ok_or_else(|| {
                wrong(&format!("want.{key}"), Some(value), &format!("0, or {LEAST_HZ} to {most}"))
            })
        };
        let truth =
            || value.as_bool().ok_or_else(|| wrong(&format!("want.{key}"), Some(value), "true or false"));
        match key.as_str() {
            "op" => {}
            "colour" => {
                want.colour = value.as_str().and_then(Tier::from_name).ok_or_else(|| {
                    wrong("want.colour", Some(value), "\"full\", \"half\", \"quarter\" or \"off\"")
                })?;
            }
            "fps" => want.fps = rate(MAX_FPS)?,
            "state_hz" => want.state_hz = rate(MAX_STATE_HZ)?,
            "thumbnails_hz" => want.thumbnails_hz = rate(MAX_THUMBNAILS_HZ)?,
            "touches" => want.touches = truth()?,
            "silhouettes" => want.silhouettes = truth()?,
            "image_of" => {
                want.image_of = match value {
                    Value::Null => None,
                    Value::String(name) => Some(name.clone()),
                    other => return Err(wrong("want.image_of", Some(other), "a camera's name or null")),
                };
            }
            other => {
                let known = "colour, fps, state_hz, touches, thumbnails_hz, image_of or silhouettes";
                return Err(format!("want.{} is unknown, expected {known}", commands::short(&other.into())));
            }
        }
    }
    Ok(want)
}

fn wrong(key: &str, found: Option<&Value>, expected: &str) -> String {
    match found {
        Some(found) => format!("{key} is {}, expected {expected}", commands::short(found)),
        None => format!("{key} is missing, expected {expected}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_want_changes_what_it_names() {
        let first = Want { fps: 10.0, ..Want::default() };
        let text = r#"{"op":"want","colour":"half","image_of":"cam_1","touches":false}"#;
        let expected =
            Want { colour: Tier::Half, image_of: Some("cam_1".into()), touches: false, ..first.clone() };
        assert_eq!(parse(text, &first), Ok(Incoming::Want(expected)));
        assert_eq!(parse(r#"{"op":"shown","seq":7}"#, &first), Ok(Incoming::Shown(7)));
        let pause = parse(r#"{"op":"command","id":1,"command":"pause"}"#, &first);
        assert!(matches!(pause, Ok(Incoming::Command(Request { id: 1, command: Ok(_) }))));
    }

    #[test]
    fn what_is_no_message_is_told_why_in_one_line() {
        for (text, expected) in [
            ("hello", "no JSON: "),
            ("[]", "no JSON object, expected one with \"op\""),
            ("{}", "op is missing, expected \"want\", \"shown\" or \"command\""),
            (r#"{"op":"dance"}"#, "op is \"dance\", expected "),
            (r#"{"op":"want","fps":-1}"#, "want.fps is -1, expected 0, or 0.1 to 240"),
            (r#"{"op":"want","state_hz":1e-300}"#, "want.state_hz is 1e-300, expected 0, or 0.1 to 240"),
            (r#"{"op":"want","thumbnails_hz":9}"#, "want.thumbnails_hz is 9, expected 0, or 0.1 to 5"),
            (r#"{"op":"want","colour":"best"}"#, "want.colour is \"best\", expected \"full\""),
            (r#"{"op":"want","size":1}"#, "want.\"size\" is unknown, expected colour"),
            (r#"{"op":"shown","seq":-1}"#, "shown.seq is -1, expected a frame set's seq"),
            (r#"{"op":"command","command":"pause"}"#, "command.id is missing"),
        ] {
            let error = parse(text, &Want::default()).expect_err("refused");
            assert!(error.starts_with(expected) && !error.contains('\n'), "{text}: {error}");
        }
    }
}
