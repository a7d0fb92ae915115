//! Film from any program that writes YUV4MPEG2 to its standard output: webcams, network cameras
//! and video files through ffmpeg or GStreamer.
//!
//! YUV4MPEG2 has no timestamps. In a film the index is the number; a live camera's frames are numbered by what its
//! program writes beside them, or by when they arrive.

use std::io::BufReader;
use std::process::ChildStdout;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::time::{Duration, Instant};

use film_time::CameraPace;
use hull::Camera;
use proto::TroubleKind;
use segment::{Format, Range};

use super::config::{PipeConfig, SourceConfig};
use super::film::{Fit, Numbering, check_rate, label};
use super::mailbox::{Mailbox, WhenFull};
use super::number::LiveNumbers;
use super::program::{Ending, Program};
use super::raw::FrameReader;
use super::side_pipe::SidePipe;
use super::y4m::{Header, Reader, Y4mError};
use super::{Clock, Image, OpenContext, Phase, Source, SourceError, SourceFrame, Stopped};

/// Frames read ahead of use: one being used, one ready, and no more memory than that.
const FRAMES_AHEAD: usize = 2;
/// How long a program may take to end after its last frame before it is killed.
const END_GRACE: Duration = Duration::from_secs(2);
/// How long one that wrote garbage may take: most have ended by then and have written why, but garbage can
/// be endless.
const GARBAGE_GRACE: Duration = Duration::from_millis(300);
/// How often a wait for a frame looks whether the run is over.
const STOP_POLL: Duration = Duration::from_millis(50);
/// Room for the pipe reader's line parsing; planes bypass it.
const BUFFER_BYTES: usize = 64 * 1024;

/// A program's film. Dropping it ends the program.
pub struct PipeSource {
    program: Program,
    mailbox: Arc<Mailbox<PipeMessage>>,
    empties: Sender<Vec<u8>>,
    /// How a live camera films, as of the newest frame.
    pace: Option<CameraPace>,
    /// The longest wait for the first frame, and for each later one.
    timeout: Duration,
    silence: Duration,
    stopped: Stopped,
    frames: u64,
    /// The newest number given out; numbers only grow.
    last: Option<u64>,
    /// How the film ended.
    end: Option<Result<(), SourceError>>,
}

/// How frames get their numbers.
enum FrameNumbers {
    Index { numbering: Numbering, fps: f64 },
    Live { numbers: Box<LiveNumbers>, side: Option<SidePipe> },
}

enum PipeMessage {
    Frame {
        format: Format,
        index: u64,
        /// Its number and capture time, if it has a place in the count.
        stamp: Option<SourceFrame>,
        pace: Option<CameraPace>,
        planes: Vec<u8>,
    },
    /// The last one: what is wrong, and the pipe. While it is open the program dies of nothing but
    /// its own faults, and its standard error does not complain about a closed pipe.
    Failed(PipeFailure, ChildStdout),
}

enum PipeFailure {
    Mismatch(SourceError),
    Garbage(String),
    /// Of a live camera's times, counts or rate.
    Numbers(TroubleKind, String),
}

impl PipeSource {
    /// Starts the program.
    pub fn open(
        config: &PipeConfig,
        camera: &Camera,
        context: &OpenContext,
    ) -> Result<PipeSource, SourceError> {
        let range = if config.full_range { Range::Full } else { Range::Limited };
        let raw = config.raw.and_then(|raw| {
            // A camera of a rig has a size that frames may have.
            Format::new(raw.layout(range), camera.width(), camera.height()).ok()
        });
        let (numbers, command) = frame_numbers(config, context.fps)?;
        let (program, stdout) = Program::start(&command, &config.folder)?;
        let film_fps = match &numbers {
            FrameNumbers::Index { numbering, fps } => Some(numbering.film_fps(*fps)),
            FrameNumbers::Live { .. } => None,
        };
        let mailbox = Arc::new(match film_fps {
            Some(_) => Mailbox::new(FRAMES_AHEAD, WhenFull::Wait),
            None => Mailbox::new(1, WhenFull::DropOldest),
        });
        let (empties, returned) = channel();
        let reader = PipeReader {
            mailbox: Arc::clone(&mailbox),
            returned,
            clock: Arc::clone(&context.clock),
            phase: Arc::clone(&context.phase),
            name: format!("the film of {:?}", program.command()),
            camera: camera.name().to_owned(),
            fit: Fit::new(camera),
            film_fps,
            raw,
        };
        let timeout = Duration::from_secs_f64(config.timeout_s);
        // Ends with the pipe, which ends with the program, which ends with the source.
        std::thread::spawn(move || reader.run(stdout, numbers));
        Ok(PipeSource {
            program,
            mailbox,
            empties,
            pace: None,
            timeout,
            silence: if config.live { timeout.min(context.live_silence) } else { timeout },
            stopped: Arc::clone(&context.stopped),
            frames: 0,
            last: None,
            end: None,
        })
    }

    /// The longest wait for the next frame.
    fn patience(&self) -> Duration {
        if self.frames == 0 { self.timeout } else { self.silence }
    }

    /// What the reader delivers next, if it does in time; `None` if the run is over.
    fn receive(&self) -> Option<Result<PipeMessage, RecvTimeoutError>> {
        let deadline = Instant::now() + self.patience();
        while !(self.stopped)() {
            let left = deadline.saturating_duration_since(Instant::now());
            match self.mailbox.receive(left.min(STOP_POLL)) {
                Err(RecvTimeoutError::Timeout) if left > STOP_POLL => {}
                received => return Some(received),
            }
        }
        None
    }

    /// How a film has ended whose reader has delivered this, and no frame.
    fn ended(&mut self, last: Result<PipeMessage, RecvTimeoutError>) -> Result<(), SourceError> {
        match last {
            Ok(PipeMessage::Failed(failure, _open_pipe)) => {
                let error = match failure {
                    PipeFailure::Mismatch(error) => error,
                    PipeFailure::Garbage(problem) => self.program.failure(problem, GARBAGE_GRACE),
                    PipeFailure::Numbers(kind, problem) => {
                        let error = Box::new(self.program.failure(problem, GARBAGE_GRACE));
                        SourceError::Numbers { error, kind }
                    }
                };
                self.program.finish(Duration::ZERO);
                Err(error)
            }
            Err(RecvTimeoutError::Timeout) => {
                let (silence_s, frames) = (self.patience().as_secs_f64(), self.frames);
                let problem = format!("wrote no frame for {silence_s} s after {frames} frames");
                Err(self.program.failure(problem, Duration::ZERO))
            }
            Err(RecvTimeoutError::Disconnected) | Ok(PipeMessage::Frame { .. }) => {
                match self.program.finish(END_GRACE) {
                    Ending::Exited(status) if !status.success() => {
                        Err(self.program.failure(format!("failed after {} frames", self.frames), END_GRACE))
                    }
                    // One that has closed its output but will not go has given all its frames.
                    Ending::Exited(_) | Ending::Killed => Ok(()),
                }
            }
        }
    }
}

impl Source for PipeSource {
    fn next(&mut self, at_least: u64, image: &mut Image) -> Result<Option<SourceFrame>, SourceError> {
        if let Some(end) = &self.end {
            return end.clone().map(|()| None);
        }
        let at_least = at_least.max(self.last.map_or(0, |last| last.saturating_add(1)));
        loop {
            let Some(received) = self.receive() else { return Ok(None) };
            let Ok(PipeMessage::Frame { format, index, stamp, pace, mut planes }) = received else {
                let result = self.ended(received);
                self.mailbox.close();
                self.end = Some(result.clone());
                return result.map(|()| None);
            };
            (self.frames, self.pace) = (index + 1, pace);
            let taken = stamp.filter(|frame| frame.number >= at_least);
            if let Some(frame) = taken {
                label(format, image);
                std::mem::swap(&mut image.data, &mut planes);
                self.last = Some(frame.number);
            }
            // Fails if the reader has ended and needs no buffer.
            let _ = self.empties.send(planes);
            if taken.is_some() {
                return Ok(taken);
            }
        }
    }

    fn pace(&self) -> Option<CameraPace> {
        self.pace
    }
}

/// How the frames of a program are numbered, and its command with a pipe where it writes what it knows of them.
fn frame_numbers(config: &PipeConfig, fps: f64) -> Result<(FrameNumbers, Vec<String>), SourceError> {
    if !config.live {
        let numbering = Numbering::new(config.start_frame, config.frame_step);
        return Ok((FrameNumbers::Index { numbering, fps }, config.command.clone()));
    }
    let stamps = SourceConfig::Pipe(config.clone()).stamps();
    let numbers = Box::new(LiveNumbers::new(stamps, fps, config.latency_s));
    let Some(kind) = config.side() else {
        return Ok((FrameNumbers::Live { numbers, side: None }, config.command.clone()));
    };
    let side = SidePipe::make(kind.what()).map_err(|error| SourceError::Start {
        command: config.command.join(" "),
        problem: format!("no pipe for {}: {error}", kind.placeholder()),
        may_pass: false,
    })?;
    let path = side.path().display().to_string();
    let command = config.command.iter().map(|word| word.replace(kind.placeholder(), &path)).collect();
    Ok((FrameNumbers::Live { numbers, side: Some(side) }, command))
}

impl Drop for PipeSource {
    fn drop(&mut self) {
        self.mailbox.close();
    }
}

/// The thread that reads the pipe, so that a live camera's driver never waits for us.
struct PipeReader {
    mailbox: Arc<Mailbox<PipeMessage>>,
    returned: Receiver<Vec<u8>>,
    clock: Clock,
    phase: Phase,
    name: String,
    camera: String,
    fit: Fit,
    film_fps: Option<f64>,
    /// What frames without headers are.
    raw: Option<Format>,
}

impl PipeReader {
    fn run(self, mut stdout: ChildStdout, mut numbers: FrameNumbers) {
        if let Err(failure) = self.frames(&mut stdout, &mut numbers) {
            // This fails only if the reader is gone.
            let _ = self.mailbox.send(PipeMessage::Failed(failure, stdout));
        }
        self.mailbox.close();
    }

    /// Reads to the film's end, or to what is wrong with it.
    fn frames(&self, stdout: &mut ChildStdout, numbers: &mut FrameNumbers) -> Result<(), PipeFailure> {
        let garbage = |error: Y4mError| PipeFailure::Garbage(error.to_string());
        let stdout = BufReader::with_capacity(BUFFER_BYTES, stdout);
        let (mut reader, format) = match self.raw {
            Some(format) => (FrameReader::Raw { inner: stdout, format, frames: 0 }, format),
            None => {
                let reader = Reader::new(stdout).map_err(garbage)?;
                let format = self.checked(reader.header())?;
                (FrameReader::Y4m(reader), format)
            }
        };
        for index in 0.. {
            let mut planes = self.returned.try_recv().unwrap_or_default();
            if !reader.read(&mut planes).map_err(garbage)? {
                break;
            }
            let (stamp, pace) = self.stamp(numbers, index, (self.clock)())?;
            if self.mailbox.send(PipeMessage::Frame { format, index, stamp, pace, planes }).is_err() {
                break;
            }
        }
        Ok(())
    }

    /// Number and capture time of a frame, `None` if it has no place in the count; and a live camera's pace.
    fn stamp(
        &self,
        numbers: &mut FrameNumbers,
        index: u64,
        arrival_s: f64,
    ) -> Result<(Option<SourceFrame>, Option<CameraPace>), PipeFailure> {
        let (numbers, side) = match numbers {
            FrameNumbers::Index { numbering, fps } => {
                let stamp = numbering.number(index).map(|number| SourceFrame::of_film(number, *fps));
                return Ok((stamp, None));
            }
            FrameNumbers::Live { numbers, side } => (numbers, side),
        };
        let said = side
            .as_mut()
            .map(SidePipe::next)
            .transpose()
            .map_err(|error| PipeFailure::Numbers(TroubleKind::Stamps, error.to_string()))?;
        let numbered = numbers.push(arrival_s, said, (self.phase)());
        let numbered = numbered.map_err(|fault| PipeFailure::Numbers(fault.kind(), fault.to_string()))?;
        if let Some(by) = numbered.anchored_again {
            let camera = &self.camera;
            tracing::warn!("camera {camera:?}: its counter was off by {by} frames, and is anchored again");
        }
        let capture_time_s = numbered.capture_time_s;
        let stamp = numbered.number.map(|number| SourceFrame { number, capture_time_s });
        Ok((stamp, numbers.pace()))
    }

    /// The format of a film whose header fits camera and cluster.
    fn checked(&self, header: &Header) -> Result<Format, PipeFailure> {
        self.fit.check(&self.name, (header.width, header.height)).map_err(PipeFailure::Mismatch)?;
        if let Some(film_fps) = self.film_fps {
            check_rate(&self.name, header, film_fps).map_err(PipeFailure::Mismatch)?;
        }
        header.format().map_err(|error| PipeFailure::Garbage(error.to_string()))
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;
    use std::sync::atomic::{AtomicU64, Ordering};

    use super::super::ImageKind;
    use super::super::SourceConfig;
    use super::super::tests::{camera, context, numbers};
    use super::*;
    use segment::Layout;

    /// A command whose process ends with this one, also when it is silent.
    fn config(command: &[&str], more: &str) -> PipeConfig {
        let (variable, mark) = testkit::mark();
        let marked = ["env".to_owned(), format!("{variable}={mark}")];
        let words = marked.iter().map(String::as_str).chain(command.iter().copied());
        let words: Vec<String> = words.map(|word| format!("{word:?}")).collect();
        let text = format!("kind = \"pipe\"\ncommand = [{}]\n{more}", words.join(", "));
        match toml::from_str(&text).expect("valid") {
            SourceConfig::Pipe(config) => config,
            other => panic!("{other:?}"),
        }
    }

    /// A 2 x 1 film from a shell script, in which `h` writes the header and `f` a frame.
    fn shell(script: &str, more: &str) -> PipeSource {
        let script = format!(
            "h() {{ printf 'YUV4MPEG2 W2 H1 F30:1 Cmono\\n'; }}; f() {{ printf 'FRAME\\nab'; }}; {script}"
        );
        PipeSource::open(&config(&["sh", "-c", &script], more), &camera(2, 1), &context(30.0))
            .expect("starts")
    }

    /// Reads to the error; its text must hold all of `parts`.
    #[track_caller]
    fn check_fails(mut source: PipeSource, frames: usize, parts: &[&str]) {
        let mut image = Image::default();
        for _ in 0..frames {
            source.next(0, &mut image).expect("reads").expect("a frame");
        }
        let error = source.next(0, &mut image).expect_err("fails");
        let text = error.to_string();
        assert!(parts.iter().all(|part| text.contains(part)), "{text}");
        assert!(!text.contains('\n'));
        assert_eq!(source.next(0, &mut image), Err(error), "and again");
    }

    /// A film of these bytes from a program.
    fn played(folder: &Path, bytes: &[u8], more: &str, size: (u32, u32)) -> PipeSource {
        let path = folder.join("film");
        std::fs::write(&path, bytes).expect("written");
        let config = config(&["cat", &path.display().to_string()], more);
        PipeSource::open(&config, &camera(size.0, size.1), &context(30.0)).expect("starts")
    }

    /// Bytes like noise, so that no two frames or planes are alike.
    fn noise(count: usize) -> Vec<u8> {
        let mut state = 1_u32;
        let next = |_| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 24) as u8
        };
        (0..count).map(next).collect()
    }

    /// The source gives these frames and then ends, again and again.
    #[track_caller]
    fn check_frames(mut source: PipeSource, layout: Layout, frames: &[&[u8]], what: &str) {
        let mut image = Image::default();
        for (number, planes) in frames.iter().enumerate() {
            let taken = source.next(0, &mut image).expect("reads").expect("a frame");
            assert_eq!(taken.number, number as u64);
            assert!(image.kind == ImageKind::Colour(layout), "{what}");
            assert!(image.data == *planes, "{what}, frame {number}");
        }
        assert_eq!(source.next(0, &mut image), Ok(None), "{what}");
        assert_eq!(source.next(0, &mut image), Ok(None), "{what}: and again");
    }

    #[test]
    fn films_of_every_layout_are_read_exactly() {
        let folder = tempfile::tempdir().expect("folder");
        for words in
            ["C420jpeg", "C422 XCOLORRANGE=FULL", "C444", "C411", "Cmono", "C420mpeg2 XYSCSS=420MPEG2"]
        {
            let line = format!("YUV4MPEG2 W33 H17 F30:1 Ip A1:1 {words}");
            let header = Header::parse(line.as_bytes()).expect("valid");
            let planes = noise(7 * header.frame_bytes());
            let frames: Vec<&[u8]> = planes.chunks(header.frame_bytes()).collect();
            let film = frames.iter().flat_map(|frame| [b"FRAME\n", *frame].concat());
            let film: Vec<u8> = line.bytes().chain([b'\n']).chain(film).collect();
            let layout = header.format().expect("size").layout();
            check_frames(played(folder.path(), &film, "", (33, 17)), layout, &frames, words);
        }
    }

    #[test]
    fn raw_frames_come_as_the_camera_writes_them() {
        let folder = tempfile::tempdir().expect("folder");
        for (raw, frame_bytes) in [
            ("rgb", 34 * 17 * 3),
            ("i420", 34 * 17 + 2 * 17 * 9),
            ("nv12", 34 * 17 + 2 * 17 * 9),
            ("yuyv", 34 * 17 * 2),
        ] {
            let film = noise(3 * frame_bytes);
            let frames: Vec<&[u8]> = film.chunks(frame_bytes).collect();
            let mut source =
                played(folder.path(), &film, &format!("raw = {raw:?}\nfull_range = true"), (34, 17));
            let mut image = Image::default();
            for frame in frames {
                source.next(0, &mut image).expect("reads").expect("a frame");
                let ImageKind::Colour(layout) = image.kind else { panic!("colours") };
                let format = Format::new(layout, 34, 17).expect("size");
                assert_eq!((image.data.len(), &image.data[..]), (format.frame_bytes(), frame), "{raw}");
            }
            assert_eq!(source.next(0, &mut image), Ok(None), "{raw}");
        }
        check_fails(
            PipeSource::open(&config(&["printf", "abcde"], "raw = \"rgb\""), &camera(1, 1), &context(30.0))
                .expect("starts"),
            1,
            &["frame 1: found 2 bytes of it, expected 3"],
        );
    }

    const TEST_FILM: [&str; 8] =
        ["ffmpeg", "-v", "error", "-f", "lavfi", "-i", "testsrc=size=33x17:rate=30", "-frames:v"];

    fn ffmpeg(last: &[&str]) -> Vec<u8> {
        testkit::command("ffmpeg").args(&TEST_FILM[1..]).args(last).output().expect("runs").stdout
    }

    #[test]
    fn a_film_through_ffmpeg_is_read_exactly() {
        if !testkit::has_program("ffmpeg", "ffmpeg") {
            return;
        }
        // The same planes as raw bytes.
        for (format, chroma) in [
            ("yuv420p", "C420jpeg"),
            ("yuvj422p", "C422"),
            ("yuv444p", "C444"),
            ("yuv411p", "C411"),
            ("gray", "Cmono"),
        ] {
            let range = if ["yuvj422p", "gray"].contains(&format) { "FULL" } else { "LIMITED" };
            let line = format!("YUV4MPEG2 W33 H17 {chroma} XCOLORRANGE={range}");
            let header = Header::parse(line.as_bytes()).expect("valid");
            let raw = ffmpeg(&["7", "-pix_fmt", format, "-f", "rawvideo", "-"]);
            assert_eq!(raw.len(), 7 * header.frame_bytes());
            let command = [&TEST_FILM[..], &["7", "-pix_fmt", format, "-f", "yuv4mpegpipe", "-"]].concat();
            let source =
                PipeSource::open(&config(&command, ""), &camera(33, 17), &context(30.0)).expect("starts");
            let frames: Vec<&[u8]> = raw.chunks(header.frame_bytes()).collect();
            check_frames(source, header.format().expect("size").layout(), &frames, format);
        }
    }

    #[test]
    fn colours_are_those_that_ffmpeg_itself_would_show() {
        if !testkit::has_program("ffmpeg", "ffmpeg") {
            return;
        }
        let rgb = ffmpeg(&["1", "-pix_fmt", "rgb24", "-f", "rawvideo", "-"]);
        for format in ["yuv444p", "yuvj444p"] {
            let command = [&TEST_FILM[..], &["1", "-pix_fmt", format, "-f", "yuv4mpegpipe", "-"]].concat();
            let mut source =
                PipeSource::open(&config(&command, ""), &camera(33, 17), &context(30.0)).expect("starts");
            let mut image = Image::default();
            source.next(0, &mut image).expect("reads").expect("a frame");
            let ImageKind::Colour(layout) = image.kind else { panic!("colours") };
            let shown = Format::new(layout, image.width, image.height).expect("size");
            let mut found = Vec::new();
            segment::to_rgb(&image.data, shown, &mut found);
            let worst = found.iter().zip(&rgb).map(|(a, b)| a.abs_diff(*b)).max();
            assert!(worst <= Some(4), "{format} {worst:?}");
        }
    }

    #[test]
    fn start_step_and_asking_for_later_frames_choose_by_index() {
        let ten = "h; for i in 1 2 3 4 5 6 7 8 9 0; do f; done";
        assert_eq!(numbers(&mut shell(ten, "")), (0..10).collect::<Vec<u64>>());
        let taken = shell(ten, "").next(4, &mut Image::default()).expect("reads").expect("a frame");
        assert_eq!(taken, SourceFrame { number: 4, capture_time_s: 4.0 / 30.0 });
        let two = config(
            &["sh", "-c", "printf 'YUV4MPEG2 W2 H1 F60:1 Cmono\\nFRAME\\nabFRAME\\nabFRAME\\nabFRAME\\nab'"],
            "start_frame = 1\nframe_step = 2",
        );
        let mut source = PipeSource::open(&two, &camera(2, 1), &context(30.0)).expect("starts");
        assert_eq!(numbers(&mut source), [0, 1]);
    }

    #[test]
    fn a_program_that_fails_is_quoted_with_its_status() {
        check_fails(
            shell("echo no such camera >&2; exit 3", ""),
            0,
            &["found no bytes at all", "(exit status 3; standard error: no such camera)"],
        );
        check_fails(
            shell("h; f; f; echo unplugged >&2; exit 4", ""),
            2,
            &["failed after 2 frames (exit status 4; standard error: unplugged)"],
        );
        check_fails(
            shell("h; f; printf 'FRAME\\na'", ""),
            1,
            &["stopped in the middle of frame 1: found 1 bytes of it, expected 2 (exit status 0)"],
        );
        check_fails(
            shell("h; f; printf 'FRAME\\na'; kill -9 $$", ""),
            1,
            &["middle of frame 1", "(ended by signal 9)"],
        );
    }

    #[test]
    fn endless_garbage_is_one_error_and_the_end_of_the_program() {
        check_fails(shell("while :; do echo hello; done", ""), 0, &["starts with \"hello\"", "was killed"]);
        check_fails(
            shell("h; f; while :; do printf 0123456789; done", ""),
            1,
            &["frame 1 starts with \"0123", "was killed"],
        );
        check_fails(shell("cat /dev/zero", ""), 0, &["starts with \"\\0\\0", "was killed"]);
    }

    #[test]
    fn a_silent_program_times_out() {
        check_fails(
            shell("h; f; sleep 100", "timeout_s = 0.2"),
            1,
            &["wrote no frame for 0.2 s after 1 frames", "was killed"],
        );
    }

    #[test]
    fn other_sizes_and_speeds_are_refused() {
        let open = |command: &str, size: (u32, u32)| {
            let config = config(&["sh", "-c", command], "");
            let mut source =
                PipeSource::open(&config, &camera(size.0, size.1), &context(30.0)).expect("starts");
            source.next(0, &mut Image::default()).expect_err("refused").to_string()
        };
        let text = open("printf 'YUV4MPEG2 W9000 H9000\\nFRAME\\n'; cat /dev/zero", (2, 1));
        assert!(
            text.ends_with("is 9000 x 9000 pixels, expected 2 x 1 as camera \"cam\" of the rig"),
            "{text}"
        );
        let text = open("printf 'YUV4MPEG2 W2 H1 F25:1\\n'; sleep 100", (2, 1));
        assert!(text.contains("says 25 frames/s, expected 30"), "{text}");
    }

    #[test]
    fn live_frames_are_numbered_by_arrival_and_old_ones_dropped() {
        // The clock moves by a frame from frame to frame; the latency is three of them.
        let ticks = AtomicU64::new(0);
        let clock: Clock = Arc::new(move || ticks.fetch_add(1, Ordering::Relaxed) as f64 / 30.0);
        let context = OpenContext { clock, ..context(30.0) };
        let script = "printf 'YUV4MPEG2 W2 H1 F30:1 Cmono\\n'; i=0; while [ $i -lt 20 ]; do printf 'FRAME\\nab'; sleep 0.01; i=$((i+1)); done; sleep 100";
        let live = config(&["sh", "-c", script], "live = true\nlatency_s = 0.1");
        let mut source = PipeSource::open(&live, &camera(2, 1), &context).expect("starts");
        let mut image = Image::default();
        let mut taken = Vec::new();
        while taken.last().is_none_or(|taken: &SourceFrame| taken.number < 12) {
            taken.push(source.next(4, &mut image).expect("reads").expect("a frame"));
        }
        // The frame before the epoch and the one too old are not given.
        assert!(taken.iter().all(|taken| taken.number >= 4));
        assert!(taken.iter().all(|taken| (taken.capture_time_s * 30.0 - taken.number as f64).abs() < 1e-6));
        assert!(taken.windows(2).all(|pair| pair[0].number < pair[1].number));
    }

    #[test]
    fn dropping_a_source_that_waits_to_write_ends_it_at_once() {
        let mut source = shell("h; while :; do f; done", "");
        source.next(1000, &mut Image::default()).expect("reads").expect("a frame");
        let started = Instant::now();
        drop(source);
        assert!(started.elapsed() < Duration::from_secs(60));
    }
}
