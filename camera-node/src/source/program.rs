//! A child program whose standard output is read: started, drained, and never left running.

use std::io::{self, Read};
use std::os::unix::process::{CommandExt as _, ExitStatusExt as _};
use std::path::Path;
use std::process::{Child, ChildStdout, Command, ExitStatus, Stdio};
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use parking_lot::Mutex;
use proto::text::clean;
use rustix::io::Errno;
use rustix::process::{Pid, Signal, WaitId, WaitIdOptions, kill_process_group, waitid};

use super::SourceError;
use super::mark::{self, Mark};

/// How much of its standard error is kept, bytes; enough for the lines before a failure.
const KEPT_STDERR_BYTES: usize = 4096;
/// How many of its last lines an error quotes, and how long they may get together.
const STDERR_TAIL_LINES: usize = 3;
const STDERR_TAIL_CHARS: usize = 400;
/// How often the end of a program is looked for.
const POLL: Duration = Duration::from_millis(2);

/// A running program. Dropping it kills it, and all it started, and waits for it.
#[derive(Debug)]
pub struct Program {
    command: String,
    child: Child,
    mark: Mark,
    ended: Option<Ending>,
    stderr: Arc<Mutex<Vec<u8>>>,
    drain: Option<JoinHandle<()>>,
}

/// How a program ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ending {
    /// By itself.
    Exited(ExitStatus),
    /// It was still running, and was killed.
    Killed,
}

/// The token of the page, which a demo's own nodes inherit.
const SECRET: &str = "HULLTOUCH_TOKEN";

impl Program {
    /// Starts `command` (program and arguments) in `folder`, with nothing on its standard input.
    pub fn start(command: &[String], folder: &Path) -> Result<(Program, ChildStdout), SourceError> {
        let shown = shown(command);
        let refused =
            |problem: String, may_pass| SourceError::Start { command: shown.clone(), problem, may_pass };
        let (program, arguments) =
            command.split_first().ok_or_else(|| refused("the command is empty".to_owned(), false))?;
        // A bare name is looked for in PATH, anything else from the folder.
        let found = if program.contains('/') { folder.join(program) } else { program.into() };
        let mark = Mark::new();
        let mut child = Command::new(found)
            .args(arguments)
            .current_dir(folder)
            // It needs none of our secrets.
            .env_remove(SECRET)
            .env(mark::VARIABLE, mark.value())
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            // A group of its own: Ctrl-C is for us to pass on, and children's children end too.
            .process_group(0)
            .spawn()
            .map_err(|error| {
                refused(format!("{error} (in folder {})", folder.display()), may_pass(&error))
            })?;
        let stdout = child.stdout.take();
        let kept = Arc::new(Mutex::new(Vec::new()));
        let drain = child.stderr.take().map(|stderr| {
            let kept = Arc::clone(&kept);
            std::thread::spawn(move || drain_stderr(stderr, &kept))
        });
        let program = Program { command: shown.clone(), child, mark, ended: None, stderr: kept, drain };
        // Both were asked for above; an error beats a panic all the same.
        let stdout = stdout.ok_or_else(|| refused("it has no standard output".to_owned(), false))?;
        Ok((program, stdout))
    }

    /// The command line, shortened.
    pub fn command(&self) -> &str {
        &self.command
    }

    /// Waits up to `grace` for the program to end by itself, then kills it. What it started and left running
    /// is killed in either case: it would hold the camera.
    pub fn finish(&mut self, grace: Duration) -> Ending {
        if let Some(ended) = self.ended {
            return ended;
        }
        let deadline = Instant::now() + grace;
        let by_itself = loop {
            match self.has_exited() {
                Ok(true) => break true,
                Ok(false) if Instant::now() < deadline => std::thread::sleep(POLL),
                Ok(false) | Err(_) => break false,
            }
        };
        let ended = match self.kill() {
            Ok(status) if by_itself => Ending::Exited(status),
            _ => Ending::Killed,
        };
        self.ended = Some(ended);
        ended
    }

    /// The error for a program that did not do its work, with how it ended and the end of its standard error.
    pub fn failure(&mut self, problem: String, grace: Duration) -> SourceError {
        let status = match self.finish(grace) {
            Ending::Killed => "it was still running and was killed".to_owned(),
            Ending::Exited(status) => match (status.code(), status.signal()) {
                (Some(code), _) => format!("exit status {code}"),
                (None, signal) => format!("ended by signal {}", signal.unwrap_or_default()),
            },
        };
        SourceError::Program {
            command: self.command.clone(),
            problem,
            status,
            stderr_tail: self.stderr_tail(),
        }
    }

    /// Whether the program itself has exited; it is not reaped by this question.
    fn has_exited(&self) -> io::Result<bool> {
        let options = WaitIdOptions::EXITED | WaitIdOptions::NOHANG | WaitIdOptions::NOWAIT;
        Ok(waitid(WaitId::Pid(Pid::from_child(&self.child)), options)?.is_some())
    }

    /// Kills the program and all that it has started, and reaps it.
    fn kill(&mut self) -> io::Result<ExitStatus> {
        // Not reaped yet, so the number is still this child's. Killing can
        // only fail if the group is gone, which is what we want.
        let _ = kill_process_group(Pid::from_child(&self.child), Signal::KILL);
        let _ = self.child.kill();
        let ended = self.child.wait();
        // What has left the group.
        self.mark.kill_all();
        ended
    }

    fn stderr_tail(&mut self) -> String {
        // A grandchild may hold the pipe open for ever; what came in this time is enough.
        let deadline = Instant::now() + Duration::from_millis(500);
        while self.drain.as_ref().is_some_and(|thread| !thread.is_finished()) && Instant::now() < deadline {
            std::thread::sleep(POLL);
        }
        tail(&self.stderr.lock())
    }
}

impl Drop for Program {
    fn drop(&mut self) {
        self.finish(Duration::ZERO);
    }
}

/// Whether the system lacks only for the moment what a start needs: processes, memory, descriptors, or the
/// program's own file, which is being written.
fn may_pass(error: &io::Error) -> bool {
    let passing = [Errno::AGAIN, Errno::NOMEM, Errno::MFILE, Errno::NFILE, Errno::TXTBSY, Errno::INTR];
    Errno::from_io_error(error).is_some_and(|error| passing.contains(&error))
}

/// Drains standard error, so that the program never blocks on it, and keeps its end.
fn drain_stderr(mut stderr: impl Read, kept: &Mutex<Vec<u8>>) {
    let mut chunk = [0; 1024];
    while let Ok(count @ 1..) = stderr.read(&mut chunk) {
        let mut kept = kept.lock();
        kept.extend_from_slice(&chunk[..count]);
        let excess = kept.len().saturating_sub(KEPT_STDERR_BYTES);
        kept.drain(..excess);
    }
}

/// The last lines in one; progress lines that end in a carriage return are lines too.
fn tail(stderr: &[u8]) -> String {
    let text = String::from_utf8_lossy(stderr);
    let lines: Vec<&str> = text.split(['\n', '\r']).map(str::trim).filter(|line| !line.is_empty()).collect();
    let last = lines[lines.len().saturating_sub(STDERR_TAIL_LINES)..].join(" | ");
    let excess = last.chars().count().saturating_sub(STDERR_TAIL_CHARS);
    let tail: String = last.chars().skip(excess).collect();
    clean(&tail, STDERR_TAIL_CHARS)
}

fn shown(command: &[String]) -> String {
    clean(&command.join(" "), 120)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shell(script: &str) -> (Program, ChildStdout) {
        let (variable, mark) = testkit::mark();
        let command = ["env", &format!("{variable}={mark}"), "sh", "-c", script];
        Program::start(&command.map(str::to_owned), Path::new("/")).expect("starts")
    }

    #[test]
    fn an_error_quotes_the_last_lines_of_standard_error() {
        let (mut program, _stdout) = shell(
            "i=0; while [ $i -lt 3000 ]; do echo line $i >&2; i=$((i+1)); done; printf 'a\\rb\\n\\n' >&2; exit 7",
        );
        let error = program.failure("failed".to_owned(), Duration::from_secs(100)).to_string();
        assert!(error.ends_with("failed (exit status 7; standard error: line 2999 | a | b)"), "{error}");
    }

    #[test]
    fn dropping_kills_children_of_children_at_once() {
        let (program, mut stdout) = shell("sleep 1000 & echo $!; sleep 1000; true");
        let mut byte = [0];
        stdout.read_exact(&mut byte).expect("started");
        let started = Instant::now();
        drop(program);
        // The pipe ends only when no process holds it any more.
        stdout.read_to_end(&mut Vec::new()).expect("ends");
        assert!(started.elapsed() < Duration::from_secs(100));
    }

    #[test]
    fn what_a_program_leaves_running_ends_with_it() {
        let (mut program, mut stdout) = shell("sleep 1000 & exit 3");
        let started = Instant::now();
        assert!(
            matches!(program.finish(Duration::from_secs(100)), Ending::Exited(status) if status.code() == Some(3))
        );
        // The pipe ends only when no process holds it any more.
        stdout.read_to_end(&mut Vec::new()).expect("ends");
        assert!(started.elapsed() < Duration::from_secs(100));
    }

    #[test]
    fn a_session_of_its_own_keeps_nothing_alive() {
        let has_setsid = Command::new("setsid").arg("true").stdin(Stdio::null()).status().is_ok();
        if !has_setsid {
            return testkit::skip(format_args!("there is no setsid (Debian package util-linux)"));
        }
        let (program, mut stdout) = shell("setsid sh -c 'echo started; sleep 1000; true' & wait");
        let mut byte = [0];
        stdout.read_exact(&mut byte).expect("started");
        let started = Instant::now();
        drop(program);
        // The pipe ends only when no process holds it any more.
        stdout.read_to_end(&mut Vec::new()).expect("ends");
        assert!(started.elapsed() < Duration::from_secs(100));
    }

    #[test]
    fn a_program_that_cannot_start_is_an_error() {
        let error = Program::start(&["no-such-program-7".to_owned()], Path::new("/")).expect_err("refused");
        let text = error.to_string();
        assert!(text.starts_with("cannot start \"no-such-program-7\": No such file"), "{text}");
    }
}
