//! Other people's software to compare with: a Python program that answers requests, one JSON object a line.

use std::fmt::Display;
use std::io::{self, BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};

use camera_node::scratch::ScratchFolder;
use clap::Args;
use serde_json::Value;

use setup::cli::{Failure, Outcome, outln, temporary_folder};

/// Threads of every library underneath, so that one core is measured.
const ONE_THREAD: [&str; 4] =
    ["OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMEXPR_NUM_THREADS"];

/// Memory that was freed is kept for the next array (glibc): large images are not mapped again, page by page,
/// every time.
const KEEP_MEMORY: [(&str, &str); 2] =
    [("MALLOC_MMAP_MAX_", "0"), ("MALLOC_TRIM_THRESHOLD_", "1099511627776")];

/// A running Python program. It ends with this value.
pub struct Peer {
    child: Child,
    requests: Option<ChildStdin>,
    answers: BufReader<ChildStdout>,
    folder: ScratchFolder,
    greeting: Value,
}

/// Who runs the programs.
#[derive(Debug, Args)]
pub struct Python {
    /// A Python interpreter with OpenCV and NumPy.
    #[arg(long, value_name = "PATH", default_value = "python3")]
    python: String,
}

impl Python {
    /// Starts a program, or says why its rows are left out.
    pub fn start(&self, script: &str) -> Outcome<Option<Peer>> {
        match Peer::start(&self.python, script) {
            Ok(peer) => Ok(Some(peer)),
            Err(problem) => outln!("no rows of OpenCV: {problem}").map(|()| None),
        }
    }
}

impl Peer {
    /// Starts `script` (its text) under an interpreter. The program's first line must be its greeting, an
    /// object with `ready`.
    fn start(python: &str, script: &str) -> Outcome<Peer> {
        let folder = temporary_folder()?;
        let path = folder.path().join("peer.py");
        std::fs::write(&path, script).map_err(|error| Failure::unwritable(&path, error))?;
        let mut command = Command::new(python);
        command.arg(&path).envs(ONE_THREAD.map(|name| (name, "1"))).envs(KEEP_MEMORY);
        command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let refused = |problem: &dyn Display| Failure::run(format_args!("{python}: {problem}"));
        let mut child = command.spawn().map_err(|error| refused(&error))?;
        let (requests, answers) = (child.stdin.take(), child.stdout.take());
        let answers = answers.map(BufReader::new).ok_or_else(|| refused(&"no output of the interpreter"))?;
        let mut peer = Peer { child, requests, answers, folder, greeting: Value::Null };
        peer.greeting = peer.line().map_err(|_| refused(&peer.last_error()))?;
        if peer.greeting.get("ready").is_none() {
            return Err(refused(&format_args!("found {}, expected a greeting", peer.greeting)));
        }
        Ok(peer)
    }

    /// What the program said of itself when it started.
    pub fn greeting(&self) -> &Value {
        &self.greeting
    }

    /// A folder to hand files over in; it goes when the program does.
    pub fn folder(&self) -> &Path {
        self.folder.path()
    }

    /// Asks and waits for the answer.
    pub fn ask(&mut self, request: &Value) -> Outcome<Value> {
        let sent = self
            .requests
            .as_mut()
            .map(|requests| writeln!(requests, "{request}").and_then(|()| requests.flush()));
        match sent {
            Some(Ok(())) => {}
            _ => return Err(self.failure("it takes no more requests")),
        }
        self.line().map_err(|problem| self.failure(problem))
    }

    fn line(&mut self) -> io::Result<Value> {
        let mut line = String::new();
        match self.answers.read_line(&mut line) {
            Ok(0) => Err(io::Error::other("it ended")),
            Ok(_) => serde_json::from_str(&line)
                .map_err(|error| io::Error::other(format!("found {line:?}: {error}"))),
            Err(error) => Err(error),
        }
    }

    fn failure(&mut self, problem: impl Display) -> Failure {
        Failure::run(format_args!("the Python program: {problem}: {}", self.last_error()))
    }

    /// The last line that it wrote to standard error, once it has ended.
    fn last_error(&mut self) -> String {
        self.requests = None;
        // It may hang rather than end; nothing is lost with it.
        let _ = self.child.kill();
        let _ = self.child.wait();
        let errors = self.child.stderr.take().map(BufReader::new);
        let lines = errors.into_iter().flat_map(|errors| errors.lines().map_while(Result::ok));
        lines.filter(|line| !line.trim().is_empty()).last().unwrap_or_else(|| "no error message".to_owned())
    }
}

impl Drop for Peer {
    fn drop(&mut self) {
        // A closed input ends it; if it is in the middle of something, this does.
        self.requests = None;
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_interpreter_that_is_not_there_is_one_line() {
        let problem = Peer::start("no-such-python", "").err().expect("a problem").to_string();
        assert!(problem.starts_with("no-such-python: ") && problem.lines().count() == 1, "{problem}");
    }
}
