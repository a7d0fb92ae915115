//! JSON text as a value that can be read in one way only: a key that stands twice in an object is an error.

use std::fmt;

use proto::text::clean;
use serde::de::{Deserialize, Deserializer, Error, MapAccess, SeqAccess, Visitor};
use serde_json::{Map, Number, Value};

/// The most characters of a key that an error repeats.
const MAX_KEY_CHARS: usize = 60;
/// The largest whole number to which every smaller one is exact as a float: 2⁵³ − 1.
const MAX_EXACT: f64 = 9_007_199_254_740_991.0;

/// The value of a text. `serde_json` itself keeps the last of two equal keys.
pub(crate) fn value(text: &str) -> Result<Value, serde_json::Error> {
    serde_json::from_str::<Unique>(text).map(|Unique(value)| value)
}

/// A whole number, also one that is written as a float: programs whose only numbers are floats write 12 as `12.0`.
/// A float beyond 2⁵³ − 1 may stand for several whole numbers and is none.
pub(crate) fn whole(value: &Value) -> Option<u64> {
    value.as_u64().or_else(|| {
        let float =
            value.as_f64().filter(|float| !value.is_i64() && !value.is_u64() && float.fract() == 0.0)?;
        (0.0..=MAX_EXACT).contains(&float).then_some(float as u64)
    })
}

struct Unique(Value);

impl<'de> Deserialize<'de> for Unique {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Unique, D::Error> {
        deserializer.deserialize_any(UniqueVisitor).map(Unique)
    }
}

struct UniqueVisitor;

impl<'de> Visitor<'de> for UniqueVisitor {
    type Value = Value;

    fn expecting(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str("a JSON value")
    }

    fn visit_unit<E>(self) -> Result<Value, E> {
        Ok(Value::Null)
    }

    fn visit_bool<E>(self, value: bool) -> Result<Value, E> {
        Ok(value.into())
    }

    fn visit_i64<E>(self, value: i64) -> Result<Value, E> {
        Ok(value.into())
    }

    fn visit_u64<E>(self, value: u64) -> Result<Value, E> {
        Ok(value.into())
    }

    fn visit_f64<E>(self, value: f64) -> Result<Value, E> {
        Ok(Number::from_f64(value).map_or(Value::Null, Value::Number))
    }

    fn visit_str<E>(self, value: &str) -> Result<Value, E> {
        Ok(value.into())
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut entries: A) -> Result<Value, A::Error> {
        let mut list = Vec::new();
        while let Some(Unique(value)) = entries.next_element()? {
            list.push(value);
        }
        Ok(list.into())
    }

    fn visit_map<A: MapAccess<'de>>(self, mut entries: A) -> Result<Value, A::Error> {
        let mut object = Map::new();
        while let Some((key, Unique(value))) = entries.next_entry::<String, Unique>()? {
            if object.contains_key(&key) {
                let key = clean(&key, MAX_KEY_CHARS);
                return Err(A::Error::custom(format_args!("key {key:?} stands twice, expected once")));
            }
            object.insert(key, value);
        }
        Ok(object.into())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn a_text_gives_the_value_that_it_always_gave() {
        for text in
            [r#"{"a": [1, -2, 3.5, null, true, "x", {"b": {}}], "c": 1e3}"#, "[]", "null", "-0.0", "\"\""]
        {
            let usual: Value = serde_json::from_str(text).expect("JSON");
            assert_eq!(value(text).expect("JSON"), usual, "{text}");
        }
    }

    #[test]
    fn a_key_that_stands_twice_is_refused_at_any_depth() {
        for text in
            [r#"{"a": 1, "a": 1}"#, r#"[{"b": {"a": 1, "c": 2, "a": 3}}]"#, r#"{"a": 1, "\u0061": 2}"#]
        {
            let error = value(text).expect_err("ambiguous").to_string();
            assert!(error.starts_with(r#"key "a" stands twice, expected once at line 1"#), "{text}: {error}");
        }
        let deep = "[".repeat(200) + &"]".repeat(200);
        assert!(value(&deep).expect_err("too deep").to_string().starts_with("recursion limit exceeded"));
    }

    #[test]
    fn whole_numbers_may_be_written_as_floats_up_to_where_floats_are_exact() {
        let read = |text: &str| whole(&value(text).expect("JSON"));
        for (text, expected) in [
            ("12", 12),
            ("12.0", 12),
            ("1e3", 1000),
            ("1.5e1", 15),
            ("0.0", 0),
            ("-0.0", 0),
            ("-0", 0),
            ("9007199254740991.0", (1 << 53) - 1),
            ("9007199254740993", (1 << 53) + 1),
            ("18446744073709551615", u64::MAX),
        ] {
            assert_eq!(read(text), Some(expected), "{text}");
        }
        for text in
            ["12.5", "-1", "-1.0", "1e-3", "9007199254740992.0", "1e300", "18446744073709551616", "\"12\""]
        {
            assert_eq!(read(text), None, "{text}");
        }
        assert_eq!(whole(&json!(null)), None);
    }
}
