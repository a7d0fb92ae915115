//! Cameras that are shell scripts, and what is seen of them.

#![allow(dead_code, reason = "each test program uses some of it")]

use std::fs;
use std::os::unix::fs::PermissionsExt as _;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use camera_node::capture::Film;
use camera_node::frames::{Frame, FrameId, FrameRing};
use camera_node::{NodeCamera, NodeConfig, SourceConfig};
use film_time::FilmState;
use hull::{Camera, ProbeSettings};
use nalgebra::{Matrix3, Vector3};
use segment::{Method, SegmentSettings};
use tempfile::TempDir;

pub const FPS: f64 = 20.0;
/// Longer than any wait that succeeds.
pub const SOON: Duration = Duration::from_secs(120);

/// The first line of each film.
const HEADER: &str = "YUV4MPEG2 W8 H4 F30:1 C444";
/// Lines of numbers that a camera writes at most: longer than any test.
const NUMBERS: usize = 20_000;
/// `h` writes a header, `f` a frame; each program notes its number, and does what its turn says.
const PROGRAM: &str = r#"#!/bin/sh
h() { printf 'YUV4MPEG2 W8 H4 F30:1 C444\n'; }
f() { printf 'FRAME\n%096d' 0; }
echo $$ >> programs
turn=$(wc -l < programs)
while [ ! -e turn_$turn ]; do turn=$((turn - 1)); done
. ./turn_$turn
"#;

/// A turn that films for ever, at the pace of the cluster; each frame comes up to 6 ms late.
pub fn film(phase_s: f64) -> String {
    film_at(FPS, phase_s)
}

/// The same of another rate.
pub fn film_at(fps: f64, phase_s: f64) -> String {
    let camera = testkit::CAMERA;
    format!("exec '{camera}' film=frame fps={fps:?} phase_s={phase_s:?} late_s=0.006 'header={HEADER}'")
}

/// The same that writes numbers beside its frames, `lines(n)` for its frame `n`: a word for each number.
pub fn film_with_numbers(folder: &Path, name: &str, lines: impl Fn(usize) -> String) -> String {
    let text: String = (0..NUMBERS).map(|frame| lines(frame) + "\n").collect();
    fs::write(folder.join(name), text).expect("written");
    format!("{} \"side=$1\" 'numbers={}'", film(0.0), folder.join(name).display())
}

/// A camera in a folder of its own.
pub struct LiveCamera {
    folder: TempDir,
    program: String,
    /// Words of its command after the program.
    words: Vec<String>,
}

impl LiveCamera {
    /// What its first program does, and the next ones; the last is repeated.
    pub fn new(turns: &[&str]) -> LiveCamera {
        let camera = LiveCamera::of_program("./camera.sh");
        camera.write(turns);
        camera
    }

    /// A camera whose program is yet to be written, or somewhere else.
    pub fn of_program(program: &str) -> LiveCamera {
        let folder = tempfile::tempdir().expect("folder");
        LiveCamera { folder, program: program.to_owned(), words: vec![] }
    }

    /// The same with a word in its command: `$1` of its programs.
    pub fn with_word(mut self, word: &str) -> LiveCamera {
        self.words.push(word.to_owned());
        self
    }

    fn write(&self, turns: &[&str]) -> PathBuf {
        for (turn, script) in (1..).zip(turns) {
            fs::write(self.folder.path().join(format!("turn_{turn}")), script).expect("written");
        }
        fs::write(self.folder.path().join("frame"), [b'0'; 96]).expect("written");
        let path = self.folder.path().join("camera.sh");
        fs::write(&path, PROGRAM).expect("written");
        fs::set_permissions(&path, fs::Permissions::from_mode(0o755)).expect("set");
        path
    }

    fn config(&self, index: u16) -> NodeCamera {
        let camera = Camera::new(
            format!("cam_{index}"),
            (8, 4),
            Matrix3::identity(),
            [0.0; 5],
            Vector3::zeros(),
            Vector3::zeros(),
        );
        // By `sh`: a program that another thread's child holds open for writing cannot be started.
        let mut command = if self.folder.path().join("camera.sh").exists() {
            let (variable, mark) = testkit::mark();
            vec!["env".to_owned(), format!("{variable}={mark}"), "sh".to_owned(), self.program.clone()]
        } else {
            vec![self.program.clone()]
        };
        command.extend(self.words.iter().cloned());
        let source = format!("kind = \"pipe\"\nlive = true\ncommand = {command:?}");
        let mut source: SourceConfig = toml::from_str(&source).expect("valid");
        let same = |text: &str| Ok::<_, ()>(text.to_owned());
        let path = |text: &str| Ok(PathBuf::from(text));
        source.resolve(self.folder.path(), path, same).expect("resolved");
        NodeCamera {
            camera: camera.expect("a camera"),
            rig_index: index,
            source,
            background: None,
            segmentation: SegmentSettings { method: Method::Chroma, ..SegmentSettings::default() },
            ignored: None,
        }
    }
}

/// Cameras of one node.
pub struct LiveRig {
    pub film: Film,
    pub ring: Arc<FrameRing>,
    cameras: Vec<LiveCamera>,
    /// Number and skipped of the frames that were looked at.
    seen: Mutex<Vec<(u64, u64)>>,
}

impl LiveRig {
    pub fn of(cameras: impl IntoIterator<Item = LiveCamera>) -> LiveRig {
        let cameras: Vec<LiveCamera> = cameras.into_iter().collect();
        let config = NodeConfig {
            cameras: (0..).zip(&cameras).map(|(index, camera)| camera.config(index)).collect(),
            settings: ProbeSettings::default(),
            fps: FPS,
        };
        let ring = Arc::new(FrameRing::new(cameras.len()));
        let film = Film::prepare(&config, Arc::clone(&ring)).expect("no background");
        LiveRig { film, ring, cameras, seen: Mutex::default() }
    }

    /// Writes a camera's program, which does this.
    pub fn write_program(&self, camera: usize, script: &str) -> PathBuf {
        self.cameras[camera].write(&[script])
    }

    /// The numbers of the processes that a camera has had.
    pub fn programs(&self, camera: usize) -> Vec<i32> {
        let text = fs::read_to_string(self.cameras[camera].folder.path().join("programs"));
        text.unwrap_or_default().lines().filter_map(|line| line.parse().ok()).collect()
    }

    /// Waits until a camera has had so many programs.
    pub fn await_program(&self, camera: usize, count: usize, limit: Duration) {
        self.until(limit, "a program", || self.programs(camera).len() >= count);
    }

    /// Waits until the newest frame has this number or a later one, and all cameras.
    pub fn await_frame(&self, number: u64, limit: Duration) {
        let is_it = |newest: &Frame| newest.number >= number && newest.cameras.len() == self.cameras.len();
        self.until(limit, "a frame", || self.ring.newest().is_ok_and(|newest| is_it(&newest)));
    }

    /// Waits until the newest frame has so many cameras.
    pub fn await_cameras(&self, count: usize) {
        let is_it = |newest: &Frame| newest.cameras.len() == count;
        self.until(SOON, "such a frame", || self.ring.newest().is_ok_and(|newest| is_it(&newest)));
    }

    /// Waits until a camera has a program, and then for more frames than can have waited.
    pub fn await_frames_of_a_new_program(&self, camera: usize) {
        self.until(SOON, "a new program", || self.programs(camera).last().is_some_and(|last| runs(*last)));
        let number = self.ring.newest().map_or(0, |newest| newest.number);
        self.await_frame(number + 4, SOON);
    }

    pub fn await_end(&self) -> FilmState {
        self.until(SOON, "an end", || self.ring.state() != FilmState::Running);
        self.ring.state()
    }

    /// Numbers only grow, and every number is a frame or counted as skipped.
    pub fn check_numbers(&self) {
        let seen = self.seen.lock().expect("whole");
        assert!(seen.len() > 1, "numbers of {} frames say nothing", seen.len());
        for pair in seen.windows(2) {
            let ((before, _), (number, skipped)) = (pair[0], pair[1]);
            assert!(number > before && skipped == number - before - 1, "{seen:?}");
        }
    }

    /// Waits until something is so.
    #[track_caller]
    pub fn until(&self, limit: Duration, what: &str, mut done: impl FnMut() -> bool) {
        let deadline = Instant::now() + limit;
        let mut done_now = false;
        while !done_now {
            assert!(Instant::now() < deadline, "no {what} came: {:?}", self.ring.state());
            done_now = done();
            self.look();
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    /// Notes the frames that are new.
    fn look(&self) {
        let mut seen = self.seen.lock().expect("whole");
        let run = self.ring.since(None).run;
        let last = seen.last().map(|&(number, _)| FrameId { run, number });
        let frames = self.ring.since(last).frames;
        seen.extend(frames.iter().map(|frame| (frame.number, frame.skipped)));
    }
}

/// Whether a process is there, be it a zombie.
pub fn runs(process: i32) -> bool {
    Path::new(&format!("/proc/{process}")).exists()
}
