//! Recordings written and read back: whole, cut off, damaged.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use coordinator::hooks::{EndRecord, FrameRecord, Recorder as _, Schedule as _, Scheduled, Sees, StepRecord};
use coordinator::live::{Command, Parameters};
use coordinator::{AskEvery, Figures, LocalFrames as _};
use hull::rule::ProbeSettings;
use hull::surface::HullTime;
use hull::{Camera, Rig, Silhouette};
use nalgebra::{Matrix3, Vector3};
use proto::convert::Precision;
use proto::recording::Header;
use sim::solid::ConvexHull;
use sim::{BodyResponse, BodySpec, MassSpec, ResponseMode, Scene, Solid, World, WorldSettings};

use super::{Recording, StepCheck};
use crate::{ColourCrop, Overwrites, RecordingFile, RunHeader, RunRecorder, record};

const SIZE: (u32, u32) = (64, 48);

fn camera(name: &str, x_m: f64) -> Camera {
    let matrix = Matrix3::new(60.0, 0.0, 32.0, 0.0, 60.0, 24.0, 0.0, 0.0, 1.0);
    let place = Vector3::new(x_m, 0.0, 3.0);
    Camera::new(name, SIZE, matrix, [0.0; 5], Vector3::zeros(), place).expect("a camera")
}

fn header(precision: Precision) -> RunHeader {
    RunHeader {
        program: "0.0.0-test".into(),
        began_unix_s: 1_700_000_000.25,
        rig: Rig::new(vec![camera("left of/the door", -0.1), camera("right", 0.3)]).expect("a rig"),
        ignored: vec![None, Some(silhouette(7, 0))],
        fps: 30.0,
        latency_s: 0.06,
        hold_s: 1.0,
        probes: ProbeSettings::default(),
        scene: Scene::named("topple").expect("a scene").with_gravity([0.0, 0.5, -9.0]).expect("finite"),
        world: WorldSettings { seed: 77, hull_time: HullTime::Between, ..WorldSettings::default() },
        precision,
        asks: AskEvery::Step,
        transport: "cluster".into(),
        lock_step: true,
    }
}

#[test]
fn a_header_of_no_moment_has_the_newest_and_one_of_a_strange_moment_is_refused() {
    let read = |hull_time: &str| {
        let message = Header { hull_time: hull_time.into(), ..header(Precision::Exact).to_message() };
        RunHeader::from_message(&message)
    };
    assert_eq!(read("").expect("a header").world.hull_time, HullTime::Newest);
    let refused = read("later").expect_err("refused").to_string();
    assert!(refused.contains("hull_time is \"later\", expected newest or between"), "{refused}");
}

#[test]
fn a_header_with_a_number_that_cannot_be_is_refused() {
    type Spoil = fn(&mut Header);
    let cases: [(Spoil, &str); 6] = [
        (|header| header.began_unix_s = f64::NAN, "began_unix_s is NaN, expected 0 to 10000000000"),
        (|header| header.frames_per_s = 0.0, "frames_per_s is 0, expected 0.1 to 10000"),
        (|header| header.latency_s = -1.0, "latency_s is -1, expected 0 to 60"),
        (|header| header.hold_s = f64::INFINITY, "hold_s is inf, expected 0 to 1000000000"),
        (|header| header.dt_s = f64::NAN, "dt_s is NaN, expected 0.0001 to 0.1"),
        (|header| header.covering_radius_m = 0.0, "covering_radius_m is 0, expected 0.005 to 0.5"),
    ];
    for (spoil, expected) in cases {
        let mut message = header(Precision::Exact).to_message();
        spoil(&mut message);
        let refused = RunHeader::from_message(&message).expect_err(expected).to_string();
        assert_eq!(refused, format!("Header: {expected}"));
    }
}

/// A bar that moves with the frame.
fn silhouette(frame: u64, camera: usize) -> Silhouette {
    let mut mask = vec![0; (SIZE.0 * SIZE.1) as usize];
    for row in 5..40 {
        let start = row * SIZE.0 as usize + (frame as usize + 3 * camera) % 40;
        mask[start..start + 10].fill(1);
    }
    Silhouette::from_mask(SIZE.0, SIZE.1, &mask).expect("size")
}

/// A frame that went on without its first camera.
const REDUCED: u64 = 5;

/// A run of four steps a frame. Frame 1 has no hull, and frame 2 is never fetched; at the others the hull moves
/// the first body a little.
struct TestRun {
    world: World,
    recorder: RunRecorder,
    file: RecordingFile,
    digests: Vec<String>,
}

impl TestRun {
    fn begin(path: &Path, precision: Precision) -> TestRun {
        TestRun::begin_with(path, precision, None)
    }

    fn begin_with(path: &Path, precision: Precision, colours: Option<crate::ColourSource>) -> TestRun {
        TestRun::begin_of(path, &header(precision), colours)
    }

    fn begin_of(path: &Path, header: &RunHeader, colours: Option<crate::ColourSource>) -> TestRun {
        let (recorder, file) = record(path, Overwrites::Never, header, colours).expect("a new file");
        let world = World::new(&header.scene, header.world).expect("a world");
        TestRun { world, recorder, file, digests: vec![] }
    }

    fn responses(&self, frame: Option<u64>) -> Vec<BodyResponse> {
        let mut responses = vec![BodyResponse::UNTOUCHED; self.world.moving_bodies().len()];
        if frame.is_some() {
            let sway = 1e-3 * libm::sin(self.digests.len() as f64);
            responses[0] = BodyResponse {
                response_m: Some([sway, 0.0, 1e-4]),
                inside_samples: 3,
                ..BodyResponse::UNTOUCHED
            };
        }
        responses
    }

    fn step(&mut self, commands: &[Command]) {
        let frame = self.digests.len() as u64 / 4;
        if self.digests.len().is_multiple_of(4) && frame != 2 {
            while !self.recorder.is_ready() {
                std::thread::yield_now();
            }
            let there = if frame == REDUCED { 1..2 } else { 0..2 };
            let silhouettes =
                there.map(|camera| (camera, Arc::new(silhouette(frame, camera.into())))).collect();
            let silhouettes = Box::pin(std::future::ready(Ok(silhouettes)));
            self.recorder.frame(FrameRecord { frame, reports: &[], silhouettes });
        }
        let frame = (frame != 1).then_some(frame);
        let responses = self.responses(frame);
        self.world.step(&responses).expect("steps");
        self.recorder.step(&StepRecord {
            generation: 0,
            step: self.world.steps(),
            commands,
            film_s: self.world.time_s(),
            slipped_s: 0.0,
            frame,
            responses: &responses,
            collisions: None,
            step_ms: 1.5,
            world: &self.world,
        });
        self.digests.push(self.world.digest().to_string());
    }

    fn end(mut self) -> Vec<String> {
        let figures = Figures::default();
        self.recorder.end(&EndRecord { commands: &[], figures: &figures, world: &self.world });
        let recorded = self.file.finish().expect("written");
        assert_eq!(recorded.steps, self.digests.len() as u64);
        self.digests
    }
}

fn recorded(folder: &tempfile::TempDir, precision: Precision, steps: usize) -> (PathBuf, Vec<String>) {
    let path = folder.path().join("run.mcap");
    let mut run = TestRun::begin(&path, precision);
    (0..steps).for_each(|_| run.step(&[]));
    (path, run.end())
}

/// Makes the steps again; what differs from what was recorded.
fn made_again(recording: &Recording) -> (StepCheck, Vec<String>) {
    let header = recording.header();
    let mut world = World::new(&header.scene, header.world).expect("a world");
    let mut steps = recording.steps().expect("readable");
    let check = steps.check();
    let mut recorder = check.recorder();
    let mut digests = vec![];
    while let Some(scheduled) = steps.next() {
        let (film_s, responses) = match scheduled.sees {
            Sees::Given { film_s, responses, .. } => (film_s, responses),
            Sees::Recorded { film_s, frame: None } => {
                (film_s, vec![BodyResponse::UNTOUCHED; world.moving_bodies().len()])
            }
            other => panic!("{other:?}"),
        };
        world.step(&responses).expect("steps");
        let step = world.steps();
        recorder.step(&StepRecord {
            generation: 0,
            step,
            commands: &[],
            film_s,
            slipped_s: 0.0,
            frame: None,
            responses: &responses,
            collisions: None,
            step_ms: 0.0,
            world: &world,
        });
        digests.push(world.digest().to_string());
    }
    (check, digests)
}

#[test]
fn what_is_read_is_what_was_recorded() {
    let folder = tempfile::tempdir().expect("folder");
    let (path, digests) = recorded(&folder, Precision::Exact, 200);
    let recording = Recording::open(&path).expect("a recording");
    assert_eq!(*recording.header(), header(Precision::Exact));
    assert_eq!((recording.step_count(), recording.index.frames.len(), recording.cut_off()), (200, 49, None));
    assert_eq!(recording.digest(), digests[199]);
    let frames = recording.frames().expect("readable");
    frames.credit(3);
    assert_eq!(frames.frames(), [0, 1, 3]);
    for frame in [0, 49, 7, 48, 3] {
        let found = frames.silhouettes(frame).expect("it is there");
        let expected: Vec<_> =
            (0..2).map(|camera| (camera, Arc::new(silhouette(frame, camera.into())))).collect();
        assert_eq!(found, expected);
        assert_eq!(frames.report(frame).expect("known").cameras[1].area, found[1].1.area());
        assert!(frames.with_views(frame, &mut |views| assert_eq!(views.views().len(), 2)));
    }
    let reduced = frames.silhouettes(REDUCED).expect("it is there");
    assert_eq!(reduced, [(1, Arc::new(silhouette(REDUCED, 1)))]);
    let report = frames.report(REDUCED).expect("known");
    assert_eq!((report.cameras.len(), report.cameras[0].rig_index), (1, 1));
    let pictures = recording.pictures().expect("readable").frame(REDUCED).expect("readable").expect("there");
    assert_eq!(pictures.iter().map(|picture| picture.camera).collect::<Vec<_>>(), [1]);
    assert_eq!((frames.silhouettes(2), frames.silhouettes(50)), (None, None));
    frames.credit(100);
    assert_eq!(frames.frames(), [42, 43, 44, 45, 46, 47, 48, 49]);
    let mut steps = recording.steps().expect("readable");
    let seen: Vec<Sees> = std::iter::from_fn(|| steps.next()).map(|step| step.sees).collect();
    let film_s = |sees: &Sees| match *sees {
        Sees::Recorded { film_s, .. } | Sees::Given { film_s, .. } => film_s,
        Sees::Film => f64::NAN,
    };
    assert!(matches!(seen[3], Sees::Recorded { frame: Some(0), .. }));
    assert!(matches!(seen[4], Sees::Recorded { frame: None, .. }), "there was no hull");
    assert!(matches!(seen[8], Sees::Given { frame: None, .. }), "the frame was never recorded");
    assert!(seen.windows(2).all(|pair| film_s(&pair[1]) > film_s(&pair[0])));
}

#[test]
fn under_contacts_answers_are_given_from_the_first_gap_on() {
    let folder = tempfile::tempdir().expect("folder");
    let path = folder.path().join("run.mcap");
    let mut header = header(Precision::Exact);
    header.world.response = ResponseMode::Contacts;
    let mut run = TestRun::begin_of(&path, &header, None);
    (0..40).for_each(|_| run.step(&[]));
    let digests = run.end();
    let recording = Recording::open(&path).expect("a recording");
    let mut steps = recording.steps().expect("readable");
    let seen: Vec<Sees> = std::iter::from_fn(|| steps.next()).map(|step| step.sees).collect();
    assert!(seen[..4].iter().all(|sees| matches!(sees, Sees::Recorded { frame: Some(0), .. })));
    assert!(seen[4..8].iter().all(|sees| matches!(sees, Sees::Recorded { frame: None, .. })), "no hull");
    assert!(seen[8..12].iter().all(|sees| matches!(sees, Sees::Given { frame: None, .. })), "no frame");
    assert!(seen[12..].iter().all(|sees| matches!(sees, Sees::Given { frame: Some(_), .. })));
    assert_eq!(steps.check().given(), 32);
    assert_eq!(recording.digest(), digests[39]);
}

/// Camera 1 has colours, from frame 3 on.
fn some_colours() -> crate::ColourSource {
    let crop = |frame: u64| ColourCrop {
        camera: 1,
        crop: [8, 16, 24, 32],
        scale_log2: 1,
        jpeg: vec![frame as u8; 99],
    };
    Box::new(move || {
        Box::new(move |frame| {
            let found = if frame < 3 { Err("nothing yet".into()) } else { Ok(vec![crop(frame)]) };
            Box::pin(std::future::ready(found))
        })
    })
}

#[test]
fn colours_are_kept_where_there_are_any() {
    let folder = tempfile::tempdir().expect("folder");
    let path = folder.path().join("run.mcap");
    let mut run = TestRun::begin_with(&path, Precision::Exact, Some(some_colours()));
    (0..40).for_each(|_| run.step(&[]));
    run.end();
    let recording = Recording::open(&path).expect("a recording");
    assert!(recording.has_colour());
    let pictures = recording.pictures().expect("readable");
    let of = |frame| pictures.frame(frame).expect("readable").expect("it is there");
    assert_eq!((of(1)[1].colour.clone(), of(7)[0].colour.clone()), (None, None));
    let crop = of(7)[1].colour.clone().expect("colours");
    assert_eq!((crop.crop, crop.scale_log2, &crop.jpeg[..2]), ([8, 16, 24, 32], 1, &[7, 7][..]));
    let runs = proto::convert::silhouette_data(&silhouette(7, 0), proto::convert::SilhouetteEncoding::Runs);
    assert_eq!(of(7)[0].runs, runs);
    assert_eq!(pictures.frame(2).expect("readable"), None, "it was never recorded");
}

#[test]
fn rounded_answers_are_given_and_a_step_that_differs_is_named() {
    let folder = tempfile::tempdir().expect("folder");
    let (path, recorded_digests) = recorded(&folder, Precision::Quantised, 40);
    let recording = Recording::open(&path).expect("a recording");
    let (check, digests) = made_again(&recording);
    assert_eq!((check.steps(), check.given(), check.difference()), (40, 36, None));
    assert_eq!(digests, recorded_digests);
    let other = RunHeader {
        world: WorldSettings { seed: 78, ..header(Precision::Exact).world },
        ..header(Precision::Quantised)
    };
    let another = Recording { header: other, ..recording };
    let difference = made_again(&another).0.difference().expect("another seed is another run");
    assert_eq!(difference.step, 1);
    assert!(difference.to_string().starts_with("step 1 (0.008 s) differs"), "{difference}");
}

#[test]
fn a_file_that_is_cut_off_anywhere_keeps_all_whole_chunks() {
    let folder = tempfile::tempdir().expect("folder");
    let (path, digests) = recorded(&folder, Precision::Exact, 480);
    let whole = std::fs::read(&path).expect("bytes");
    let mut most = 0;
    for share in 1..40 {
        let cut = folder.path().join("cut.mcap");
        std::fs::write(&cut, &whole[..whole.len() * share / 40]).expect("written");
        let Ok(recording) = Recording::open(&cut) else { continue };
        let steps = recording.step_count();
        assert!(steps >= most, "more bytes, no fewer steps");
        most = steps;
        assert_eq!(recording.digest(), digests[steps as usize - 1]);
        assert!(recording.cut_off().is_some() || steps == 480);
    }
    assert!(most > 300, "{most} of 480 steps");
}

#[test]
fn a_run_that_is_dropped_leaves_all_but_the_last_moment() {
    let folder = tempfile::tempdir().expect("folder");
    let path = folder.path().join("run.mcap");
    let mut run = TestRun::begin(&path, Precision::Exact);
    (0..480).for_each(|_| run.step(&[]));
    drop(run);
    let recording = Recording::open(&path).expect("a recording");
    assert_eq!((recording.step_count(), recording.cut_off().is_some()), (480, true));
}

/// The same channels and messages, written as another tool would.
fn repacked(path: &Path, name: &str, options: mcap::WriteOptions) -> PathBuf {
    changed(path, name, options, |_| {})
}

/// The same with other messages.
fn changed(
    path: &Path,
    name: &str,
    options: mcap::WriteOptions,
    change: impl Fn(&mut mcap::Message<'_>),
) -> PathBuf {
    let bytes = std::fs::read(path).expect("bytes");
    let to = path.with_file_name(name);
    let mut writer = options.create(std::fs::File::create(&to).expect("a new file")).expect("a writer");
    for message in mcap::MessageStream::new(&bytes).expect("a recording") {
        let mut message = message.expect("a message");
        change(&mut message);
        writer.write(&message).expect("written");
    }
    writer.finish().expect("finished");
    to
}

#[test]
fn a_step_of_more_answers_than_bodies_can_be_is_refused_before_it_is_decoded() {
    let folder = tempfile::tempdir().expect("folder");
    let (path, _) = recorded(&folder, Precision::Exact, 8);
    // Empty answers: a hundred bytes each in memory.
    let answers = [0x3a, 0].repeat(super::MAX_ENTRIES + 1);
    let bomb = changed(&path, "bomb.mcap", mcap::WriteOptions::new(), |message| {
        if message.channel.topic == "/step" {
            message.data.to_mut().extend_from_slice(&answers);
        }
    });
    assert!(std::fs::metadata(&bomb).expect("there").len() < 200_000);
    let error = Recording::open(&bomb).expect_err("refused").to_string();
    assert!(
        error.contains("Step.responses: 655") && error.contains(" entries, expected at most 65536"),
        "{error}"
    );
}

#[test]
fn steps_that_are_handed_out_again_are_the_same_and_are_counted_once() {
    let folder = tempfile::tempdir().expect("folder");
    let (path, _) = recorded(&folder, Precision::Quantised, 200);
    let recording = Recording::open(&path).expect("a recording");
    let mut steps = recording.steps().expect("readable");
    let first: Vec<Scheduled> = std::iter::from_fn(|| steps.next()).collect();
    let given = steps.check().given();
    for count in [200, 7, 200] {
        steps.begin_again();
        let again: Vec<Scheduled> = std::iter::from_fn(|| steps.next()).take(count).collect();
        assert_eq!(again, first[..count]);
    }
    assert!(given > 0 && steps.check().given() == given);
    let Sees::Given { film_s, .. } = first[199].sees else { panic!("answers were rounded") };
    assert_eq!(recording.length_s(), film_s);
}

#[test]
fn files_that_other_tools_have_repacked_are_read_alike() {
    let folder = tempfile::tempdir().expect("folder");
    let (path, digests) = recorded(&folder, Precision::Exact, 200);
    let options = || mcap::WriteOptions::new().compression(None);
    for (name, options) in [
        ("zstd.mcap", options().compression(Some(mcap::Compression::Zstd))),
        ("small_zstd.mcap", options().compression(Some(mcap::Compression::Zstd)).chunk_size(Some(2000))),
        ("plain.mcap", options()),
        ("without_chunks.mcap", options().use_chunks(false)),
    ] {
        let recording = Recording::open(&repacked(&path, name, options)).expect(name);
        assert_eq!((recording.step_count(), recording.cut_off()), (200, None), "{name}");
        assert_eq!(recording.digest(), digests[199], "{name}");
        assert_eq!(recording.index.frames.len(), 49, "{name}");
        let frames = recording.frames().expect("readable");
        assert_eq!(frames.silhouettes(7).expect("there")[1].1, Arc::new(silhouette(7, 1)), "{name}");
        let mut steps = recording.steps().expect("readable");
        assert_eq!(std::iter::from_fn(|| steps.next()).count(), 200, "{name}");
        assert_eq!(steps.check().problem(), None, "{name}");
    }
}

#[test]
fn a_file_without_chunks_that_is_cut_off_keeps_its_whole_messages() {
    let folder = tempfile::tempdir().expect("folder");
    let (path, digests) = recorded(&folder, Precision::Exact, 200);
    let options = mcap::WriteOptions::new().compression(None).use_chunks(false);
    let plain = std::fs::read(repacked(&path, "plain.mcap", options)).expect("bytes");
    let cut = folder.path().join("cut.mcap");
    std::fs::write(&cut, &plain[..plain.len() / 2]).expect("written");
    let recording = Recording::open(&cut).expect("a recording");
    let steps = recording.step_count() as usize;
    assert!((60..200).contains(&steps), "{steps}");
    assert_eq!(recording.digest(), digests[steps - 1]);
    assert!(recording.cut_off().expect("less than all").contains("it ends too early"));
}

#[test]
fn a_chunk_of_an_unknown_compression_is_named_with_what_helps() {
    let folder = tempfile::tempdir().expect("folder");
    let (path, _) = recorded(&folder, Precision::Exact, 8);
    let bytes = std::fs::read(&path).expect("bytes");
    let at = bytes.windows(3).position(|bytes| bytes == b"lz4").expect("its chunks are compressed");
    let strange = [&bytes[..at], b"bz2", &bytes[at + 3..]].concat();
    std::fs::write(&path, strange).expect("written");
    let error = Recording::open(&path).expect_err("refused").to_string();
    let expected = "no recording of this program (chunks compressed with \"bz2\", expected lz4, zstd or none: repack it \
        with --compression lz4)";
    assert!(error.ends_with(expected), "{error}");
}

#[test]
fn damage_ends_a_recording_where_it_is() {
    let folder = tempfile::tempdir().expect("folder");
    let (path, _) = recorded(&folder, Precision::Exact, 480);
    let mut bytes = std::fs::read(&path).expect("bytes");
    let middle = bytes.len() / 2;
    bytes[middle] ^= 0x10;
    std::fs::write(&path, &bytes).expect("written");
    let recording = Recording::open(&path).expect("a recording");
    assert!((60..480).contains(&recording.step_count()), "{}", recording.step_count());
    assert!(recording.cut_off().expect("less than all").contains("not complete"));
}

#[test]
fn what_is_no_recording_is_refused_in_one_line() {
    let folder = tempfile::tempdir().expect("folder");
    let path = folder.path().join("x.mcap");
    for (bytes, expected) in [
        (&b"hello"[..], "no MCAP file"),
        (&[mcap::MAGIC, &[1, 2, 3]].concat()[..], "no recording of this program (it ends too early)"),
        (&[mcap::MAGIC, &[6, 255, 255, 255, 255, 255, 255, 255, 255]].concat()[..], "claims"),
    ] {
        std::fs::write(&path, bytes).expect("written");
        let error = Recording::open(&path).expect_err("refused").to_string();
        assert!(error.contains(expected) && error.lines().count() == 1, "{error}");
    }
    assert!(Recording::open(&folder.path().join("none")).is_err());
}

#[test]
fn a_file_that_is_there_stays_until_the_new_one_is_complete() {
    let folder = tempfile::tempdir().expect("folder");
    let path = folder.path().join("run.mcap");
    std::fs::write(&path, "precious").expect("written");
    let error =
        record(&path, Overwrites::Never, &header(Precision::Exact), None).expect_err("refused").to_string();
    assert!(error.contains("is there already"), "{error}");
    let (recorder, file) =
        record(&path, Overwrites::AtTheEnd, &header(Precision::Exact), None).expect("beside it");
    drop((recorder, file));
    assert_eq!(std::fs::read_to_string(&path).expect("still there"), "precious");
    assert_eq!(
        std::fs::read_dir(folder.path()).expect("folder").count(),
        1,
        "nothing recorded, nothing left"
    );
    let left = folder.path().join("run.mcap.partial");
    std::fs::write(&left, "what a crash left").expect("written");
    let error =
        record(&path, Overwrites::AtTheEnd, &header(Precision::Exact), None).expect_err("kept").to_string();
    assert!(error.contains("run.mcap.partial") && error.contains("did not end"), "{error}");
    assert_eq!(std::fs::read_to_string(&left).expect("still there"), "what a crash left");
    std::fs::remove_file(&left).expect("removed");
    let (mut recorder, file) =
        record(&path, Overwrites::AtTheEnd, &header(Precision::Exact), None).expect("beside");
    let world = World::new(&header(Precision::Exact).scene, WorldSettings::default()).expect("a world");
    recorder.step(&StepRecord {
        generation: 0,
        step: 1,
        commands: &[],
        film_s: 0.01,
        slipped_s: 0.0,
        frame: None,
        responses: &[],
        collisions: None,
        step_ms: 0.0,
        world: &world,
    });
    recorder.end(&EndRecord { commands: &[], figures: &Figures::default(), world: &world });
    file.finish().expect("complete");
    assert_eq!(Recording::open(&path).expect("replaced").step_count(), 1);
}

#[test]
fn a_step_at_no_time_of_film_ends_a_recording() {
    let folder = tempfile::tempdir().expect("folder");
    let world = World::new(&header(Precision::Exact).scene, WorldSettings::default()).expect("a world");
    for (film_s, frame) in [(f64::INFINITY, 0), (f64::NAN, 0), (-1.0, 0), (1e300, 0), (1.0, u64::MAX)] {
        let path = folder.path().join(format!("{film_s:e}_{frame}.mcap"));
        let (mut recorder, file) =
            record(&path, Overwrites::Never, &header(Precision::Exact), None).expect("a new file");
        recorder.step(&StepRecord {
            generation: 0,
            step: 1,
            commands: &[],
            film_s,
            slipped_s: 0.0,
            frame: Some(frame),
            responses: &[],
            collisions: None,
            step_ms: 0.0,
            world: &world,
        });
        recorder.end(&EndRecord { commands: &[], figures: &Figures::default(), world: &world });
        file.finish().expect("complete");
        let error = Recording::open(&path).expect_err("no step that could be made").to_string();
        assert!(error.lines().count() == 1, "{error}");
    }
}

#[test]
fn a_body_that_cannot_be_is_refused() {
    let spawned = |radius_m, mass_kg, restitution| {
        let solid = Solid::Ball { radius_m };
        let (pose, velocity_m_s, mass) = (hull::Pose::IDENTITY, [0.0; 3], MassSpec::MassKg(mass_kg));
        let spec = BodySpec {
            name: "b".into(),
            solid,
            pose,
            velocity_m_s,
            mass,
            friction: 0.3,
            restitution,
            fixed: false,
            color: [0.5; 3],
        };
        crate::convert::command_from_message(crate::convert::command_to_message(&Command::Spawn(Box::new(
            spec,
        ))))
    };
    assert!(spawned(0.1, 1.0, 0.1).is_ok());
    for (radius_m, mass_kg, restitution) in [(1e6, 1.0, 0.1), (0.1, f64::NAN, 0.1), (0.1, 1.0, 2.0)] {
        let error = spawned(radius_m, mass_kg, restitution).expect_err("no body").to_string();
        assert!(error.starts_with("BodySpec: ") && error.contains("expected"), "{error}");
    }
}

/// A world that another run has left.
fn kept_world() -> sim::WorldSnapshot {
    let scene = Scene::named("topple").expect("a scene");
    let mut world = World::new(&scene, WorldSettings::default()).expect("a world");
    world.remove(1).expect("gone");
    let responses = vec![BodyResponse::UNTOUCHED; world.moving_bodies().len()];
    (0..20).for_each(|_| drop(world.step(&responses).expect("a step")));
    world.snapshot()
}

#[test]
fn every_command_survives() {
    let corners: Vec<[f64; 3]> =
        (0..8).map(|i| [i & 1, i >> 1 & 1, i >> 2].map(|bit| 0.2 * f64::from(bit) - 0.1)).collect();
    let hull = Solid::Hull(Arc::new(ConvexHull::new(&corners).expect("a cube")));
    let spec = |solid: Solid, mass: MassSpec| {
        Command::Spawn(Box::new(BodySpec {
            name: "b".into(),
            solid,
            pose: hull::Pose::new([0.1, 1.0 / 3.0, -2.0], [0.6, 0.0, 0.0, 0.8]).expect("a pose"),
            velocity_m_s: [0.1, 0.2, -0.3],
            mass,
            friction: 0.3,
            restitution: 0.1,
            fixed: false,
            color: [0.1, 0.2, 0.3],
        }))
    };
    let commands = [
        Command::Reset,
        Command::Choose(
            Scene::named("lift").expect("a scene").with_gravity([0.0, 0.0, -9.0]).expect("finite"),
        ),
        Command::GoOn(Box::new(kept_world())),
        spec(hull, MassSpec::MassKg(2.5)),
        spec(Solid::Box { size_m: [0.1, 0.2, 0.3] }, MassSpec::DensityKgM3(100.0)),
        spec(Solid::Ball { radius_m: 0.1 }, MassSpec::MassKg(1.0)),
        spec(Solid::Capsule { radius_m: 0.1, length_m: 0.3 }, MassSpec::MassKg(1.0)),
        spec(Solid::Cylinder { radius_m: 0.1, height_m: 0.3 }, MassSpec::MassKg(1.0)),
        spec(Solid::Cone { radius_m: 0.1, height_m: 0.3 }, MassSpec::MassKg(1.0)),
        Command::Remove(3),
        Command::Push { body: 1, impulse_n_s: [1.0, 0.1, 0.0], at_m: Some([0.0, 1.0, 0.0]) },
        Command::Push { body: 1, impulse_n_s: [1.0, 0.1, 0.0], at_m: None },
        Command::Grab { body: 2, grip_body_m: [0.0; 3], target_m: [0.1; 3] },
        Command::Release { body: 2, velocity_m_s: None },
        Command::Release { body: 2, velocity_m_s: Some([0.0; 3]) },
        Command::Set(Parameters {
            answers_hull: Some(false),
            gravity_m_s2: Some([0.0; 3]),
            ..Parameters::default()
        }),
        Command::Pause,
        Command::Resume,
        Command::Step(4),
        Command::TakeBackground { seconds: 2.0, allow_foreground: true },
        Command::RestoreBackground { id: u64::MAX },
    ];
    let folder = tempfile::tempdir().expect("folder");
    let path = folder.path().join("run.mcap");
    let mut run = TestRun::begin(&path, Precision::Exact);
    run.step(&[]);
    run.step(&commands);
    run.end();
    let mut steps = Recording::open(&path).expect("a recording").steps().expect("readable");
    assert_eq!(steps.next().expect("a step").commands, []);
    assert_eq!(steps.next().expect("a step").commands, commands);
    assert!(steps.next().is_none());
}

#[test]
fn a_pipe_is_refused_at_once() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("pipe.mcap");
    let made = std::process::Command::new("mkfifo").arg(&path).status().expect("coreutils are there");
    assert!(made.success());
    let refused = Recording::open(&path).expect_err("refused").to_string();
    assert!(refused.contains("no file, expected an MCAP file on a disk"), "{refused}");
}
