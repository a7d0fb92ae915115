//! No process outlives the test process that started it, also when that one is killed.
//!
//! Processes carry a mark in their environment, which their own children inherit. A shell beside the test process reads
//! a pipe that closes when the test process ends, however it ends, and then kills every process with the mark. A
//! parent-death signal would reach children only, and would come when the thread that started them ends.

use std::ffi::OsStr;
use std::os::unix::process::CommandExt as _;
use std::process::{Child, Command, Stdio, id};
use std::sync::OnceLock;
use std::time::SystemTime;

/// The environment variable of the mark.
const VARIABLE: &str = "HULLTOUCH_TEST_PROCESS";

/// Sweeps once its standard input ends; `$0` is the mark. A process that is being started shows the mark only after a
/// moment, so it looks again until nothing was found for a second. Signals of a terminal do not end it.
const SWEEPER: &str = r#"
trap '' HUP INT QUIT TERM
cat > /dev/null
clean=0
while [ "$clean" -lt 10 ]; do
    clean=$((clean + 1))
    for found in $(grep -lzxF -e "$0" /proc/[0-9]*/environ 2> /dev/null); do
        process=${found#/proc/}
        kill -KILL "${process%/environ}" 2> /dev/null && clean=0
    done
    sleep 0.1
done
"#;

struct Sweeper {
    mark: String,
    /// Holds the pipe. It is never dropped: the system closes the pipe when this process ends.
    _shell: Child,
}

/// The mark of this process's children: the name and value of an environment variable. The first call starts what
/// sweeps. For programs that the code under test starts itself: `["env", "NAME=VALUE", …]`.
pub fn mark() -> (&'static str, &'static str) {
    static SWEEPER_OF_THIS_PROCESS: OnceLock<Sweeper> = OnceLock::new();
    let sweeper = SWEEPER_OF_THIS_PROCESS.get_or_init(|| {
        let now = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
        let mark = format!("{}-{}", id(), now.as_nanos());
        let mut shell = Command::new("sh");
        shell.args(["-c", SWEEPER, &format!("{VARIABLE}={mark}")]).current_dir("/");
        // Without the mark of a test whose process this is.
        shell.env_remove(VARIABLE);
        // A group of its own: what ends the test by its group must not end the sweeper.
        shell.stdin(Stdio::piped()).stdout(Stdio::null()).stderr(Stdio::null()).process_group(0);
        Sweeper { mark, _shell: shell.spawn().expect("sh starts") }
    });
    (VARIABLE, &sweeper.mark)
}

/// A command whose process, and all that it starts, ends at the latest when this process ends.
pub fn command(program: impl AsRef<OsStr>) -> Command {
    let (name, value) = mark();
    let mut command = Command::new(program);
    command.env(name, value);
    command
}
