//! The messages of a page.

use std::ops::RangeInclusive;

use serde_json::Value;

use crate::commands::{self, Request};
use crate::fields::{Fields, InputError, object, wrong};
use crate::message::WorldParts;
use crate::tier::Tier;

/// Rates that a page may ask for, a second, if it wants any.
const FPS: RangeInclusive<f64> = 0.1..=240.0;
const STATE_HZ: RangeInclusive<f64> = 0.1..=240.0;
const THUMBNAILS_HZ: RangeInclusive<f64> = 0.1..=5.0;

/// The wants of a page.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Want {
    /// The most of the colours.
    pub colour: Tier,
    /// Frame sets a second, at most; none at 0.
    pub fps: f64,
    /// Worlds a second, at most; none at 0.
    pub state_hz: f64,
    /// What worlds carry besides bodies.
    pub world: WorldParts,
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
            world: WorldParts { touches: true, patches: false },
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

/// Reads a text; `want` is what the page wanted so far, of which it may change parts.
pub(crate) fn parse(text: &str, want: &Want) -> Result<Incoming, InputError> {
    let object = object(text)?;
    let fields = |of| Fields { object: &object, of };
    match object.get("op").and_then(Value::as_str) {
        Some("want") => changed(want, &fields("want")).map(Incoming::Want),
        Some("shown") => Ok(Incoming::Shown(fields("shown").whole("seq", 0..=u32::MAX.into())? as u32)),
        Some("command") => commands::parse(&object).map(Incoming::Command),
        _ => Err(wrong("op", object.get("op").unwrap_or(&Value::Null), "\"want\", \"shown\" or \"command\"")),
    }
}

fn changed(want: &Want, fields: &Fields<'_>) -> Result<Want, InputError> {
    fields.only(
        &["colour", "fps", "state_hz", "touches", "patches", "thumbnails_hz", "image_of", "silhouettes"],
        &["op"],
    )?;
    let tier = |fields: &Fields<'_>, key: &str| {
        let tier = |value: &Value| value.as_str().and_then(Tier::from_name);
        fields.read(key, "\"full\", \"half\", \"quarter\" or \"off\"", tier)
    };
    let name = |fields: &Fields<'_>, key: &str| {
        fields.read(key, "a camera's name or null", |value| match value {
            Value::Null => Some(None),
            Value::String(name) => Some(Some(name.clone())),
            _ => None,
        })
    };
    Ok(Want {
        colour: fields.optional("colour", tier)?.unwrap_or(want.colour),
        fps: fields.optional("fps", rate(FPS))?.unwrap_or(want.fps),
        state_hz: fields.optional("state_hz", rate(STATE_HZ))?.unwrap_or(want.state_hz),
        world: WorldParts {
            touches: fields.optional("touches", Fields::truth)?.unwrap_or(want.world.touches),
            patches: fields.optional("patches", Fields::truth)?.unwrap_or(want.world.patches),
        },
        thumbnails_hz: fields.optional("thumbnails_hz", rate(THUMBNAILS_HZ))?.unwrap_or(want.thumbnails_hz),
        image_of: fields.optional("image_of", name)?.unwrap_or_else(|| want.image_of.clone()),
        silhouettes: fields.optional("silhouettes", Fields::truth)?.unwrap_or(want.silhouettes),
    })
}

/// Reads a rate within bounds, or none.
fn rate(allowed: RangeInclusive<f64>) -> impl Fn(&Fields<'_>, &str) -> Result<f64, InputError> {
    move |fields, key| {
        let expected = format!("0, or {} to {}", allowed.start(), allowed.end());
        fields.read(key, &expected, |value| {
            value.as_f64().filter(|rate| *rate == 0.0 || allowed.contains(rate))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_want_changes_what_it_names() {
        let first = Want { fps: 10.0, ..Want::default() };
        let text = r#"{"op":"want","colour":"half","image_of":"cam_1","touches":false,"patches":true}"#;
        let world = WorldParts { touches: false, patches: true };
        let expected = Want { colour: Tier::Half, image_of: Some("cam_1".into()), world, ..first.clone() };
        assert_eq!(parse(text, &first), Ok(Incoming::Want(expected)));
        assert_eq!(parse(r#"{"op":"shown","seq":7}"#, &first), Ok(Incoming::Shown(7)));
        assert_eq!(parse(r#"{"op":"shown","seq":7.0}"#, &first), Ok(Incoming::Shown(7)));
        let pause = parse(r#"{"op":"command","id":1,"command":"pause"}"#, &first);
        assert!(matches!(pause, Ok(Incoming::Command(Request { id: 1, command: Ok(_) }))));
    }

    #[test]
    fn an_invalid_message_is_answered_by_one_line_that_says_why() {
        for (text, expected) in [
            ("hello", "no JSON: "),
            ("[]", "message is [], expected an object with \"op\""),
            ("{}", "op is null, expected \"want\", \"shown\" or \"command\""),
            (r#"{"op":"dance"}"#, "op is \"dance\", expected "),
            (r#"{"op":"want","fps":-1}"#, "want.fps is -1, expected 0, or 0.1 to 240"),
            (r#"{"op":"want","state_hz":1e-300}"#, "want.state_hz is 1e-300, expected 0, or 0.1 to 240"),
            (r#"{"op":"want","thumbnails_hz":9}"#, "want.thumbnails_hz is 9, expected 0, or 0.1 to 5"),
            (r#"{"op":"want","colour":"best"}"#, "want.colour is \"best\", expected \"full\""),
            (r#"{"op":"want","size":1}"#, "want.size is unknown, expected colour"),
            (r#"{"op":"shown","seq":-1}"#, "shown.seq is -1, expected a whole number from 0 to 4294967295"),
            (r#"{"op":"command","command":"pause"}"#, "command.id is missing"),
            (r#"{"op":"shown","seq":1,"seq":2}"#, "message: key \"seq\" stands twice, expected once"),
        ] {
            let error = parse(text, &Want::default()).expect_err("refused").to_string();
            assert!(error.starts_with(expected) && !error.contains('\n'), "{text}: {error}");
        }
    }
}
