//! A camera for tests: a program that writes the frames of a film again and again, each when it is due.
//!
//! Arguments, each `name=value`:
//!
//! | argument | meaning |
//! | --- | --- |
//! | `film` | the file of the film, frame after frame as raw bytes |
//! | `bytes` | bytes of a frame; default: the film is one frame |
//! | `fps` | frames a second |
//! | `header` | writes YUV4MPEG2 with this first line; default: raw frames |
//! | `phase_s` | each frame is due so long after a multiple of 1/`fps` of the wall clock; default 0 |
//! | `late_s` | each frame comes up to so long after it is due; default 0 |
//! | `side` | a file to write numbers to, before their frames; default, and if empty: none |
//! | `numbers` | the file with these numbers, a line a frame, words of a line as lines of their own |
//!
//! Other arguments without `=` are ignored: a doctor looks for names of devices there. While a file beside the film with
//! `.silent` after its name exists, no frames are written, and garbage while it is one with `.garbled`.
//!
//! Cameras of one film write the same frame at the same time, also when one is started again. It uses the standard
//! library only: the build script compiles this file alone.

use std::collections::HashMap;
use std::fs::{self, File};
use std::io::{self, Write};
use std::process::ExitCode;
use std::thread;
use std::time::{Duration, Instant, SystemTime};

fn main() -> ExitCode {
    let camera = match Camera::of(std::env::args().skip(1)) {
        Ok(camera) => camera,
        Err(problem) => {
            let _ = writeln!(io::stderr(), "camera: {problem}");
            return ExitCode::from(2);
        }
    };
    // It ends when its reader has gone.
    match camera.play(&mut io::stdout().lock()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            let _ = writeln!(io::stderr(), "camera: {error}");
            ExitCode::FAILURE
        }
    }
}

/// What the arguments say.
struct Camera {
    path: String,
    film: Vec<u8>,
    frame_bytes: usize,
    fps: f64,
    header: Option<String>,
    phase_s: f64,
    late_s: f64,
    side: Option<String>,
    numbers: Vec<String>,
}

impl Camera {
    fn of(arguments: impl Iterator<Item = String>) -> Result<Camera, String> {
        let pairs = arguments
            .filter_map(|word| word.split_once('=').map(|(name, value)| (name.to_owned(), value.to_owned())));
        let mut given: HashMap<String, String> = pairs.collect();
        let path = given.remove("film").ok_or("no film=…")?;
        let film = fs::read(&path).map_err(|error| format!("{path}: {error}"))?;
        let frame_bytes = match given.remove("bytes") {
            Some(text) => text.parse().map_err(|error| format!("bytes={text}: {error}"))?,
            None => film.len(),
        };
        if frame_bytes == 0 || film.len() < frame_bytes {
            return Err(format!("{path}: {} bytes, expected a frame of {frame_bytes}", film.len()));
        }
        let numbers = match given.remove("numbers") {
            Some(file) => fs::read_to_string(&file).map_err(|error| format!("{file}: {error}"))?,
            None => String::new(),
        };
        let camera = Camera {
            frame_bytes,
            fps: seconds(&mut given, "fps")?.filter(|fps| *fps > 0.0).ok_or("no fps=…")?,
            header: given.remove("header"),
            phase_s: seconds(&mut given, "phase_s")?.unwrap_or_default(),
            late_s: seconds(&mut given, "late_s")?.unwrap_or_default(),
            side: given.remove("side").filter(|side| !side.is_empty()),
            numbers: numbers.lines().map(str::to_owned).collect(),
            film,
            path,
        };
        match given.keys().next() {
            Some(name) => Err(format!("unknown argument {name}=…")),
            None => Ok(camera),
        }
    }

    fn play(&self, output: &mut impl Write) -> io::Result<()> {
        let mut side = match &self.side {
            Some(path) => Some(File::options().write(true).open(path)?),
            None => None,
        };
        if let Some(header) = &self.header {
            writeln!(output, "{header}")?;
        }
        let (begin, begin_s) = (Instant::now(), wall_clock_s());
        let first = first_frame(begin_s, self.fps, self.phase_s);
        let mut chance = Chance(u64::from(std::process::id()));
        for count in 0.. {
            let number = first + count;
            let due_s = number as f64 / self.fps + self.phase_s + chance.below_one() * self.late_s;
            let due = Duration::from_secs_f64((due_s - begin_s).max(0.0));
            thread::sleep(due.saturating_sub(begin.elapsed()));
            if let (Some(side), Some(line)) = (&mut side, self.numbers.get(count as usize)) {
                let lines: String = line.split_whitespace().map(|word| format!("{word}\n")).collect();
                side.write_all(lines.as_bytes())?;
            }
            output.write_all(&self.frame(number))?;
            output.flush()?;
        }
        Ok(())
    }

    /// What is written for the frame of this number.
    fn frame(&self, number: u64) -> Vec<u8> {
        let is_marked = |mark: &str| fs::exists(format!("{}.{mark}", self.path)).unwrap_or_default();
        if is_marked("silent") {
            return Vec::new();
        }
        if is_marked("garbled") {
            return vec![b'?'; 1000];
        }
        let frames = self.film.chunks_exact(self.frame_bytes);
        let at = (number % frames.len() as u64) as usize * self.frame_bytes;
        let mark: &[u8] = if self.header.is_some() { b"FRAME\n" } else { b"" };
        [mark, &self.film[at..at + self.frame_bytes]].concat()
    }
}

fn seconds(given: &mut HashMap<String, String>, name: &str) -> Result<Option<f64>, String> {
    let Some(text) = given.remove(name) else { return Ok(None) };
    let found = text.parse::<f64>().ok().filter(|value| value.is_finite() && *value >= 0.0);
    found.map(Some).ok_or_else(|| format!("{name}={text}: expected a number"))
}

/// The number of the first frame that is not yet due.
fn first_frame(now_s: f64, fps: f64, phase_s: f64) -> u64 {
    ((now_s - phase_s) * fps).ceil() as u64
}

fn wall_clock_s() -> f64 {
    SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default().as_secs_f64()
}

/// Numbers from a seed (SplitMix64).
struct Chance(u64);

impl Chance {
    fn below_one(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut mixed = self.0;
        mixed = (mixed ^ (mixed >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((mixed ^ (mixed >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use super::*;

    fn film(name: &str, bytes: &[u8]) -> PathBuf {
        let path = std::env::temp_dir().join(format!("hulltouch-{}-{name}.film", std::process::id()));
        fs::write(&path, bytes).expect("written");
        path
    }

    fn camera(words: &[String]) -> Result<Camera, String> {
        Camera::of(words.iter().cloned())
    }

    #[test]
    fn frames_go_round_and_marks_silence_or_garble_them() {
        let path = film("round", b"aabbcc");
        let words = [format!("film={}", path.display()), "bytes=2".into(), "fps=10".into(), "video0".into()];
        let plays = camera(&words).expect("valid");
        assert_eq!([3, 4, 5, 6].map(|number| plays.frame(number)), [b"aa", b"bb", b"cc", b"aa"]);
        let mark = |name: &str| format!("{}.{name}", path.display());
        fs::write(mark("garbled"), "").expect("written");
        assert_eq!(plays.frame(3), [b'?'; 1000]);
        fs::write(mark("silent"), "").expect("written");
        assert_eq!(plays.frame(3), b"");
        [mark("garbled"), mark("silent")].iter().for_each(|file| fs::remove_file(file).expect("removed"));
        let with_header = camera(&[&words[..], &["header=YUV4MPEG2".into()]].concat()).expect("valid");
        assert_eq!(with_header.frame(4), b"FRAME\nbb");
        fs::remove_file(path).expect("removed");
    }

    #[test]
    fn a_frame_is_due_at_its_phase_of_the_wall_clock() {
        assert_eq!(first_frame(100.0, 20.0, 0.0), 2000);
        assert_eq!(first_frame(100.01, 20.0, 0.0), 2001);
        assert_eq!(first_frame(100.01, 20.0, 0.02), 2000);
    }

    #[test]
    fn what_is_misspelt_is_refused() {
        let path = film("refused", b"ab");
        let film = format!("film={}", path.display());
        for (words, problem) in [
            (vec!["fps=10".to_owned()], "no film=…"),
            (vec![film.clone()], "no fps=…"),
            (vec![film.clone(), "fps=x".into()], "fps=x: expected a number"),
            (vec![film.clone(), "fps=10".into(), "phase=1".into()], "unknown argument phase=…"),
        ] {
            assert_eq!(camera(&words).err().as_deref(), Some(problem));
        }
        let refused = camera(&[film, "fps=10".into(), "bytes=3".into()]).err().unwrap_or_default();
        assert!(refused.ends_with("2 bytes, expected a frame of 3"), "{refused}");
        fs::remove_file(path).expect("removed");
    }
}
