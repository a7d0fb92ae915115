//! The fields of a JSON object, each read strictly: it is known, there, and of its kind, or an error names it, what
//! was found and what was expected.

use std::ops::RangeInclusive;

use proto::text::clean;
use serde_json::{Map, Value};
use thiserror::Error;
use world_encodings::service::Missing;

use crate::json;

/// The most characters of a value that an error repeats.
const MAX_FOUND_CHARS: usize = 60;

/// Why a message of a page or a program cannot be read: one line.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum InputError {
    /// It is no JSON.
    #[error("no JSON: {0}")]
    NotJson(String),
    /// It can be read in two ways.
    #[error("message: {0}")]
    Ambiguous(String),
    /// It is no text.
    #[error("a binary message of {bytes} bytes, expected a text message with one JSON object")]
    Binary {
        /// Its length.
        bytes: usize,
    },
    /// A field is not there.
    #[error("{field} is missing, expected {expected}")]
    Missing {
        /// Its path in the message.
        field: String,
        /// What would be right.
        expected: String,
    },
    /// A field has another value or kind.
    #[error("{field} is {found}, expected {expected}")]
    Wrong {
        /// Its path in the message.
        field: String,
        /// Its value.
        found: String,
        /// What would be right.
        expected: String,
    },
    /// A field that the message has not.
    #[error("{field} is unknown, expected {expected}")]
    Unknown {
        /// Its path in the message.
        field: String,
        /// What there is.
        expected: String,
    },
    /// Parameters to set, and none among them.
    #[error("set has no field, expected one or more")]
    NothingToSet,
    /// A scene that does not come with the program.
    #[error(transparent)]
    Scene(#[from] sim::SceneError),
    /// A body with a key or a type that bodies have not.
    #[error("spawn: {0}")]
    BodyKeys(String),
    /// A body that cannot be.
    #[error("{of}{error}")]
    Body {
        /// What stands before its keys in the message.
        of: &'static str,
        /// The key, what was found and what was expected.
        error: sim::ValueError,
    },
}

impl From<Missing> for InputError {
    fn from(Missing { field, expected }: Missing) -> InputError {
        InputError::Missing { field: field.into(), expected: expected.into() }
    }
}

/// The object of a text.
pub(crate) fn object(text: &str) -> Result<Map<String, Value>, InputError> {
    match json::value(text) {
        Ok(Value::Object(object)) => Ok(object),
        Ok(other) => Err(wrong("message", &other, "an object with \"op\"")),
        Err(error) if error.is_data() => Err(InputError::Ambiguous(error.to_string())),
        Err(error) => Err(InputError::NotJson(error.to_string())),
    }
}

/// A field with another value than it can have.
pub(crate) fn wrong(field: &str, found: &Value, expected: &str) -> InputError {
    let found = clean(&found.to_string(), MAX_FOUND_CHARS);
    InputError::Wrong { field: field.into(), found, expected: expected.into() }
}

/// The fields of an object, and what it is called in errors.
#[derive(Clone, Copy)]
pub(crate) struct Fields<'a> {
    pub object: &'a Map<String, Value>,
    pub of: &'a str,
}

impl<'a> Fields<'a> {
    fn name(&self, key: &str) -> String {
        format!("{}.{key}", self.of)
    }

    /// Refuses keys other than these.
    pub fn only(&self, known: &[&str], envelope: &[&str]) -> Result<(), InputError> {
        let is_known = |key: &str| known.contains(&key) || envelope.contains(&key);
        let Some(key) = self.object.keys().find(|key| !is_known(key)) else { return Ok(()) };
        let expected = if known.is_empty() { "no fields".into() } else { known.join(", ") };
        Err(InputError::Unknown { field: self.name(&clean(key, MAX_FOUND_CHARS)), expected })
    }

    /// A field that need not be there.
    pub fn optional<T>(
        &self,
        key: &str,
        read: impl Fn(&Self, &str) -> Result<T, InputError>,
    ) -> Result<Option<T>, InputError> {
        if self.object.contains_key(key) { read(self, key).map(Some) } else { Ok(None) }
    }

    /// A field's value as something, if it can be that.
    pub fn read<T>(
        &self,
        key: &str,
        expected: &str,
        read: impl FnOnce(&'a Value) -> Option<T>,
    ) -> Result<T, InputError> {
        let Some(value) = self.object.get(key) else {
            return Err(InputError::Missing { field: self.name(key), expected: expected.into() });
        };
        read(value).ok_or_else(|| wrong(&self.name(key), value, expected))
    }

    pub fn text(&self, key: &str) -> Result<&'a str, InputError> {
        self.read(key, "a text", Value::as_str)
    }

    pub fn truth(&self, key: &str) -> Result<bool, InputError> {
        self.read(key, "true or false", Value::as_bool)
    }

    /// A whole number, which may be written as a float: `12.0` is 12, `12.5` is refused.
    pub fn whole(&self, key: &str, allowed: RangeInclusive<u64>) -> Result<u64, InputError> {
        let expected = format!("a whole number from {} to {}", allowed.start(), allowed.end());
        self.read(key, &expected, |value| json::whole(value).filter(|number| allowed.contains(number)))
    }

    pub fn number(&self, key: &str, allowed: RangeInclusive<f64>) -> Result<f64, InputError> {
        let expected = format!("a number from {} to {}", allowed.start(), allowed.end());
        self.read(key, &expected, |value| value.as_f64().filter(|number| allowed.contains(number)))
    }

    /// Three numbers that `f32` can hold: the solver's.
    pub fn vector(&self, key: &str) -> Result<[f64; 3], InputError> {
        let fits = |value: &Value| value.as_f64().filter(|number| (*number as f32).is_finite());
        self.read(key, "3 numbers", |value| {
            let numbers: Option<Vec<f64>> = value.as_array()?.iter().map(fits).collect();
            numbers?.try_into().ok()
        })
    }
}
