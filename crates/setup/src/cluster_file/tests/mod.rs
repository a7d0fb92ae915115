//! Values of a cluster file, and the message of each mistake.

mod nodes;

use std::fs;
use std::path::{Path, PathBuf};

use camera_node::source::SourceConfig;
use hull::rule::{NormalWindow, OutOfView};
use nalgebra::{Matrix3, Vector3};

use super::*;

/// A folder with a rig of cameras "a", "b", "c" and a cluster file.
struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Folder {
        let folder = tempfile::tempdir().expect("folder");
        let camera = |name: &str| {
            let zero = Vector3::zeros();
            hull::Camera::new(name, (4, 3), Matrix3::identity(), [0.0; 5], zero, zero).expect("a camera")
        };
        let rig = Rig::new(["a", "b", "c"].map(camera).to_vec()).expect("a rig");
        fs::write(folder.path().join("rig.toml"), rig.to_toml()).expect("written");
        Folder(folder)
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn read(&self, text: &str) -> Result<ClusterFile, ClusterFileError> {
        fs::write(self.path("cluster.toml"), text).expect("written");
        let data = self.0.path().to_string_lossy().into_owned();
        ClusterFile::read(&self.path("cluster.toml"), &|name| match name {
            "DATA" => Some(data.clone()),
            "NOWHERE" => Some("/no/such".to_owned()),
            "HERE" => Some("here".to_owned()),
            _ => None,
        })
    }
}

const TEXT: &str = r#"
rig = "rig.toml"
scene = "topple"
fps = 50
segmentation = { high = 100, low = 30 }

[[camera]]
name = "c"
node = "192.0.2.1:7001"
source = { kind = "masks", path = "masks/c" }

[[camera]]
name = "a"
node = "192.0.2.2:7001"
source = { kind = "pipe", command = ["ffmpeg", "-i", "${DATA}/a.avi"], live = true, latency_s = 0.05 }
background = { kind = "images", path = "plates/a.png" }
segmentation = { low = 20 }

[[camera]]
name = "b"
node = "192.0.2.1:7001"
source = { kind = "stage", motion = "punch" }
"#;

#[test]
fn stamps_follow_from_the_source_and_may_be_said() {
    let folder = Folder::new();
    for (word, stamps) in [("times", "capture"), ("counts", "counter")] {
        let text = TEXT.replace("${DATA}/a.avi\"]", &format!("x\", \"{{{word}}}\"]"));
        let text = text.replace("background = {", &format!("stamps = {stamps:?}\nbackground = {{"));
        let cluster = folder.read(&text).expect("valid");
        let found: Vec<&str> = cluster.cameras.iter().map(|camera| camera.source.stamps().word()).collect();
        assert_eq!(found, [stamps, "index", "index"]);
    }
}

#[test]
fn a_file_gives_its_cameras_in_rig_order_with_paths_and_defaults() {
    let folder = Folder::new();
    let cluster = folder.read(TEXT).expect("valid");
    let names: Vec<&str> = cluster.cameras.iter().map(|camera| camera.name.as_str()).collect();
    assert_eq!(names, ["a", "b", "c"]);
    assert!(cluster.cameras.iter().enumerate().all(|(index, camera)| camera.rig_index == index));
    assert_eq!((cluster.fps, cluster.latency_s, cluster.hold_s, cluster.seed), (50.0, None, 1.0, None));
    assert_eq!(cluster.scene, SceneChoice::Named("topple".to_owned()));
    assert_eq!(cluster.probes, ProbeSettings::default());
    let [a, b, c] = &cluster.cameras[..] else { panic!("three") };
    assert_eq!((a.segmentation.low, a.segmentation.high), (Some(20.0), 100.0));
    assert_eq!((b.segmentation.low, b.segmentation.high), (Some(30.0), 100.0));
    let SourceConfig::Pipe(pipe) = &a.source else { panic!("a pipe") };
    assert_eq!(pipe.command[2], format!("{}/a.avi", folder.0.path().display()));
    assert_eq!((pipe.folder.as_path(), pipe.live, pipe.latency_s), (folder.0.path(), true, 0.05));
    let Some(SourceConfig::Images(plate)) = &a.background else { panic!("a plate") };
    assert_eq!(plate.path, folder.path("plates/a.png"));
    assert_eq!(b.background, b.source.empty_room(), "the studio knows its own empty room");
    assert!(c.background.is_none());
    assert_eq!(cluster.precision, Precision::Exact);
}

#[test]
fn sockets_are_files_beside_the_others_and_numbers_may_be_rounded() {
    let folder = Folder::new();
    let text = TEXT.replace("\"192.0.2.1:7001\"", "\"unix:run/b.sock\"");
    let text = text.replace("\"192.0.2.2:7001\"", "\"unix:${HERE}/a.sock\"");
    let text = text.replacen("[[camera]]", "[wire]\nprecision = \"quantised\"\n[[camera]]", 1);
    let cluster = folder.read(&text).expect("valid");
    let nodes: Vec<String> = cluster.nodes.iter().map(nodes::address).collect();
    let here = std::env::current_dir().expect("a folder");
    let expected = [
        format!("unix:{}/here/a.sock", here.display()),
        format!("unix:{}", folder.path("run/b.sock").display()),
    ];
    assert_eq!(nodes, expected);
    assert_eq!(cluster.precision, Precision::Quantised);
}

#[test]
fn the_rule_and_unused_cameras_are_taken_over() {
    let keys = "out_of_view = \"abstain\"\nmin_views = 1\nnormal_window = 7\nmax_depth_m = 0.5\nseed = 9\n\
                gravity = [0, 0, -9.81]\nhold_s = 0\nmin_cameras = 2\npush_m_s = 0.5\nunused_cameras = [\"b\"]";
    let text = TEXT[..TEXT.find("[[camera]]\nname = \"b\"").expect("there")].replacen(
        "fps",
        &format!("{keys}\nfps"),
        1,
    );
    let cluster = Folder::new().read(&text).expect("valid");
    let probes = cluster.probes;
    assert_eq!((probes.rule().out_of_view, probes.rule().min_views), (OutOfView::Abstain, 1));
    assert_eq!(cluster.going_on, GoingOn { min_cameras: 2, push_m_s: 0.5 });
    assert_eq!((probes.normal_window(), probes.max_depth_m()), (NormalWindow::Pixels(7), 0.5));
    assert_eq!((cluster.seed, cluster.gravity_m_s2, cluster.hold_s), (Some(9), Some([0.0, 0.0, -9.81]), 0.0));
    assert_eq!(cluster.rig.cameras().len(), 2);
    assert_eq!((cluster.cameras[1].name.as_str(), cluster.cameras[1].rig_index), ("c", 1));
}

#[test]
fn each_mistake_is_one_line_with_file_key_found_and_expected() {
    let folder = Folder::new();
    for (from, to, parts) in [
        ("fps = 50", "", &["missing field `fps`"][..]),
        ("fps = 50", "fps = \"50\"", &["line 4 (`fps = \"50\"`)", "string \"50\"", "f64"]),
        ("fps = 50", "fps = 0", &["fps: found 0, expected a number from 0.01 to 1000"]),
        ("fps = 50", "fps = 50\nhold_s = nan", &["hold_s: found NaN, expected"]),
        (
            "fps = 50",
            "fps = 50\nlatency = 1",
            &["line 5 (`latency = 1`)", "unknown field `latency`", "`latency_s`"],
        ),
        ("fps = 50", "fps = 50\nmin_views = 0", &["the hull rule: min_views is 0, expected at least 1"]),
        (
            "fps = 50",
            "fps = 50\nmin_cameras = 4",
            &["min_cameras: found 4, expected at least min_views, 2, and at most the 3 cameras"],
        ),
        ("fps = 50", "fps = 50\nmin_cameras = 1", &["min_cameras: found 1, expected at least min_views, 2"]),
        ("fps = 50", "fps = 50\nlatency_s = -1", &["latency_s: found -1, expected a number from 0 to 60"]),
        (
            "fps = 50",
            "fps = 50\nlatency_s = \"low\"",
            &["latency_s: found \"low\", expected \"auto\" or seconds"],
        ),
        ("fps = 50", "fps = 50\npush_m_s = -1", &["push_m_s: found -1, expected a number from 0 to 100"]),
        (
            "fps = 50",
            "fps = 50\nnormal_window = \"big\"",
            &["normal_window: found \"big\", expected \"auto\" or pixels"],
        ),
        ("fps = 50", "fps = 50\nout_of_view = \"silent\"", &["line 5", "`silent`", "`outside` or `abstain`"]),
        (
            "fps = 50",
            "fps = 50\nunused_cameras = [\"d\"]",
            &["unused_cameras: found \"d\", expected a camera of the rig: a, b, c"],
        ),
        (
            "fps = 50",
            "fps = 50\nunused_cameras = [\"a\"]",
            &["camera \"a\", name: found in unused_cameras too"],
        ),
        (
            "rig = \"rig.toml\"",
            "rig = \"none.toml\"",
            &["rig: found nothing at ", "none.toml", "expected a rig file"],
        ),
        (
            "rig = \"rig.toml\"",
            "rig = \"cluster.toml\"",
            &["rig: ", "cluster.toml: [segmentation] name: found nothing"],
        ),
        ("rig = \"rig.toml\"", "rig = \"${NOT_SET}/rig.toml\"", &["rig: variable NOT_SET is not set"]),
        (
            "rig = \"rig.toml\"",
            "rig = \"${NOWHERE:-x}/rig.toml\"",
            &["rig: found nothing at /no/such/rig.toml (from \"${NOWHERE:-x}/rig.toml\")"],
        ),
        (
            "rig = \"rig.toml\"",
            "rig = \"rig.toml\"\nfolder = \"${NOWHERE}\"",
            &["folder: found nothing at /no/such", "expected a folder"],
        ),
        (
            "scene = \"topple\"",
            "scene = \"my.toml\"",
            &["scene: found nothing at ", "my.toml", "expected a scene file"],
        ),
        (
            "name = \"c\"",
            "name = \"d\"",
            &["camera \"d\", name: found \"d\", expected a camera of the rig: a, b, c"],
        ),
        ("name = \"c\"", "name = \"a\"", &["camera: found \"a\" twice, expected every name once"]),
        ("[[camera]]\nname = \"c\"", "[other]\nname = \"c\"", &["unknown field `other`"]),
        (
            "\"192.0.2.2:7001\"",
            "\"unix:\"",
            &["camera \"a\", node: found a socket path of 0 bytes, expected 1 to 107"],
        ),
        (
            "[[camera]]\nname = \"c\"",
            "[wire]\nprecision = \"fine\"\n[[camera]]\nname = \"c\"",
            &["unknown variant `fine`", "`exact` or `quantised`"],
        ),
        (
            "\"192.0.2.2:7001\"",
            "\"192.0.2.2\"",
            &[
                "camera \"a\", node: found \"192.0.2.2\", expected \"host:port\", \"unix:/path\", or the name of a [[node]]",
            ],
        ),
        ("low = 20", "lwo = 20", &["camera \"a\", segmentation: unknown field `lwo`", "`low`"]),
        ("low = 20", "high = 300", &["camera \"a\", segmentation: high is 300, expected 1 to 255"]),
        (
            "background = { kind = \"images\", path = \"plates/a.png\" }",
            "",
            &["camera \"a\", background: found nothing, expected a source of the empty room"],
        ),
        (
            "kind = \"images\"",
            "kind = \"masks\"",
            &["camera \"a\", background: found masks, expected colour images"],
        ),
        (
            "kind = \"images\", path = \"plates/a.png\"",
            "kind = \"stage\"",
            &["camera \"a\", background: found a source without end, expected a clip"],
        ),
        (
            "segmentation = { low = 20 }",
            "ignore_mask = \"no.png\"",
            &["camera \"a\", ignore_mask: found nothing at"],
        ),
        ("kind = \"masks\"", "kind = \"mask\"", &["line 10", "unknown variant `mask`", "`masks`"]),
        ("kind = \"masks\", path = \"masks/c\"", "kind = \"masks\"", &["line 10", "missing field `path`"]),
        ("kind = \"masks\",", "kind = \"masks\", live = true,", &["line 10", "unknown field `live`"]),
        ("kind = \"masks\",", "kind = \"masks\", frame_step = 0,", &["line 10", "frame_step = 0", "nonzero"]),
        ("motion = \"punch\"", "motion = \"dance\"", &["line 22", "motion \"dance\", expected one of idle"]),
        ("latency_s = 0.05", "latency_s = -1", &["line 15", "found -1, expected 0 to 3600 seconds"]),
        ("[\"ffmpeg\", \"-i\", \"${DATA}/a.avi\"]", "[]", &["line 15", "found no program"]),
        (
            "\"${DATA}/a.avi\"], live = true",
            "\"{times}\"]",
            &[
                "camera \"a\", source: found {times} or {counts} in a film's command, expected live = true too",
            ],
        ),
        (
            "\"${DATA}/a.avi\"]",
            "\"{times}\", \"{counts}\"]",
            &["camera \"a\", source: found {times} and {counts} in a command, expected one of the two"],
        ),
        (
            "background = {",
            "stamps = \"counter\"\nbackground = {",
            &["camera \"a\", stamps: found \"counter\", expected \"arrival\" of this source"],
        ),
        (
            "source = { kind = \"masks\"",
            "stamps = \"capture\"\nsource = { kind = \"masks\"",
            &["camera \"c\", stamps: found \"capture\", expected \"index\" of this source"],
        ),
        ("${DATA}/a.avi", "${DATA", &["camera \"a\", source: found \"${DATA\", expected ${NAME}"]),
    ] {
        let text = TEXT.replacen(from, to, 1);
        assert_ne!(text, TEXT, "{from}");
        let error = folder.read(&text).expect_err(to).to_string();
        assert_eq!(error.lines().count(), 1, "{error}");
        for part in ["cluster.toml"].iter().chain(parts) {
            assert!(error.contains(part), "{error:?} lacks {part:?}");
        }
    }
    let without_b = &TEXT[..TEXT.find("[[camera]]\nname = \"b\"").expect("there")];
    let error = folder.read(without_b).expect_err("b is missing").to_string();
    assert!(
        error.ends_with(
            "camera \"b\" of the rig: found no [[camera]] entry, expected one, or its name in unused_cameras"
        ),
        "{error}"
    );
    let error =
        ClusterFile::read(Path::new("/no/such.toml"), &|_| None).expect_err("nothing there").to_string();
    assert!(error.starts_with("/no/such.toml: No such file"), "{error}");
}

#[test]
fn a_path_that_begins_with_a_variable_starts_where_the_program_does() {
    let folder = Folder::new();
    let text = TEXT.replacen("path = \"masks/c\"", "path = \"${HERE}/masks\"", 1);
    let cluster = folder.read(&text).expect("valid");
    let SourceConfig::Masks(masks) = &cluster.cameras[2].source else { panic!("masks") };
    assert_eq!(masks.path, std::env::current_dir().expect("a folder").join("here/masks"));
}

fn shipped(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../deploy").join(name)
}

#[test]
fn the_example_for_three_pcs_is_right_for_a_rig_of_three() {
    let folder = Folder::new();
    let rig = fs::read_to_string(folder.path("rig.toml")).expect("read");
    let named = [("\"a\"", "\"left\""), ("\"b\"", "\"middle\""), ("\"c\"", "\"right\"")];
    let rig = named.iter().fold(rig, |rig, (from, to)| rig.replace(from, to));
    fs::write(folder.path("rig.toml"), rig).expect("written");
    let studio = folder.0.path().to_string_lossy().into_owned();
    let read = ClusterFile::read(&shipped("three_pcs.cluster.toml"), &|name| {
        (name == "HULLTOUCH_STUDIO").then(|| studio.clone())
    });
    let cluster = read.expect("valid");
    assert_eq!(cluster.nodes.len(), 3);
    cluster.load_scene().expect("a scene");
    assert!(cluster.cameras.iter().all(|camera| camera.source.is_live()));
}

#[test]
fn the_recordings_are_read_where_they_are_installed() {
    // A variable that is set and leads nowhere is a failure; not set, there is nothing to read.
    let Ok(datasets) = std::env::var("HULLTOUCH_DATASETS") else { return };
    for (name, size, fps) in [
        ("uu_horseman.cluster.toml", (644, 486), 50.0),
        ("pose2sim_balance.cluster.toml", (1080, 1920), 60.0),
    ] {
        let cluster = ClusterFile::read(&shipped(name), &|name| {
            (name == "HULLTOUCH_DATASETS").then(|| datasets.clone())
        });
        let cluster = cluster.expect("valid");
        assert_eq!((cluster.fps, cluster.cameras.len()), (fps, 4));
        let scene = cluster.load_scene().expect("a scene");
        assert_eq!(scene.up(), [0.0, 0.0, 1.0]);
        assert!(scene.bodies(1).iter().filter(|body| !body.fixed).count() >= 3);
        let context = camera_node::source::OpenContext::outside_runs(fps);
        for (entry, camera) in cluster.cameras.iter().zip(cluster.rig.cameras()) {
            let mut image = camera_node::source::Image::default();
            for config in [Some(&entry.source), entry.background.as_ref()].into_iter().flatten() {
                let mut source = config.open(camera, entry.rig_index, &context).expect("opens");
                let taken = source.next(0, &mut image).expect("reads").expect("a frame");
                assert_eq!(taken.number, 0);
                assert!(image.width.abs_diff(size.0) <= 8 && image.height == size.1);
            }
        }
    }
}

#[test]
fn two_cameras_of_one_machine_have_films_and_backgrounds_of_their_own() {
    let folder = Folder::new();
    let stage = r#"source = { kind = "stage", motion = "punch" }"#;
    let film = r#"source = { kind = "pipe", command = ["ffmpeg", "-i", "${DATA}/a.avi"], live = true }
background = { kind = "images", path = "PLATE" }"#;
    let at = |node: &str, film: &str, plate: &str| {
        let text = TEXT.replace(stage, &film.replace("PLATE", plate));
        text.replacen("192.0.2.1:7001", "NODE", 1)
            .replace("192.0.2.1", node)
            .replace("NODE", "192.0.2.1:7001")
    };
    // The devices and files of another machine have the same names.
    assert!(folder.read(&at("192.0.2.3", film, "plates/a.png")).is_ok());
    let refused = |text: &str| folder.read(text).expect_err("refused").to_string();
    let same = refused(&at("192.0.2.2", film, "plates/b.png"));
    assert!(
        same.ends_with("camera \"b\", source: found that of camera \"a\" too, expected its own"),
        "{same}"
    );
    let own = film.replace("a.avi", "b.avi");
    assert!(folder.read(&at("192.0.2.2", &own, "plates/b.png")).is_ok());
    let same = refused(&at("192.0.2.2", &own, "./plates/a.png"));
    assert!(
        same.ends_with("camera \"b\", background: found that of camera \"a\" too, expected its own"),
        "{same}"
    );
    let masks = r#"source = { kind = "masks", path = "masks/c", start_frame = 7 }"#;
    let same = refused(&TEXT.replace(stage, masks));
    assert!(
        same.ends_with("camera \"b\", source: found that of camera \"c\" too, expected its own"),
        "{same}"
    );
    #[cfg(unix)]
    {
        fs::create_dir_all(folder.path("masks/c")).expect("made");
        std::os::unix::fs::symlink("c", folder.path("masks/d")).expect("linked");
        let linked = refused(&TEXT.replace(stage, &masks.replace("masks/c", "masks/d")));
        assert_eq!(linked, same);
    }
}
