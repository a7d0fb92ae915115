use std::fs;

use super::*;

/// A camera 4 m from the origin, as a plain matrix.
const P: &str = "500 0 320 1280\n0 500 240 960\n0 0 1 4\n";

fn folder(files: &[(&str, &str)]) -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    for (name, text) in files {
        let path = folder.path().join(name);
        fs::create_dir_all(path.parent().expect("a parent")).expect("made");
        fs::write(path, text).expect("written");
    }
    folder
}

const SIZE: ImportOptions =
    ImportOptions { up: None, scale: None, size: Some((640, 480)), pixel_origin: None };

fn names(path: &Path, format: Option<Format>) -> Vec<String> {
    let imported = import(path, format, &SIZE).expect("a rig");
    imported.rig.cameras().iter().map(|camera| camera.name().to_owned()).collect()
}

#[test]
fn folders_are_known_by_their_files() {
    let other = P.replace("1280", "900");
    let tool =
        folder(&[("camera2.Pmat.cal", P), ("camera10.Pmat.cal", &other), ("Res.dat", "640 480\n640 480\n")]);
    assert_eq!(detect(tool.path()).expect("known"), Format::Svoboda);
    assert_eq!(names(tool.path(), None), ["camera2", "camera10"]);
    let plain =
        folder(&[("b.txt", P), ("a.P", &other), ("notes.txt", "taken on Monday"), ("a.png", "no text")]);
    assert_eq!(detect(plain.path()).expect("known"), Format::Matrices);
    assert_eq!(names(plain.path(), None), ["a", "b"]);
    // The same files read as plain matrices where the format is given.
    assert_eq!(names(tool.path(), Some(Format::Matrices)), ["camera2", "camera10"]);
}

#[test]
fn what_cannot_be_read_or_known_is_named() {
    let other = folder(&[("notes.txt", "taken on Monday"), ("bytes.txt.gz", "x")]);
    let message = |path: &Path| import(path, None, &SIZE).expect_err("refused").to_string();
    let found = message(other.path());
    assert!(found.contains(": found no calibration, expected OpenCV FileStorage files, "), "{found}");
    let found = message(&other.path().join("notes.txt"));
    assert!(
        found.ends_with(
            "notes.txt: found no calibration, expected OpenCV FileStorage, Qualisys .qca.txt, \
        a rig .toml, or a 3 x 4 matrix"
        ),
        "{found}"
    );
    let found = message(&other.path().join("nothing.toml"));
    assert!(found.contains("nothing.toml: "), "{found}");
    assert!(import(other.path(), Some(Format::Qualisys), &SIZE).is_err());
}

#[test]
fn formats_are_found_by_their_names() {
    for format in Format::ALL {
        assert_eq!(format.name().parse(), Ok(format));
    }
    assert_eq!(
        "svb".parse::<Format>().expect_err("none").to_string(),
        "found \"svb\", expected a format: opencv, qualisys, aniposelib, svoboda or matrices"
    );
}

/// A FileStorage of a camera that stands at x.
fn storage(x: usize) -> String {
    format!(
        "%YAML:1.0\n---\nK: [ 500., 0., 320., 0., 500., 240., 0., 0., 1. ]\nD: [ 0., 0., 0., 0. ]\n\
         rvec: [ 0., 0., 0. ]\ntvec: [ {x}., 0., 3. ]\n"
    )
}

fn packed(text: &str) -> Vec<u8> {
    use std::io::Write as _;
    let mut packed = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::default());
    packed.write_all(text.as_bytes()).expect("packed");
    packed.finish().expect("packed")
}

#[test]
fn endings_in_capitals_packed_files_and_deeper_folders_are_read() {
    let texts: Vec<String> = (0..6).map(storage).collect();
    let room = folder(&[
        ("room/cam1.yml", &texts[0]),
        ("room/cam2.YML", &texts[1]),
        ("room/cam3.Yaml", &format!("\u{feff}{}", texts[2])),
        ("room/notes.txt", "taken on Monday"),
    ]);
    fs::write(room.path().join("room/cam4.yml.gz"), packed(&texts[3])).expect("written");
    fs::write(room.path().join("room/cam5.yaml"), packed(&texts[4])).expect("written");
    let five = ["cam1", "cam2", "cam3", "cam4", "cam5"];
    assert_eq!(names(room.path(), None), five);
    assert_eq!(names(&room.path().join("room"), None), five);
    assert_eq!(names(&room.path().join("room/cam4.yml.gz"), None), ["cam4"]);
    let matrices = folder(&[("m/a.1.TXT", P), ("m/a.2.txt", &P.replace("1280", "900"))]);
    fs::write(matrices.path().join("m/a.3.txt.gz"), packed(&P.replace("1280", "800"))).expect("written");
    assert_eq!(names(matrices.path(), None), ["a.1", "a.2", "a.3"]);
}

#[test]
fn unrelated_neighbours_are_passed_over() {
    let room = folder(&[("cam1.yml", &storage(1)), ("README.txt", "a room"), (".hidden.txt", "x")]);
    let path = room.path();
    fs::write(path.join("notes.txt"), b"caf\xe9 on Monday").expect("written");
    fs::write(path.join("points.dat"), [0u8, 159, 146, 150, 7]).expect("written");
    fs::write(path.join("run.txt"), vec![b'a'; 17 << 20]).expect("written");
    fs::create_dir(path.join(".git")).expect("made");
    let imported = import(path, None, &SIZE).expect("a rig");
    assert_eq!((imported.rig.cameras().len(), imported.warnings), (1, Vec::<String>::new()));
}

#[test]
fn no_camera_is_lost_without_a_word() {
    let json = "{ \"K\": { \"type_id\": \"opencv-matrix\" } }";
    let room = folder(&[
        ("cam1.yml", &storage(1)),
        ("cam2.yml.bak", &storage(2)),
        ("cam3.json", json),
        (".cam4.yml", &storage(4)),
        ("cam5.yml", ""),
        ("cam6.txt", P),
        ("a/b/c/d/e/cam7.yml", &storage(7)),
        ("cam10.mat", P),
        (".cam11.txt", P),
        ("cam12", P),
        ("cam13.txt", &format!("{P}{P}")),
        ("cam14.xml", "<camera><K>500 0 320 0 500 240 0 0 1</K></camera>"),
        ("cam15.json", "{\n  \"K\": [[500, 0, 320], [0, 500, 240], [0, 0, 1]],\n  \"R\": [0, 0, 0]\n}"),
        ("cam16.yml", "{D: [0, 0, 0, 0], K: [[500, 0, 320]], R: [[1, 0, 0]]}"),
        ("cam17.npz", "PK\u{3}\u{4}\0"),
        ("cam18.toml", "[cam_3]\nname = \"a\"\ndistortions = [ 0, 0, 0, 0 ]\n"),
        ("cam1_dist.txt", "-0.28 0.09 0.0011 -0.0003 0.02"),
        ("cam2_dist.csv", "-0.28,0.09,0.0011,-0.0003,0.02"),
        ("cam19.txt", "1.0D+03 2 3 4\n5 6 7 8\n9 1 2 3\n"),
        ("cam20.txt", "1 2 3 4\n5 1.#QNAN 7 8\n9 1 2 3\n"),
        ("cam21.yml", "version https://git-lfs.github.com/spec/v1\noid sha256:4d7a\nsize 412\n"),
    ]);
    fs::write(room.path().join("cam8.yml"), [0u8, 159]).expect("written");
    let warnings = import(room.path(), None, &SIZE).expect("a rig").warnings;
    for name in [
        "cam2.yml.bak",
        "cam3.json",
        ".cam4.yml",
        "cam5.yml",
        "cam6.txt",
        "a/b/c/d/e",
        "cam8.yml",
        "cam10.mat",
        ".cam11.txt",
        "cam12",
        "cam13.txt",
        "cam14.xml",
        "cam15.json",
        "cam16.yml",
        "cam17.npz",
        "cam18.toml",
        "cam1_dist.txt",
        "cam2_dist.csv",
        "cam19.txt",
        "cam20.txt: left out, it holds \"1.#QNAN\"",
        "cam21.yml: left out, no OpenCV FileStorage",
    ] {
        assert!(warnings.iter().any(|warning| warning.starts_with(name)), "{name}: {warnings:?}");
    }
    let plain = "image_size: [640, 480]\nK: [500, 0, 320, 0, 500, 240, 0, 0, 1]\nD: [0, 0, 0, 0]\nrvec: [0, 0, 1]\ntvec: [0, 0, 3]\n";
    let python = folder(&[("cam1.yml", &storage(1)), ("cam2.yml", plain)]);
    assert_eq!(import(python.path(), None, &SIZE).expect("a rig").rig.cameras().len(), 2);
    let latin = b"%YAML:1.0\n# caf\xe9\ncamera_matrix: !!opencv-matrix\n";
    fs::write(room.path().join("cam9.yml"), latin).expect("written");
    let found = import(room.path(), None, &SIZE).expect_err("refused").to_string();
    assert_eq!(found, "cam9.yml: found bytes that are no UTF-8, expected text");
    let wide: Vec<u8> =
        [0xff, 0xfe].into_iter().chain(storage(9).bytes().flat_map(|byte| [byte, 0])).collect();
    let wide: Vec<u8> = wide.into_iter().chain("camera_matrix".bytes().flat_map(|byte| [byte, 0])).collect();
    fs::write(room.path().join("cam9.yml"), wide).expect("written");
    let found = import(room.path(), None, &SIZE).expect_err("refused").to_string();
    assert!(found.starts_with("cam9.yml: found UTF-16"), "{found}");
    let short = folder(&[("a.txt", P), ("b.txt", "1 2 3 4 5 6 7 8 9 10 11")]);
    assert!(
        import(short.path(), None, &SIZE).expect("a rig").warnings[0]
            .starts_with("b.txt: left out, it holds 11")
    );
}

#[test]
#[cfg(unix)]
fn links_are_read_once_and_end() {
    use std::os::unix::fs::symlink;
    let room = folder(&[("set/cam1.yml", &storage(1)), ("set/cam2.yml", &storage(2))]);
    let path = room.path();
    symlink("cam1.yml", path.join("set/another.yml")).expect("linked");
    symlink("nowhere.yml", path.join("set/cam3.yml")).expect("linked");
    symlink("..", path.join("set/up")).expect("linked");
    symlink("set", path.join("latest")).expect("linked");
    let imported = import(path, None, &SIZE).expect("a rig");
    let names: Vec<&str> = imported.rig.cameras().iter().map(hull::Camera::name).collect();
    assert_eq!(names, ["cam1", "cam2"]);
    assert!(imported.warnings.iter().any(|warning| warning.starts_with("set/cam3.yml: left out")));
}

#[test]
fn a_folder_without_files_of_the_format_is_named() {
    let empty = folder(&[]);
    for format in Format::ALL {
        let found = import(empty.path(), Some(format), &SIZE).expect_err("refused").to_string();
        assert!(found.starts_with(&empty.path().display().to_string()), "{found}");
    }
}

#[test]
fn matrices_of_the_self_calibration_are_read_in_capitals_and_packed() {
    let room = folder(&[
        ("camera1.Pmat.cal", P),
        ("camera2.pmat.cal", &P.replace("1280", "900")),
        ("camera3.PMAT.CAL", &P.replace("1280", "800")),
        ("RES.DAT", "640 480\n640 480\n640 480\n640 480\n"),
        ("cameraA.Pmat.cal", P),
    ]);
    fs::write(room.path().join("camera4.Pmat.cal.gz"), packed(&P.replace("1280", "700"))).expect("written");
    assert_eq!(detect(room.path()).expect("known"), Format::Svoboda);
    let imported = import(room.path(), None, &ImportOptions::default()).expect("a rig");
    let names: Vec<&str> = imported.rig.cameras().iter().map(hull::Camera::name).collect();
    assert_eq!(names, ["camera1", "camera2", "camera3", "camera4"]);
    assert_eq!(imported.warnings[0], "cameraA.Pmat.cal: left out, expected a number before .Pmat.cal");
    fs::write(room.path().join("camera4.pmat.cal"), P).expect("written");
    let found = import(room.path(), None, &SIZE).expect_err("two versions").to_string();
    assert!(found.contains("found two projection matrices of camera 4"), "{found}");
}

#[test]
fn a_file_of_all_cameras_in_a_folder_is_named() {
    for (name, text) in [
        ("room.qca.txt", "<?xml version=\"1.0\"?><calibration><cameras/></calibration>"),
        ("rig.toml", "[cam_0]\nname = \"a\"\ndistortions = [ 0, 0, 0, 0 ]\n"),
    ] {
        let room = folder(&[(name, text), ("notes.txt", "taken on Monday"), ("Cargo.toml", "[package]\n")]);
        let found = import(room.path(), None, &SIZE).expect_err("refused").to_string();
        let expected = format!("{name} holds all cameras: give this file, not its folder");
        assert!(found.ends_with(&expected), "{found}");
    }
}

#[test]
fn a_matrix_in_another_form_is_named() {
    let room = folder(&[
        ("a.txt", P),
        ("b.csv", &P.replace(' ', ",")),
        ("c.txt", "P=[500 0 320 3; 0 500 240 0; 0 0 1 3]"),
        ("d.txt", "[[500 0 320 0]\n[0 500 240 0]\n[0 0 1 3]]\n"),
        ("e.txt", &format!("Camera 5\n{P}")),
        ("f.txt", "\0\0\0\0"),
        ("g.yml", "%Y\0\0\0"),
        ("notes.txt", "taken on Monday"),
    ]);
    let imported = import(room.path(), None, &SIZE).expect("a rig");
    let left_out: Vec<&str> = imported.warnings.iter().filter_map(|line| line.split(':').next()).collect();
    let expected = ["b.csv", "c.txt", "d.txt", "e.txt", "f.txt", "g.yml", "a.txt"];
    assert_eq!(left_out, expected, "{:?}", imported.warnings);
}
