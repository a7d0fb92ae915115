//! A pipe beside a program's film, on which it writes one number a frame: a capture time, or a trigger's count.

use std::collections::VecDeque;
use std::fs::File;
use std::io::{self, Read};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use crate::scratch::ScratchFolder;
use proto::text::clean;
use rustix::fs::{CWD, Mode, OFlags};
use rustix::io::Errno;
use thiserror::Error;

/// A frame's number comes within so long of its frame.
const LATEST: Duration = Duration::from_secs(1);
/// How often a number that is waited for is looked for.
const POLL: Duration = Duration::from_millis(1);
/// A program may be so many lines ahead of its frames.
const MAX_AHEAD: usize = 64;
/// No line is longer, bytes.
const MAX_LINE_BYTES: usize = 64;
/// The greatest number: exact, as milliseconds a quarter of a million years.
const MAX_NUMBER: f64 = 9_007_199_254_740_992.0;

/// Why a frame has no number of its own.
#[derive(Debug, Error)]
pub enum SideError {
    /// Nothing came.
    #[error("wrote no {what} for frame {frame} within {} s of it", LATEST.as_secs())]
    Missing {
        /// "time" or "count".
        what: &'static str,
        /// Number of the frame.
        frame: u64,
    },
    /// Far more came than frames.
    #[error("wrote {MAX_AHEAD} {what}s more than frames after frame {frame}")]
    TooMany {
        /// "time" or "count".
        what: &'static str,
        /// After which frame.
        frame: u64,
    },
    /// Something else came.
    #[error("wrote {found:?} as the {what} of frame {frame}, expected one number a line")]
    Garbage {
        /// "time" or "count".
        what: &'static str,
        /// The line, shortened.
        found: String,
        /// Of which frame.
        frame: u64,
    },
    /// Reading failed.
    #[error("its {what}s cannot be read: {error}")]
    Read {
        /// "time" or "count".
        what: &'static str,
        /// The system's reason.
        error: io::Error,
    },
}

/// The reading end; the file goes with it.
#[derive(Debug)]
pub struct SidePipe {
    _folder: ScratchFolder,
    path: PathBuf,
    file: File,
    what: &'static str,
    frames: u64,
    lines: VecDeque<Vec<u8>>,
    part: Vec<u8>,
}

impl SidePipe {
    /// Makes a pipe in a folder of its own, for numbers of this name.
    pub fn make(what: &'static str) -> io::Result<SidePipe> {
        let folder = ScratchFolder::new()?;
        let path = folder.path().join(format!("{what}s"));
        make_fifo(&path)?;
        let file = open(&path)?;
        Ok(SidePipe {
            _folder: folder,
            path,
            file,
            what,
            frames: 0,
            lines: VecDeque::new(),
            part: Vec::new(),
        })
    }

    /// Where the program writes.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The number of the next frame, which has just come; waits for it.
    pub fn next(&mut self) -> Result<f64, SideError> {
        let (what, frame) = (self.what, self.frames);
        let deadline = Instant::now() + LATEST;
        loop {
            self.read().map_err(|error| SideError::Read { what, error })?;
            if self.lines.len() > MAX_AHEAD {
                return Err(SideError::TooMany { what, frame });
            }
            if let Some(line) = self.lines.pop_front() {
                self.frames += 1;
                let garbage = || SideError::Garbage { what, found: shown(&line), frame };
                return number(&line).ok_or_else(garbage);
            }
            if self.part.len() > MAX_LINE_BYTES {
                return Err(SideError::Garbage { what, found: shown(&self.part), frame });
            }
            if Instant::now() >= deadline {
                return Err(SideError::Missing { what, frame });
            }
            std::thread::sleep(POLL);
        }
    }

    /// Takes what is there; comments are no lines.
    fn read(&mut self) -> io::Result<()> {
        let mut chunk = [0; 1024];
        while self.lines.len() <= MAX_AHEAD && self.part.len() <= MAX_LINE_BYTES {
            let count = match self.file.read(&mut chunk) {
                Ok(0) => return Ok(()),
                Ok(count) => count,
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => return Ok(()),
                Err(error) if error.kind() == io::ErrorKind::Interrupted => continue,
                Err(error) => return Err(error),
            };
            for byte in &chunk[..count] {
                if *byte != b'\n' {
                    self.part.push(*byte);
                    continue;
                }
                let line = std::mem::take(&mut self.part);
                if !line.starts_with(b"#") {
                    self.lines.push_back(line);
                }
            }
        }
        Ok(())
    }
}

fn make_fifo(path: &Path) -> io::Result<()> {
    let (kind, mode) = (rustix::fs::FileType::Fifo, Mode::RUSR | Mode::WUSR);
    Ok(rustix::fs::mknodat(CWD, path, kind, mode, 0)?)
}

/// Opens it to read without waiting for a writer.
fn open(path: &Path) -> io::Result<File> {
    let flags = OFlags::RDONLY | OFlags::NONBLOCK | OFlags::CLOEXEC;
    let opened: Result<_, Errno> = rustix::fs::open(path, flags, Mode::empty());
    Ok(File::from(opened?))
}

fn number(line: &[u8]) -> Option<f64> {
    let text = std::str::from_utf8(line).ok()?.trim();
    // `parse` would also take words and exponents.
    let is_plain = text.bytes().all(|byte| byte.is_ascii_digit() || byte == b'.' || byte == b'-');
    let found: f64 = is_plain.then(|| text.parse().ok())??;
    (found.abs() <= MAX_NUMBER).then_some(found)
}

fn shown(line: &[u8]) -> String {
    clean(&String::from_utf8_lossy(line), 40)
}

#[cfg(test)]
mod tests {
    use std::io::Write as _;

    use super::*;

    /// What comes of these bytes, one after the other, up to the first error.
    fn read(bytes: &[u8]) -> (Vec<f64>, String) {
        let mut pipe = SidePipe::make("time").expect("made");
        let mut writer = File::options().write(true).open(pipe.path()).expect("a reader");
        writer.write_all(bytes).expect("room");
        drop(writer);
        let mut found = vec![];
        loop {
            match pipe.next() {
                Ok(number) => found.push(number),
                Err(error) => return (found, error.to_string()),
            }
        }
    }

    #[test]
    fn numbers_come_line_by_line_and_comments_are_none() {
        let (found, end) = read(b"# timestamp format v2\n0\n33.366667\r\n -5 \n70");
        assert_eq!(found, [0.0, 33.366667, -5.0]);
        assert_eq!(end, "wrote no time for frame 3 within 1 s of it");
        assert_eq!(read(b"").1, "wrote no time for frame 0 within 1 s of it");
    }

    #[test]
    fn what_is_no_number_is_one_line() {
        for (bytes, line) in [
            (&b"hello\n"[..], "\"hello\""),
            (b"nan\n", "\"nan\""),
            (b"1e3\n", "\"1e3\""),
            (b"\n", "\"\""),
            (b"1 2\n", "\"1 2\""),
            (b"99999999999999999999\n", "\"99999999999999999999\""),
            (&[b'7'; 500], "\"7777777777777777777777777777777777777"),
        ] {
            let (found, error) = read(bytes);
            assert!(found.is_empty());
            assert!(error.starts_with(&format!("wrote {line}")), "{error}");
            assert!(error.ends_with(" as the time of frame 0, expected one number a line"), "{error}");
        }
        assert!(read("1\n".repeat(100).as_bytes()).1.starts_with("wrote 64 times more than frames"));
    }

    #[test]
    fn a_pipe_leaves_nothing_behind() {
        let pipe = SidePipe::make("count").expect("made");
        let folder = pipe._folder.path().to_owned();
        assert!(folder.join("counts").exists());
        drop(pipe);
        assert!(!folder.exists());
    }
}
