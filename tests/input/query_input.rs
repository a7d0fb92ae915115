//! Bad input to `hulltouch query` and `hulltouch rig`: one line, exit status 2, nothing written.

use std::fs;
use std::path::Path;

use assert_cmd::Command;
use hull::Rig;

const RIG: &str = "\
[a]
name = \"left\"
size = [8, 6]
matrix = [[10.0, 0.0, 4.0], [0.0, 10.0, 3.0], [0.0, 0.0, 1.0]]
distortions = [0.0, 0.0, 0.0, 0.0]
rotation = [0.0, 0.0, 0.0]
translation = [0.0, 0.0, 2.0]
";

/// A folder in which a query answers.
fn good() -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path();
    fs::create_dir(path.join("sil")).expect("a folder");
    image::GrayImage::from_pixel(8, 6, image::Luma([255])).save(path.join("sil/left.png")).expect("written");
    fs::write(path.join("rig.toml"), RIG).expect("written");
    fs::write(path.join("points.csv"), "x,y,z\n0,0,0\n").expect("written");
    folder
}

fn query(folder: &Path, options: &[&str]) -> assert_cmd::assert::Assert {
    let mut command = Command::from_std(testkit::command(env!("CARGO_BIN_EXE_hulltouch")));
    command.current_dir(folder).args(["query", "--rig", "rig.toml", "--silhouettes", "sil"]);
    command.args(["--points", "points.csv", "--json", "answers.json"]).args(options).assert()
}

#[track_caller]
fn refused(folder: &Path, options: &[&str], expected: &str) {
    let output = query(folder, options).code(2).get_output().clone();
    assert_eq!(String::from_utf8_lossy(&output.stderr), format!("hulltouch: {expected}\n"));
    assert!(!folder.join("answers.json").exists());
}

#[test]
fn good_input_is_answered_and_summed_up_in_a_line() {
    let folder = good();
    let output = query(folder.path(), &["--min-views", "1"]).success().get_output().clone();
    let summary = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(summary.starts_with("1 points, 1 inside, 1 cameras, "), "{summary}");
    assert_eq!(summary.lines().count(), 1);
    assert!(folder.path().join("answers.json").exists());
}

#[test]
fn silhouettes_that_are_not_the_rigs_are_refused() {
    let folder = good();
    let path = folder.path();
    let image = |width, height| image::GrayImage::from_pixel(width, height, image::Luma([255]));
    image(8, 6).save(path.join("sil/right.png")).expect("written");
    let unexpected = "sil/right.png: found camera \"right\", expected one of the rig: left";
    refused(path, &[], unexpected);
    fs::remove_file(path.join("sil/right.png")).expect("removed");

    image(8, 7).save(path.join("sil/left.png")).expect("written");
    let size = "sil/left.png is 8 x 7 pixels, expected 8 x 6 as camera \"left\" of the rig";
    refused(path, &[], size);

    fs::remove_file(path.join("sil/left.png")).expect("removed");
    let missing = "found no such file, expected the silhouette of camera \"left\" of the rig";
    refused(path, &[], &format!("sil/left.png (or .jpg): {missing}"));

    fs::create_dir(path.join("sil/left")).expect("a folder");
    image(8, 6).save(path.join("sil/left/000007.png")).expect("written");
    refused(path, &["--frame", "6"], &format!("sil/left/6.png: {missing}"));
    query(path, &["--frame", "7"]).success();

    fs::remove_file(path.join("answers.json")).expect("removed");
    image(8, 6).save(path.join("sil/left.png")).expect("written");
    refused(path, &[], "sil/left.png: found a folder \"left\" beside it, expected one of the two");
    let mut check = Command::from_std(testkit::command(env!("CARGO_BIN_EXE_hulltouch")));
    check.current_dir(path).args(["rig", "check", "--rig", "rig.toml", "--silhouettes", "sil"]);
    let said = check.assert().code(2).get_output().stderr.clone();
    let both = "hulltouch: sil/left.png: found an image beside folders of numbered ones, expected either for all cameras\n";
    assert_eq!(String::from_utf8_lossy(&said), both);

    fs::write(path.join("rig.toml"), RIG.replace("\"left\"", "\"../left\"")).expect("written");
    refused(path, &[], "sil: found camera \"../left\" in the rig, expected names that a file can have");
}

#[test]
fn a_silhouette_is_a_png_or_a_jpeg_and_not_both() {
    let folder = good();
    let path = folder.path();
    image::GrayImage::from_pixel(8, 6, image::Luma([255])).save(path.join("sil/left.jpg")).expect("written");
    refused(path, &[], "sil/left.jpg: found sil/left.png beside it, expected one of the two");
    fs::remove_file(path.join("sil/left.png")).expect("removed");
    query(path, &["--min-views", "1"]).success();

    fs::remove_file(path.join("answers.json")).expect("removed");
    fs::create_dir(path.join("sil/left")).expect("a folder");
    for name in ["12.png", "12 (1).png"] {
        image::GrayImage::new(8, 6).save(path.join("sil/left").join(name)).expect("written");
    }
    refused(
        path,
        &["--frame", "12"],
        "sil/left: sil/left/12 (1).png is a copy of \"12\" by its name, expected one image: remove it",
    );
}

#[test]
fn rigs_of_another_unit_are_refused() {
    let folder = good();
    let path = folder.path();
    fs::write(path.join("rig.toml"), format!("{RIG}[metadata]\nunits = \"mm\"\n")).expect("written");
    let unit = "rig.toml: [metadata] units: found mm, expected metres, or `rig import` with --scale and the unit in metres (mm: --scale 0.001)";
    refused(path, &[], unit);
}

#[test]
fn rig_points_and_options_are_refused_by_name() {
    let folder = good();
    let path = folder.path();
    let none = "options: min_views is 0, expected at least 1";
    refused(path, &["--min-views", "0"], none);
    refused(path, &["--max-depth=-1"], "options: max_depth is -1 m, expected more than 0 and at most 1000");
    fs::write(path.join("points.csv"), "x,y,z\n0,0,NaN\n").expect("written");
    refused(path, &[], "points.csv: line 2, z: found \"NaN\", expected a finite number, metres");
    fs::write(path.join("rig.toml"), RIG.replace("[8, 6]", "[0, 6]")).expect("written");
    refused(path, &[], "rig.toml: [a] size is 0 x 6, expected 1 to 16384 pixels a side");
}

#[test]
fn rig_import_and_check_say_what_is_wrong() {
    let folder = good();
    let path = folder.path();
    let run = |arguments: &[&str]| {
        let mut command = Command::from_std(testkit::command(env!("CARGO_BIN_EXE_hulltouch")));
        let output = command.current_dir(path).arg("rig").args(arguments).assert().get_output().clone();
        (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
    };
    let (status, said) = run(&["import", "points.csv", "--out", "other.toml"]);
    assert_eq!((status, said.lines().count()), (Some(2), 1), "{said}");
    assert!(said.contains("points.csv") && said.contains("expected"), "{said}");
    assert!(!path.join("other.toml").exists());
    let (status, said) = run(&["check", "--rig", "rig.toml", "--silhouettes", "nowhere"]);
    assert_eq!((status, said.lines().count()), (Some(2), 1), "{said}");
    assert!(said.contains("nowhere"), "{said}");
    let (status, said) = run(&["import", "rig.toml", "--up", "z", "--out", "other.toml"]);
    assert_eq!((status, said.as_str()), (Some(0), ""));
    assert!(path.join("other.toml").exists());
    let (status, said) = run(&["import", "rig.toml", "--out", "./rig.toml"]);
    assert_eq!((status, said.lines().count()), (Some(2), 1), "{said}");
    assert!(said.contains("rig.toml: it is part of the calibration that is imported"), "{said}");
    assert_eq!(fs::read_to_string(path.join("rig.toml")).expect("a rig"), RIG);
}

#[test]
fn rig_import_reads_every_camera_or_names_the_files_in_conflict() {
    let folder = good();
    let path = folder.path();
    let storage = |x: u32| {
        format!(
            "%YAML:1.0\n---\nK: [ 500., 0., 320., 0., 500., 240., 0., 0., 1. ]\nD: [ 0., 0., 0., 0. ]\n\
             rvec: [ 0., 0., 0. ]\ntvec: [ {x}., 0., 3. ]\n"
        )
    };
    fs::create_dir(path.join("room")).expect("made");
    for camera in 1..=4 {
        fs::write(path.join(format!("room/room.cam{camera}.yml")), storage(camera)).expect("written");
    }
    let import = || {
        let mut command = Command::from_std(testkit::command(env!("CARGO_BIN_EXE_hulltouch")));
        command.current_dir(path).args(["rig", "import", "--size", "640x480", "room", "--out", "other.toml"]);
        let output = command.assert().get_output().clone();
        (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
    };
    assert_eq!(import(), (Some(0), String::new()));
    let rig = Rig::from_toml(&fs::read_to_string(path.join("other.toml")).expect("a rig")).expect("a rig");
    let names: Vec<&str> = rig.cameras().iter().map(hull::Camera::name).collect();
    assert_eq!(names, ["room.cam1", "room.cam2", "room.cam3", "room.cam4"]);

    fs::remove_file(path.join("other.toml")).expect("removed");
    fs::write(path.join("room/room.cam1.old.yml"), storage(9)).expect("written");
    let (status, said) = import();
    assert_eq!((status, said.lines().count()), (Some(2), 1), "{said}");
    assert!(
        said.contains("room.cam1.yml and room.cam1.old.yml: found two versions of camera room.cam1"),
        "{said}"
    );
    assert!(!path.join("other.toml").exists());
}

#[test]
fn a_rig_of_another_lens_is_refused_and_one_with_a_mark_is_read() {
    let folder = good();
    let path = folder.path();
    fs::write(path.join("rig.toml"), RIG.replacen("rotation =", "fisheye = \"true\"\nrotation =", 1))
        .expect("written");
    refused(
        path,
        &[],
        "rig.toml: [a] fisheye: found true, expected the pinhole with k1 k2 p1 p2 k3 (plumb_bob, radtan, pinhole, false or 0)",
    );
    fs::write(path.join("rig.toml"), format!("\u{feff}{RIG}")).expect("written");
    let points = fs::read_to_string(path.join("points.csv")).expect("points");
    fs::write(path.join("points.csv"), format!("\u{feff}{points}")).expect("written");
    query(path, &[]).success();
    fs::remove_file(path.join("answers.json")).expect("written");
    let wide: Vec<u8> = format!("\u{feff}{RIG}").encode_utf16().flat_map(u16::to_le_bytes).collect();
    fs::write(path.join("rig.toml"), wide).expect("written");
    refused(path, &[], "rig.toml: found UTF-16 text, expected UTF-8: save the file as UTF-8");
}
