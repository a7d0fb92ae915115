//! Options whose values are those of an enum of a crate without clap.

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use proto::convert::Precision;
use sim::ResponseMode;

/// A value that an option takes: its name, the value, and its line in `--help`.
pub type NamedValue<T> = (&'static str, T, &'static str);

/// How bodies answer the hull.
pub const RESPONSES: [NamedValue<ResponseMode>; 2] = [
    ("paper", ResponseMode::Paper, "The paper's: translate, and mirror the velocity"),
    ("contacts", ResponseMode::Contacts, "Contacts with planes of the hull's surface, in the physics solver"),
];

/// How numbers travel between coordinator and nodes.
pub const PRECISIONS: [NamedValue<Precision>; 2] = [
    ("exact", Precision::Exact, "Every bit: the same run over every transport"),
    (
        "quantised",
        Precision::Quantised,
        "About half the bytes; responses within 0.1 mm but for rays that graze a pixel's corner",
    ),
];

/// A parser of these values by name. Its help, completion and errors are those of an enum that derives clap's `ValueEnum`.
pub fn named<T, const N: usize>(values: [NamedValue<T>; N]) -> impl TypedValueParser<Value = T>
where
    T: Copy + Send + Sync + 'static,
{
    let possible = values.map(|(name, _, help)| PossibleValue::new(name).help(help));
    PossibleValuesParser::new(possible).map(move |found: String| {
        let value = values.iter().find(|(name, ..)| *name == found);
        value.expect("the parser accepts these names alone").1
    })
}

#[cfg(test)]
mod tests {
    use std::ffi::OsStr;

    use clap::Command;

    use super::*;

    #[test]
    fn values_are_read_by_the_names_that_they_have_elsewhere() {
        let command = Command::new("program");
        for (name, response, _) in RESPONSES {
            assert_eq!(response.name(), name);
            let read = named(RESPONSES).parse_ref(&command, None, OsStr::new(name));
            assert_eq!(read.expect("a response"), response);
        }
        for (name, precision, _) in PRECISIONS {
            assert_eq!(precision.name(), name);
            let read = named(PRECISIONS).parse_ref(&command, None, OsStr::new(name));
            assert_eq!(read.expect("a precision"), precision);
        }
        let refused = named(PRECISIONS).parse_ref(&command, None, OsStr::new("Exact")).expect_err("refused");
        assert!(refused.to_string().contains("[possible values: exact, quantised]"), "{refused}");
    }
}
