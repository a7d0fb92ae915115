//! What systemd is to a service: who starts it, hears of it, and asks it to end.

use std::fs::File;
use std::io::{BufRead as _, BufReader, Read, Write as _};
use std::os::fd::AsRawFd as _;
use std::os::unix::fs::OpenOptionsExt as _;
use std::os::unix::net::UnixDatagram;
use std::path::Path;
use std::process::{Command, ExitStatus, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::process::{Pid, Signal, kill_process};
use testkit::Running;

/// The watchdog's time; it is fed twice in it.
pub const WATCHDOG: Duration = Duration::from_millis(1000);
/// No watchdog of a service that works is silent for so long, however busy the machine.
pub const SILENCE: Duration = Duration::from_secs(4);
/// All that is waited for comes sooner.
const PATIENCE: Duration = Duration::from_secs(60);

/// A service, and what it tells of itself. It ends with its test.
pub struct Service {
    running: Running,
    messages: Receiver<String>,
    /// What it writes to standard error.
    errors: BufReader<std::io::PipeReader>,
    /// The other end of that pipe.
    pipe: std::io::PipeWriter,
}

impl Service {
    /// Starts a program whose socket is in a folder of its own.
    pub fn start(mut command: Command, folder: &Path) -> Service {
        let path = folder.join("notify");
        let messages = messages(UnixDatagram::bind(&path).expect("a socket"));
        let (errors, pipe) = std::io::pipe().expect("a pipe");
        command.env("NOTIFY_SOCKET", &path).env("WATCHDOG_USEC", WATCHDOG.as_micros().to_string());
        command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(pipe.try_clone().expect("a pipe"));
        Service { running: Running::start(&mut command), messages, errors: BufReader::new(errors), pipe }
    }

    pub fn id(&self) -> u32 {
        self.running.id()
    }

    /// What it says next, if it does within this time.
    pub fn hear(&self, within: Duration) -> Option<String> {
        self.messages.recv_timeout(within).ok()
    }

    /// Hears what it says until this is in it, and returns that.
    #[track_caller]
    pub fn await_word(&self, word: &str) -> String {
        let deadline = Instant::now() + PATIENCE;
        loop {
            let left = deadline.saturating_duration_since(Instant::now());
            let heard = self.hear(left).unwrap_or_else(|| panic!("no {word} in {} s", PATIENCE.as_secs()));
            if heard.contains(word) {
                return heard;
            }
        }
    }

    /// Hears no longer what it said before now.
    pub fn forget(&self) {
        while self.hear(Duration::ZERO).is_some() {}
    }

    /// The watchdog is fed again and again from now on.
    #[track_caller]
    pub fn is_fed(&self) {
        self.forget();
        for _ in 0..3 {
            self.await_word("WATCHDOG=1");
        }
    }

    /// The watchdog is fed no longer, from some time on.
    #[track_caller]
    pub fn starves(&self) {
        let (deadline, mut fed) = (Instant::now() + PATIENCE, Instant::now());
        while fed.elapsed() < SILENCE {
            assert!(Instant::now() < deadline, "the watchdog is fed");
            match self.hear(SILENCE.saturating_sub(fed.elapsed())) {
                Some(heard) if heard.contains("WATCHDOG=1") => fed = Instant::now(),
                _ => {}
            }
        }
    }

    /// Reads standard error to the line with these words; what follows them.
    #[track_caller]
    pub fn await_line(&mut self, words: &str) -> String {
        loop {
            if self.errors.buffer().is_empty() {
                let mut ready = [PollFd::new(self.errors.get_ref(), PollFlags::IN)];
                let patience = Timespec { tv_sec: PATIENCE.as_secs().cast_signed(), tv_nsec: 0 };
                let count = poll(&mut ready, Some(&patience)).expect("polled");
                assert!(count > 0, "no line with {words:?} in {} s", PATIENCE.as_secs());
            }
            let mut line = String::new();
            assert!(self.errors.read_line(&mut line).expect("read") > 0, "no line with {words:?}");
            if let Some(rest) = line.trim_end().split_once(words).map(|(_, rest)| rest.to_owned()) {
                return rest;
            }
        }
    }

    /// Standard error is not read any more, and takes not one byte: a journal that hangs.
    pub fn clog(&self) {
        // A description of its own: the program's end must go on blocking.
        let path = format!("/proc/self/fd/{}", self.pipe.as_raw_fd());
        let mut pipe = File::options()
            .write(true)
            .custom_flags(rustix::fs::OFlags::NONBLOCK.bits().cast_signed())
            .open(path)
            .expect("the pipe");
        for size in [4096, 1] {
            while pipe.write(&vec![b' '; size]).is_ok() {}
        }
    }

    /// Asks it to end, as systemd does, and hears that it does; everything else it wrote to standard error.
    #[track_caller]
    pub fn end(mut self) -> (ExitStatus, String) {
        self.forget();
        let process = Pid::from_raw(self.running.id().cast_signed()).expect("a number");
        kill_process(process, Signal::TERM).expect("sent");
        self.await_word("STOPPING=1");
        let status = self.running.child().wait().expect("ends");
        let (errors, end) = std::io::pipe().expect("a pipe");
        self.pipe = end;
        let mut rest = String::new();
        let mut errors = std::mem::replace(&mut self.errors, BufReader::new(errors));
        errors.read_to_string(&mut rest).expect("text");
        (status, rest)
    }
}

/// All that comes to a socket, read at once: what finds its queue full is dropped.
fn messages(socket: UnixDatagram) -> Receiver<String> {
    let (sender, messages) = channel();
    std::thread::spawn(move || {
        let mut bytes = [0; 4096];
        while let Ok(count) = socket.recv(&mut bytes) {
            if sender.send(String::from_utf8_lossy(&bytes[..count]).into_owned()).is_err() {
                return;
            }
        }
    });
    messages
}
