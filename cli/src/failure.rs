//! How the program fails: bad input is told from a run that failed.

use std::fmt::{self, Display};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// What a subcommand returns.
pub type Outcome<T = ()> = Result<T, Failure>;

/// One line for the user, and the exit status that goes with it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Failure {
    /// What was given is wrong: status 2.
    Input(String),
    /// It ran and failed: status 1.
    Run(String),
}

impl Failure {
    /// Bad input, in one line.
    pub fn input(problem: impl Display) -> Failure {
        Failure::Input(one_line(problem))
    }

    /// A failed run, in one line.
    pub fn run(problem: impl Display) -> Failure {
        Failure::Run(one_line(problem))
    }

    /// A file that cannot be read.
    pub fn unreadable(path: &Path, problem: impl Display) -> Failure {
        Failure::input(format_args!("{}: {problem}", path.display()))
    }

    /// A file that cannot be written: a full disk is no bad input.
    pub fn unwritable(path: &Path, problem: impl Display) -> Failure {
        Failure::run(format_args!("cannot write {}: {problem}", path.display()))
    }

    /// The exit status.
    pub fn exit_code(&self) -> ExitCode {
        match self {
            Failure::Input(_) => ExitCode::from(2),
            Failure::Run(_) => ExitCode::from(1),
        }
    }
}

impl Display for Failure {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (Failure::Input(problem) | Failure::Run(problem)) = self;
        formatter.write_str(problem)
    }
}

fn one_line(problem: impl Display) -> String {
    let text = problem.to_string();
    text.lines().map(str::trim).filter(|line| !line.is_empty()).collect::<Vec<_>>().join(", ")
}

/// Writes a file whole or not at all: beside it first, then in its place. What is no regular file (a
/// device, a pipe) is written to as it is.
pub fn write_whole(path: &Path, contents: &[u8]) -> Outcome {
    if is_special(path) {
        return std::fs::write(path, contents).map_err(|error| Failure::unwritable(path, error));
    }
    let beside = beside(path);
    let written = std::fs::write(&beside, contents).and_then(|()| std::fs::rename(&beside, path));
    written.map_err(|error| {
        // What is left of a failed attempt helps nobody.
        let _ = std::fs::remove_file(&beside);
        Failure::unwritable(path, error)
    })
}

/// Asks before a long run, not after it, whether a file can be written.
pub fn check_writable(flag: &str, path: &Path) -> Outcome {
    if is_special(path) {
        return Ok(());
    }
    let beside = beside(path);
    let tried = std::fs::write(&beside, b"").and_then(|()| std::fs::remove_file(&beside));
    tried.map_err(|error| Failure::input(format_args!("{flag} {}: {error}", path.display())))
}

fn is_special(path: &Path) -> bool {
    path.metadata().is_ok_and(|metadata| !metadata.is_file())
}

fn beside(path: &Path) -> PathBuf {
    let mut name = path.file_name().unwrap_or_default().to_owned();
    name.push(".partial");
    path.with_file_name(name)
}
