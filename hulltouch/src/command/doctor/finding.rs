//! What a check found.

use serde::Serialize;

/// How bad it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Level {
    /// As it should be.
    Ok,
    /// It could not be looked at.
    Skip,
    /// It runs, and may stop or be worse than it could.
    Warn,
    /// It does not run so.
    Fail,
}

impl Level {
    /// As it is printed.
    pub fn word(self) -> &'static str {
        match self {
            Level::Ok => "ok",
            Level::Skip => "skip",
            Level::Warn => "warn",
            Level::Fail => "FAIL",
        }
    }
}

/// One line of a check.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Finding {
    /// How bad it is.
    pub level: Level,
    /// What was found.
    pub what: String,
    /// What to do about it.
    pub cure: Option<String>,
}

impl Finding {
    /// All is as it should be.
    pub fn ok(what: impl Into<String>) -> Finding {
        Finding { level: Level::Ok, what: what.into(), cure: None }
    }

    /// It could not be looked at, and why.
    pub fn skip(why: impl Into<String>) -> Finding {
        Finding { level: Level::Skip, what: why.into(), cure: None }
    }

    /// Something that may become worse.
    pub fn warn(what: impl Into<String>, cure: impl Into<String>) -> Finding {
        Finding { level: Level::Warn, what: what.into(), cure: Some(cure.into()) }
    }

    /// Something that does not run so.
    pub fn fail(what: impl Into<String>, cure: impl Into<String>) -> Finding {
        Finding { level: Level::Fail, what: what.into(), cure: Some(cure.into()) }
    }
}

/// What was found wrong, or else this.
pub fn or_ok(wrong: Vec<Finding>, well: impl FnOnce() -> Finding) -> Vec<Finding> {
    if wrong.is_empty() { vec![well()] } else { wrong }
}
