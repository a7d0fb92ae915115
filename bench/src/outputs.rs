//! Where a bench's figures and charts go, and numbers of the command line.

use std::fmt::Display;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use clap::Args;
use serde::Serialize;

use super::plot;
use super::table::write_json;
use cli::{ArgumentError, Outcome, check_writable};

/// The options that all benches share.
#[derive(Debug, Args)]
pub struct Outputs {
    /// Write the figures.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Draw charts into a folder.
    #[arg(long, value_name = "DIR")]
    plot: Option<PathBuf>,
}

/// A number on the command line, from `least` to `most`.
pub fn within<T: Copy + Display + FromStr + PartialOrd>(
    text: &str,
    least: T,
    most: T,
) -> Result<T, ArgumentError> {
    let found = text.parse().ok().filter(|number| (&least..=&most).contains(&number));
    found.ok_or_else(|| ArgumentError::new(text, format!("{least} to {most}")))
}

impl Outputs {
    /// Says now what would fail at the end, and makes the folder.
    pub fn prepare(&self) -> Outcome {
        if let Some(path) = &self.json {
            check_writable("--json", path)?;
        }
        self.plot.as_deref().map_or(Ok(()), plot::make_folder)
    }

    /// Writes what was asked for: `draw` is given the folder of the charts.
    pub fn write(&self, figures: &impl Serialize, draw: impl FnOnce(&Path) -> Outcome) -> Outcome {
        self.plot.as_deref().map_or(Ok(()), draw)?;
        write_json(figures, self.json.as_deref())
    }
}
