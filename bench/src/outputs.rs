//! Where a bench's figures and charts go, and numbers of the command line.

use std::fmt::Display;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use clap::Args;
use serde::Serialize;
use setup::cli::{ArgumentError, Outcome, check_json_writable};

use super::plot;
use super::table::write_json;

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
            check_json_writable(path)?;
        }
        self.plot.as_deref().map_or(Ok(()), plot::make_folder)
    }

    /// Writes what was asked for, also of a bench that failed: what it measured until then. `draw` is given the folder
    /// of the charts. Returns why the bench failed, or else why its figures are not written.
    pub fn write(
        &self,
        measured: Outcome,
        figures: &impl Serialize,
        draw: impl FnOnce(&Path) -> Outcome,
    ) -> Outcome {
        let written = write_json(figures, self.json.as_deref());
        measured.and(written).and_then(|()| self.plot.as_deref().map_or(Ok(()), draw))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use setup::cli::Failure;

    #[test]
    fn figures_are_written_before_a_bench_ends_with_the_check_that_failed() {
        let folder = tempfile::tempdir().expect("a folder");
        let json = folder.path().join("figures.json");
        let outputs = Outputs { json: Some(json.clone()), plot: Some(folder.path().to_owned()) };
        let failed = Err(Failure::run("answers differ"));
        let mut is_drawn = false;
        let outcome = outputs.write(failed.clone(), &[1, 2], |_| {
            is_drawn = true;
            Ok(())
        });
        assert_eq!((outcome, is_drawn), (failed, false), "no charts of half a bench");
        let written = std::fs::read_to_string(json).expect("written");
        assert_eq!(written.split_whitespace().collect::<String>(), "[1,2]");
        assert_eq!(outputs.write(Ok(()), &[1, 2], |_| Ok(())), Ok(()));
    }
}
