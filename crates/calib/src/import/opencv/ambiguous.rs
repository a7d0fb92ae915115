//! Tests: files that were once read in one of two ways, and are read in the right one now or refused.

use nalgebra::{Matrix3, Vector3};

use super::*;

const HEAD: &str = "%YAML:1.0\n---\nimage_width: 640\nimage_height: 480\n";
const K: &str = "K: [500, 0, 320, 0, 500, 240, 0, 0, 1]\n";
const D: &str = "D: [-0.1, 0.02, 0.001, 0.002, 0.003]\n";
const R: &str = "R: [0, -1, 0, 1, 0, 0, 0, 0, 1]\n";
const T: &str = "T: [0.1, 0.2, 3]\n";

fn read_files(files: &[(&str, &str)], options: &ImportOptions) -> Result<Imported, ImportError> {
    let text = |(path, text): &(&str, &str)| TextFile { path: (*path).to_owned(), text: (*text).to_owned() };
    from_opencv(&files.iter().map(text).collect::<Vec<_>>(), options)
}

fn read(text: &str) -> Result<Camera, ImportError> {
    let imported = read_files(&[("c.yml", text)], &ImportOptions::default())?;
    Ok(imported.rig.cameras()[0].clone())
}

#[track_caller]
fn refused(text: &str, message: &str) {
    let found = read(text).expect_err(text).to_string();
    assert!(found.contains(message) && found.lines().count() == 1, "{found} lacks {message}");
}

#[test]
fn lists_in_lists_are_matrices() {
    for text in [
        format!("{HEAD}{K}{D}R: [[0, -1, 0], [1, 0, 0], [0, 0, 1]]\n{T}"),
        format!("{HEAD}{K}{D}R: [[0, -1, 0],\n    [1, 0, 0],\n    [0, 0, 1]]\n{T}"),
        format!("{HEAD}{K}{D}R:\n  [[0, -1, 0],\n   [1, 0, 0], [0, 0, 1]]\n{T}"),
        format!("{HEAD}{K}{D}R:\n  rows: 3\n  cols: 3\n  data: [[0, -1, 0], [1, 0, 0], [0, 0, 1]]\n{T}"),
        format!(
            "{HEAD}{K}{D}R:\n  rows: 3\n  cols: 3\n  data:\n  - 0\n  - -1\n  - 0\n  - 1\n  - 0\n  - 0\n  - 0\n  - 0\n  - 1\n{T}"
        ),
        format!("{HEAD}{K}D: &d [[-0.1], [0.02], [0.001], [0.002], [0.003]]\n{R}{T}"),
        format!("{HEAD}K: [[500, 0, 320], [0, 500, 240], [0, 0, 1]]\n{D}{R}T: [[0.1], [0.2], [3.0]]\n"),
    ] {
        let camera = read(&text).expect(&text);
        let turn = Matrix3::new(0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0);
        assert!((camera.rotation() - turn).amax() < 1e-12, "{text}");
        assert_eq!(camera.translation_m(), &Vector3::new(0.1, 0.2, 3.0), "{text}");
        assert_eq!(camera.lens().coefficients(), [-0.1, 0.02, 0.001, 0.002, 0.003], "{text}");
    }
}

#[test]
fn a_list_that_holds_anything_but_numbers_is_refused_with_it() {
    for (lens, message) in [
        ("D:\n- -0.1\n- 0.02\n- .nan\n- 0.001\n- 0.3\n", "D: found \".nan\", expected numbers"),
        ("D:\n- -0.1\n- ~\n- 0.3\n- 0.1\n", "D: found \"~\""),
        ("D:\n- -0.1\n-\n- 0.3\n- 0.1\n", "D: found \"an item without a value\""),
        ("D:\n- -0.1\n- 1.0D-01\n", "D: found \"1.0D-01\""),
        ("D:\n- -0,1\n- 0,02\n", "D: found \"-0,1\""),
        ("D: [ -0.1, , 0.3, 0.001, 0.002 ]\n", "D: found \"nothing between two commas\""),
        ("D: { k1: -0.1 }\n", "D: found \"{ k1: -0.1 }\""),
        ("D: none\n", "D: found \"none\", expected 1, 2, 4 or 5 numbers"),
        ("d: 4.2\n", "d: found the single number 4.2, expected 1, 2, 4 or 5 numbers"),
    ] {
        refused(&format!("{HEAD}{K}{lens}{R}{T}"), message);
    }
    refused(&format!("{HEAD}{K}{D}rvec:\n- 0.1\n- 0.2\n- .nan\n- 0.3\n{T}"), "rvec: found \".nan\"");
    refused(&format!("{HEAD}{K}{D}{R}tvec: [ 0.1, .Nan, 3. ]\n"), "tvec: found \".Nan\"");
    refused(&format!("{HEAD}{K}{D}{R}T: [0.1, 0.2, 3] [1]\n"), "found \" [1]\" behind a list");
    let xml = |lens: &str| {
        let list = |name: &str, numbers: &str| format!("<{name}>{numbers}</{name}>");
        format!(
            "<opencv_storage>{}{}{}{}{}{lens}</opencv_storage>",
            list("image_width", "640"),
            list("image_height", "480"),
            list("K", "500 0 320 0 500 240 0 0 1"),
            list("R", "0 -1 0 1 0 0 0 0 1"),
            list("T", "0.1 0.2 3"),
        )
    };
    let camera = read(&xml("<D>&#45;0.1 0.02 0 0</D>")).expect("a camera");
    assert_eq!(camera.lens().coefficients()[0], -0.1);
    refused(
        &xml("<D><rows>1</rows><cols>1</cols><data>-0.1<_>0.02</_></data></D>"),
        "D: found <_> in its data",
    );
    refused(&xml("<D>-0.1 x 0 0</D>"), "D: found \"x\"");
    refused(&format!("{}{}", xml(""), xml("")), "a second document behind the first");
}

#[test]
fn a_size_in_another_form_is_not_replaced_by_the_option() {
    let options = ImportOptions { size: Some((640, 480)), ..ImportOptions::default() };
    for (size, found) in [
        ("image_size: 3840x2160\n", "image_size: found \"3840x2160\", expected image_width and image_height"),
        ("resolution: \"3840 x 2160\"\n", "resolution: found \"3840 x 2160\""),
        ("image_size: [2160, 3840, 3]\n", "image_size: found \"2160 3840 3\""),
        ("image_size:\n  width: 3840\n  height: 2160\n", "image_size/width: found \"3840\""),
        ("image:\n  width: 3840\n  height: 2160\n", "image/width: found \"3840\""),
        ("image_shape: [2160, 3840]\n", "image_shape: found \"2160 3840\""),
    ] {
        let text = format!("%YAML:1.0\n---\n{K}{D}{R}{T}{size}");
        let error = read_files(&[("c.yml", &text)], &options).expect_err(size).to_string();
        assert!(error.contains(found), "{error} lacks {found}");
    }
    let other = format!("%YAML:1.0\n---\n{K}{D}{R}{T}size: 4\nsensor:\n  width: 36\n");
    assert!(read_files(&[("c.yml", &other)], &options).is_ok());
    let imported = read_files(&[("c.yml", &format!("{K}{D}{R}{T}img_size: [1280, 960]\n"))], &options);
    let imported = imported.expect("a camera");
    assert_eq!(
        (imported.rig.cameras()[0].width(), imported.warnings.len()),
        (1280, 2),
        "{:?}",
        imported.warnings
    );
}

#[test]
fn files_that_say_that_they_are_not_what_is_read_are_refused() {
    for (more, message) in [
        ("calibrated: false\n", "calibrated: found false, expected a calibration that succeeded"),
        ("valid: 0\n", "valid: found 0, expected a calibration that succeeded"),
        ("rotation_type: euler_xyz\n", "rotation_type: found euler_xyz, expected a Rodrigues vector"),
        ("cam_to_world: 1\n", "cam_to_world: found 1, expected a pose from world to camera"),
        ("units: feet\n", "units: found feet, expected metres"),
    ] {
        refused(&format!("{HEAD}{K}{D}{R}{T}{more}"), message);
    }
    let turned = format!("{HEAD}{K}{D}{R}{T}image_rotation: 90\nroi_x: 0\n");
    let warnings = read_files(&[("c.yml", &turned)], &ImportOptions::default()).expect("a camera").warnings;
    assert_eq!(
        warnings,
        ["c.yml: has image_rotation 90: the calibration is read as one of images as the camera gives them"]
    );
    let inner = format!("{HEAD}{K}{D}extrinsics:\n  rvec: [0, 0, 1]\n  tvec: [0, 0, 3]\n");
    refused(&inner, "extrinsics/tvec: found a key in a map, expected this key at the top");
    refused(
        &format!("{inner}rvec: [0, 0, 1]\n"),
        "extrinsics/tvec: found a key in a map, expected this key at",
    );
    let whole = format!("{HEAD}{K}{D}{R}{T}board:\n  units: mm\n");
    let beside = read_files(&[("cam1.yml", &whole), ("cam2.yml", &inner)], &ImportOptions::default());
    let warnings = beside.expect("a camera").warnings;
    assert_eq!(warnings, ["cam2.yml: left out, it has no pose: extrinsics/tvec stands in a map"]);
    assert!(read(&format!("{HEAD}{K}{D}{R}T: [0.1, 0.2, 3.0]\t# metres\n")).is_ok());
}

#[test]
fn keys_that_name_the_camera_of_another_file_are_refused() {
    let camera = |name: &str, x: &str| format!("{HEAD}{K}{D}{R}T: [{x}, 0.2, 3]\ncamera_name: {name}\n");
    let (one, other) = (camera("cam2", "0.1"), camera("cam1", "0.9"));
    let found = read_files(&[("cam1.yml", &one), ("cam2.yml", &other)], &ImportOptions::default());
    let found = found.expect_err("swapped").to_string();
    assert!(found.starts_with("cam1.yml and cam2.yml: found camera cam2 in the keys of the one"), "{found}");
    let (one, other) = (camera("0", "0.1"), camera("1", "0.9"));
    assert!(read_files(&[("1.yml", &one), ("2.yml", &other)], &ImportOptions::default()).is_ok());
    let (one, other) = (camera("left", "0.1"), camera("right", "0.9"));
    assert!(read_files(&[("cam1.yml", &one), ("cam2.yml", &other)], &ImportOptions::default()).is_ok());
}

#[test]
fn lens_coefficients_of_another_camera_or_key_are_refused() {
    for (lens, message) in [
        ("D_depth: [-0.3, 0.1, 0, 0]\n", "K, D_depth: found keys of one camera and of others"),
        ("D_ir: [-0.3, 0.1, 0, 0]\nD_rgb: [-0.2, 0.1, 0, 0]\n", "found keys of one camera and of others"),
        ("radial: [-0.3, 0.1]\n", "radial: found lens coefficients under a key that is not read"),
        ("kappa_1: -0.3\n", "kappa_1: found lens coefficients under a key that is not read"),
        ("D: [0, 0, 0, 0, 0]\nk1: -0.3\nk2: 0.1\n", "D, k1: found zeros, and lens coefficients under a key"),
        ("k456: [0.1, 0.2, 0.3]\n", "k456: found lens coefficients"),
        ("tau: [0.1, 0.1]\n", "tau: found lens coefficients"),
    ] {
        refused(&format!("{HEAD}{K}{lens}{R}{T}"), message);
    }
    for model in [
        "lens_projection: ftheta",
        "projection_function: ftheta",
        "lens_distortion: ftheta",
        "lens_geometry: kb4",
        "distortion_coefficients_model: division",
        "dist_func: division",
        "scaramuzza: 1",
        "mei_xi: 1.2",
        "ucm_alpha: 0.6",
        "equi: 1",
        "rational_model: true",
    ] {
        refused(&format!("{HEAD}{K}{D}{R}{T}{model}\n"), "expected the pinhole with k1 k2 p1 p2 k3");
    }
}

#[test]
fn one_image_has_one_size() {
    let body = format!("{K}{D}{R}{T}");
    let sides = "image_width: 640\nimage_height: 480\n";
    for (size, message) in [
        (
            "image_size: [640, 480]\nimage_width: 1920\nimage_height: 1080\n",
            "image_size, image_width: found 640 and 1920",
        ),
        (&format!("size: [9, 6]\n{sides}"), "size, image_width: found 9 and 640, expected one image size"),
    ] {
        refused(&format!("%YAML:1.0\n---\n{size}{body}"), message);
    }
    let halves = [
        ("cam1_intrinsics.yml", format!("%YAML:1.0\nimage_size: [1280, 720]\n{K}{D}")),
        ("cam1_extrinsics.yml", format!("%YAML:1.0\n{sides}{R}{T}")),
    ];
    let halves: Vec<(&str, &str)> = halves.iter().map(|(path, text)| (*path, &text[..])).collect();
    let found = read_files(&halves, &ImportOptions::default()).expect_err("two sizes").to_string();
    assert!(found.contains("found 1280 and 640"), "{found}");
    let half = format!("%YAML:1.0\nimage_width: 640\n{body}");
    let options = ImportOptions { size: Some((1280, 720)), ..Default::default() };
    let found = read_files(&[("c.yml", &half)], &options).expect_err("another width").to_string();
    assert!(found.contains("the size given, image_width: found 1280 and 640"), "{found}");
}

#[test]
fn intrinsics_of_another_image_are_refused() {
    let with = |k: &str, size: &str| format!("%YAML:1.0\n---\nimage_size: {size}\nK: {k}\n{D}{R}{T}");
    refused(
        &with("[500, 0, 320, 0, 500, 240, 0, 0, 1]", "[160, 120]"),
        "its principal point at 320.0, 240.0 for an image of 160 x 120",
    );
    refused(
        &with("[0.8, 0, 0.5, 0, 0.8, 0.5, 0, 0, 1]", "[640, 480]"),
        "focal lengths of 0.8000 and 0.8000 pixels",
    );
    refused(
        &with("[1, 0, 0, 0, 1, 0, 0, 0, 1]", "[640, 480]"),
        "expected a tenth of the image's side or more",
    );
}

#[test]
fn a_pose_in_another_form_is_refused() {
    for (pose, message) in [
        (format!("rvec: [0, 0, 90]\n{T}"), "rotation is a vector of 90.0 rad, expected at most 2 π"),
        (format!("rotation: [0.1, 0.2, 0.3]\nrotation_order: XYZ\n{T}"), "rotation_order: found XYZ"),
        (format!("{R}{T}pose_convention: camera_to_world\n"), "pose_convention: found camera_to_world"),
        (format!("{R}{T}units: mm\n"), "units: found mm, expected metres, or `rig import` with --scale"),
        (
            format!("{R}{T}R_new: [1, 0, 0, 0, 1, 0, 0, 0, 1]\nT_new: [5, 5, 5]\n"),
            "found keys of one camera and of others",
        ),
    ] {
        refused(&format!("{HEAD}{K}{D}{pose}"), message);
    }
    refused(
        &format!("{HEAD}{K}{D}{R}{T}f_x: 999\n"),
        "K, f_x: found 500 and 999, expected one value for one camera",
    );
    assert!(
        read_files(
            &[("c.yml", &format!("{HEAD}{K}{D}{R}{T}fx: 500\ncx: 320.01\n"))],
            &ImportOptions::default()
        )
        .is_ok()
    );
    let millimetres = format!("{HEAD}{K}{D}{R}{T}units: mm\n");
    let options = ImportOptions { scale: Some(0.001), ..Default::default() };
    assert!(read_files(&[("c.yml", &millimetres)], &options).is_ok());
    let zero = format!("{HEAD}{K}{D}R: [0, 0, 0]\nT: [0, 0, 0]\n");
    let found = read_files(&[("a.yml", &zero), ("b.yml", &zero)], &ImportOptions::default());
    let found = found.expect_err("no poses").to_string();
    assert!(found.contains("cameras a and b: found rotation and translation of zeros"), "{found}");
}

#[test]
fn halves_of_two_cameras_make_none() {
    let whole = format!("{HEAD}{K}{D}{R}{T}");
    let (lens, matrix, pose) =
        (format!("%YAML:1.0\n{D}"), format!("{HEAD}{K}{D}"), format!("%YAML:1.0\n{R}{T}"));
    let bare = format!("{HEAD}{K}{R}{T}");
    for files in [
        [("room/cam1.yml", &bare), ("room/cam2_lens.yml", &lens)],
        [("room/cam1.yml", &whole), ("room/cam2_intrinsics.yml", &matrix)],
        [("room/camA_intrinsics.yml", &matrix), ("room/camB_extrinsics.yml", &pose)],
    ] {
        let files = files.map(|(path, text)| (path, &text[..]));
        let found = read_files(&files, &ImportOptions::default()).expect_err("two cameras").to_string();
        assert!(found.starts_with(&format!("{} and {}: found", files[0].0, files[1].0)), "{found}");
    }
    let files = [("cam1/config.yml", &bare[..]), ("cam1/lens.yml", &lens[..])];
    assert!(read_files(&files, &ImportOptions::default()).is_ok());
}

#[test]
fn versions_by_date_and_word_are_a_conflict() {
    let (one, other) = (format!("{HEAD}{K}{D}{R}{T}"), format!("{HEAD}{K}{D}{R}T: [1, 2, 3]\n"));
    for (first, second) in [
        ("cam1_v1.2.yml", "cam1_v1.3.yml"),
        ("cam1_2021-05-03.yml", "cam1_2021-06-03.yml"),
        ("cam1_outdated.yml", "cam1_latest.yml"),
        ("cam1.yml", "cam1_latest.yml"),
        ("cam1.yml", "cam1-recalib.yml"),
        ("ÄCam.yml", "äcam.yml"),
    ] {
        let found = read_files(&[(first, &one), (second, &other)], &ImportOptions::default());
        let found = found.expect_err(first).to_string();
        assert!(found.contains("found two versions of camera"), "{first}, {second}: {found}");
    }
}

#[test]
fn a_name_without_keys_is_a_camera_that_would_be_lost() {
    let keys = |name: &str| {
        format!(
            "K_{name}: [500, 0, 320, 0, 500, 240, 0, 0, 1]\ndist_{name}: [0, 0, 0, 0, 0]\nH_{name}: 480\nW_{name}: 640\n"
        )
    };
    let pose = |name: &str, x: f64| format!("R_{name}: [0, 0, 0.5]\nT_{name}: [{x}, 0, 3]\n");
    let intri = format!("%YAML:1.0\nnames: [\"01\", \"02\", \"03\"]\n{}{}", keys("01"), keys("02"));
    let extri = format!("%YAML:1.0\n{}{}", pose("01", 0.0), pose("02", 1.0));
    let found = read_files(&[("intri.yml", &intri), ("extri.yml", &extri)], &ImportOptions::default());
    let found = found.expect_err("03 is lost").to_string();
    assert!(found.starts_with("intri.yml: names: found 03, and no camera matrix"), "{found}");
}
