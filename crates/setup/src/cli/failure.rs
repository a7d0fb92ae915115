//! How the program fails: bad input, a run that failed, or standard output that was closed.

use std::fmt::{self, Display};
use std::path::Path;
use std::process::ExitCode;

use camera_node::FilmCheckError;
use camera_node::capture::CaptureError;

use crate::{ClusterFileError, LocalClusterError, NodeConfigError};

/// The longest message, characters.
const MAX_CHARS: usize = 4000;
/// What shells show of a program that a closed pipe has ended: 128 and the number of SIGPIPE.
const CLOSED: u8 = 141;

/// What a subcommand returns.
pub type Outcome<T = ()> = Result<T, Failure>;

/// One line for the user, and the exit status that goes with it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Failure {
    /// What was given is wrong: status 2.
    Input(String),
    /// It ran and failed: status 1.
    Run(String),
    /// The reader of standard output has gone (`| head`): status 141 and no word, as if by SIGPIPE.
    Closed,
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
            Failure::Closed => ExitCode::from(CLOSED),
        }
    }
}

impl Display for Failure {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Failure::Input(problem) | Failure::Run(problem) => formatter.write_str(problem),
            Failure::Closed => formatter.write_str("standard output was closed"),
        }
    }
}

impl From<ClusterFileError> for Failure {
    fn from(error: ClusterFileError) -> Failure {
        Failure::input(error)
    }
}

impl From<NodeConfigError> for Failure {
    fn from(error: NodeConfigError) -> Failure {
        Failure::input(error)
    }
}

impl From<LocalClusterError> for Failure {
    fn from(error: LocalClusterError) -> Failure {
        match error {
            LocalClusterError::Input { .. } => Failure::input(error),
            LocalClusterError::Folder { .. }
            | LocalClusterError::LongFolder { .. }
            | LocalClusterError::Start { .. }
            | LocalClusterError::Failed { .. } => Failure::run(error),
        }
    }
}

impl From<FilmCheckError> for Failure {
    fn from(error: FilmCheckError) -> Failure {
        Failure::input(error)
    }
}

impl From<CaptureError> for Failure {
    fn from(error: CaptureError) -> Failure {
        Failure::run(error)
    }
}

/// Part of a message may come from another process or a file: nothing in it moves the cursor or forges a line.
fn one_line(problem: impl Display) -> String {
    let text = problem.to_string();
    let lines = text.lines().map(str::trim).filter(|line| !line.is_empty()).collect::<Vec<_>>().join(", ");
    proto::text::clean(&lines, MAX_CHARS)
}
