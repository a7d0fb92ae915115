//! `${NAME}` in texts of configuration files.

use thiserror::Error;

/// Looks a variable of the environment up.
pub type Variables<'a> = &'a dyn Fn(&str) -> Option<String>;

/// A text with its variables filled in.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Expanded {
    /// The text.
    pub text: String,
    /// It begins with what stands in a variable, not with the file's own words.
    pub starts_with_variable: bool,
}

/// Why a text cannot be filled in.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum ExpandError {
    /// No value and no default.
    #[error("variable {name} is not set (in {text:?}), expected it in the environment")]
    Missing {
        /// The variable.
        name: String,
        /// The text as it stands in the file.
        text: String,
    },
    /// Not a name, or no end.
    #[error("found {text:?}, expected ${{NAME}} or ${{NAME:-default}}")]
    Form {
        /// The text as it stands in the file.
        text: String,
    },
}

/// Fills in `${NAME}` and `${NAME:-default}`; as in a shell, an empty variable counts as not set
/// where there is a default. `$${` becomes `${`; any other `$` stays.
pub fn expand(text: &str, variables: Variables<'_>) -> Result<Expanded, ExpandError> {
    let wrong = || ExpandError::Form { text: text.to_owned() };
    let mut expanded = Expanded { text: String::new(), starts_with_variable: false };
    let mut rest = text;
    while let Some(at) = rest.find("${") {
        let before = &rest[..at];
        if let Some(kept) = before.strip_suffix('$') {
            expanded.text.push_str(kept);
            expanded.text.push_str("${");
            rest = &rest[at + 2..];
            continue;
        }
        expanded.text.push_str(before);
        let (inner, after) = rest[at + 2..].split_once('}').ok_or_else(wrong)?;
        let (name, default) = match inner.split_once(":-") {
            Some((name, default)) => (name, Some(default)),
            None => (inner, None),
        };
        if name.is_empty() || !name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_') {
            return Err(wrong());
        }
        let is_first = expanded.text.is_empty();
        match (variables(name).filter(|value| default.is_none() || !value.is_empty()), default) {
            (Some(value), _) => {
                expanded.starts_with_variable |= is_first;
                expanded.text.push_str(&value);
            }
            (None, Some(default)) => expanded.text.push_str(default),
            (None, None) => {
                return Err(ExpandError::Missing { name: name.to_owned(), text: text.to_owned() });
            }
        }
        rest = after;
    }
    expanded.text.push_str(rest);
    Ok(expanded)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn variables(name: &str) -> Option<String> {
        match name {
            "DATA" => Some("/data".to_owned()),
            "EMPTY" => Some(String::new()),
            _ => None,
        }
    }

    #[track_caller]
    fn check(text: &str, expected: &str, starts_with_variable: bool) {
        let expected = Expanded { text: expected.to_owned(), starts_with_variable };
        assert_eq!(expand(text, &variables), Ok(expected));
    }

    #[test]
    fn variables_and_defaults_are_filled_in() {
        check("plain $5 {x}", "plain $5 {x}", false);
        check("${DATA}/a", "/data/a", true);
        check("a/${DATA}/${NONE:-b}", "a//data/b", false);
        check("${NONE:-../shared}/a", "../shared/a", false);
        check("${DATA:-../shared}/a", "/data/a", true);
        check("${EMPTY:-x}${EMPTY}y", "xy", false);
        check("$${DATA} ${NONE:-}", "${DATA} ", false);
    }

    #[test]
    fn what_is_missing_is_named() {
        let text = |text: &str| expand(text, &variables).expect_err("refused").to_string();
        assert_eq!(
            text("a/${NONE}"),
            "variable NONE is not set (in \"a/${NONE}\"), expected it in the environment"
        );
        let form = "expected ${NAME} or ${NAME:-default}";
        assert_eq!(text("${DATA"), format!("found \"${{DATA\", {form}"));
        assert_eq!(text("${A B}"), format!("found \"${{A B}}\", {form}"));
        assert_eq!(text("${}"), format!("found \"${{}}\", {form}"));
    }
}
